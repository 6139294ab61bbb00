"""What differs between two results, bit by bit: `eqt diff`."""

from eqt_cli.base.extensions import READ, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    example = "results/paper results/again"
    extension.add_command("diff", "commands.diff", READ, example, after="results")
