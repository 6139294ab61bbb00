"""White noise of a measurement."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import check_deviations
from eqt_cli.vehicle.numbers import Numbers
from eqt_cli.vehicle.sensors.base import Sensor
from eqt_cli.written.poses import vector


@dataclass(frozen=True)
class Noise(Sensor):
    """Independent normals at every control instant, along every coordinate.

    Attributes
    ----------
    std
        Standard deviation of one measurement, whatever the period; one number, or a list of m.
    density
        Instead: the deviation of one measurement times √period, so that a mean over a second has
        the same one at any period.
    """

    name: ClassVar[str] = "noise"
    departs: ClassVar[str] = "measurements with noise"

    std: Numbers | None = None
    density: Numbers | None = None

    def errors(
        self, G: MatrixLieGroup, instants: int, period: float, random: np.random.Generator
    ) -> Array:
        """std · N(0, 1)^m, or density/√period · N(0, 1)^m."""
        deviation = self.of_run(random).white_deviation(G, period)
        return deviation * random.standard_normal((instants, G.dimension))

    def white_deviation(self, G: MatrixLieGroup, period: float) -> Array:
        """std, or density/√period."""
        part: Any = self
        if part.std is not None:
            return vector(part.std, G.dimension, G)
        return vector(part.density or 0.0, G.dimension, G) / np.sqrt(period)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Both or none of the two, a negative deviation, a wrong length."""
        if (self.std is None) == (self.density is None):
            got = "neither" if self.std is None else "both"
            problems.add(f"expected std or density, got {got}")
        for name, value in (("std", self.std), ("density", self.density)):
            if value is not None:
                check_deviations(value, G, problems.at(name))
