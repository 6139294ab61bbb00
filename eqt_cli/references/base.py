"""What a reference is: a desired motion Q_d(t), V_d(t), V̇_d(t) and the force τ_d that it takes."""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from eqt_cli.core.arrays import Array, stack
from eqt_cli.core.component import Component
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.mechanics.motions import Piece, Pieces
from eqt_cli.mechanics.over_time import GivenOverTime

T = TypeVar("T")


class InExpressions:
    """What is given by an option with expressions in t, one per coordinate."""

    expressed: ClassVar[str]
    """The option."""

    @cached_property
    def expressions(self) -> list[Expression]:
        """The expressions, parsed."""
        return [formula(entry) for entry in getattr(self, self.expressed)]

    def at(self, t: Any) -> Array:
        """Their values, ``(..., m)``."""
        return stack([expression.evaluate({"t": t}) for expression in self.expressions])

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """The same with a new function of time for each of its expressions."""
        found = copy(self)
        vars(found)["expressions"] = [new() for _ in self.expressions]
        return found

    def instants(self, *group: MatrixLieGroup) -> Array:
        """Where an expression changes its piece."""
        return instants_of(self.expressions)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Expressions that do not parse, or a number of them that is not m."""
        problems, entries = problems.at(self.expressed), getattr(self, self.expressed)
        if len(entries) != G.dimension:
            expected = f"expected {G.dimension} expressions for {G.name}"
            problems.add(f"{expected}, got {len(entries)}")
        for index, entry in enumerate(entries):
            with problems.catching(index):
                formula(entry)


def instants_of(expressions: Iterable[Expression]) -> Array:
    """Where expressions change their piece, in order."""
    return np.unique([t for expression in expressions for t in expression.instants])


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
    """A desired motion; this class is of those that a torque drives, from Q_d(0) and V_d(0).

    A frozen dataclass whose fields are its options in a configuration, beside those of `pose` and
    `velocity` that it starts from.
    """

    keeps_velocity: ClassVar[bool] = False
    """Whether V_d(t) = V_d(0) by construction."""
    starts_from: ClassVar[tuple[str, ...]] = ("pose", "velocity")
    """What of Q_d(0) and V_d(0) is given beside the options; it is integrated with each run."""

    @abstractmethod
    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """τ_d at time t, body frame, ``(..., m)``."""

    def desired(
        self, G: MatrixLieGroup, inertia: Inertia, t: Any, Qd: Array | None, Pd: Array | None
    ) -> Desired:
        """The desired state at time t.

        Parameters
        ----------
        Qd, Pd
            What of it is integrated; None where it is not.
        """
        assert Qd is not None and Pd is not None
        return Desired(Qd, Pd, self.driving_torque(G, inertia, t, Pd))

    def initial(self, G: MatrixLieGroup, pose: Array, velocity: Array) -> tuple[Array, Array]:
        """Q_d(0) and V_d(0), where `pose` and `velocity` are given beside the options."""
        return pose, velocity

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """The same with a new function of time for each of its expressions, where it has any."""
        return self

    def remarks(self, G: MatrixLieGroup) -> Iterator[str]:
        """What a user should know of it before it is run, and no error is."""
        yield from ()

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note what of its options does not fit the group."""


class MovingReference(Reference):
    """A reference whose V_d and V̇_d are given, so that τ_d follows from them."""

    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """τ_d = 𝕀V̇_d − ad*_{V_d} 𝕀V_d + 𝕀̇V_d, which holds V_d in the Lie-Poisson system."""
        return self.desired(G, inertia, t, None, None).tau

    def _driven(
        self, G: MatrixLieGroup, inertia: Inertia, Q: Any, V: Array, acceleration: Array
    ) -> Desired:
        P = inertia.momentum(V)
        tau = inertia.momentum(acceleration) + inertia.rate_force(V) - G.ad_star(V, P)
        return Desired(Q, P, tau, V, acceleration)


@dataclass(frozen=True)
class ReferenceByRates(MovingReference):
    """A reference whose velocity is given; its pose is integrated from Q_d(0)."""

    starts_from: ClassVar[tuple[str, ...]] = ("pose",)

    @abstractmethod
    def velocity(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array]:
        """V_d and V̇_d at time t, body frame, ``(..., m)`` each."""

    def desired(
        self, G: MatrixLieGroup, inertia: Inertia, t: Any, Qd: Array | None, Pd: Array | None
    ) -> Desired:
        """The velocity and the force at time t, at the pose that was integrated."""
        return self._driven(G, inertia, Qd, *self.velocity(G, t))

    def initial(self, G: MatrixLieGroup, pose: Array, velocity: Array) -> tuple[Array, Array]:
        """Q_d(0) as given, and V_d(0) = V_d(t) at t = 0."""
        return pose, self.velocity(G, 0.0)[0]


@dataclass(frozen=True)
class ClosedReference(MovingReference):
    """A reference in closed form: evaluated, not integrated, and no part of a state."""

    starts_from: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Q_d ``(..., d, d)``, V_d and V̇_d ``(..., m)`` at time t; body frame."""

    def desired(
        self, G: MatrixLieGroup, inertia: Inertia, t: Any, Qd: Array | None, Pd: Array | None
    ) -> Desired:
        """All of it at time t."""
        return self._driven(G, inertia, *self.motion(G, t))

    def initial(self, G: MatrixLieGroup, pose: Array, velocity: Array) -> tuple[Array, Array]:
        """Q_d(0) and V_d(0), which follow from the motion."""
        Q, V, _ = self.motion(G, 0.0)
        return Q, V

    def prepared(self, G: MatrixLieGroup, make: Callable[[MatrixLieGroup], T], name: str = "") -> T:
        """What `make` makes of a group, which is done once."""
        kept = vars(self).setdefault("_prepared", {})
        if (G.name, name) not in kept:
            kept[G.name, name] = make(G)
        return kept[G.name, name]


@dataclass(frozen=True)
class PiecewiseReference(ClosedReference):
    """A reference in closed form that is given piece by piece, between instants."""

    @abstractmethod
    def pieces(self, G: MatrixLieGroup) -> Pieces:
        """All of its pieces."""

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """The motion of the piece that is held, or else of those that the times are in."""
        kept = vars(self)
        if "_held" not in kept:
            return self.holding(self.held(G, t)).motion(G, t)
        if "_piece" not in kept:
            kept["_piece"] = self.prepared(G, self.pieces).piece(kept["_held"])
        piece: Piece = kept["_piece"]
        return piece.motion(G, t)

    def instants(self, G: MatrixLieGroup) -> Array:
        """Where a piece begins."""
        return self.prepared(G, self.pieces).starts

    def held(self, G: MatrixLieGroup, t: Any) -> dict[str, Array]:
        """The numbers of a piece."""
        return self.prepared(G, self.pieces).at(t)

    def holding(self, held: Mapping[str, Array]) -> Self:
        """The same in one piece, or in one for each run."""
        found = copy(self)
        vars(found)["_held"] = held
        vars(found).pop("_piece", None)
        return found
