"""A measured velocity that follows the true one with a first-order lag."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import Scale
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import Numbers, check_numbers
from eqt_cli.vehicle.sensors.base import Sensor


@dataclass(frozen=True)
class Lag(Sensor):
    """A lag of first order, as of a gyroscope: ẋ = (V − x) / T from x = V, and x is measured.

    Attributes
    ----------
    time_constant
        T, s; one number for every coordinate, or a list.
    """

    name: ClassVar[str] = "lag"
    departs: ClassVar[str] = "measurements that lag"
    positive: ClassVar[tuple[str, ...]] = ("time_constant",)

    time_constant: Annotated[Numbers, Scale("time constant", "s")]

    def errors(
        self, G: MatrixLieGroup, instants: int, period: float, random: np.random.Generator
    ) -> Array:
        """Return 0: the lag depends on the motion."""
        return np.zeros((instants, self.coordinates(G)))

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states, one for each coordinate."""
        return self.coordinates(G)

    def state_rate(self, V: Array, x: Array) -> Array:
        """Return (V − x) / T."""
        return (V - x) / self.time_constant

    def reading(self, V: Array, x: Array) -> Array:
        """Return the state."""
        return x

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note time constants that are not greater than 0, and a wrong length."""
        here = problems.at("time_constant")
        check_numbers(self.time_constant, here, positive=True)
        if not here:
            self.check_entries(self.time_constant, G, here)
