"""The base class of forces; it knows no law, actuator or engine."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.mechanics.flatness import RigidMotion
from eqt_cli.vehicle.component import VehiclePart


@dataclass(frozen=True)
class Force(VehiclePart):
    """A force on the plant, of which the law knows nothing.

    Attributes
    ----------
    frame
        The frame of its coordinates and of the velocity that it depends on. A spatial force f acts
        as Ad*_Q f: on SE3 its line of action is given in space and not on the body.
    """

    frame: Literal["body", "spatial"] = field(default="body", kw_only=True)

    @abstractmethod
    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the force at a time, pose and velocity, in its frame, ``(..., m)``."""

    def in_body(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the force in the body frame, ``(..., m)``; V is the body velocity."""
        if self.frame == "body":
            return self.acting(G, t, Q, V)
        force = self.acting(G, t, Q, G.Ad(Q, V))
        return G.Ad_star(Q, force + 0 * V)

    @property
    def turns(self) -> bool:
        """Whether it may have a torque about the origin of the body."""
        return True

    def in_space(self, G: EuclideanGroup, t: Any, moving: RigidMotion) -> Any:
        """Return what moves the origin of a rigid body as a series, in space, ``(..., n)``.

        The time is a series, too, see `eqt_cli.core.jets`.
        """
        assert G.translation is not None
        force: Any = self.in_body(G, t, moving.pose, moving.twist)[..., G.translation.axes]
        return (G.rotation(moving.pose) @ force[..., None])[..., 0]

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times, s, at which the force switches to another expression, in order."""
        return np.empty(0)
