"""A cascade whose position loop is a P of the position around a PI of the velocity, as in PX4."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator

from eqt_cli.base.arrays import (
    Array,
    absolute,
    apply,
    apply_matrix,
    clip,
    cos,
    cross,
    dot,
    less,
    maximum,
    minimum,
    norm,
    sin,
    sqrt,
    stack,
    where,
)
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Positive, Real, Scale, Unit
from eqt_cli.base.registry import Keys
from eqt_cli.components.laws import EachAxis, check_each_axis
from eqt_cli.components.matrix_groups import rigid
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.motions import PlantModel, RigidMotion, body_axes
from eqt_cli.extensions.underactuated.attitude import Attitude
from eqt_cli.extensions.underactuated.cascade import Cascade, or_none
from eqt_cli.numbers.jets import Jet

TINY = 1e-12
"""Less than any speed or acceleration that decides a direction."""


@dataclass(frozen=True)
class VelocityGains(Keys):
    """Gains and limits of a position loop around a velocity loop.

    Attributes
    ----------
    kp
        k_p of the position, 1/s: a number, or one for each axis of space.
    kv
        k_v of the velocity, 1/s, likewise.
    ki
        k_i of the velocity, 1/s², likewise.
    i_limit
        Largest vertical part of the integral, m/s².
    horizontal_speed, up_speed, down_speed
        Limits of the velocity that is asked for, m/s.
    tilt
        Limit of the tilt, rad; below 90 deg.
    least, most
        Limits of the push, N.
    margin
        What of `most` the horizontal part keeps where the vertical one wants all, N.
    period
        Of this loop, s: a whole number of control periods.
    """

    kp: Annotated[EachAxis, Scale("k_p of the position", "1/s", is_symbol=True)]
    kv: Annotated[EachAxis, Scale("k_v of the velocity", "1/s", is_symbol=True)]
    ki: Annotated[
        Real | list[Real] | None,
        Scale("k_i of the velocity", "1/s^2", is_symbol=True),
        AfterValidator(or_none),
    ] = None
    i_limit: Annotated[Positive | None, Unit("m/s^2")] = None
    horizontal_speed: Annotated[Positive | None, Unit("m/s")] = None
    up_speed: Annotated[Positive | None, Unit("m/s")] = None
    down_speed: Annotated[Positive | None, Unit("m/s")] = None
    tilt: Annotated[Positive | None, Unit("rad")] = None
    least: Annotated[Positive | None, Unit("N")] = None
    most: Annotated[Positive | None, Unit("N")] = None
    margin: Annotated[Real, Unit("N")] = 0.0
    period: Annotated[Positive | None, Scale("period of the position loop", "s")] = None

    # What a cascade asks of its gains.
    c1: ClassVar[Any] = None
    limit: ClassVar[Any] = None
    anti_windup: ClassVar[Any] = "none"
    k_x: ClassVar[Any] = None
    k_v: ClassVar[Any] = None
    kx: ClassVar[Any] = property(lambda self: self.kp * self.kv)

    def check(self, space: int, problems: Problems) -> None:
        """Note gains that are not for each axis, and limits that exclude each other."""
        for name in ("kp", "kv", "ki"):
            check_each_axis(getattr(self, name), space, problems.at(name))
        if self.ki is not None and np.min(self.ki) < 0:
            problems.at("ki").add(f"expected at least 0, got {np.min(self.ki):g}")
        if self.tilt is not None and self.tilt >= np.pi / 2:
            got = np.degrees(self.tilt)
            problems.at("tilt").add(f"expected less than 90 deg, got {got:g} deg")
        if self.most is not None and (self.least or 0.0) >= self.most:
            problems.at("least").add(f"expected less than most, {self.most:g} N")
        if self.margin and (self.most is None or not 0 <= self.margin <= self.most):
            of = (
                "needs most" if self.most is None else f"expected from 0 to {self.most:g} N, `most`"
            )
            problems.at("margin").add(f"{of}, got {self.margin:g}")
        if self.i_limit is not None and self.ki is None:
            problems.at("i_limit").add("applies to the integral only; add ki")


@dataclass(frozen=True)
class VelocityCascade(Cascade):
    """A cascade with limits as autopilots have them: P of the position, PI of the velocity; SE3.

    v_c = k_p (p_d − p) + ṗ_d within the limits of the speed, where the part by the position goes
    first, a = p̈_d + k_v (v_c − v) + z and ż = k_i (v_c − v). The body axis of the push is to point
    along a_h + h, with the horizontal part a_h of a and the acceleration h against the weight,
    within the limit of the tilt; other known forces are taken from a. The push is such that its
    vertical part gives that of a, along the commanded axis: it does not depend on the attitude. The
    first axis of the body has the heading as seen from above; in a `cascade`, the plane with F has
    it. The push is limited with priority for the vertical part; z is stopped there where it would
    go further, and horizontally it is led back by 2/k_v of what is cut.

    PX4's PositionControl.cpp (commit 02c4e036) in continuous time or at instants, apart from its D
    term, the gain of a measured acceleration. Nothing is claimed.

    Attributes
    ----------
    attitude
        The attitude law: a kind of SO3, or a mapping with `kind` and options, such as `{kind: rate,
        kp: [6.5, 6.5, 2.8], error: reduced}`.
    position
        Gains and limits of both loops.
    rates
        Rates of the commanded attitude: `none`, 0, or `heading`, ψ̇ about the third axis.
    along
        The body axis of the push. Default: the only direction in which actuators push.
    """

    name: ClassVar[str] = "velocity_cascade"
    bandwidth: ClassVar[Any] = None  # type: ignore[misc]

    position: VelocityGains  # type: ignore[assignment]
    rates: Literal["none", "heading"] = "none"

    def for_plant(self, G: Any, plant: PlantModel, problems: Problems) -> "VelocityCascade":
        """Return the law with what it knows, after noting a plane and missing weight."""
        if rigid(G).space == 2:
            problems.add("velocity_cascade needs SE3, got SE2; use cascade in the plane")
        elif not any(hasattr(force, "weight_alone") for force in plant.forces):
            problems.add(
                "needs the weight in model.forces, against which it hovers, such as model: "
                "{forces: [{kind: restoring, weight: 9.81}]}"
            )
        law: Any = super().for_plant(G, plant, problems)
        return law

    @property
    def undefined(self) -> str:  # type: ignore[override]
        """Nothing where the push has a least size."""
        return "" if self.position.least else "a cascade whose force passes 0 has no attitude"

    def _loops(self, s: Tracking) -> tuple[Array, Array]:
        """Return F/m, and the rate of the integral."""
        return s.once("loops", self._both_loops)

    def _hover(self, s: Tracking) -> tuple[Array, Array, Array]:
        """Return the upward direction, the acceleration against the weight, and by other forces."""
        G = rigid(s.G)
        p, v = self._motion(s)
        motion = RigidMotion(G, G.rotation(s.Q), s.V[..., :3], Jet.of([p]), Jet.of([v]))
        hover: Any = 0.0 * p
        others = hover
        for force in self.known_forces:
            pull: Any = force.in_space(G, Jet.time(s.t, 0), motion)
            a = (pull.value if isinstance(pull, Jet) else pull) / _mass(s)
            hover, others = (
                (hover - a, others) if hasattr(force, "weight_alone") else (hover, others + a)
            )
        size = norm(hover)[..., None]
        return hover / size, size, others

    def _motion(self, s: Tracking) -> tuple[Array, Array]:
        """Return position and velocity in space."""
        G = rigid(s.G)
        return G.translations(s.Q)[..., 0], apply_matrix(G.rotation(s.Q), s.V[..., 3:])

    def _both_loops(self, s: Tracking) -> tuple[Array, Array]:
        assert s.flat is not None
        gains, mass, (p, v) = self.position, _mass(s), self._motion(s)
        up, size, others = s.once("hover", self._hover)
        v0, v1 = gains.kp * (s.flat.position[..., 0, :] - p), s.flat.position[..., 1, :]
        climb = dot(v0 + v1, up)[..., None]
        across = _within(_flat(v0, up), _flat(v1, up), gains.horizontal_speed)
        if gains.up_speed is not None:
            climb = minimum(climb, gains.up_speed + 0.0 * climb)
        if gains.down_speed is not None:
            climb = maximum(climb, 0.0 * climb - gains.down_speed)
        error = across + climb * up - v
        a = s.flat.position[..., 2, :] + gains.kv * error - others
        if "integral" in s.memory:
            a = a + s.memory["integral"]
        rise = dot(a, up)[..., None]
        aside = a - rise * up
        leaning = aside / size
        if gains.tilt is not None:
            most, tangent = apply("tan", gains.tilt), norm(leaning)[..., None]
            leaning = leaning * minimum(most / (tangent + TINY), 1.0 + 0.0 * tangent)
        lean = sqrt(1.0 + dot(leaning, leaning))[..., None]
        push = (rise + size) * lean
        if gains.least is not None:
            push = maximum(push, gains.least / mass)
        vertical, level = push / lean, push / lean * leaning
        return self._saturated(error, vertical, level, aside, up, mass)

    def _saturated(
        self, error: Array, vertical: Any, level: Any, aside: Array, up: Array, mass: Any
    ) -> tuple[Array, Array]:
        """Return F/m within the limits of the push, and the rate of the integral."""
        gains, rising = self.position, dot(error, up)[..., None]
        stopped = rising
        if gains.least is not None:
            below = where(less(0.0, rising), rising, 0.0 * rising)
            stopped = where(less(gains.least / mass, vertical), stopped, below)
        if gains.most is not None:
            most = gains.most / mass
            above = where(less(rising, 0.0), rising, 0.0 * rising)
            stopped = where(less(vertical, most), stopped, above)
            wide = norm(level)[..., None]
            spared = minimum(wide, gains.margin / mass)
            vertical = minimum(vertical, sqrt(most * most - spared * spared))
            left = sqrt(maximum(most * most - vertical * vertical, 0.0 * vertical))
            level = level * minimum(left / (wide + TINY), 1.0 + 0.0 * wide)
        is_cut = less(dot(level, level), dot(aside, aside))[..., None]
        first = gains.kv if np.ndim(gains.kv) == 0 else gains.kv[..., :1]
        led = where(is_cut, aside - level, 0.0 * aside)
        rate: Any = 0.0 if gains.ki is None else gains.ki
        rate = rate * (_flat(error, up) + stopped * up - 2.0 / first * led)
        return vertical * up + level, rate

    # In place of the parts of a cascade.

    def _acceleration(self, s: Tracking) -> tuple[Jet, Array]:
        force, rate = self._loops(s)
        return Jet.of([force]), rate

    def oriented(self, force: Jet, heading: Jet | None, R: Array, side: Any) -> Attitude:
        """Return the attitude whose first axis has the heading, seen from above."""
        if heading is None:
            return super().oriented(force, heading, R, side)
        n, psi = force.value / norm(force.value)[..., None], heading.value
        b3 = n if self.direction[2] >= 0 else -n
        b1 = cross(stack([-sin(psi), cos(psi), 0.0 * psi]), b3)
        b1 = b1 / norm(b1)[..., None]
        axes, still = body_axes(self.direction), 0.0 * b3
        return Attitude(stack([b1, cross(b3, b1), b3]) @ axes.T, still, still)

    def push(self, acceleration: Any, b: Any) -> Any:
        """Return |F|/m."""
        return norm(acceleration)

    output_units: ClassVar[Mapping[str, str]] = {"integral": "m/s^2"}

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Mapping[str, Array]]:
        """Return the command, and the memory a period later, with an integral within its limit."""
        command, later = super().answer(s, period)
        if (limit := self.position.i_limit) is None or "integral" not in s.memory:
            return command, later
        z, up = later["integral"], s.once("hover", self._hover)[0]
        part = dot(z, up)[..., None]
        return command, {**later, "integral": z + (clip(part, -limit, limit) - part) * up}


def _mass(s: Tracking) -> Any:
    """Return m, ``(..., 1)``."""
    return s.inertia.matrix[..., 3, 3, None]


def _flat(x: Array, up: Array) -> Array:
    """Return the part of a vector across the vertical."""
    return x - dot(x, up)[..., None] * up


def _within(first: Array, second: Array, most: Any) -> Array:
    """Return first + second, of which the second is shortened, then the first, to a size."""
    if most is None:
        return first + second
    size, whole = norm(first)[..., None], norm(first + second)[..., None]
    ahead = second / (norm(second)[..., None] + TINY)
    along = dot(ahead, first)[..., None]
    room = along * along - size * size + most * most
    reached = first + ahead * (sqrt(absolute(room)) - along)
    alone = first / (size + TINY) * most
    return where(less(most, whole), where(less(size, most), reached, alone), first + second)
