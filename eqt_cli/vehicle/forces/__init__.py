"""Forces that act beside the actuators: one file per kind, found by scanning this folder."""

from eqt_cli.core.registry import Registry
from eqt_cli.vehicle.forces.base import Force as Force

forces = Registry("force", __name__, Force)
