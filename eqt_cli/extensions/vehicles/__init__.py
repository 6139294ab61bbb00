"""Vehicles from files: SDF, URDF, xacro and MJCF become configurations."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function(purposes.vehicle_file, "vehicle_file.configuration_of")
