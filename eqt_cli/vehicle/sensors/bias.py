"""An offset of a measurement, which may drift."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import check_deviations
from eqt_cli.vehicle.numbers import Numbers, check_numbers
from eqt_cli.vehicle.sensors.base import Sensor
from eqt_cli.written.poses import vector


@dataclass(frozen=True)
class Bias(Sensor):
    """An offset, and a random walk that begins there.

    Attributes
    ----------
    value
        The offset at t = 0; one number for every coordinate, or a list of m.
    walk
        Standard deviation of the drift after one second; it grows with √t.
    """

    name: ClassVar[str] = "bias"
    departs: ClassVar[str] = "measurements with bias"

    value: Numbers = 0.0
    walk: Numbers = 0.0

    def errors(
        self, G: MatrixLieGroup, instants: int, period: float, random: np.random.Generator
    ) -> Array:
        """value + walk √period Σ N(0, 1)^m, with a step from each instant to the next."""
        m = G.dimension
        part: Any = self.of_run(random)
        steps = random.standard_normal((instants, m))
        drift = np.cumsum(steps, axis=0) - steps[:1]
        return vector(part.value, m, G) + vector(part.walk, m, G) * np.sqrt(period) * drift

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A negative deviation of the walk, a wrong length."""
        here = problems.at("value")
        check_numbers(self.value, here)
        if isinstance(self.value, list) and len(self.value) != G.dimension:
            here.add(f"expected {G.dimension} entries for {G.name}, got {len(self.value)}")
        check_deviations(self.walk, G, problems.at("walk"))
