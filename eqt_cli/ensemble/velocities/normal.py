"""Normal initial velocities, as in the paper's §7."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import Real
from eqt_cli.core.problems import Problems
from eqt_cli.ensemble.spread import Spread
from eqt_cli.ensemble.velocities.base import VelocityDistribution
from eqt_cli.groups import MatrixLieGroup


@dataclass(frozen=True)
class Normal(VelocityDistribution):
    """Independent normal velocity coordinates.

    Attributes
    ----------
    std
        Standard deviation of every coordinate, or a list of m.
    """

    name: ClassVar[str] = "normal"

    std: Real | list[Real] = 1.0

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """std · N(0, 1)^m."""
        return Spread(self.std).draw(G.dimension, generator)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A wrong number of standard deviations, or a negative one."""
        Spread(self.std).check(G.dimension, problems)
