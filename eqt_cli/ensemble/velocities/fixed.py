"""The same initial velocity in every run."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.ensemble.spread import Coordinates
from eqt_cli.ensemble.velocities.base import VelocityDistribution


@dataclass(frozen=True)
class FixedVelocity(Coordinates, VelocityDistribution):
    """A given velocity error in every run; 0 where none is given.

    Attributes
    ----------
    coordinates
        m velocity coordinates.
    """

    name: ClassVar[str] = "fixed"
