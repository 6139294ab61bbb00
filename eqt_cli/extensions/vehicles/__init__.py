"""Vehicles: from numbers, or an SDF, URDF, xacro or MJCF file, to a first configuration."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    place = "first_file.configuration_of_a_vehicle"
    extension.add_function(purposes.configuration_of_a_vehicle, place)
