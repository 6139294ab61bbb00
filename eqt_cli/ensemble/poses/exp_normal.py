"""The exponential of normal coordinates, on every group."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.numbers import Real
from eqt_cli.ensemble.poses.base import PoseDistribution
from eqt_cli.ensemble.spread import Spread
from eqt_cli.groups import MatrixLieGroup


@dataclass(frozen=True)
class ExpNormal(PoseDistribution):
    """exp of independent normal algebra coordinates; for every group.

    Attributes
    ----------
    std
        Standard deviation of every coordinate, or a list of m.
    """

    name: ClassVar[str] = "exp_normal"

    std: Real | list[Real] = 1.0

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """m algebra coordinates."""
        return Spread(self.std).draw(G.dimension, generator)

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """exp of the coordinates."""
        return G.exp(numbers)

    def problems(self, G: MatrixLieGroup) -> list[tuple[str, str]]:
        """A wrong number of standard deviations, or a negative one."""
        return Spread(self.std).problems("std", G.dimension)
