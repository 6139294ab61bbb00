"""Where bodies went: figures of paths and poses, what stands for a body, loads of thrusters."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    for name in ("path", "pose"):
        extension.add_component("figures", name, "figures")
    extension.add_function(purposes.figure_of_loads, "loads.draw_loads")
