"""The suite: standard tasks for tracking laws, with an archive of judged laws: `eqt suite`."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import COMPUTE, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.need("search")
    extension.add_command("suite", "commands.app", COMPUTE, "mylaw.py", "tune")
    extension.add_function(purposes.citations, "citing.citations", beside="law.zip")
    extension.add_function(purposes.task_by_name, "named.task_by_name")
