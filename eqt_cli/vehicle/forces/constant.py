"""A force that does not change: a push, or the torque of a thruster that leaks."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import TORQUE, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import Numbers
from eqt_cli.vehicle.forces.base import Force


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

    force: Annotated[Numbers, Unit(TORQUE)]

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the force."""
        return self.force
