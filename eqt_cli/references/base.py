"""Base classes of references: a desired motion Q_d(t), V_d(t), V̇_d(t) and its force τ_d."""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from eqt_cli.core.arrays import Array, stack
from eqt_cli.core.errors import Problems
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.core.leaves import STRUCTURE
from eqt_cli.core.registry import Component
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.flatness import FlatOutput, PlantModel
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.mechanics.motions import Piece, Pieces
from eqt_cli.mechanics.over_time import GivenOverTime

T = TypeVar("T")


class InExpressions:
    """A component with an option that holds expressions in t, one per coordinate."""

    expressed: ClassVar[str]
    """The name of the option."""

    @cached_property
    def expressions(self) -> list[Expression]:
        """The expressions, parsed."""
        return [formula(entry) for entry in getattr(self, self.expressed)]

    def at(self, t: Any) -> Array:
        """Return the values of the expressions, ``(..., m)``."""
        return stack([expression.evaluate({"t": t}) for expression in self.expressions])

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """Return the component with a new function of time for each of its expressions."""
        other = copy(self)
        vars(other)["expressions"] = [new() for _ in self.expressions]
        return other

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which an expression changes its piece, and of short pulses."""
        return instants_of(self.expressions, until)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note expressions that do not parse, and a wrong number of them."""
        entries = getattr(self, self.expressed)
        check_expressions(entries, G.dimension, G, problems.at(self.expressed))


def check_expressions(
    entries: Sequence[str | float], count: int, G: MatrixLieGroup, problems: Problems
) -> None:
    """Note expressions that do not parse, and a wrong number of them."""
    if len(entries) != count:
        problems.add(f"expected {count} expressions for {G.name}, got {len(entries)}")
    for index, entry in enumerate(entries):
        with problems.catching(index):
            formula(entry)


def check_rising(points: Sequence[Any], problems: Problems) -> None:
    """Note fewer than two points, and those that are not in the order of time."""
    if len(points) < 2:
        problems.add(f"expected at least two points, got {len(points)}")
    for index, (before, point) in enumerate(pairwise(points), 1):
        if not point.t > before.t:
            problems.at(index, "t").add(f"expected a time after {before.t:g} s, got {point.t:g} s")


def instants_of(expressions: Iterable[Expression], until: float) -> Array:
    """Return the sorted times at which expressions change their piece, and of short pulses."""
    return np.array(sorted({t for each in expressions for t in each.instants(until)}))


class Desired(NamedTuple):
    """The desired state at one instant, and the force that drives it.

    Attributes
    ----------
    Q : (..., d, d)
        Q_d.
    P, tau : (..., m)
        P_d = 𝕀V_d and τ_d, body frame.
    V, V_dot : (..., m)
        V_d and V̇_d, where they are known without P_d and τ_d.
    """

    Q: Array
    P: Array
    tau: Array
    V: Array | None = None
    V_dot: Array | None = None


@dataclass(frozen=True)
class Reference(GivenOverTime, Component):
    """A desired motion; by default one that a torque drives, from Q_d(0) and V_d(0).

    A frozen dataclass whose fields are its options in a configuration, in addition to the initial
    `pose` and `velocity` in `starts_from`.
    """

    keeps_velocity: ClassVar[bool] = False
    """Whether V_d(t) = V_d(0) by construction."""
    starts_from: ClassVar[tuple[str, ...]] = ("pose", "velocity")
    """The initial values given in addition to the options; these states are integrated."""
    smooth: ClassVar[bool] = False
    """Whether it has a method ``series(G, t, order)``, as `path`: Q_d as a Taylor series."""

    @abstractmethod
    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """Return τ_d at time t, body frame, ``(..., m)``."""

    def desired(
        self, G: MatrixLieGroup, inertia: Inertia, t: Any, Qd: Array | None, Pd: Array | None
    ) -> Desired:
        """Return the desired state at time t.

        Parameters
        ----------
        Qd, Pd
            The integrated states; None where they are not integrated.
        """
        assert Qd is not None and Pd is not None
        return Desired(Qd, Pd, self.driving_torque(G, inertia, t, Pd))

    def initial(self, G: MatrixLieGroup, pose: Array, velocity: Array) -> tuple[Array, Array]:
        """Return Q_d(0) and V_d(0) from the given `pose` and `velocity`."""
        return pose, velocity

    def flat_output(self, G: MatrixLieGroup, t: Any) -> FlatOutput | None:
        """Return position and heading with their derivatives at time t; None if there are none."""
        return None

    def given_at(self, G: MatrixLieGroup) -> Array | None:
        """Return the times of the poses that give it, by points or rows; None for other kinds."""
        return None

    def knowing(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the reference with what it knows of the plant, after noting what does not fit."""
        return self

    @property
    def known_forces(self) -> tuple[Any, ...]:
        """The forces that act along the motion besides those of the actuators, as far as known."""
        return ()

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """Return the reference with a new function of time for each of its expressions."""
        return self

    def remarks(self, G: MatrixLieGroup) -> Iterator[str]:
        """Yield remarks for the user before a run."""
        yield from ()

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note options that do not fit the group."""


class MovingReference(Reference):
    """A reference whose V_d and V̇_d are given, so that τ_d follows from them."""

    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """Return τ_d = 𝕀V̇_d − ad*_{V_d} 𝕀V_d + 𝕀̇V_d, which gives V_d in the Lie-Poisson system."""
        return self.desired(G, inertia, t, None, None).tau

    def _driven(
        self, G: MatrixLieGroup, inertia: Inertia, Q: Any, V: Array, acceleration: Array
    ) -> Desired:
        P = inertia.momentum(V)
        tau = inertia.momentum(acceleration) + inertia.rate_force(V) - G.ad_star(V, P)
        return Desired(Q, P, tau, V, acceleration)


@dataclass(frozen=True)
class ReferenceByRates(MovingReference):
    """A reference whose velocity is given, and whose pose is integrated from Q_d(0)."""

    starts_from: ClassVar[tuple[str, ...]] = ("pose",)

    @abstractmethod
    def velocity(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array]:
        """Return V_d and V̇_d at time t, body frame, ``(..., m)`` each."""

    def desired(
        self, G: MatrixLieGroup, inertia: Inertia, t: Any, Qd: Array | None, Pd: Array | None
    ) -> Desired:
        """Return the velocity and the force at time t, with the integrated pose."""
        return self._driven(G, inertia, Qd, *self.velocity(G, t))

    def initial(self, G: MatrixLieGroup, pose: Array, velocity: Array) -> tuple[Array, Array]:
        """Return the given Q_d(0), and the velocity at t = 0."""
        return pose, self.velocity(G, 0.0)[0]


@dataclass(frozen=True)
class ClosedReference(MovingReference):
    """A reference in closed form, which needs no integration and no state."""

    starts_from: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Return Q_d ``(..., d, d)``, V_d and V̇_d ``(..., m)`` at time t, body frame."""

    def desired(
        self, G: MatrixLieGroup, inertia: Inertia, t: Any, Qd: Array | None, Pd: Array | None
    ) -> Desired:
        """Return the desired state of the motion at time t."""
        return self._driven(G, inertia, *self.motion(G, t))

    def initial(self, G: MatrixLieGroup, pose: Array, velocity: Array) -> tuple[Array, Array]:
        """Return Q_d(0) and V_d(0) of the motion."""
        Q, V, _ = self.motion(G, 0.0)
        return Q, V

    def prepared(self, G: MatrixLieGroup, make: Callable[[MatrixLieGroup], T], name: str = "") -> T:
        """Return `make(G)`, which is computed once for each group and name."""
        cache = vars(self).setdefault("_prepared", {})
        if (G.name, name) not in cache:
            cache[G.name, name] = make(G)
        return cache[G.name, name]


@dataclass(frozen=True)
class PiecewiseReference(ClosedReference):
    """A reference in closed form that consists of pieces between instants."""

    @abstractmethod
    def pieces(self, G: MatrixLieGroup) -> Pieces:
        """Return all pieces."""

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Return the motion of the pieces at the times."""
        return self.held(G, t).motion(G, t)

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which a piece begins."""
        return self.prepared(G, self.pieces).starts

    def held(self, G: MatrixLieGroup, t: Any) -> "InPiece":
        """Return the piece at a time, or at each of some times."""
        return InPiece(self, *self.prepared(G, self.pieces).at(t))


@dataclass(frozen=True)
class InPiece(ClosedReference):
    """One piece of a motion as a reference, or an array of pieces for some times.

    Attributes
    ----------
    whole
        The reference with all pieces, which gives the structure.
    since, numbers
        As by `Pieces.at`.
    """

    whole: PiecewiseReference = field(metadata=STRUCTURE)
    since: Array
    numbers: Array

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Return the motion of the piece."""
        return self.prepared(G, self._piece).motion(G, t)

    def _piece(self, G: MatrixLieGroup) -> Piece:
        return self.whole.prepared(G, self.whole.pieces).piece(self.since, self.numbers)
