"""An offset of a measurement, which may drift."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import MEASURED, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import Numbers, drawn, mean_square
from eqt_cli.vehicle.sensors.base import Sensor


@dataclass(frozen=True)
class Bias(Sensor):
    """A constant offset plus a random walk.

    Attributes
    ----------
    value
        The offset at t = 0; one number for every coordinate, or a list.
    walk
        Standard deviation of the drift after one second; it grows with √t.
    """

    name: ClassVar[str] = "bias"
    departs: ClassVar[str] = "measurements with bias"

    value: Annotated[Numbers, Unit(MEASURED)] = 0.0
    walk: Numbers = 0.0

    def errors(
        self, G: MatrixLieGroup, instants: int, period: float, random: np.random.Generator
    ) -> Array:
        """Return value + walk √period Σ N(0, 1)^n, with a step from each instant to the next."""
        part = self.drawn(random)
        steps = random.standard_normal((instants, self.coordinates(G)))
        drift = np.cumsum(steps, axis=0) - steps[:1]
        return self.entries(part.value, G) + self.entries(part.walk, G) * np.sqrt(period) * drift

    def bias_deviation(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        """Return the root mean square of `value`, and `walk`, ``(n,)`` each."""
        values = self.value if isinstance(self.value, list) else [self.value]
        size = self.entries([mean_square(value) for value in values], G)
        return np.sqrt(size), self.entries(drawn(self.walk, None), G)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note negative deviations of the walk, and a wrong length."""
        self.check_entries(self.value, G, problems.at("value"))
        self.check_entries(self.walk, G, problems.at("walk"), deviations=True)
