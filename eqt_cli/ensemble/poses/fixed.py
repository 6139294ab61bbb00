"""The same initial pose in every run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.numbers import Real
from eqt_cli.core.problems import Problems
from eqt_cli.ensemble.poses.base import PoseDistribution
from eqt_cli.groups import MatrixLieGroup


@dataclass(frozen=True)
class FixedPose(PoseDistribution):
    """exp of given algebra coordinates in every run; the identity where none are given.

    Attributes
    ----------
    coordinates
        m algebra coordinates; on SO3 a rotation vector, rad.
    """

    name: ClassVar[str] = "fixed"

    coordinates: list[Real] | None = None

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """The coordinates, the same in every run."""
        return np.zeros(G.dimension) if self.coordinates is None else np.array(self.coordinates)

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """exp of the coordinates."""
        return G.exp(numbers)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A wrong number of coordinates."""
        if self.coordinates is not None and len(self.coordinates) != G.dimension:
            expected = f"expected {G.dimension} numbers for {G.name}"
            problems.at("coordinates").add(f"{expected}, got {len(self.coordinates)}")
