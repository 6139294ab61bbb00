"""The same initial pose in every run."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import POSE, Real, Unit
from eqt_cli.ensemble.poses.base import PoseDistribution
from eqt_cli.ensemble.spread import Coordinates
from eqt_cli.groups import MatrixLieGroup


@dataclass(frozen=True)
class FixedPose(Coordinates, PoseDistribution):
    """exp of given algebra coordinates in every run. Default: the identity.

    Attributes
    ----------
    coordinates
        m algebra coordinates; on SO3 a rotation vector, rad, or such as 30 deg.
    """

    name: ClassVar[str] = "fixed"

    coordinates: Annotated[list[Real] | None, Unit(POSE)] = None

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return exp of the coordinates."""
        return G.exp(numbers)
