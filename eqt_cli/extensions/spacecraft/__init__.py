"""What turns a spacecraft without fuel: reaction wheels, gyros, magnetorquers, and B-dot."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("actuators", "wheels", "wheels")
    extension.add_component("actuators", "gyros", "gyros")
    extension.add_component("actuators", "magnetorquers", "magnetic")
    extension.add_component("controllers", "b_dot", "magnetic")
