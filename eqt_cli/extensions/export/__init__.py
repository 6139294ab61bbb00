"""Laws as C for a vehicle: `eqt export`."""

from eqt_cli.base.extensions import COMPUTE, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    example = "configs/paper.yaml --controller eqt --out law"
    extension.add_command("export", "commands.export", COMPUTE, example, after="pack")
