"""A distribution of initial velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.extend import Array, MatrixLieGroup, Positive, VelocityDistribution


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
