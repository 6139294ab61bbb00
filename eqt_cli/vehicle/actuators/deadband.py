"""An actuator with a dead zone for small commands."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from eqt_cli.core.arrays import Array, absolute, less, where
from eqt_cli.core.option_types import TORQUE, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.actuators.base import Actuator, PassThrough
from eqt_cli.vehicle.component import Numbers


@dataclass(frozen=True)
class Deadband(Actuator):
    """Commands that are smaller than a width give 0 along their axis; all others pass.

    Attributes
    ----------
    width
        Along each axis, or a list of m.
    """

    name: ClassVar[str] = "deadband"
    departs: ClassVar[str] = "deadband"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("width",)
    positive: ClassVar[tuple[str, ...]] = ("width",)
    sampled: ClassVar[bool] = True

    width: Annotated[Numbers, Unit(TORQUE)]

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the command, or 0 within the width."""
        return where(less(absolute(command), self.width + 0 * command), 0 * command, command)
