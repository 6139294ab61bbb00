"""What to cite of a result: `eqt cite`."""

from eqt_cli.base.extensions import READ, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    example = "results/paper > refs.bib"
    extension.add_command("cite", "commands.cite", READ, example, after="results")
