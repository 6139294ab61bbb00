"""Uniformly distributed rotations."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.poses.base import RotationDistribution
from eqt_cli.groups.euclidean import EuclideanGroup


@dataclass(frozen=True)
class Haar(RotationDistribution):
    """The uniform (Haar) distribution of the rotation."""

    name: ClassVar[str] = "haar"

    def draw_rotation(self, G: EuclideanGroup, generator: np.random.Generator) -> Array:
        """Return normals: four for rotations of space, two for those of the plane."""
        return generator.standard_normal(4 if G.space == 3 else 2)

    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """Return the rotations in the directions of these normals."""
        return G.rotation_towards(numbers)
