"""An actuator that follows its command with a first-order lag."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import Scale
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.actuators.base import Actuator
from eqt_cli.vehicle.component import Numbers


@dataclass(frozen=True)
class Lag(Actuator):
    """A lag of first order: ẋ = (command − x) / T, from x = 0.

    Attributes
    ----------
    time_constant
        T, s; along every axis, or a list of m.
    """

    name: ClassVar[str] = "lag"
    departs: ClassVar[str] = "torque lags"
    vectors: ClassVar[tuple[str, ...]] = ("time_constant",)
    positive: ClassVar[tuple[str, ...]] = ("time_constant",)

    moves: ClassVar[bool] = True

    time_constant: Annotated[Numbers, Scale("time constant of the actuators", "s")]

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states, one along each axis."""
        return G.dimension

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the state."""
        return x

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return (command − x) / T."""
        return (command - x) / self.time_constant
