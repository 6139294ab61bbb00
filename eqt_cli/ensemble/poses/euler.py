"""Rotations with uniform Euler angles, as in the paper's §7."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import Angle
from eqt_cli.ensemble.poses.base import RotationDistribution
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.groups.rotations import rotation_of_euler


@dataclass(frozen=True)
class Euler(RotationDistribution):
    """Three independent Euler angles, uniform between two bounds; the rotation is not uniform.

    Attributes
    ----------
    sequence
        Axes as in SciPy: upper case rotates about the moving axes (intrinsic), lower case about
        the fixed ones.
    low, high
        Bounds of each angle, rad, or such as 90 deg.
    """

    name: ClassVar[str] = "euler"
    angles: ClassVar[tuple[str, ...]] = ("low", "high")

    sequence: str = "ZYX"
    low: Angle = -np.pi
    high: Angle = np.pi

    def draw_rotation(self, G: EuclideanGroup, generator: np.random.Generator) -> Array:
        """Return three angles."""
        return generator.uniform(self.low, self.high, size=3)

    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """Return the rotations with these angles."""
        return rotation_of_euler(self.sequence, numbers)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a group without rotations of space, an invalid sequence, and invalid bounds."""
        super().check(G, problems)
        if isinstance(G, EuclideanGroup) and G.space != 3:
            advice = f"for {G.name} use haar or exp_normal"
            problems.at("kind").add(f"euler needs rotations in three dimensions; {advice}")
        axes = self.sequence.upper()
        valid = len(axes) == 3 and set(axes) <= set("XYZ") and axes[1] not in (axes[0], axes[2])
        if not valid or self.sequence not in (axes, axes.lower()):
            expected = "expected three axes such as ZYX (intrinsic) or xyz (extrinsic)"
            problems.at("sequence").add(f"{expected}, got '{self.sequence}'")
        if self.low > self.high:
            problems.at("low").add(
                f"expected at most {self.high:g}, the value of high, got {self.low:g}"
            )
