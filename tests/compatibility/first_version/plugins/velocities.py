"""A distribution of initial velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.numbers import Positive
from eqt_cli.ensemble.velocities.base import VelocityDistribution
from eqt_cli.groups import MatrixLieGroup


@dataclass(frozen=True)
class Box(VelocityDistribution):
    """Independent velocities, uniform within ±half_width.

    Attributes
    ----------
    half_width
        Of every coordinate.
    """

    name: ClassVar[str] = "box"

    half_width: Positive = 1.0

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """m coordinates."""
        return generator.uniform(-self.half_width, self.half_width, size=G.dimension)

    def problems(self, G: MatrixLieGroup) -> list[tuple[str, str]]:
        """Nothing: it is for every group."""
        return []
