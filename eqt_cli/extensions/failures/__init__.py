"""What was drawn for each run, and where laws fail: the runs that went wrong against the rest."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("figures", "failures", "figures")
    extension.add_function("variables of a result", "drawn.variables")
    extension.add_function("boxes of a diagram", "diagram.boxes")
    extension.add_function("show --run", "views.show_run")
    extension.add_function("show --failures", "views.show_failures")
