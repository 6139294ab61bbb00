"""The loop of a configuration as a block diagram, in SVG and as text."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function(purposes.show_diagram, "commands.show")
    extension.add_function(purposes.diagram_of_a_report, "api.of_result")
