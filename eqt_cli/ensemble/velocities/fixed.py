"""The same initial velocity in every run."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from eqt_cli.core.option_types import VELOCITY, Real, Unit
from eqt_cli.ensemble.spread import Coordinates
from eqt_cli.ensemble.velocities.base import VelocityDistribution


@dataclass(frozen=True)
class FixedVelocity(Coordinates, VelocityDistribution):
    """A given velocity error in every run. Default: 0.

    Attributes
    ----------
    coordinates
        m velocity coordinates.
    """

    name: ClassVar[str] = "fixed"

    coordinates: Annotated[list[Real] | None, Unit(VELOCITY)] = None
