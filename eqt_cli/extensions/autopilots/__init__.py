"""How autopilots turn a body: an attitude law that commands rates, and the loop that takes them."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("controllers", "rate", "rate")
    extension.add_component("controllers", "pid_cascade", "pid_cascade")
    extension.add_component("actuators", "rate_loop", "rate_loop")
    extension.add_component("actuators", "delay", "delay")
    extension.add_component("references", "setpoints", "setpoints")
