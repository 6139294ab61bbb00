"""A closed loop linearised about its reference, as matrices; it knows no engine.

The loop's own code is differentiated by finite differences: law, hold, delay and actuators are
those of a run.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from eqt_cli.closed_loop.system import DESIRED, ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.tracking import Gains, Tracking
from eqt_cli.vehicle.sensors.channels import FIRST, MEASURED, Errors

STEP = 1e-4
"""Step of a difference. Rounding then changes a derivative by 1e-12, and truncation by less; a kink
at the reference itself, such as quadratic drag at rest, changes it by 1e-4 of its coefficient."""

STENCIL = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
"""Weights of a fourth-order first derivative, by the number of steps from the centre."""

SMOOTH = 0.1
"""Relative: where differences over one step and over two differ by more, the function jumps or is
not finite, and has no derivative. At a jump they differ by half."""

MOST_ITERATIONS = 20
"""Limit on Newton's iterations for the state where a loop comes to rest; it takes 2 to 5."""

AT_REST = 1e-6
"""Newton step, rad or m, below which a loop is at rest. References are integrated to 1e-8."""

SAME = 1e-6
"""Relative difference below which matrices count as equal."""

_ELSEWHERE = {"pose", "momentum", *DESIRED, "work"}
"""Stretches of a flat state that are not copied into x as they are."""


@dataclass(frozen=True)
class Linearised:
    """The linearised loop at some times, opened where the law gives its command.

    Continuous: ẋ = A x + B u, y = C x. Sampled: A x + B u is x one period later, just before the
    next control instant. The loop is closed by u = y; a further delay acts between y and u. The
    state is x = (ε, e, z, …): the body error ε (left-trivialised) with Q = Q_d exp(ε), whose rate
    is e = V − Ad_{Q_L⁻¹}V_d to first order; the memory z of the law; the states of the actuators
    and the delayed commands.

    Attributes
    ----------
    A : (times, n, n)
    B : (times, n, m)
    C : (times, m, n)
    period
        Control period of a sampled loop, s; None for a continuous one.
    offset : (times, m)
        ε of the states about which it is linearised.
    is_constant
        Whether the loop stays at these states and has the same matrices at all times; all axes of
        times then have length 1. Else it is linearised about its reference.
    """

    A: Array
    B: Array
    C: Array
    period: float | None
    offset: Array
    is_constant: bool
    about: "_About" = dataclasses.field(repr=False)

    @cached_property
    def closed(self) -> Array:
        """The matrix A + BC of the closed loop."""
        return self.A + self.B @ self.C

    @cached_property
    def eigenvalues(self) -> Array:
        """The closed loop's eigenvalues, ``(times, n)``: rates, 1/s, or multipliers per period."""
        return np.linalg.eigvals(self.closed)

    def with_gains(self, factors: Mapping[str, float]) -> "Linearised":
        """Return the loop about the same states with its gains kp and kd multiplied."""
        own, kp, kd = self.about.loop.gains, factors.get("kp", 1.0), factors.get("kd", 1.0)
        loop = dataclasses.replace(self.about.loop, gains=Gains(kp * own.K, kd * own.K_d))
        about = dataclasses.replace(self.about, loop=loop)
        if self.period is not None:  # motion under a held command does not depend on gains
            vars(about).update(_flow=self.about._flow, held=self.about.held)
        return about.linearised(self.is_constant)


@dataclass(frozen=True)
class _Pushed(ClosedLoop):
    """A loop with `push` added to the command of the law."""

    push: Array = dataclasses.field(default_factory=lambda: np.zeros(1))

    def command(self, s: Tracking) -> Array:
        return super().command(s) + self.push


class _Derivative(NamedTuple):
    """A function at 0, ``(times, l)``, and its first derivative, ``(times, l, k)``."""

    value: Array
    slope: Array


def linearised(loop: ClosedLoop, times: Array, poses: Array, velocities: Array) -> Linearised:
    """Linearise a loop, without limits and steps; NaN where it has no derivative.

    It is linearised about its reference. If it does not depend on time to first order, and a force
    keeps it off its reference, it is linearised about the states where it comes to rest.

    Parameters
    ----------
    times : (times,)
        Times, s.
    poses, velocities
        Q_d and V_d at these times, ``(times, d, d)`` and ``(times, m)``.
    """
    loop = dataclasses.replace(loop, vehicle=loop.vehicle.linear_part)
    about = _About.reference(loop, times, poses, velocities)
    if not about.is_same_at_all_times:
        return about.linearised()
    first = about.at_first_time
    for _ in range(MOST_ITERATIONS):
        step = first.steps_to_rest()
        if np.abs(step).max() <= AT_REST:
            return first.linearised(is_constant=True)
        if not np.isfinite(step).all():
            break
        first = first.moved(step)
    return about.linearised()


def flow(loop: ClosedLoop, times: Array, poses: Array, velocities: Array) -> Array:
    """Return the matrix of ẋ about the reference, for a sampled loop while its command is held.

    ``(times, n, n)``; NaN where there is no derivative.
    """
    loop = dataclasses.replace(loop, vehicle=loop.vehicle.linear_part)
    return _About.reference(loop, times, poses, velocities).flow


def _same(arrays: Array) -> bool:
    """Return whether arrays are the same at all times; False if they are not finite."""
    return bool(np.abs(arrays - arrays[0]).max() <= SAME * np.abs(arrays).max())


@dataclass(frozen=True)
class _About:
    """A chart (x, u) of flat states about base states with e = 0.

    u is added to the command of the law.

    Attributes
    ----------
    poses
        Q at x = 0, ``(times, d, d)``.
    states
        Flat states from which all else is taken, ``(times, l)``.
    errors
        A measurement without errors, where sensors hold their measurements.
    """

    loop: ClosedLoop
    times: Array
    poses: Array
    states: Array
    errors: Errors | None
    offset: Array

    @classmethod
    def reference(cls, loop: ClosedLoop, times: Array, poses: Array, velocities: Array) -> Self:
        """Return the chart about the reference, with all other states as at the start of a run."""
        states, errors = loop.initial_state(poses, velocities, poses, velocities, times), None
        if channels := loop.vehicle.holding(loop.group):
            still = np.zeros(loop.group.dimension)
            first = Errors(loop.group.identity, still, np.full(len(channels), FIRST))
            states = loop.measured(times, states, first)
            errors = first._replace(arrived=np.full(len(channels), MEASURED))
        return cls(loop, times, poses, states, errors, np.zeros_like(velocities))

    @cached_property
    def others(self) -> dict[str, slice]:
        """The slice in x of each stretch that is copied into x as it is."""
        found, begin = {}, 2 * self.loop.group.dimension
        for name, length in self.loop.layout.lengths.items():
            if name not in _ELSEWHERE:
                found[name] = slice(begin, begin + length)
                begin += length
        return found

    @property
    def dimension(self) -> int:
        """The dimension of x."""
        m = self.loop.group.dimension
        return 2 * m + sum(where.stop - where.start for where in self.others.values())

    def moved(self, x: Array) -> Self:
        """Return the chart about the states at x, ``(times, n)``; e in x is ignored."""
        m = self.loop.group.dimension
        poses = self.poses @ self.loop.group.exp(x[:, :m])
        found = self.loop.layout.split(self.states)
        found |= {name: found[name] + x[:, where] for name, where in self.others.items()}
        states = self.loop.layout.join(found, self.states)
        offset = self.loop.group.log(self.loop.group.inverse(self.desired) @ poses)
        return dataclasses.replace(self, poses=poses, states=states, offset=offset)

    @cached_property
    def desired(self) -> Array:
        """The desired pose Q_d."""
        return self.loop.tracking(self.times, self.states).Qd

    @property
    def is_same_at_all_times(self) -> bool:
        """Whether neither the matrices nor the steps to rest depend on time."""
        found = (self._flow,) if self._is_continuous else (self._flow, self._jump)
        if not all(_same(each.slope) for each in found):
            return False
        steps = self.steps_to_rest()
        return bool(np.abs(steps - steps[0]).max() <= AT_REST)

    @property
    def at_first_time(self) -> Self:
        """The chart at the first of the times."""
        one = {name: getattr(self, name)[:1] for name in ("times", "poses", "states", "offset")}
        return dataclasses.replace(self, **one)

    @property
    def _is_continuous(self) -> bool:
        return self.loop.vehicle.control is None

    def linearised(self, is_constant: bool = False) -> Linearised:
        """Return the matrices of the linearised loop."""
        n, control = self.dimension, self.loop.vehicle.control
        whole = (self._flow if control is None else self._jump).slope
        closed, B, C = whole[:, :n, :n], whole[:, :n, n:], whole[:, n:, :n]
        A, period = closed - B @ C, None
        if control is not None:
            A, B, period = self.held @ A, self.held @ B, control.period
        return Linearised(A, B, C, period, self.offset, is_constant, self)

    @cached_property
    def held(self) -> Array:
        """The transition matrix of x over a period under a held command, ``(times, n, n)``."""
        from scipy.linalg import expm  # slow to import

        assert self.loop.vehicle.control is not None
        flow = self.loop.vehicle.control.period * self.flow
        found: Array = expm(flow) if np.isfinite(flow).all() else np.full_like(flow, np.nan)
        return found

    @property
    def flow(self) -> Array:
        """The matrix of ẋ, for a sampled loop while its command is held, ``(times, n, n)``."""
        return self._flow.slope[:, : self.dimension, : self.dimension]

    def steps_to_rest(self) -> Array:
        """Return Newton's steps to the states where the loop is at rest, ``(times, n)``.

        All use the matrices at the first time.
        """
        n = self.dimension
        value, slope = self._flow.value[:, :n], self._flow.slope[0, :n, :n]
        if not self._is_continuous:  # at rest, a control instant changes nothing
            value = np.concatenate([value, self._jump.value[:, :n]], axis=1)
            slope = np.concatenate([slope, self._jump.slope[0, :n, :n] - np.eye(n)])
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            return np.full((len(value), n), np.nan)
        found: Array = -np.linalg.lstsq(slope, value.T)[0].T
        return found

    @cached_property
    def _flow(self) -> _Derivative:
        return self._derivative(self._rates_and_command)

    @cached_property
    def _jump(self) -> _Derivative:
        return self._derivative(self._change_and_command)

    def _derivative(self, function: Callable[[Array], Array]) -> _Derivative:
        """Differentiate a function of (x, u), ``(k, 1, n + m) -> (k, times, l)``."""
        count = self.dimension + self.loop.group.dimension
        moved = [number * np.eye(count) for number in STENCIL]
        points = STEP * np.concatenate([np.zeros((1, count)), *moved])
        with np.errstate(all="ignore"):
            values = function(points[:, None])
        around = dict(zip(STENCIL, values[1:].reshape(-1, count, *values.shape[1:]), strict=True))
        slope = sum(weight * around[number] for number, weight in STENCIL.items()) / STEP
        near, far = ((around[k] - around[-k]) / (2 * k * STEP) for k in (1, 2))
        if not np.abs(far - near).max() <= SMOOTH * np.abs(slope).max():
            slope = np.full_like(slope, np.nan)
        return _Derivative(values[0], np.moveaxis(slope, 0, -1))

    def _flat(self, x: Array) -> Array:
        """Return the flat states at x, ``(k, times, l)``."""
        loop, m = self.loop, self.loop.group.dimension
        like = np.empty((len(x), *self.states.shape))
        found = loop.layout.split(self.states)
        found |= {name: found[name] + x[..., where] for name, where in self.others.items()}
        found["pose"] = loop.group.pack(self.poses @ loop.group.exp(x[..., :m]))
        s = loop.tracking(self.times, loop.layout.join(found, like))
        found["momentum"] = s.inertia.momentum(s.relative.Vd + x[..., m : 2 * m])
        return loop.layout.join(found, like)

    def _rates_and_command(self, x: Array) -> Array:
        """Return the time derivative of x, and the command."""
        loop = dataclasses.replace(_Pushed.of(self.loop), push=x[..., self.dimension :])
        states = self._flat(x)
        s, rates = loop.tracking(self.times, states), loop.vector_field(self.times, states)
        found, r = loop.layout.split(rates), s.relative
        V_dot = s.inertia.velocity(found["momentum"] - s.inertia.rate_force(s.V))
        others = [found[name] for name in self.others]
        return np.concatenate([r.V_tilde, V_dot - r.Vd_dot, *others, self.loop.command(s)], axis=-1)

    def _change_and_command(self, x: Array) -> Array:
        """Return x after a control instant, relative to the base states, and the command."""
        loop, t, control = self.loop, self.times, self.loop.vehicle.control
        assert control is not None
        states = loop.measured(t, self._flat(x), self.errors)
        told, memory = loop.told(t, states, self.errors), loop.memory(states)
        command, memory = loop.answer(told, memory, control.period)
        after = loop.answered(t, states, command + x[..., self.dimension :], memory)
        there, here = loop.layout.split(after), loop.layout.split(self.states)
        still = np.zeros((*command.shape[:-1], 2 * loop.group.dimension))
        still += x[..., : still.shape[-1]]
        others = [there[name] - here[name] for name in self.others]
        return np.concatenate([still, *others, command], axis=-1)
