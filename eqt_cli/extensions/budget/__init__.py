"""From a data sheet to an error budget: drift as sheets state it, and `eqt budget`."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import READ, Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("sensors", "drift", "drift")
    extension.add_function(purposes.remarks_on_an_experiment, "remarks.remarks")
    example = "examples/budget/cubesat12.yaml --figure budget.pdf"
    extension.add_command("budget", "commands.budget", READ, example, after="margins")
