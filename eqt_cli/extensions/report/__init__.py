"""The HTML page of a result, and a GIF of a run."""

from eqt_cli.base.extensions import READ, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    of_run = "results/paper --run 1"
    extension.add_command("animate", "commands.animate", READ, of_run, after="margins")
    of_result = "results/paper --out report.html"
    extension.add_command("report", "commands.report", READ, of_result, after="animate")
