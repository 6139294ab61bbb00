"""A force that does not change: a push, or the torque of a thruster that leaks."""

from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.forces.base import Force
from eqt_cli.vehicle.numbers import Numbers


@dataclass(frozen=True)
class ConstantForce(Force):
    """The same force at all times.

    Attributes
    ----------
    force
        m coordinates of g*.
    """

    name: ClassVar[str] = "constant"
    departs: ClassVar[str] = "constant force"
    vectors: ClassVar[tuple[str, ...]] = ("force",)

    force: Numbers

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the force."""
        return self.force
