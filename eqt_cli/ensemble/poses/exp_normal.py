"""The exponential of normal coordinates, on every group."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import POSE, Real, Unit
from eqt_cli.ensemble.poses.base import PoseDistribution
from eqt_cli.ensemble.spread import NormalCoordinates, check_coordinates
from eqt_cli.groups import MatrixLieGroup


@dataclass(frozen=True)
class ExpNormal(NormalCoordinates, PoseDistribution):
    """A pose times exp of independent normal algebra coordinates, for every group.

    Attributes
    ----------
    std
        Standard deviation of every coordinate, or a list of m; angles also such as 5 deg.
    centre
        m algebra coordinates of the central pose. Default: the identity.
    """

    name: ClassVar[str] = "exp_normal"

    std: Annotated[Real | list[Real], Unit(POSE)] = 1.0
    centre: Annotated[list[Real] | None, Unit(POSE)] = None

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return exp of the centre times exp of the coordinates."""
        drawn = G.exp(numbers)
        return drawn if self.centre is None else G.exp(np.array(self.centre)) @ drawn

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a wrong number of standard deviations or coordinates, and a negative deviation."""
        super().check(G, problems)
        check_coordinates(self.centre, G, problems.at("centre"))
