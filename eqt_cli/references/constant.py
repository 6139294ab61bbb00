"""A reference that moves with a constant body velocity."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.core.errors import InputError, Problems
from eqt_cli.core.option_types import VELOCITY, Real, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.motions import Pieces
from eqt_cli.notation.poses import pose_from, vector
from eqt_cli.references.base import PiecewiseReference


@dataclass(frozen=True)
class ConstantReference(PiecewiseReference):
    """A constant body velocity: Q_d(t) = Q_0 exp(t V_d). At V_d = 0 the pose stands still.

    Attributes
    ----------
    pose
        Q_0 = Q_d(0).
    velocity
        V_d, body frame: a number for all coordinates, or m numbers.
    """

    name: ClassVar[str] = "constant"
    keeps_velocity: ClassVar[bool] = True

    pose: Any = "identity"
    velocity: Annotated[Real | list[Real], Unit(VELOCITY)] = 0.0

    def pieces(self, G: MatrixLieGroup) -> Pieces:
        """Return one piece of one factor with a(t) = t."""
        pose = pose_from(self.pose, G, Problems())
        if pose is None:
            raise InputError(f"expected a pose of {G.name}, got {self.pose}")
        V = vector(self.velocity, G.dimension, G)
        return Pieces.of(G, np.zeros(1), pose[None], V[None, None], np.array([[[0.0, 1.0]]]))

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an invalid pose or velocity."""
        pose_from(self.pose, G, problems.at("pose"))
        with problems.catching("velocity"):
            vector(self.velocity, G.dimension, G)
