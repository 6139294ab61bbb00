"""Forces that act on a vehicle besides the torque of the law."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self, TypeGuard

import numpy as np

from eqt_cli.base.arrays import Array, absolute, apply_matrix, as_array, cos, cross, dot, sin, stack
from eqt_cli.base.errors import Problems
from eqt_cli.base.expressions import Expression, formula
from eqt_cli.base.option_types import DAMPING, DRAG, TORQUE, Scale, Unit
from eqt_cli.base.registry import Registry
from eqt_cli.components import vehicle_parts
from eqt_cli.components.groups import MatrixLieGroup, ProductGroup
from eqt_cli.components.inertia import ROUNDING, Inertia, InertiaLaw
from eqt_cli.components.matrix_groups import EuclideanGroup, rigid_motions
from eqt_cli.components.motions import RigidMotion, body_axes, unit_vector
from eqt_cli.components.references import InExpressions, check_expressions
from eqt_cli.components.vehicle_parts import NamedFormula
from eqt_cli.numbers.instants import instants_of
from eqt_cli.numbers.jets import Jet, value_and_derivative
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

DIGITS = 1e-6
"""Negative eigenvalue of a drag matrix, relative to its largest entry, that its digits explain."""

UNLIKE = 0.03
"""Relative difference of numbers of one body beyond which they get a remark; of g it is 0.005."""

# The base class of forces; it knows no law, actuator or engine ------------------------------------


@dataclass(frozen=True)
class Force(vehicle_parts.VehiclePart):
    """A force on the plant, of which the law knows nothing.

    Attributes
    ----------
    frame
        The frame of its coordinates and of the velocity that it depends on. `spatial`: the axes of
        space, at the origin of the body, as wind and weight act.
    """

    frame: Literal["body", "spatial"] = field(default="body", kw_only=True)

    @abstractmethod
    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the force at a time, pose and velocity, in its frame, ``(..., m)``."""

    def in_body(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the force in the body frame, ``(..., m)``; V is the body velocity."""
        if self.frame == "body":
            return self.acting(G, t, Q, V)
        place = at_origin(G, Q)
        return G.Ad_star(place, self.acting(G, t, Q, G.Ad(place, V)) + 0 * V)

    @property
    def turns(self) -> bool:
        """Whether it may have a torque about the origin of the body."""
        return True

    def in_space(self, G: EuclideanGroup, t: Any, moving: RigidMotion) -> Any:
        """Return what moves the origin of a rigid body as a series, in space, ``(..., n)``.

        The time is a series, too, see `eqt_cli.numbers.jets`.
        """
        assert G.translation is not None
        force: Any = self.in_body(G, t, moving.pose, moving.twist)[..., G.translation.axes]
        return (G.rotation(moving.pose) @ force[..., None])[..., 0]

    def turns_with_body(self, G: EuclideanGroup) -> bool:
        """Return whether the force in space depends on the attitude of a body that moves."""
        turns, moves = np.ones((1, G.rotations)), Jet([np.ones((1, G.space))])
        turned = G.rotation(G.exp(np.linspace(0.3, 0.8, G.dimension)[None]))
        values: list[Any] = []
        for R in (np.eye(G.space)[None], turned):
            wrench = self.in_space(G, Jet.time(0.0, 0), RigidMotion(G, R, turns, moves, moves))
            values.append(wrench.value if isinstance(wrench, Jet) else wrench)
        return bool(np.ptp(values, axis=0).max() > 1e-9 * np.abs(values[0]).max())

    def apart(self, G: EuclideanGroup, along: Any, even: bool) -> Any:
        """Return a force that does not turn with the body, and a drag across its axis `along`.

        Their sum is the force; None where there is no such sum, and for the drag where it is 0. One
        that is `even` is the same along both axes across.
        """
        return None if self.frame == "spatial" or self.turns_with_body(G) else (self, None)

    def remarks(self, G: MatrixLieGroup, inertia: Inertia) -> Iterator[tuple[str, str]]:
        """Yield remarks for the user with their options, where `inertia` is the plant's."""
        yield from ()


def at_origin(G: MatrixLieGroup, Q: Array) -> Array:
    """Return a pose without its translations, which carries vectors of space without a lever."""
    if isinstance(G, ProductGroup):
        factors = zip(G.factors, G.places, strict=True)
        return G.assemble([at_origin(factor, Q[..., at, at]) for factor, at in factors])
    if isinstance(G, EuclideanGroup) and G.columns:
        return G.assemble(G.rotation(Q), np.zeros_like(G.translations(Q)))
    return Q


@dataclass(frozen=True)
class PlacedForce(vehicle_parts.Timed, Force):
    """A force that may act along a line of space, and for a stretch of time.

    Attributes
    ----------
    at
        Where it acts with `frame: spatial`. `centre`: at the origin of the body, so that its
        translational part has no torque. `line`: along a line that is fixed in space, as Ad*_Q f,
        so that far from the origin of space it turns the body.
    """

    at: Literal["centre", "line"] = field(default="centre", kw_only=True)

    def __post_init__(self) -> None:
        """Refuse a line in space for a force that turns with the body."""
        if self.at == "line" and self.frame == "body":
            raise ValueError("at: line is fixed in space; add frame: spatial, or leave it out")

    def in_body(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the force in the body frame; along a line, with its lever."""
        if self.at == "centre":
            force = super().in_body(G, t, Q, V)
        else:
            force = G.Ad_star(Q, self.acting(G, t, Q, G.Ad(Q, V)) + 0 * V)
        return force if self.presence is None else self.presence.at(t) * force


forces = Registry("force", "forces", Force, ("components.forces",))


@dataclass(frozen=True)
class ConstantForce(PlacedForce):
    """The same force at all times.

    Attributes
    ----------
    force
        m coordinates of g*.
    """

    name: ClassVar[str] = "constant"
    departs: ClassVar[str] = "constant force"
    vectors: ClassVar[tuple[str, ...]] = ("force",)

    force: Annotated[vehicle_parts.Numbers, Unit(TORQUE)]

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the force."""
        return self.force


# Drag, linear and quadratic in the velocity, in a medium that may flow ----------------------------


def currents(acting: tuple[Force, ...]) -> "dict[int, Drag]":
    """Return the forces with a current that moves masses, too, by their numbers."""
    drags = {k: force for k, force in enumerate(acting) if isinstance(force, Drag)}
    return {k: drag for k, drag in drags.items() if drag.current is not None and not drag.drag_only}


def in_currents(
    G: MatrixLieGroup, acting: tuple[Force, ...], inertia: InertiaLaw | None
) -> tuple[Force, ...]:
    """Return the forces on a vehicle, of which the first with a current moves the masses, too.

    Parameters
    ----------
    inertia
        The inertia of the vehicle, whose added part moves with the medium; None where not known.
    """
    acting = weighed(G, acting, inertia)
    moving = list(currents(acting))
    if not moving:
        return acting
    floating = [f.displaced(G) for f in acting if isinstance(f, Restoring) and np.any(f.buoyancy)]
    added = None if inertia is None else inertia.at(0.0).added
    masses: dict[str, Any] = {"added": added}
    masses["displaced_mass"] = sum(floating) if floating else None
    k = moving[0]
    return (*acting[:k], with_fields(acting[k], **masses), *acting[k + 1 :])


@dataclass(frozen=True)
class Drag(PlacedForce):
    """The drag −(D₁ + D₂ diag|U|) U, with U = V − Ad_{Q⁻¹} (0, c) in a current c, else U = V.

    A current also acts through `inertia: {rigid: …, added: M_A}`, whose added part has the velocity
    U and the rate U̇, by the force M_A(V̇ − U̇) + ad*_U M_A U − ad*_V M_A V. One that varies pushes
    the displaced mass of `restoring`, too, by (B/g) ċ at the centre of buoyancy, g = 9.80665 m/s².

    Attributes
    ----------
    linear
        D₁.
    quadratic
        D₂.
    current
        c, the velocity of the medium in the spatial frame, m/s: a number or an expression in t for
        each translation. Default: 0.
    drag_only
        Whether the current moves no added or displaced mass, as wind on a boat.
    """

    name: ClassVar[str] = "drag"
    departs: ClassVar[str] = "drag"
    matrices: ClassVar[tuple[str, ...]] = ("linear", "quadratic")
    in_time: ClassVar[tuple[str, ...]] = ("current",)

    linear: Annotated[vehicle_parts.Matrix, Unit(DAMPING)] = 0.0
    quadratic: Annotated[vehicle_parts.Matrix, Unit(DRAG)] = 0.0
    current: Annotated[list[vehicle_parts.NumberOrExpression] | None, Unit("m/s")] = None
    drag_only: bool = False

    expressions: tuple[Expression | None, ...] = field(
        default=(), init=False, repr=False, metadata=STRUCTURE
    )
    added: Any = field(default=None, init=False, repr=False)
    displaced_mass: Any = field(default=None, init=False, repr=False)
    named: Any = field(default=None, init=False, repr=False)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the drag with the expressions of the current, and 0 for them among its numbers."""
        part: Any = super().of_run(G, random)
        if self.current is None:
            return part
        texts = [entry if isinstance(entry, str | NamedFormula) else "" for entry in part.current]
        numbers = [0.0 if text else entry for text, entry in zip(texts, part.current, strict=True)]
        expressions = tuple(_expression(text) if text else None for text in texts)
        named = vehicle_parts.named_numbers(texts, random)
        return with_fields(part, current=np.array(numbers), expressions=expressions, named=named)

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which an expression changes its piece, and of short pulses."""
        if self.named is not None:
            return instants_of(self.named.bound(self.expressions), until)
        return instants_of(filter(None, self.expressions), until)

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return −D₁ U − D₂ (|U| U)."""
        if self.current is not None:
            flow = self._flow(G, t)
            V = V - (flow if self.frame == "spatial" else G.Ad(G.inverse(Q), flow))
        return -apply_matrix(self.linear, V) - apply_matrix(self.quadratic, absolute(V) * V)

    def in_body(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the drag, and the force of the current on the masses."""
        force = super().in_body(G, t, Q, V)
        if self.added is None and self.displaced_mass is None:
            return force
        to_body = G.inverse(Q)
        if self.added is not None:
            flow = G.Ad(to_body, self._flow(G, t))
            slip = V - flow
            force = force + G.ad_star(slip, apply_matrix(self.added, slip))
            force = force - G.ad_star(V, apply_matrix(self.added, V))
            force = force - apply_matrix(self.added, G.ad(V, flow))  # as the body turns in it
        for mass in (self.added, self.displaced_mass):
            if mass is not None and any(self.expressions):
                force = force + apply_matrix(mass, G.Ad(to_body, self._flow(G, t, rate=True)))
        return force

    def in_space(self, G: EuclideanGroup, t: Any, moving: RigidMotion) -> Any:
        """Return the drag, in a medium that moves no masses, of the velocity in it."""
        if self.current is None or self.added is not None or self.displaced_mass is not None:
            return super().in_space(G, t, moving)
        slip = moving.velocity - self._flow(G, t)[..., G.parts[1].axes]
        return with_fields(self, current=None).in_space(G, t, replace(moving, velocity=slip))

    def apart(self, G: EuclideanGroup, along: Any, even: bool) -> Any:
        """Return the drag D_b along all axes, and D − D_b across, if it has that form."""
        turns, moves = G.parts[0].axes, G.parts[1].axes
        whole, axes = self.linear, body_axes(along)
        D = axes.T @ whole[moves, moves] @ axes
        rest: list[Any] = [D - np.diag(np.diag(D)), whole[moves, turns], self.quadratic[moves]]
        if even:
            rest.append(np.ptp(np.diag(D)[:-1]))
        size = ROUNDING * np.abs(whole).max()
        is_own = self.frame == "body" and not any(self.expressions)
        if is_own and all(np.abs(block).max() <= size for block in rest):
            across = np.zeros_like(whole)
            across[moves, moves] = whole[moves, moves] - D[-1, -1] * np.eye(G.space)
            free = with_fields(self, linear=whole - across)
            if across.any() and not free.turns_with_body(G):
                none = dict.fromkeys(("added", "displaced_mass"))
                return free, with_fields(self, linear=across, quadratic=0.0 * across, **none)
        return super().apart(G, along, even)

    def beside(self, G: EuclideanGroup, axis: Array, velocity: Any) -> Any:
        """Return D_k U for an axis b_k of the body; velocities in space, ``(..., n)``."""
        moves = G.parts[1].axes
        share = dot(apply_matrix(self.linear[..., moves, moves], axis), axis)
        return share[..., None] * (velocity if self.current is None else velocity - self.current)

    def _flow(self, G: MatrixLieGroup, t: Any, rate: bool = False) -> Array:
        """Return the velocity of the medium, or its rate, in space, ``(..., m)``."""
        assert G.translation is not None
        entries: list[Any] = [0.0] * G.dimension
        values = {"t": t} if self.named is None else self.named.at(t)
        for k, expression in enumerate(self.expressions):
            if expression is None:
                value: Any = 0.0 if rate else np.asarray(self.current)[..., k]
            elif rate:
                value = value_and_derivative(expression, values)[1]
            else:
                value = expression.evaluate(values)
            entries[G.translation.axes.start + k] = value
        return stack(entries)

    def remarks(self, G: MatrixLieGroup, inertia: Inertia) -> Iterator[tuple[str, str]]:
        """Yield remarks on drag that gives energy, and on a current without added mass."""
        for key in self.matrices:
            D = getattr(self, key)
            least = np.linalg.eigvalsh(D + D.T)[0] / 2
            if least < -DIGITS * np.abs(D).max():
                yield (
                    key,
                    f"has the eigenvalue {least:.4g} and drives the body at some velocities; "
                    "derivatives such as X_u are negative: give −X_u",
                )
        if self.current is None or self.drag_only or inertia.added is not None:
            return
        assert G.translation is not None
        masses = inertia.matrix[G.translation.axes, G.translation.axes]
        off = np.abs(masses - masses[0, 0] * np.eye(len(masses))).max()
        differs = off > ROUNDING * masses.max()
        if differs or self.displaced_mass is not None:
            why = "the masses differ by direction" if differs else "the body has buoyancy"
            yield (
                "current",
                f"acts on the drag only, but {why}: write the inertia as {{rigid: …, added: …}}, "
                "for the current to act on its added part; for a wind, write `drag_only: true`",
            )

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid numbers, and a current on a group without a translation."""
        super().check(G, problems)
        if self.current is None:
            return
        here, part = problems.at("current"), G.translation
        if part is None:
            here.add(
                f"needs a group with one translation in m/s, as SE2 and SE3, got {G.name}; remove "
                "this key"
            )
            return
        axes = part.axes.stop - part.axes.start
        if len(self.current) != axes:
            here.add(
                f"expected {axes} numbers or expressions for {G.name}, got {len(self.current)}"
            )
        for index, entry in enumerate(self.current):
            if isinstance(entry, str):
                with here.catching(index):
                    formula(entry)
            else:
                vehicle_parts.check_numbers(entry, here.at(index))


@dataclass(frozen=True)
class ExpressionForce(InExpressions, PlacedForce):
    """A force f(t), one expression per coordinate.

    Attributes
    ----------
    force
        m expressions in t.
    """

    name: ClassVar[str] = "expression"
    departs: ClassVar[str] = "force in time"
    expressed: ClassVar[str] = "force"
    in_time: ClassVar[tuple[str, ...]] = ("force",)

    force: list[str | float | NamedFormula]
    named: Any = field(default=None, init=False, repr=False)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the force: its entries are expressions, even where they are numbers."""
        named = vehicle_parts.named_numbers(self.force, random)
        return with_fields(self.drawn(random), force=self.force, named=named)

    @cached_property
    def expressions(self) -> list[Expression]:
        """The expressions, parsed."""
        return [_expression(entry) for entry in self.force]

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return f(t)."""
        if self.named is None:
            return self.values(t)
        values = self.named.at(t)
        return stack([expression.evaluate(values) for expression in self.expressions])

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which an expression changes its piece, and of short pulses."""
        if self.named is not None:
            return instants_of(self.named.bound(self.expressions), until)
        return super().instants(G, until)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note expressions that do not parse, and a wrong number of them."""
        texts = ["0" if isinstance(entry, NamedFormula) else entry for entry in self.force]
        check_expressions(texts, G.dimension, G, problems.at("force"))


def _expression(entry: Any) -> Expression:
    return entry.expression if isinstance(entry, NamedFormula) else formula(entry)


# Gusts: a smooth random force, a sum of sines whose phases each run draws -------------------------


SINES = 12
"""Number of sines per coordinate; each carries the same part of the variance."""

SHARES = np.tan(np.pi / 2 * (np.arange(SINES) + 0.5) / SINES)
"""ωT in the middle of each part of the spectrum of an Ornstein-Uhlenbeck process."""


def sines(std: Array, time_constant: Any, random: np.random.Generator | None) -> dict[str, Array]:
    """Return frequencies ω ``(sines,)``, a cos φ and a sin φ ``(sines, n)`` of `wave`."""
    a, shape = np.sqrt(2 / SINES) * std, (SINES, len(std))
    phase = np.zeros(shape) if random is None else random.uniform(0, 2 * np.pi, shape)
    numbers = {"sine": a * np.cos(phase), "cosine": a * np.sin(phase)}
    return {"frequency": SHARES / time_constant} | numbers


def wave(part: Any, t: Any) -> Array:
    """Return Σ a sin(ω t + φ) = Σ a cos φ sin ω t + a sin φ cos ω t, ``(..., n)``."""
    angle = (part.frequency * column(t))[..., None, :]
    total: Array = (sin(angle) @ part.sine + cos(angle) @ part.cosine)[..., 0, :]
    return total


@dataclass(frozen=True)
class Gust(PlacedForce):
    """A force with the spectrum of an Ornstein-Uhlenbeck process, its coordinates independent.

    Each coordinate is a sum of sines of equal amplitude, with frequencies that divide the spectrum
    2σ²T / (1 + ω²T²) into equal parts, and with phases that each run draws: its variance is σ².

    Attributes
    ----------
    std
        σ of the coordinates.
    time_constant
        T, s, after which the correlation is about 1/e; 0.31 with these sines.
    """

    name: ClassVar[str] = "gust"
    by_processor: ClassVar[bool] = True  # its sines are drawn by NumPy
    departs: ClassVar[str] = "gusts"
    vectors: ClassVar[tuple[str, ...]] = ("std",)
    positive: ClassVar[tuple[str, ...]] = ("time_constant", *PlacedForce.positive)

    std: Annotated[vehicle_parts.Numbers, Unit(TORQUE)]
    time_constant: Annotated[vehicle_parts.Number, Scale("time constant of the gust", "s")]
    frequency: Any = field(default=None, init=False, repr=False)
    sine: Any = field(default=None, init=False, repr=False)
    cosine: Any = field(default=None, init=False, repr=False)
    axes: Any = field(default=None, init=False, repr=False, metadata=STRUCTURE)

    @property
    def varies(self) -> bool:
        """Whether numbers differ from run to run: the phases always do."""
        return True

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the gust with its sines: frequencies ω ``(sines,)``, a cos φ and a sin φ.

        These are ``(sines, n)`` along the n `axes` whose σ is not 0.
        """
        part, m = self.drawn(random), G.dimension
        std = np.broadcast_to(np.array(self.std, dtype=object), m)
        axes = [k for k in range(m) if vehicle_parts.is_drawn(std[k]) or std[k]]
        waves = sines(np.full(m, part.std, dtype=float), part.time_constant, random)
        waves |= {name: waves[name][:, axes] for name in ("sine", "cosine")}
        return with_fields(part, std=None, time_constant=None, axes=axes, **waves)

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the sum of the sines."""
        force = np.zeros_like(V)
        force[..., self.axes] = wave(self, t)
        return force

    def lever_torque(self, G: MatrixLieGroup, Q: Array) -> tuple[Array, float]:
        """Return σ of the wrench in the body by the lever of a line alone, ``(..., m)``, and T."""
        sigmas = np.zeros((*Q.shape[:-2], G.dimension, G.dimension))
        if self.at == "line":
            std = np.sqrt((self.sine**2 + self.cosine**2).sum(axis=0) / 2)
            sigmas[..., self.axes, self.axes] = std
            Q = Q[..., None, :, :]
            sigmas = G.Ad_star(Q, sigmas) - G.Ad_star(at_origin(G, Q), sigmas)
        return np.linalg.norm(sigmas, axis=-2), float(SHARES[0] / self.frequency[0])

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note negative deviations, a time constant that is not positive, and a wrong length."""
        vehicle_parts.check_count(
            self.std, G.dimension, G.name, problems.at("std"), deviations=True
        )
        vehicle_parts.check_numbers(self.time_constant, problems.at("time_constant"), positive=True)


def column(t: Any) -> Any:
    """Return times ``(samples,)`` as a column that broadcasts with V; one time as it is."""
    times = as_array(t)
    return times[..., None] if times.ndim else t


# Weight and buoyancy of a rigid body, on SE2 and SE3 ----------------------------------------------


GRAVITY = 9.80665
"""Standard acceleration of free fall, m/s²; the mass of the displaced medium is B/g."""


def moment(point: Array, force: Array) -> Array:
    """The torque of a force at a point, ``(..., 3)`` in space and ``(..., 1)`` in the plane."""
    if point.shape[-1] == 3:
        return cross(point, force)
    return stack([point[..., 0] * force[..., 1] - point[..., 1] * force[..., 0]])


def rigid_part(inertia: Inertia) -> Array:
    """Return the inertia of the body without the medium."""
    return inertia.matrix - (0.0 if inertia.added is None else inertia.added)


def mass_of(G: MatrixLieGroup, inertia: Inertia) -> float | None:
    """Return the mass of a rigid body, kg; None with added mass in it, which differs by axis."""
    assert G.translation is not None
    masses = rigid_part(inertia)[G.translation.axes, G.translation.axes]
    least = float(masses[0, 0])
    return least if np.abs(masses - least * np.eye(len(masses))).max() <= ROUNDING * least else None


def weighed(
    G: MatrixLieGroup, acting: tuple[Force, ...], inertia: InertiaLaw | None
) -> tuple[Force, ...]:
    """Return the forces of a run, where those with `gravity` have the weight of an inertia."""
    if inertia is None or not any(map(follows_mass, acting)):
        return acting
    mass: Any = mass_of(G, inertia.at(0.0))
    return tuple(
        with_fields(force, weight=mass * force.gravity) if follows_mass(force) else force
        for force in acting
    )


def follows_mass(force: Any) -> TypeGuard["Restoring"]:
    """Whether a force is a weight that follows from the mass of the body."""
    return isinstance(force, Restoring) and force.gravity is not None


@dataclass(frozen=True)
class Restoring(Force):
    """The weight acts at the centre of mass, downwards; the buoyancy at its own centre, upwards.

    With u the direction upwards in the body frame, the force is (B − W) u and the torque
    r_B × B u − r_G × W u. Only for SE2 and SE3, whose coordinates are torque and force.

    Attributes
    ----------
    weight, buoyancy
        W and B, N.
    gravity
        Instead of `weight`: g of W = m g, m/s². The plant takes the mass of its inertia in each
        run, a law the mass of its model.
    centre_of_mass, centre_of_buoyancy
        r_G and r_B in the body frame, m.
    up
        The direction upwards in the spatial frame, of any length. Default: the last axis, [0, 0, 1]
        on SE3 and [0, 1] on SE2.
    """

    name: ClassVar[str] = "restoring"
    departs: ClassVar[str] = "weight and buoyancy"

    positive: ClassVar[tuple[str, ...]] = ("gravity",)

    weight: Annotated[vehicle_parts.Number | None, Unit("N")] = None
    buoyancy: Annotated[vehicle_parts.Number, Unit("N")] = 0.0
    centre_of_mass: Annotated[list[vehicle_parts.Number] | None, Unit("m")] = None
    centre_of_buoyancy: Annotated[list[vehicle_parts.Number] | None, Unit("m")] = None
    up: list[vehicle_parts.Number] | None = None
    gravity: Annotated[vehicle_parts.Number | None, Unit("m/s^2")] = None

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the force with `up` of length 1."""
        part: Any = super().of_run(G, random)
        assert isinstance(G, EuclideanGroup)
        up = np.eye(G.space)[-1] if part.up is None else part.up
        return with_fields(part, up=np.array(unit_vector(up)))

    @property
    def turns(self) -> bool:
        """Whether weight or buoyancy acts beside the origin."""
        return self.centre_of_mass is not None or self.centre_of_buoyancy is not None

    def in_space(self, G: EuclideanGroup, t: Any, moving: RigidMotion) -> Any:
        """Return (B − W) up, wherever the body points."""
        return (self.buoyancy - self.weight) * np.asarray(self.up)

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return torque and force."""
        assert isinstance(G, EuclideanGroup)
        part: Any = self
        up = (G.rotation(Q) * part.up[..., :, None]).sum(axis=-2)  # Rᵀ up
        lift, weight = self.buoyancy * up, self.weight * up
        torque, force = 0.0 * up[..., : G.rotations], lift - weight
        if part.centre_of_buoyancy is not None:
            torque = torque + moment(part.centre_of_buoyancy, lift)
        if part.centre_of_mass is not None:
            torque = torque - moment(part.centre_of_mass, weight)
        return stack([load[..., k] for load in (torque, force) for k in range(load.shape[-1])])

    @property
    def weight_alone(self) -> "Restoring":
        """The weight without the buoyancy: no accelerometer feels it."""
        return with_fields(self, buoyancy=0.0, centre_of_buoyancy=None)

    def displaced(self, G: MatrixLieGroup) -> Array:
        """Return what makes a wrench of an acceleration of the medium, ``(m, m)``; in a run."""
        assert G.translation is not None
        at, axes, matrix = self.centre_of_buoyancy, G.translation.axes, np.zeros((G.dimension,) * 2)
        matrix[axes, axes] = np.eye(axes.stop - axes.start)
        if at is not None:
            matrix[: axes.start, axes] = moment(np.asarray(at), matrix[axes, axes]).T
        return matrix * self.buoyancy / GRAVITY

    def remarks(self, G: MatrixLieGroup, inertia: Inertia) -> Iterator[tuple[str, str]]:
        """Yield remarks on a weight and a centre of mass that are not those of the inertia."""
        assert isinstance(G, EuclideanGroup) and G.translation is not None
        weight: Any = self.weight
        axes, W = G.translation.axes, float(np.max(weight))
        one, coupling = mass_of(G, inertia), rigid_part(inertia)[: axes.start, axes]
        is_known, I = one is not None, np.eye(G.space)
        mass = W / GRAVITY if one is None else one  # with added mass in it, it is not known
        if W and self.gravity is None and abs(W / (mass * GRAVITY) - 1) > UNLIKE:
            yield (
                "weight",
                f"belongs to {W / GRAVITY:.4g} kg, but the inertia has {mass:.4g} kg, which weigh "
                f"{mass * GRAVITY:.5g} N; correct one of the two, or write `gravity: {GRAVITY}` "
                "instead, by which each run weighs what its inertia has",
            )
        r = np.zeros(G.space) if self.centre_of_mass is None else np.asarray(self.centre_of_mass)
        wanted = moment(r, mass * I).T
        most = (UNLIKE if is_known else 1 - UNLIKE) * np.abs(wanted).max() + ROUNDING * mass
        if W and (is_known or r.any()) and np.abs(coupling - wanted).max() > most:
            there, right = ((x.round(4) + 0.0).tolist() for x in (coupling, wanted))
            yield (
                "centre_of_mass",
                f"does not fit the inertia, whose block of torque and force is {there} where "
                f"m r× is {right}; correct one of the two, or put the origin at the centre of mass",
            )

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SE2 and SE3, invalid points, and a direction that is 0."""
        if not rigid_motions(G):
            problems.add(f"restoring needs group SE2 or SE3, got {G.name}")
            return
        if self.frame != "body":
            problems.at("frame").add(
                "restoring fixes the frame of each of its numbers; remove this key"
            )
        if (self.weight is None) == (self.gravity is None):
            got = "neither" if self.weight is None else "both"
            problems.at("weight").add(f"expected either weight or gravity, got {got}")
        for name in ("weight", "buoyancy"):
            value, here = getattr(self, name) or 0.0, problems.at(name)
            vehicle_parts.check_numbers(value, here)
            if not here and vehicle_parts.lowest(value) < 0:
                here.add(
                    f"expected at least 0 N, got {vehicle_parts.lowest(value):g}; `up` gives the "
                    "direction, and the weight acts against it"
                )
        for name in ("centre_of_mass", "centre_of_buoyancy", "up"):
            value = getattr(self, name)
            if value is not None and len(value) != G.space:
                problems.at(name).add(f"expected {G.space} numbers, got {len(value)}")
            elif value is not None:
                vehicle_parts.check_numbers(value, problems.at(name))
        if self.up is not None and not any(vehicle_parts.drawn(self.up, None)):
            problems.at("up").add("expected a direction, got a vector of zeros")
