"""Rotations by a given angle."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import Angle, Scale
from eqt_cli.ensemble.poses.base import RotationDistribution
from eqt_cli.ensemble.spread import Axis, check_axis, check_size, directed
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup


@dataclass(frozen=True)
class AnglePose(RotationDistribution):
    """A rotation by a fixed or a uniform angle, about a random or a fixed axis.

    Attributes
    ----------
    angle
        The angle, from 0 to 180 deg, in rad or such as 170 deg; uniform between the two of a list.
    axis
        `random`, uniform over all directions, or a vector in the frame of the desired pose; in the
        plane [1] or [-1].
    """

    name: ClassVar[str] = "angle"

    angle: Annotated[Angle | list[Angle], Scale("initial angle", "rad")] = np.pi
    axis: Axis = "random"

    def draw_rotation(self, G: EuclideanGroup, generator: np.random.Generator) -> Array:
        """Return a rotation vector, the angle along the axis."""
        return directed(self.angle, self.axis, G.rotations, generator)

    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """Return exp of the rotation vectors."""
        still = np.zeros((len(numbers), G.dimension - G.rotations))
        return G.rotation(G.exp(np.concatenate([numbers, still], axis=1)))

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a group without rotations, an angle beyond a half-turn, and an invalid axis."""
        super().check(G, problems)
        check_size(self.angle, problems.at("angle"))
        if (largest := np.max(self.angle)) > np.pi:
            got = f"{np.degrees(largest):.6g} deg"
            problems.at("angle").add(f"expected an angle from 0 to 180 deg, got {got}")
        if isinstance(G, EuclideanGroup) and G.rotations:
            check_axis(self.axis, G.rotations, problems.at("axis"))
