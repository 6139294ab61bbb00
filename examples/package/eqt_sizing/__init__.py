"""Which actuator does a law need? A law with bounded feedback, a figure and a command."""


def register(extension):
    """Name what the package adds; eqt imports each module where it uses it."""
    extension.add_component("controllers", "bounded_feedback", "law")
    extension.add_component("figures", "actuator", "figure")
    extension.add_command("actuator", "command.actuator", example="results/paper", after="show")
