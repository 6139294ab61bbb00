"""What an oracle is, and the rigid body that it is asked about."""

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
    """A rigid body, described as other programs do.

    Attributes
    ----------
    mass
        kg.
    centre : (3,)
        The centre of mass in the body frame, m.
    inertia : (3, 3)
        About the centre of mass, in axes of the body frame, kg m^2.
    free
        Whether it moves freely (SE3), or turns about the origin of its frame (SO3).
    """

    mass: float
    centre: Array
    inertia: Array
    free: bool

    @classmethod
    def of(cls, G: MatrixLieGroup, tensor: Array) -> Self | None:
        """The body that has this inertia tensor; None where no rigid body in space has.

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
        As after ``--oracle``, and of the Python package.
    remedy
        What to do where the package is missing.
    title
        As it is written.
    """

    name: ClassVar[str]
    remedy: ClassVar[str]
    title: ClassVar[str]

    @classmethod
    def is_installed(cls) -> bool:
        """Whether its package is there."""
        return find_spec(cls.name) is not None

    @classmethod
    def version(cls) -> str:
        """Of its package, which is loaded for that."""
        return str(import_module(cls.name).__version__)

    @abstractmethod
    def __init__(self, body: RigidBody) -> None:
        """The body in that program, without gravity.

        Raises
        ------
        ValueError
            If the program does not take such a body, with its reason.
        """

    @abstractmethod
    def acceleration(self, R: Array, x: Array, V: Array, force: Array) -> Array:
        """V̇ in eqt's coordinates: body frame, (ω, v) on SE3 and ω on SO3.

        Parameters
        ----------
        R, x
            Attitude, body to space, and position, m; the latter is nothing on SO3.
        V, force
            Velocity, and the torque and force that act at the origin of the body frame, body frame.
        """


class SteppingOracle(Oracle):
    """An oracle that also integrates."""

    @abstractmethod
    def start(self, R: Array, x: Array, V: Array) -> None:
        """Put the body somewhere."""

    @abstractmethod
    def steps(self, force: Array, step: float, count: int) -> tuple[Array, Array, Array]:
        """R, x and V after so many steps, in s, under a force that is held in the body frame."""
