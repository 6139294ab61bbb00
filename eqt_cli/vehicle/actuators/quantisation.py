"""An actuator whose output is a multiple of a step."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import TORQUE, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.actuators.base import Actuator, PassThrough
from eqt_cli.vehicle.component import Numbers

SHIFT = 1.5 * 2.0**52
"""A size at which doubles are whole numbers: adding it rounds to the nearest, half to even."""


@dataclass(frozen=True)
class Quantisation(Actuator):
    """The nearest multiple of a step along each axis, for up to 2⁵¹ steps.

    Attributes
    ----------
    resolution
        The step along each axis, or a list of m.
    """

    name: ClassVar[str] = "quantisation"
    departs: ClassVar[str] = "torque in steps"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("resolution",)
    positive: ClassVar[tuple[str, ...]] = ("resolution",)
    sampled: ClassVar[bool] = True

    resolution: Annotated[Numbers, Unit(TORQUE)]
    # Fields, so that a compiler cannot cancel them.
    up: float = field(default=SHIFT, init=False, repr=False)
    down: float = field(default=SHIFT, init=False, repr=False)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the step times the rounded number of steps."""
        rounded: Array = (command / self.resolution + self.up) - self.down
        return self.resolution * rounded
