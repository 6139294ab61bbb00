"""White noise of a measurement."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import MEASURED, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import Numbers
from eqt_cli.vehicle.sensors.base import Sensor


@dataclass(frozen=True)
class Noise(Sensor):
    """Independent normals at every measurement, along every coordinate.

    Attributes
    ----------
    std
        Standard deviation of one measurement, whatever the period; one number, or a list.
    density
        Instead: the deviation of one measurement times √period, so that a mean over a second has
        the same deviation at any period.
    """

    name: ClassVar[str] = "noise"
    departs: ClassVar[str] = "measurements with noise"

    std: Annotated[Numbers | None, Unit(MEASURED)] = None
    density: Numbers | None = None

    def errors(
        self, G: MatrixLieGroup, instants: int, period: float, random: np.random.Generator
    ) -> Array:
        """Return std · N(0, 1)^n, or density/√period · N(0, 1)^n."""
        deviation = self.drawn(random).white_deviation(G, period)
        return deviation * random.standard_normal((instants, self.coordinates(G)))

    def white_deviation(self, G: MatrixLieGroup, period: float) -> Array:
        """Return std, or density/√period."""
        part: Any = self
        if part.std is not None:
            return self.entries(part.std, G)
        return self.entries(part.density or 0.0, G) / np.sqrt(period)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note both or neither of std and density, negative deviations, and a wrong length."""
        if (self.std is None) == (self.density is None):
            got = "neither" if self.std is None else "both"
            problems.add(f"expected std or density, got {got}")
        for name, value in (("std", self.std), ("density", self.density)):
            if value is not None:
                self.check_entries(value, G, problems.at(name), deviations=True)
