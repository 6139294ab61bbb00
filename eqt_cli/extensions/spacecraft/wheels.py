"""Reaction wheels."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from eqt_cli.base.arrays import (
    Array,
    Arrays,
    absolute,
    apply_matrix,
    clip,
    cos,
    exp,
    less,
    maximum,
    norm,
    outside,
    sin,
    stack,
    tanh,
    where,
)
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Angle, Positive, Real, Scale, Unit
from eqt_cli.base.registry import Keys
from eqt_cli.base.stored import SIGNALS, WHEEL, Signal, signal
from eqt_cli.components.actuators import Actuator, check_members, of_each
from eqt_cli.components.allocation import allocation, lost_directions
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.vehicle_parts import Number, Numbers, drawn, is_drawn
from eqt_cli.numbers.leaves import STRUCTURE, with_fields
from eqt_cli.numbers.rounded import is_exact, product, pseudo_inverse, rounded

CREEP = 1.0
"""Scale, rad/s, on which Coulomb friction changes its sign, by a hyperbolic tangent."""

NEAR = 1e-9
"""Relative distance from a limit within which a wheel is at it."""

FLAT = 1e-9
"""Volume of three unit axes below which they lie in one plane."""

_OF_WHEEL = "absolute momentum of each wheel about its axis"
_RELATIVE = "speed of each wheel relative to the body"
MOMENTUM = signal("wheel_momentum", "N m s", "h", dims=(WHEEL,), words=_OF_WHEEL)
SPEED = signal("wheel_speed", "rad/s", r"\Omega", "Ω", dims=(WHEEL,), words=_RELATIVE)

OF_EACH = ("limit", "momentum", "inertia", "speed", "start", "gain", "ki")
"""Options with a number for each wheel."""


@dataclass(frozen=True)
class Friction(Keys):
    """Friction of each wheel, against its speed Ω relative to the body.

    It is c Ω + T_c tanh(Ω/Ω_s), Ω_s = 1 rad/s. With `static`, it is Stribeck's curve as Basilisk's
    reactionWheelStateEffector has it, c Ω + T_c tanh(10 x) + (T_s − T_c) x e^((1 − x²)/2) with
    x = Ω/Ω_b: T_s + c Ω_b at Ω_b, and T_c + c Ω far beyond it. Both are smooth, so that engines
    integrate them without events: a wheel creeps through 0, and never sticks.

    Attributes
    ----------
    viscous
        c, torque over speed, N m s (per rad).
    coulomb
        T_c, torque of dry friction, N m.
    static
        T_s, the largest torque of friction near speed 0, N m; needs `breakaway`.
    breakaway
        Ω_b, the speed at which static friction breaks away, rad/s.
    """

    viscous: Annotated[Real, Unit("N m s")] = 0.0
    coulomb: Annotated[Real, Unit("N m")] = 0.0
    static: Annotated[Real | None, Unit("N m")] = None
    breakaway: Annotated[Positive | None, Unit("rad/s")] = None

    def check(self, problems: Problems) -> None:
        """Note negative torques, and half of a curve."""
        for name in ("viscous", "coulomb"):
            if (value := getattr(self, name)) < 0:
                problems.at(name).add(f"expected at least 0, got {value:g}")
        if (self.static is None) != (self.breakaway is None):
            problems.add("expected static and breakaway, or none of them; give both")
        elif self.static is not None and self.static < self.coulomb:
            least = f"expected at least coulomb, {self.coulomb:g} N m"
            problems.at("static").add(f"{least}, got {self.static:g}")


@dataclass(frozen=True)
class Bias(Keys):
    """Momenta to which torques without effect on the body bring the wheels.

    Attributes
    ----------
    momentum
        Momentum of each wheel, N m s; its part that adds up to 0 counts.
    time_constant
        Time after which 1/e of the difference is left, s.
    """

    momentum: Annotated[list[Real], Unit("N m s")]
    time_constant: Annotated[Positive, Unit("s")]


@dataclass(frozen=True)
class Wheels(Actuator):
    """The torque A u of k wheels with momenta h, ḣ = −u; on groups with the turns of SO3.

    A has the unit axes as columns. The total momentum of body and wheels is R(𝕁ω + A h): 𝕁 is the
    inertia without the spin of the wheels, and h_i the absolute momentum of wheel i about its axis.
    The body feels A u, the friction of the wheels, and (A h) × ω. The last two are not part of the
    stored torque. With a momentum limit, the torques are set at the ticks, so that no momentum is
    beyond it at the next one.

    With `command: speed`, u is what is wanted: the wheels are told speeds Ω_c, with J_w Ω̇_c = −u
    from Ω at t = 0, and the speed loop of each drive gives the torque

        −(g e + z) on the body, within `limit`,  ż = k_i e,  e = Ω_c − Ω,

    which fights the friction of the wheel, too. A momentum limit then limits J_w Ω_c.

    Attributes
    ----------
    axes
        Row i: the axis of wheel i in the body frame, of any length. Of axes that are drawn, the
        allocation knows the means: they are misaligned.
    pyramid
        Instead of `axes`: the angle of four axes from z; seen from above, at 45°, 135°, 225° and
        315° from x.
    limit
        Largest torque, N m.
    momentum
        Largest momentum, N m s.
    inertia
        J_w about the axis, kg m²; gives speeds h_i/J_w − a_iᵀω relative to the body.
    speed
        Instead of `momentum`: the largest |h_i|/J_w, rad/s.
    start
        Momentum at t = 0, N m s. Default: 0.
    friction
        `{viscous: …, coulomb: …, static: …, breakaway: …}`; needs `inertia`.
    command
        `torque`, or `speed` for drives that track a speed; needs `inertia`, `gain`.
    told
        Whether the allocation knows axes that are drawn for a run, and the speeds are computed with
        its J_w, in place of the means.
    gain
        g of the drives, N m s (per rad): a speed is tracked with a lag of J_w/g.
    ki
        k_i of the drives, N m (per rad). Default: none.
    allocation
        `pseudo_inverse`: the torques with the least sum of squares. `min_max`: those whose largest
        is least.
    least
        With `pseudo_inverse`, as `least` of `thrusters`.
    bias
        `{momentum: […], time_constant: …}`: momenta to which wheels are driven, without torque on
        the body, to keep them away from speed 0.
    """

    name: ClassVar[str] = "wheels"
    departs: ClassVar[str] = "reaction wheels"

    axes: list[list[Number]] | None = None
    pyramid: Angle | None = None
    limit: Annotated[Numbers | None, Unit("N m")] = None
    momentum: Annotated[Numbers | None, Unit("N m s")] = None
    inertia: Annotated[Numbers | None, Unit("kg m^2")] = None
    speed: Annotated[Numbers | None, Unit("rad/s")] = None
    start: Annotated[Numbers | None, Unit("N m s")] = None
    friction: Friction | None = None
    allocation: Literal["pseudo_inverse", "min_max"] = "pseudo_inverse"
    least: Annotated[float, Field(ge=0, lt=1)] = 0.05
    bias: Bias | None = None
    command: Literal["torque", "speed"] = "torque"
    gain: Annotated[Numbers | None, Scale("gain of the drives", "N m s")] = None
    ki: Annotated[Numbers | None, Scale("integral gain of the drives", "N m")] = None
    told: bool = False
    moves: bool = field(default=True, init=False, repr=False, metadata=STRUCTURE)
    matrix: Any = field(default=None, init=False, repr=False)
    inverse: Any = field(default=None, init=False, repr=False)
    faces: Any = field(default=(), init=False, repr=False)
    rubbing: Any = field(default=None, init=False, repr=False)
    pulled: Any = field(default=None, init=False, repr=False)
    surplus: Any = field(default=None, init=False, repr=False)
    """J_w relative to that with which the speeds are computed; None for 1."""

    @property
    def limits(self) -> bool:
        """Whether torques or momenta have limits."""
        return self.limit is not None or self.sampled

    @property
    def sampled(self) -> bool:
        """Whether momenta have limits."""
        return self.momentum is not None or self.speed is not None

    @property
    def changes(self) -> bool:  # type: ignore[override]  # a constant of other actuators
        """Whether drives follow a speed relative to the body, which turns."""
        return self.command == "speed"

    @property
    def linear_part(self) -> Actuator:
        """The wheels with the momenta of the start and their drives, without limits, friction."""
        if not self.moves:
            return self
        none = dict.fromkeys(("limit", "momentum", "speed", "bias", "pulled"))
        return with_fields(self, **none, allocation="pseudo_inverse", moves=False)

    @property
    def members(self) -> Mapping[str, tuple[str, ...]]:
        """The wheels, numbered from 1."""
        return {WHEEL: tuple(f"wheel {k + 1}" for k in range(self.count))}

    @property
    def shows(self) -> tuple[Signal, ...]:
        """Their momenta, and with their inertia their speeds; and ‖A h‖."""
        of_wheels = (MOMENTUM,) if self.inertia is None else (MOMENTUM, SPEED)
        return (*of_wheels, SIGNALS["stored_momentum"])

    @property
    def ranges(self) -> Mapping[str, tuple[Any, Any]]:
        """The least and largest momenta."""
        most: Any = self.momentum
        return {} if most is None else {"wheel_momentum": (-most, most)}

    def signals(self, G: MatrixLieGroup, V: Array, command: Array, x: Array) -> Arrays:
        """Return h, the speeds, and ‖A h‖."""
        h = self.momenta(x) + 0.0 * V[..., :1]
        speeds = {} if self.inertia is None else {"wheel_speed": self.speeds(V, x)}
        return {"wheel_momentum": h, **speeds, "stored_momentum": norm(self.stored(x))}

    def stored(self, x: Array) -> Array:
        """Return A h, the momentum that the wheels store, in the body frame."""
        A: Any = self.matrix
        return apply_matrix(A, self.momenta(x))

    @property
    def count(self) -> int:
        """Number k of wheels."""
        if self.matrix is not None:
            return int(self.matrix.shape[-1])
        return 4 if self.axes is None else len(self.axes)

    @property
    def by_processor(self) -> bool:
        """Whether LAPACK takes part in the allocation."""
        return not is_exact(np.asarray(self.matrix))

    def unit_axes(self) -> Array:
        """Return the unit axes as columns, ``(3, k)``."""
        if self.axes is not None:
            A = np.array(drawn(self.axes, None), dtype=float).T
            return A / np.linalg.norm(A, axis=0)
        assert self.pyramid is not None
        half = np.sqrt(0.5) * np.array([[1.0, -1.0, -1.0, 1.0], [1.0, 1.0, -1.0, -1.0]])
        across, z = rounded(lambda beta: stack([sin(beta), cos(beta)]), np.array(self.pyramid))
        return np.concatenate([across * half, np.full((1, 4), z)])

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return wheels with A, the allocation, and a number for each wheel."""
        part, turns = self.drawn(random), _turns(G)
        A, believed = np.zeros((2, G.dimension, self.count))
        A[turns], believed[turns] = part.unit_axes(), (part if self.told else self).unit_axes()
        values = {"start": np.zeros(self.count)} | of_each(part, OF_EACH, self.count)
        if self.changes:
            values.setdefault("ki", np.zeros(self.count))
            if is_drawn(self.inertia) and not self.told:
                values["surplus"] = values["inertia"] / np.array(drawn(self.inertia, None))
        if "speed" in values:
            values["momentum"] = values["inertia"] * values.pop("speed")
        inverse = allocation(believed, part.least, np.ones(self.count))[0]
        values |= {"matrix": A, "inverse": inverse}
        if (rub := self.friction) is not None:
            curve = [] if rub.static is None else [rub.static - rub.coulomb, rub.breakaway]
            values["rubbing"] = np.array([rub.viscous, rub.coulomb, *curve])
        if self.bias is not None:
            null = np.eye(self.count) - product(inverse, believed)
            pull, target = null / self.bias.time_constant, np.array([self.bias.momentum])
            values["pulled"] = np.concatenate([pull, target])
        if self.allocation == "min_max":
            values["faces"] = tuple(_faces(believed, turns))
        used = dict.fromkeys(("axes", "pyramid", "speed", "friction", "bias"))
        return with_fields(part, **used, **values)

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states.

        They are torques that are set at ticks, J_w Ω_c − h and z of drives, and momenta h.
        """
        return (self.sampled + 2 * self.changes + self.moves) * self.count

    def started(self, G: MatrixLieGroup, V: Array) -> Array:
        """Return the states at t = 0."""
        start = self.start + 0.0 * V[..., :1]  # type: ignore[operator]
        drives = [-self.inertia * self._along(V), 0.0 * start] if self.changes else []  # type: ignore[operator]
        held = [0.0 * start] if self.sampled else []
        return np.concatenate([*held, *drives, start], axis=-1)[..., : self.states(G)]

    def momenta(self, x: Array) -> Array:
        """Return h from the states."""
        start: Any = self.start
        return x[..., -self.count :] if self.moves else start

    def speeds(self, V: Array, x: Array) -> Array:
        """Return the speeds relative to the body."""
        speeds: Array = self.momenta(x) / self.inertia - self._along(V)
        return speeds

    def _along(self, V: Array) -> Array:
        """Return the rates of the body about the axes."""
        A: Any = self.matrix
        return apply_matrix(A.swapaxes(-1, -2), V)

    def _drives(self, x: Array) -> tuple[Array, Array]:
        """Return ż and −(g e + z) of the drives."""
        k, first = self.count, self.count * self.sampled
        ahead, z = x[..., first : first + k], x[..., first + k : first + 2 * k]
        e = ahead / self.inertia + (self._along(self.moving[0].V) if self.moving else 0.0)
        return self.ki * e, -(self.gain * e + z)  # type: ignore[operator]

    @property
    def allocation_matrix(self) -> tuple[Array, Array | None, Array | None] | None:
        """B⁺, ``(k, m)``, and the limits, but behind a bias; None for `min_max`."""
        if self.faces:
            return None
        if self.limit is None or self.pulled is not None:
            return self.inverse, None, None
        return self.inverse, -self.limit, self.limit

    def allocated(self, command: Array) -> Array:
        """Return torques u with A u = command."""
        if not self.faces:
            return apply_matrix(self.inverse, command)
        # Each pair of wheels spans a face of the torques that are possible (Markley et al. 2010).
        torques, most = apply_matrix(self.faces[0][..., 1:, :], command), 0.0 * command[..., :1]
        for face in self.faces:
            size = absolute(apply_matrix(face[..., :1, :], command))
            larger = less(most, size)
            torques = where(larger, apply_matrix(face[..., 1:, :], command), torques)
            most = where(larger, size, most)
        return torques

    def _commanded(self, command: Array, x: Array) -> Array:
        """Return the torques for a command, without limits."""
        u = self.allocated(command)
        if self.pulled is not None:
            null, target = self.pulled[..., :-1, :], self.pulled[..., -1, :]
            u = u + apply_matrix(null, self.momenta(x) - target)
        return u

    def _within(self, u: Array) -> Array:
        """Return torques within their limit."""
        return u if self.limit is None else clip(u, -self.limit, self.limit)

    def torques(self, command: Array, x: Array) -> Array:
        """Return the torque of each wheel on the body."""
        return self._within(self._drives(x)[1]) if self.changes else self._wanted(command, x)

    def _wanted(self, command: Array, x: Array) -> Array:
        """Return u."""
        return x[..., : self.count] if self.sampled else self._within(self._commanded(command, x))

    def within(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return A u, before any drive."""
        A: Any = self.matrix
        return apply_matrix(A, self._wanted(command, x))

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return A times the torques of the wheels."""
        A: Any = self.matrix
        return apply_matrix(A, self.torques(command, x))

    def allowed(self, G: MatrixLieGroup, command: Array) -> Array | None:
        """Return what the limit of torques leaves of a command, without a bias and momenta."""
        if self.limit is None:
            return None
        A, u = self.matrix, self.allocated(command)
        return command + apply_matrix(A, clip(u, -self.limit, self.limit) - u)

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return ḣ = −u, without friction, and the rates of drives."""
        u = self.torques(command, x)
        rates = [0.0 * u] if self.sampled else []
        if self.changes:
            wanted = self._wanted(command, x)
            if self.surplus is not None:
                wanted = self.surplus * wanted
            rates += [u - wanted, self._drives(x)[0]]
        if self.moves:
            rates.append(-u)
        return np.concatenate(rates, axis=-1)

    def reaction(self, G: MatrixLieGroup, V: Array, x: Array) -> tuple[Array, Array]:
        """Return (A h) × ω with the friction on the body, and the rates that friction causes."""
        A: Any = self.matrix
        force, rate = G.ad_star(V, apply_matrix(A, self.momenta(x))), 0.0 * x
        if self.rubbing is None or not self.moves:
            return force, rate
        speed, curve = self.speeds(V, x), self.rubbing[..., 2:]
        rubbing, slip = self.rubbing[..., :1] * speed, speed / CREEP
        if curve.shape[-1]:
            ratio = speed / curve[..., 1:]
            slip = 10.0 * ratio
            rubbing = rubbing + curve[..., :1] * ratio * exp(0.5 - 0.5 * ratio * ratio)
        rubbing = rubbing + self.rubbing[..., 1:2] * tanh(slip)
        drives = [rubbing, 0.0 * rubbing] if self.changes else []
        held = [0.0 * rubbing] if self.sampled else []
        return force + apply_matrix(A, rubbing), np.concatenate([*held, *drives, -rubbing], axis=-1)

    def step(self, G: MatrixLieGroup, command: Array, x: Array, period: float) -> Array:
        """Return the states with the torques until the next tick, if momenta have limits."""
        if not self.sampled:
            return x
        h, most = self._limited_h(x), self.momentum
        u = self._within(self._commanded(command, x))
        step = period if self.surplus is None else period * self.surplus
        u = clip(u, (h - most) / step, (h + most) / step)
        return np.concatenate([u, x[..., self.count :]], axis=-1)

    def _limited_h(self, x: Array) -> Array:
        """Return the momenta that are limited: J_w Ω_c of drives, else h."""
        return self.momenta(x) + (x[..., self.count : 2 * self.count] if self.changes else 0.0)

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array | None:
        """Return 1 where a torque is beyond its limit, or a momentum at its own, else 0."""
        beyond: Any = np.zeros(command.shape[:-1])
        pairs = [(self.limit, self._commanded(command, x)), (self.momentum, self._limited_h(x))]
        if self.changes:
            pairs.append((self.limit, self._drives(x)[1]))
        for limit, values in pairs:
            if limit is not None:
                most = limit * (1 - NEAR)
                beyond = maximum(beyond, outside(values, -most, most))
        return beyond

    def remarks(self, G: MatrixLieGroup, wanted: Array) -> Iterator[str]:
        """Yield a remark on the turns about which no wheel has a torque."""
        turns = wanted[np.abs(wanted[:, _turns(G)]).any(axis=1)]
        part = self if self.matrix is not None else self.of_run(G, None)
        least = 0.0 if self.allocation == "min_max" else self.least
        yield from lost_directions(G, turns, turns @ part.matrix, least, self.name)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without wheels, and missing numbers."""
        if _turns(G) is None:
            problems.add(f"wheels need a body that turns about three axes, got group {G.name}")
        if (self.axes is None) == (self.pyramid is None):
            got = "neither" if self.axes is None else "both"
            problems.add(f"expected either axes or pyramid, got {got}")
        for index, axis in enumerate(self.axes or ()):
            if len(axis) != 3 or not any(axis):
                problems.at("axes", index).add(f"expected three numbers, not all 0, got {axis}")
        if not problems:
            self._check_numbers(problems)
        if not problems and self.sampled:
            most, bias = self.of_run(G, None), self.bias
            self._check_momenta(most, most.start, problems.at("start"))
            self._check_momenta(most, bias and bias.momentum, problems.at("bias", "momentum"))

    def _check_momenta(self, most: Self, momenta: Any, problems: Problems) -> None:
        """Note momenta beyond the limit of wheels, by the means."""
        limit: Any = most.momentum
        if momenta is not None:
            for k in np.flatnonzero(np.abs(momenta) > limit):
                problems.add(
                    f"expected at most the limit of the momentum, {limit[k]:g} N m s, got "
                    f"{momenta[k]:g} for wheel {k + 1}"
                )

    def _check_numbers(self, problems: Problems) -> None:
        threes = map(list, combinations(range(self.count), 3))
        volumes = [abs(np.linalg.det(self.unit_axes()[:, three])) for three in threes]
        if self.allocation == "min_max" and min(volumes, default=0.0) < FLAT:
            problems.at("allocation").add(
                "min_max needs axes of which no three lie in a plane; use pseudo_inverse"
            )
        self._check_others(problems)
        (self.friction or Friction()).check(problems.at("friction"))
        check_members(self, self.count, "wheel", OF_EACH, "start", problems)

    def _check_others(self, problems: Problems) -> None:
        if self.speed is not None and self.momentum is not None:
            problems.at("speed").add("give momentum or speed, not both")
        for name in ("speed", "friction", "command"):
            applies = name != "command" or self.changes
            if applies and getattr(self, name) is not None and self.inertia is None:
                problems.at(name).add("needs inertia; give the inertia of a wheel about its axis")
        if self.changes and self.gain is None:
            problems.add("command: speed needs gain, the gain of the drives; for example 1 mN m s")
        if not self.changes:
            for name in ("gain", "ki"):
                if getattr(self, name) is not None:
                    problems.at(name).add("applies to drives only; add command: speed")
        if self.bias is not None and len(self.bias.momentum) != self.count:
            expected = f"expected {self.count} entries, one for each wheel"
            problems.at("bias", "momentum").add(f"{expected}, got {len(self.bias.momentum)}")
        if self.bias is not None and self.count == 3:
            problems.at("bias").add("three wheels have no null space; remove this key")


def _turns(G: MatrixLieGroup) -> Any:
    """Return the coordinates of the turns in space; None where a group has none."""
    turns = (part.axes for part in G.parts if part.turns)
    return next((axes for axes in turns if len(range(G.dimension)[axes]) == 3), None)


def _faces(A: Array, turns: Any) -> list[Array]:
    """Return c and M of each pair of wheels, ``(1 + k, m)``, with the rows c, M.

    Where |c·τ| is the largest of all pairs, M τ is the allocation of which the largest torque is
    least: all other wheels give ± c·τ, and the pair gives the rest.
    """
    faces = []
    for pair in map(list, combinations(range(A.shape[1]), 2)):
        normal = np.zeros(len(A))
        normal[turns] = np.cross(*A[turns][:, pair].T)
        along = product(normal[None], A)[0]
        along[pair] = 0.0
        c, M = normal / np.abs(along).sum(), np.zeros(A.T.shape)
        M += np.outer(np.sign(along), c)
        M[pair] = product(pseudo_inverse(A[:, pair], 2), np.eye(len(A)) - product(A, M))
        faces.append(np.concatenate([c[None], M]))
    return faces
