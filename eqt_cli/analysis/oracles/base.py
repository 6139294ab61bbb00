"""Base classes of oracles, and the rigid body that they simulate."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup

_ROUNDING = 1e-12


@dataclass(frozen=True)
class RigidBody:
    """A rigid body in the description of other programs.

    Attributes
    ----------
    mass
        Mass, kg.
    centre : (3,)
        Centre of mass in the body frame, m.
    inertia : (3, 3)
        Inertia about the centre of mass in the axes of the body frame, kg m^2.
    free
        Whether the body moves freely (SE3); else it rotates about the origin of its frame (SO3).
    """

    mass: float
    centre: Array
    inertia: Array
    free: bool

    @classmethod
    def of(cls, G: MatrixLieGroup, tensor: Array) -> Self | None:
        """Return the rigid body with this inertia tensor; None if there is none.

        On SE3, with V = (ω, v), the tensor of a body is
        [[J − m c^× c^×, m c^×], [−m c^×, m I]].
        """
        if not (isinstance(G, EuclideanGroup) and G.space == 3 and len(G.columns) <= 1):
            return None
        if not len(G.columns):
            return cls(1.0, np.zeros(3), tensor, False)
        mass = float(tensor[3, 3])
        lever = tensor[:3, 3:] / mass
        centre = np.array([lever[2, 1], lever[0, 2], lever[1, 0]])
        cross = np.cross(centre, np.eye(3)).T
        inertia = tensor[:3, :3] + mass * cross @ cross
        found = np.block(
            [[inertia - mass * cross @ cross, mass * cross], [-mass * cross, mass * np.eye(3)]]
        )
        if np.abs(found - tensor).max() > _ROUNDING * np.abs(tensor).max():
            return None
        return cls(mass, centre, inertia, True)


class Oracle(ABC):
    """Another program's rigid body, in that program's coordinates.

    Attributes
    ----------
    name
        Name for ``--oracle`` and of the Python package.
    remedy
        Advice if the package is missing.
    title
        Display name.
    """

    name: ClassVar[str]
    remedy: ClassVar[str]
    title: ClassVar[str]

    @classmethod
    def is_installed(cls) -> bool:
        """Whether the package is installed."""
        return find_spec(cls.name) is not None

    @classmethod
    def version(cls) -> str:
        """Load the package and return its version."""
        return str(import_module(cls.name).__version__)

    @abstractmethod
    def __init__(self, body: RigidBody) -> None:
        """Create the body in the program, without gravity.

        Raises
        ------
        ValueError
            If the program rejects the body, with its reason.
        """

    @abstractmethod
    def acceleration(self, R: Array, x: Array, V: Array, force: Array) -> Array:
        """Return V̇ in eqt's coordinates: body frame, (ω, v) on SE3 and ω on SO3.

        Parameters
        ----------
        R, x
            Attitude (body to space) and position, m; the position is empty on SO3.
        V, force
            Velocity, and torque and force at the origin of the body frame, in body axes.
        """


class SteppingOracle(Oracle):
    """An oracle that also integrates."""

    @abstractmethod
    def start(self, R: Array, x: Array, V: Array) -> None:
        """Set the state of the body."""

    @abstractmethod
    def steps(self, force: Array, step: float, count: int) -> tuple[Array, Array, Array]:
        """Return R, x and V after `count` steps of `step` s with a constant body-frame force."""
