"""What turns a spacecraft without fuel: wheels, gyros, magnetorquers, B-dot; gravity gradient."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("actuators", "wheels", "wheels")
    extension.add_component("actuators", "gyros", "gyros")
    extension.add_component("actuators", "magnetorquers", "magnetic")
    extension.add_component("actuators", "momentum_limit", "momentum_limit")
    extension.add_component("controllers", "b_dot", "magnetic")
    extension.add_component("forces", "gravity_gradient", "gravity")
    on_orbits, on_wheels = "remarks.remarks", "running_down.remarks"
    of_orbits = "gravity", "magnetic"
    extension.add_function(purposes.remarks_on_an_experiment, on_orbits, about=of_orbits)
    extension.add_function(purposes.remarks_on_an_experiment, on_wheels, about=["wheels"])
