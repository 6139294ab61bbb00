"""What was drawn for each run, and where laws fail: the runs that went wrong against the rest."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("figures", "failures", "figures")
    extension.add_function(purposes.variables_of_a_result, "drawn.variables")
    extension.add_function(purposes.boxes_of_a_diagram, "diagram.boxes")
    extension.add_function(purposes.show_run, "views.show_run")
    extension.add_function(purposes.show_failures, "views.show_failures")
