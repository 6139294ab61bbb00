"""Normal initial velocities, as in the paper's §7."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from eqt_cli.core.option_types import VELOCITY, Real, Unit
from eqt_cli.ensemble.spread import NormalCoordinates
from eqt_cli.ensemble.velocities.base import VelocityDistribution


@dataclass(frozen=True)
class Normal(NormalCoordinates, VelocityDistribution):
    """Independent normal velocity coordinates.

    Attributes
    ----------
    std
        Standard deviation of every coordinate, or a list of m.
    """

    name: ClassVar[str] = "normal"

    std: Annotated[Real | list[Real], Unit(VELOCITY)] = 1.0
