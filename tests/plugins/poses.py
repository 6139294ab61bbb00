"""Distributions of initial poses: of rotations, and on every group."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from eqt_cli.extend import (
    Array,
    EuclideanGroup,
    MatrixLieGroup,
    PoseDistribution,
    Positive,
    Problems,
    RotationDistribution,
    Spread,
)


@dataclass(frozen=True)
class Tilted(RotationDistribution):
    """Rotations by a given angle about a random horizontal axis.

    Attributes
    ----------
    angle
        rad.
    """

    name: ClassVar[str] = "tilted"

    angle: Positive = 1.0

    def draw_rotation(self, G: EuclideanGroup, generator: np.random.Generator) -> Array:
        """The direction of the axis."""
        return generator.uniform(-np.pi, np.pi, size=1)

    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """The rotations about these axes."""
        axes = np.concatenate([np.cos(numbers), np.sin(numbers), 0 * numbers], axis=1)
        rotations: Array = Rotation.from_rotvec(self.angle * axes).as_matrix()
        return rotations

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a group without rotations of space."""
        super().check(G, problems)
        if isinstance(G, EuclideanGroup) and G.rotations and G.space != 3:
            problems.at("kind").add(f"tilted is for rotations of space, not for {G.name}")


@dataclass(frozen=True)
class Shell(PoseDistribution):
    """exp of coordinates of a given length, in a random direction.

    Attributes
    ----------
    radius
        The length.
    """

    name: ClassVar[str] = "shell"

    radius: Positive = 1.0

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """A direction."""
        return Spread(1.0).draw(G.dimension, generator)

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """exp of the coordinates."""
        return G.exp(self.radius * numbers / np.linalg.norm(numbers, axis=-1, keepdims=True))

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a radius beyond the cut locus of rotations."""
        if self.radius >= np.pi:
            problems.at("radius").add("expected less than π")
