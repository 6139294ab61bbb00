"""Thrusters that together give a torque: rotors, jets, thrusters of vehicles in water."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("actuators", "thrusters", "thrusters")
    extension.add_component("actuators", "propellers", "propellers")
