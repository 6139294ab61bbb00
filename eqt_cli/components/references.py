"""Desired trajectories: their base classes and the short kinds."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self, TypeVar

import numpy as np

from eqt_cli.base import units
from eqt_cli.base.arrays import Array, Arrays, stack
from eqt_cli.base.errors import InputError, Problems
from eqt_cli.base.expressions import Expression, formula
from eqt_cli.base.option_types import VELOCITY, Positive, Real, Unit
from eqt_cli.base.registry import Component, Keys, Registry
from eqt_cli.components import motions
from eqt_cli.components.groups import MatrixLieGroup, screws_of
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.mechanics import AXES, LATER, TimeVarying
from eqt_cli.components.pose_notation import check_turn, pose_from, vector
from eqt_cli.components.pose_tables import coordinate_names
from eqt_cli.numbers.instants import instants_of
from eqt_cli.numbers.jets import Jet, series, value_and_derivative
from eqt_cli.numbers.leaves import STRUCTURE, with_fields
from eqt_cli.numbers.rounded import rounded

# Base classes of references: a desired motion Q_d(t), V_d(t), V̇_d(t) and its force τ_d -----------


T = TypeVar("T")


class InExpressions:
    """A component with an option that holds expressions in t, one per coordinate."""

    expressed: ClassVar[str]
    """The name of the option."""

    @cached_property
    def expressions(self) -> list[Expression]:
        """The expressions, parsed."""
        return [formula(entry) for entry in getattr(self, self.expressed)]

    def values(self, t: Any) -> Array:
        """Return the values of the expressions, ``(..., m)``."""
        return stack([expression.evaluate({"t": t}) for expression in self.expressions])

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """Return the component with a new function of time for each of its expressions."""
        return with_fields(self, expressions=[new() for _ in self.expressions])

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


def check_end(
    velocity: Sequence[float] | None, count: int, index: int, points: int, problems: Problems
) -> None:
    """Note a velocity at a point between the ends, or of another length."""
    if velocity is not None and 0 < index < points - 1:
        problems.add("belongs to the first and the last point alone; remove it here")
    elif velocity is not None and len(velocity) != count:
        problems.add(f"expected {count} numbers, got {len(velocity)}")


def check_rising(points: Sequence[Any], problems: Problems) -> None:
    """Note fewer than two points, and those that are not in the order of time."""
    if len(points) < 2:
        problems.add(f"expected at least two points, got {len(points)}")
    for index, (before, point) in enumerate(pairwise(points), 1):
        if not point.t > before.t:
            problems.at(index, "t").add(f"expected a time after {before.t:g} s, got {point.t:g} s")


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
class Reference(TimeVarying, Component):
    """A desired motion; by default one that a torque drives, from Q_d(0) and V_d(0).

    A frozen dataclass whose fields are its options in a configuration, in addition to the initial
    `pose` and `velocity` in `starts_from`.
    """

    keeps_velocity: ClassVar[bool] = False
    """Whether V_d(t) = V_d(0) by construction."""
    starts_from: ClassVar[tuple[str, ...]] = ("pose", "velocity")
    """The initial values given in addition to the options; these states are integrated."""
    jumps: ClassVar[bool] = False
    """Whether its pose jumps at its instants, which no energy balance covers."""
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

    def flat_output(self, G: MatrixLieGroup, t: Any) -> motions.FlatOutput | None:
        """Return position and heading with their derivatives at time t; None if there are none."""
        return None

    def knot_times(self, G: MatrixLieGroup) -> Array | None:
        """Return the times of the poses that give it, by points or rows; None for other kinds."""
        return None

    def for_plant(self, G: MatrixLieGroup, plant: motions.PlantModel, problems: Problems) -> Self:
        """Return the reference with what it knows of the plant, after noting what does not fit."""
        return self

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
        if (G.name, name) not in self._prepared:
            self._prepared[G.name, name] = make(G)
        value: T = self._prepared[G.name, name]
        return value

    @cached_property
    def _prepared(self) -> dict[tuple[str, str], Any]:
        return {}


@dataclass(frozen=True)
class PiecewiseReference(ClosedReference):
    """A reference in closed form that consists of pieces between instants."""

    @abstractmethod
    def pieces(self, G: MatrixLieGroup) -> motions.Pieces:
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
        return self.prepared(G, self._piece).motion_within(G, t)

    def _piece(self, G: MatrixLieGroup) -> motions.Pieces:
        return self.whole.prepared(G, self.whole.pieces).piece(self.since, self.numbers)


@dataclass(frozen=True)
class ReferenceAhead(TimeVarying):
    """A reference at later times, which a law with a preview knows.

    Attributes
    ----------
    after
        The times from now, s.
    names
        What the law reads of it, among `LATER`.
    pieces
        The reference in its piece at each of them; () where it has none.
    """

    reference: ClosedReference = field(metadata=STRUCTURE)
    after: tuple[float, ...] = field(metadata=STRUCTURE)
    names: tuple[str, ...] = field(default=LATER[:2], metadata=STRUCTURE)
    pieces: tuple[Any, ...] = ()

    def parts(self, G: MatrixLieGroup, inertia: Any, t: Any, batch: tuple[int, ...]) -> Arrays:
        """Return what the law reads, ``(..., k, …)`` each; its inertia gives the torque τ_d."""
        pieces, rows = self.pieces or [self.reference] * len(self.after), dict[str, list[Array]]()
        for piece, s in zip(pieces, self.after, strict=True):
            state = piece.desired(G, inertia.at(t + s), t + s, None, None)
            values = dict(zip(LATER[:3], (state.Q, state.V, state.tau), strict=True))
            flat = piece.flat_output(G, t + s) if LATER[3] in self.names else None
            if flat is not None:
                values[LATER[3]] = flat.position
            for name in self.names:
                value, axes = values[name], AXES[name] - 1
                whole = (*batch, *value.shape[value.ndim - axes :])
                rows.setdefault(name, []).append(np.broadcast_to(value, whole))
        return {name: np.stack(parts, axis=-AXES[name]) for name, parts in rows.items()}

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which the reference changes at one of the later times."""
        return np.concatenate([self.reference.instants(G, until + s) - s for s in self.after])

    def held(self, G: MatrixLieGroup, t: Any) -> Self | None:
        """Return the reference in its pieces."""
        held = tuple(self.reference.held(G, t + s) for s in self.after)
        return None if held[0] is None else replace(self, pieces=held)


references = Registry(
    "reference", "references", Reference, ("components.references", "components.waypoints")
)


@dataclass(frozen=True)
class ConstantReference(PiecewiseReference):
    """A constant body velocity: Q_d(t) = Q_0 exp(t V_d). At V_d = 0 the pose stands still.

    Attributes
    ----------
    pose
        Q_0 = Q_d(0).
    velocity
        V_d, body frame.
    """

    name: ClassVar[str] = "constant"
    keeps_velocity: ClassVar[bool] = True

    pose: Any = "identity"
    velocity: Annotated[Real | list[Real], Unit(VELOCITY)] = 0.0

    def pieces(self, G: MatrixLieGroup) -> motions.Pieces:
        """Return one piece of one factor with a(t) = t."""
        pose = pose_from(self.pose, G, Problems())
        assert pose is not None
        V = vector(self.velocity, G.dimension, G)
        polynomial = np.array([[[0.0, 1.0]]])
        return motions.Pieces.of(G, np.zeros(1), pose[None], V[None, None], polynomial)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an invalid pose or velocity."""
        pose_from(self.pose, G, problems.at("pose"))
        with problems.catching("velocity"):
            vector(self.velocity, G.dimension, G)


# A reference that is a product of rotations and translations, each given by an expression ---------


@dataclass(frozen=True)
class PathFactor(Keys):
    """One factor exp(a(t) ξ) of a path.

    Attributes
    ----------
    axis
        ξ: the name of a coordinate of the algebra, such as wz, or m numbers.
    by
        a(t), an expression in t, in rad or m; or with its unit, such as 30*t deg.
    """

    axis: str | list[Real]
    by: str | float

    @cached_property
    def expression(self) -> Expression:
        """The parsed expression of `by`, in rad and m."""
        text, unit = self.written
        size = "pi/180" if unit == "deg" else repr(units.factor(unit, units.base_of(unit)))
        return formula(text, times=size if unit else "")

    @property
    def written(self) -> tuple[str | float, str]:
        """The text of `by` and its unit, which may be empty."""
        parts = units.split(self.by) if isinstance(self.by, str) else None
        return parts or (self.by, "")

    def vector(self, G: MatrixLieGroup) -> Array:
        """Return ξ in coordinates, or raise an `InputError` if the group has no such axis."""
        if isinstance(self.axis, list):
            return vector(self.axis, G.dimension, G)
        names = coordinate_names(G)
        if self.axis not in names:
            raise InputError(
                f"expected {', '.join(names)} or a list of {G.dimension} numbers for {G.name}, "
                f"got '{self.axis}'"
            )
        return np.eye(G.dimension)[names.index(self.axis)]


@dataclass(frozen=True)
class PathReference(ClosedReference):
    """Q_d(t) = Q_0 exp(a_1(t) ξ_1) exp(a_2(t) ξ_2) …, rotations and translations in sequence.

    Attributes
    ----------
    factors
        Axes ξ_k, each constant in the frame moved by the factors before it, and displacements
        a_k(t) along them.
    pose
        Q_0.
    """

    name: ClassVar[str] = "path"
    smooth: ClassVar[bool] = True

    factors: list[PathFactor]
    pose: Any = "identity"

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Return the product, its velocity and its acceleration."""
        links, numbers, rates = self.prepared(G, self._constants)
        angles = []
        for factor, rate in zip(self.factors, rates, strict=True):
            angle = series(factor.expression, {"t": t}, 2)
            angles.append(stack([angle.derivative(k) for k in range(3)])[..., None] * rate)
        return motions.motion_along(G, links, numbers, angles)

    def series(self, G: MatrixLieGroup, t: Any, order: int) -> Jet:
        """Return Q_d as a series; a factor E has the rate ȧ E ξ^."""
        links, numbers, rates = self.prepared(G, self._constants)
        Q: Any = links[0]
        screws = screws_of(G)
        for factor, of_each, rate, link in zip(
            self.factors, numbers, rates, links[1:], strict=True
        ):
            angle: Any = stack([series(factor.expression, {"t": t}, order)])
            E: Any = Jet([screws.exp_along(of_each, angle.value * rate)])
            axis = G.hat(screws.along(of_each, rate))
            while E.order < order:
                E = E.extended((angle.rate[..., None] * E @ axis).derivative(E.order))
            Q = Q @ E @ link
        return Q

    def _constants(self, G: MatrixLieGroup) -> tuple[Array, Array, Array]:
        pose = pose_from(self.pose, G, Problems())
        assert pose is not None
        return motions.screws(G, pose, np.stack([factor.vector(G) for factor in self.factors]))

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which an expression changes its piece."""
        return instants_of(self.expressions, until)

    @property
    def expressions(self) -> list[Expression]:
        """The displacements, parsed."""
        return [factor.expression for factor in self.factors]

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an invalid pose, axis or expression, and missing factors."""
        pose_from(self.pose, G, problems.at("pose"))
        if not self.factors:
            problems.at("factors").add(
                "expected at least one factor, such as [{axis: wz, by: 0.1*t}]"
            )
        for index, factor in enumerate(self.factors):
            here = problems.at("factors", index)
            with here.catching("axis"):
                factor.vector(G)
            with here.catching("by"):
                _ = factor.expression
                unit = "" if here.at("axis") else factor.written[1]
                if unit:
                    for part in G.parts:
                        needed, along = part.error_unit, factor.vector(G)[part.axes]
                        if np.any(along) and units.factor(unit, needed) is None:
                            raise InputError(f"expected {units.offered(needed)}, got '{factor.by}'")


@dataclass(frozen=True)
class RatesReference(InExpressions, ReferenceByRates):
    """A body velocity V_d(t), one expression per coordinate; the pose is integrated.

    Attributes
    ----------
    rates
        m expressions in t, body frame.
    """

    name: ClassVar[str] = "rates"
    expressed: ClassVar[str] = "rates"

    rates: list[str | float]

    def velocity(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array]:
        """V_d(t) and its exact derivative."""
        pairs = [value_and_derivative(expression, {"t": t}) for expression in self.expressions]
        values, rates = zip(*pairs, strict=True)
        return stack(values), stack(rates)


@dataclass(frozen=True)
class SlewReference(PiecewiseReference):
    """Rest to rest along the geodesic from · exp(a(t) log(from⁻¹ to)).

    Attributes
    ----------
    to
        The final pose.
    duration
        Duration, s.
    from_
        The initial pose.
    start
        Start time, s.
    profile
        a(t): ``quintic``, 10s³ − 15s⁴ + 6s⁵, which minimises the jerk; at rest at both ends.
    """

    name: ClassVar[str] = "slew"

    to: Any
    duration: Annotated[Positive, Unit("s")]
    from_: Any = "identity"
    start: Annotated[Real, Unit("s")] = 0.0
    profile: Literal["quintic"] = "quintic"

    def pieces(self, G: MatrixLieGroup) -> motions.Pieces:
        """Return three pieces: rest, the slew, and rest."""
        start, end = (pose_from(pose, G, Problems()) for pose in (self.from_, self.to))
        assert start is not None and end is not None
        turn = rounded(lambda P, Q: G.log(G.inverse(P) @ Q), start, end)
        return motions.eased(G, self.start, self.start + self.duration, start, turn)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid poses."""
        for option, pose in (("from", self.from_), ("to", self.to)):
            pose_from(pose, G, problems.at(option))
        check_turn(self.from_, self.to, G, problems.at("to"))


@dataclass(frozen=True)
class TorqueReference(InExpressions, Reference):
    """A torque τ_d(t), one expression per coordinate (the paper's §7).

    It moves the desired body, on which no forces of `model` or `plant` act: what holds a weight is
    no part of τ_d.

    Attributes
    ----------
    torque
        m expressions in t, body frame: forces dual to the velocity coordinates.
    """

    name: ClassVar[str] = "torque"
    expressed: ClassVar[str] = "torque"

    torque: list[str | float]

    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """τ_d(t)."""
        return self.values(t)
