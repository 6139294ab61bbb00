"""A closed loop linearised about its reference, as matrices; it knows no engine.

The loop's own code is differentiated by finite differences: law, hold, delay and actuators are
those of a run.
"""

import dataclasses
import math
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple, Self

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import InputError
from eqt_cli.components.actuators import nominal
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import (
    CountsInstants,
    Designed,
    LinearPlant,
    OuterLoop,
    ReadsLimits,
    RunsCode,
)
from eqt_cli.components.matrix_groups import rigid
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.references import ClosedReference
from eqt_cli.components.sensors import CHANNEL_MEASURED as MEASURED
from eqt_cli.components.sensors import FIRST, NOTHING, Errors
from eqt_cli.components.vehicle import (
    CLOCKS,
    ESTIMATOR,
    PROPELLANT,
    Vehicle,
    navigates,
    requested_torque,
)
from eqt_cli.loop.closed_loop import DESIRED, MEMORY, VEHICLE, ClosedLoop, StateLayout
from eqt_cli.numbers.leaves import STRUCTURE, leaves, structure, with_fields, with_leaves


def off_limits(loop: ClosedLoop) -> ClosedLoop:
    """Return the loop where no limit is reached, without an estimator."""
    law = loop.controller
    law = with_fields(law, acting=()) if isinstance(law, ReadsLimits) else law
    law = law.unfailing if isinstance(law, RunsCode) else law
    return dataclasses.replace(loop, controller=law, vehicle=loop.vehicle.linear_part)


def designed(loop: ClosedLoop, times: Array, poses: Array, velocities: Array) -> ClosedLoop:
    """Return a loop whose law has the gains that follow from its model of the loop.

    The model has the law's inertia, the forces that it knows, the linear part of the actuators, and
    the clock; it knows no other inertia, no other forces and no sensors.

    Parameters
    ----------
    times : (k + 2,)
        The begin of the horizon, the times of the k matrices of `LinearPlant`, and the end, s.
    poses, velocities
        Q_d and V_d at these times, ``(k + 2, d, d)`` and ``(k + 2, m)``.

    Raises
    ------
    InputError
        If the model has no derivative, or no gain makes it stable.
    """
    law = loop.controller
    assert isinstance(law, Designed)
    clock, forces = loop.vehicle.control, law.known_forces
    actuators = tuple(map(nominal, loop.vehicle.actuators))
    vehicle = Vehicle(forces=forces, actuators=actuators, control=clock)
    linear = linearised(dataclasses.replace(loop, vehicle=vehicle), times, poses, velocities)
    if not np.isfinite(linear.closed).all():
        raise InputError(
            "the loop has no derivative about its reference, so that it has no regulator"
        )
    A, B, period = linear.closed, linear.phases[0].B, linear.period
    if len(linear.phases) > 1:
        raise InputError("actuators slower than the law have no regulator; shorten their period")
    plant = LinearPlant(np.zeros(1), A[:1], B[:1], period)
    if not linear.is_constant:
        knots = times[1:-1] if period is None else period * np.floor(times[1:-1] / period)
        plant = LinearPlant(knots, A[1:-1], B[1:-1], period, _differs(linear.about, A=A, B=B))
    return dataclasses.replace(loop, controller=law.designed(loop.group, plant))


def _differs(about: "_About", **matrices: Array) -> str:
    """Return the first quantity that does not repeat at the last time, in words; "" if all do."""
    s = about.loop.tracking(about.times, about.states)
    parts = {"Q_d": s.Qd, "V_d": s.Vd, "τ_d": s.tau_d + 0.0 * s.P, **matrices}
    for name, values in parts.items():
        change = np.abs(values[-1] - values[0])
        if not change.max() <= SAME * np.abs(values).max():
            entry = np.unravel_index(change.argmax(), change.shape)
            first, last = (f"{values[place][entry]:.6g}" for place in (0, -1))
            place = ", ".join(str(k) for k in entry)
            return (
                f"{name}[{place}] is {first} at the start of the horizon and {last} at its end, "
                f"{about.times[-1]:g} s, a difference of {change[entry]:.3g}"
            )
    return ""


STEP = 1e-4
"""Step of a difference. Rounding then changes a derivative by 1e-12, and truncation by less; a kink
at the reference itself, such as quadratic drag at rest, changes it by 1e-4 of its coefficient."""

STENCIL = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
"""Weights of a fourth-order first derivative, by the number of steps from the centre."""

SMOOTH = 0.1
"""Relative: where differences over one step and over two differ by more, the function jumps or is
not finite, and has no derivative. At a jump they differ by half."""

MOST_STATES = 300
"""Largest number of states, with the commands that wait, of a loop that is linearised, or whose
delays are tried: the margins of a law then take 3 s, and more with the cube of the number."""

MOST_ITERATIONS = 20
"""Limit on Newton's iterations for the state where a loop comes to rest; it takes 2 to 5."""

AT_REST = 1e-6
"""Newton step, rad or m, below which a loop is at rest. References are integrated to 1e-8."""

SINGULAR = 1e-9
"""Singular values below this part of the largest are 0 but for the rounding of differences, 1e-12;
a loop without feedback has some."""

SAME = 1e-6
"""Relative difference below which matrices count as equal."""

STILL = 1e-11
"""Change of a state per unit of any other, below which it never changes, but for rounding."""

MOST_RECALLED = 8
"""Limit on the values of a reference that are kept: two at some times, and a step or two later."""

MOST_INSTANTS = 1000
"""Limit on the instants in which the covariance of an estimator settles."""

SETTLED = 1e-9
"""Relative change of a covariance in a cycle, below which it has settled."""

_ELSEWHERE = {"pose", "momentum", *DESIRED, "work", f"{VEHICLE}{PROPELLANT}"}
"""Stretches of a flat state that are not copied into x as they are."""

_ESTIMATED = f"{VEHICLE}{ESTIMATOR}_"
_POSES = {f"{_ESTIMATED}pose", f"{_ESTIMATED}behind_pose"}
"""Stretches that are poses; x has their errors in the algebra."""

_BIAS, _BEHIND_BIAS = f"{_ESTIMATED}bias", f"{_ESTIMATED}behind_bias"
_SETTLE = {
    f"{_ESTIMATED}{name}"
    for name in ("covariance", "behind_covariance", "age", "behind_age", "past_live", "past_fresh")
}
"""States of an estimator that no error changes to first order."""

_NOT_COPIED = _SETTLE | {
    f"{_ESTIMATED}{name}" for name in ("error", "innovations", "last_innovation", "lost", "begun")
}
"""The same, and those that it does not read."""


@dataclass(frozen=True)
class Linearised:
    """The linearised loop at some times, opened where the law gives its command.

    Continuous: ẋ = A x + B u, y = C x. Sampled: A x + B u is x one control period later, just
    before the next instant of the law, whatever ticks are in between. The loop is closed by u = y;
    a further delay acts between y and u. The state is x = (ε, e, z, …): the body error ε
    (left-trivialised) with Q = Q_d exp(ε), whose rate is e = V − Ad_{Q_L⁻¹}V_d to first order; the
    memory z of the law; the states of the actuators, the delayed commands, the measurements that
    are held, and the estimate of an estimator.

    Attributes
    ----------
    phases
        The matrices A, B, C from each instant of the law to the next, until all sensors and
        actuators act together again, and a law with a cycle begins it again; other loops have one
        phase.
    period
        Control period of a sampled loop, s; None for a continuous one.
    offset : (times, m)
        ε of the states about which it is linearised.
    is_constant
        Whether the loop stays at these states and has the same matrices at all times; all axes of
        times then have length 1. Else it is linearised about its reference.
    """

    phases: tuple["Phase", ...]
    period: float | None
    offset: Array
    is_constant: bool
    about: "_About" = dataclasses.field(repr=False)

    @property
    def cycle(self) -> float | None:
        """The duration of all phases, s; None for a continuous loop."""
        return None if self.period is None else len(self.phases) * self.period

    @cached_property
    def closed(self) -> Array:
        """The matrix of the closed loop: A + BC, or the product of those of all phases."""
        change = self.phases[0].closed
        for phase in self.phases[1:]:
            change = phase.closed @ change
        return change

    @cached_property
    def at_rest(self) -> "Linearised | None":
        """The loop in coordinates in which it is the same at all times, if eqt knows such.

        These are its own if `is_constant`. Else, of a continuous loop, they are x' = T x for a T
        of `_About.charts`, where the closed loop has A' = (T A + Ṫ) T⁻¹. The eigenvalues of A'
        decide. They say nothing of a delay: the command turns against these coordinates.
        """
        if self.is_constant or self.period is not None or len(self.about.times) == 1:
            return self if self.is_constant else None
        if not np.abs(self.about.steps_to_rest()).max() <= AT_REST:  # it does not stay there
            return None
        [phase] = self.phases
        for T, rate, inner in self.about.charts():
            inverse = np.linalg.inv(T)
            matrix, B, C = (T @ phase.closed + rate) @ inverse, T @ phase.B, phase.C @ inverse
            if np.abs(matrix[:, :inner, inner:]).max(initial=0) <= SAME * np.abs(matrix).max():
                matrix[:, inner:, :inner] = 0.0  # what a stable inner loop drives, it stops driving
            if _same(matrix):
                one = [array[:1] for array in (matrix - B @ C, B, C)]
                return dataclasses.replace(self, phases=(Phase(*one),), is_constant=True)
        return None

    def multiplied(self, factors: Mapping[str, float]) -> "Linearised":
        """Return the loop about the same states with its numbers multiplied, by ends of paths."""
        numbers = leaves(self.about.loop)
        scaled = {
            path: factor * numbers[path]
            for end, factor in factors.items()
            for path in numbers
            if path.endswith(end)
        }
        if not scaled:
            return self
        loop = with_leaves(self.about.loop, scaled)
        # Motion and measurements of a sampled loop do not depend on gains.
        names = () if self.period is None else ("_flow", "held", "_measurements")
        computed = {name: getattr(self.about, name) for name in names}
        return with_fields(self.about, loop=loop, **computed).linearised(self.is_constant)


class Phase(NamedTuple):
    """The matrices of an open loop, from one control instant to the next, at all times."""

    A: Array
    B: Array
    C: Array

    @property
    def closed(self) -> Array:
        """A + BC."""
        return self.A + self.B @ self.C


@dataclass(frozen=True)
class _Recalled(ClosedReference):
    """A reference in closed form that is computed once at the times that it was asked for last.

    The law's model of the inertia does not change meanwhile.
    """

    whole: ClosedReference = dataclasses.field(metadata=STRUCTURE)
    last: dict[tuple[str, bytes], Any] = dataclasses.field(
        default_factory=dict, compare=False, metadata=STRUCTURE
    )

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        return self.whole.motion(G, t)

    def desired(self, G: MatrixLieGroup, inertia: Any, t: Any, Qd: Any, Pd: Any) -> Any:
        return self._at("desired", t, lambda: self.whole.desired(G, inertia, t, Qd, Pd))

    def flat_output(self, G: MatrixLieGroup, t: Any) -> Any:
        return self._at("flat output", t, lambda: self.whole.flat_output(G, t))

    def _at(self, name: str, t: Any, compute: Callable[[], Any]) -> Any:
        key = name, np.asarray(t).tobytes()
        if key not in self.last:
            if len(self.last) >= MOST_RECALLED:
                self.last.clear()
            self.last[key] = compute()
        return self.last[key]


@dataclass(frozen=True)
class _Pushed(ClosedLoop):
    """A loop with `push` added to the command of the law; L and W are 0, which no matrix has."""

    push: Array | None = None

    def command(self, s: Tracking) -> Array:
        command = super().command(s)
        return command if self.push is None else _pushed(command, self.push)

    def lyapunov(self, s: Tracking) -> Array:
        return 0.0 * s.P[..., 0]

    def outflow(self, s: Tracking, acting: Array) -> None:
        return None


def _pushed(command: Array, push: Array) -> Array:
    """Return a command with more torque; thrusts may stand behind it."""
    m = push.shape[-1]
    thrusts = command[..., m:] + 0.0 * push[..., :1]
    return np.concatenate([command[..., :m] + push, thrusts], axis=-1)


class _Derivative(NamedTuple):
    """A function at 0, ``(times, l)``, and its first derivative, ``(times, l, k)``."""

    value: Array
    slope: Array


def linearised(
    loop: ClosedLoop, times: Array, poses: Array, velocities: Array, *, with_estimator: bool = False
) -> Linearised:
    """Linearise a loop, without limits and steps; NaN where it has no derivative.

    It is linearised about its reference. If it does not depend on time to first order, and a force
    keeps it off its reference, it is linearised about the states where it comes to rest.

    Parameters
    ----------
    times : (times,)
        Times, s.
    poses, velocities
        Q_d and V_d at these times, ``(times, d, d)`` and ``(times, m)``.
    with_estimator
        Whether the estimate is part of the state, where the reference rests. Its covariance is that
        to which it settles there: to first order, errors do not change it.
    """
    # A filter by an accelerometer settles after thousands of ticks with dozens of steps each.
    has_filter = with_estimator and not navigates(loop.vehicle)
    estimator = loop.vehicle.estimator if has_filter else None
    loop = off_limits(loop)
    about = _About.reference(loop, times, poses, velocities)
    if about.dimension > MOST_STATES:
        raise InputError(
            f"the linearised loop has {about.dimension:,} states, because what waits for a delay "
            f"counts, and at most {MOST_STATES} are computed; take fewer ticks of delay, or a "
            "longer control.period"
        )
    moves = np.abs(velocities).max() > AT_REST
    held = any(channel.signal == "pose" for channel in loop.vehicle.holding(loop.group))
    # Of a reference that moves, a held pose is an old one: the loop does not stay on it.
    if (moves and held) or not about.is_same_at_all_times:
        return about.linearised()
    one = {name: getattr(about, name)[:1] for name in ("times", "poses", "states", "offset")}
    first = dataclasses.replace(about, **one)
    for _ in range(MOST_ITERATIONS):
        step = first.steps_to_rest()
        if np.abs(step).max() <= AT_REST:
            if estimator is not None and not moves:
                first = first.estimated(estimator)
            return first.linearised(is_constant=True)
        if not np.isfinite(step).all():
            break
        first = first.moved(step)
    return about.linearised()


def flow(loop: ClosedLoop, times: Array, poses: Array, velocities: Array) -> Array:
    """Return the matrix of ẋ about the reference, for a sampled loop while its command is held.

    ``(times, n, n)``; NaN where there is no derivative.
    """
    loop = off_limits(loop)
    return _About.reference(loop, times, poses, velocities).flow


def rates_of_runs(
    loop: ClosedLoop, numbers: Arrays, time: float, pose: Array, velocity: Array
) -> tuple[Array, Array]:
    """Return how fast small errors of many runs grow about one point of the reference.

    Parameters
    ----------
    numbers
        The leaves of the loop that differ by run, ``(runs, …)`` each, by path.

    Returns
    -------
    growth : (runs,)
        The rate of the errors that grow most, 1/s; NaN where there is no derivative.
    rates : (runs, n)
        The eigenvalues of ẋ; of a sampled loop, while its command is held.
    """
    runs = len(next(iter(numbers.values())))
    points = (np.repeat(np.asarray(x)[None], runs, axis=0) for x in (time, pose, velocity))
    about = _About.reference(off_limits(with_leaves(loop, numbers)), *points)
    linear, flow = about.linearised(), about.flow
    if not (np.isfinite(linear.closed).all() and np.isfinite(flow).all()):
        return np.full(runs, np.nan), np.full(flow.shape[:2], np.nan)
    eigenvalues, rates = np.linalg.eigvals(linear.closed), np.linalg.eigvals(flow)
    if linear.cycle is None:
        return eigenvalues.real.max(axis=-1), rates
    return np.log(np.abs(eigenvalues).max(axis=-1)) / linear.cycle, rates


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
    bases
        The same before each tick of a cycle, where an estimator makes them differ.
    is_settled
        Whether the last base is again the first.
    """

    loop: _Pushed
    times: Array
    poses: Array
    states: Array
    offset: Array
    bases: tuple[Array, ...] = ()
    is_settled: bool = True

    @classmethod
    def reference(cls, loop: ClosedLoop, times: Array, poses: Array, velocities: Array) -> Self:
        """Return the chart about the reference, with all other states as at the start of a run."""
        pushed = _Pushed.of(loop)
        if isinstance(loop.reference, ClosedReference) and loop.held_reference is None:
            pushed = dataclasses.replace(pushed, held_reference=_Recalled(loop.reference))
        states = pushed.initial_state(poses, velocities, poses, velocities, times)
        if loop.vehicle.holding(loop.group):
            states = pushed.measured(times, states, _at_instant(pushed, None))
        return cls(pushed, times, poses, states, np.zeros_like(velocities))

    @cached_property
    def others(self) -> dict[str, slice]:
        """The slice in x of each stretch besides pose and momentum."""
        m, elsewhere = self.loop.group.dimension, {*_ELSEWHERE, *_NOT_COPIED, *self._counts[0]}
        lengths = self.loop.layout.lengths.items()
        copied = {x: m if x in _POSES else length for x, length in lengths if x not in elsewhere}
        slices = StateLayout({"motion": 2 * m} | copied).slices
        return {name: slices[name] for name in copied}

    @property
    def dimension(self) -> int:
        """The dimension of x."""
        m = self.loop.group.dimension
        return 2 * m + sum(where.stop - where.start for where in self.others.values())

    @cached_property
    def instants(self) -> int:
        """The number of ticks of a cycle."""
        every = (sensor.every for sensor in self.loop.vehicle.holding(self.loop.group))
        return math.lcm(*every, len(self._counts))

    @cached_property
    def _counts(self) -> list[dict[str, tuple[float, ...]]]:
        """The counts of law and clocks at each tick of their cycle, by stretch."""
        vehicle = self.loop.vehicle
        if vehicle.control is None:
            return [{}]
        formula, law = self.loop.controller.formula, vehicle.control.clock
        of_law: Sequence[Mapping[str, float]] = [{}]
        if isinstance(formula, CountsInstants):
            of_law = formula.cycle(vehicle.control.period)
        ticks = math.lcm(
            law.every * len(of_law), *(clock.every for clock in vehicle.clocks.values())
        )
        rows = []
        for tick in range(ticks):
            instant = of_law[(tick - law.offset) // law.every % len(of_law)].items()
            counts: dict[str, tuple[float, ...]] = {MEMORY + name: (z,) for name, z in instant}
            if vehicle.clocks:
                counts[f"{VEHICLE}{CLOCKS}"] = tuple(vehicle.ticks_left(tick).tolist())
            rows.append(counts)
        return rows

    def estimated(self, estimator: Any) -> Self:
        """Return the chart with an estimator that has settled at the base states."""
        vehicle = dataclasses.replace(self.loop.vehicle, estimator=estimator)
        loop = dataclasses.replace(self.loop, vehicle=vehicle)
        layout, by_name = loop.layout, self.loop.layout.split(self.states)
        like = np.empty((*self.states.shape[:-1], layout.length))
        states = layout.join(dict.fromkeys(layout.lengths, 0.0) | by_name, like)
        states = loop.measured(self.times, states, _at_instant(loop, None))
        pose, none = loop.group.pack(self.poses), np.zeros(())
        there = {name: pose for name in layout.lengths if name in _POSES}
        there |= {name: none for name in layout.lengths if name in (_BIAS, _BEHIND_BIAS)}
        states = layout.join(layout.split(states) | by_name | there, like)
        begun = dataclasses.replace(self, loop=loop, states=states)
        cycle, is_settled = _settled(_Begun.of(begun))
        bases = tuple(layout.join({**layout.split(states), **base}, like) for base in cycle)
        return dataclasses.replace(begun, states=bases[-1], bases=bases, is_settled=is_settled)

    @property
    def cycles(self) -> int:
        """The number of cycles in which a covariance settles, at most."""
        return max(2, MOST_INSTANTS // self.instants)

    @property
    def settling(self) -> float:
        """The time after which a covariance counts as it is, s."""
        assert self.loop.vehicle.control is not None
        return self.cycles * self.instants * self.loop.vehicle.control.tick

    def moved(self, x: Array) -> Self:
        """Return the chart about the states at x, ``(times, n)``; e in x is ignored."""
        G = self.loop.group
        poses = self.poses @ G.exp(x[:, : G.dimension])
        parts = self.loop.layout.split(self.states)
        parts |= {name: parts[name] + x[:, where] for name, where in self.others.items()}
        states = self.loop.layout.join(parts, self.states)  # there is no estimator yet
        offset = G.log(G.inverse(self.loop.tracking(self.times, self.states).Qd) @ poses)
        return dataclasses.replace(self, poses=poses, states=states, offset=offset)

    def charts(self) -> Iterator[tuple[Array, Array, int]]:
        """Yield T and Ṫ, ``(times, n, n)``, of coordinates x' = T x in which a loop may not change.

        These are those of x; (F ε, d/dt F ε) with F = Ad_{Q_d}, in the axes of space; and the
        errors of a cascade, whose attitude comes first and depends on nothing else. The number of
        coordinates of such an inner loop comes with them, or n.
        """
        G, n = self.loop.group, self.dimension - len(self.loop.task.free(self.loop.gains))
        m, s = G.dimension, self.loop.tracking(self.times, self.states)
        one = np.broadcast_to(np.eye(n), (len(self.times), n, n))
        yield one, np.zeros_like(one), n
        if not self.loop.task.is_whole:
            return
        F, ad = G.Ad_matrix(s.Qd), G.ad_matrix(s.Vd)
        T, rate = one.copy(), np.zeros_like(one)
        T[:, :m, :m] = T[:, m : 2 * m, m : 2 * m] = F
        T[:, m : 2 * m, :m] = rate[:, :m, :m] = rate[:, m : 2 * m, m : 2 * m] = F @ ad
        rate[:, m : 2 * m, :m] = F @ (ad @ ad + G.ad_matrix(s.Vd_dot))
        yield T, rate, n
        if n == 2 * m and isinstance(law := self.loop.controller, OuterLoop):
            # Forward differences: a reference begins at its first time.
            T, *later = (self._slope_of_errors(law, k * STEP) for k in range(3))
            yield (T, (4 * later[0] - 3 * T - later[1]) / (2 * STEP), 2 * rigid(G).rotations)

    def _slope_of_errors(self, law: OuterLoop, step: float) -> Array:
        """Return ∂/∂x of the law's errors, a step later along a reference in closed form."""
        loop, times = self.loop, self.times + step
        s = loop.tracking(times, self.states)
        about = type(self).reference(loop, times, s.Qd, s.Vd)

        def errors(x: Array) -> Array:
            return law.loop_errors(loop.seen(loop.tracking(times, about._flat(x))))

        return about._derivative(errors, with_command=False).slope

    @property
    def is_same_at_all_times(self) -> bool:
        """Whether neither the matrices nor the steps to rest depend on time."""
        sampled = () if self.loop.vehicle.control is None else (*self._measurements, *self._answers)
        if not all(_same(part.slope) for part in (self._flow, *sampled)):
            return False
        steps = self.steps_to_rest()
        return bool(np.abs(steps - steps[0]).max() <= AT_REST)

    def linearised(self, is_constant: bool = False) -> Linearised:
        """Return the matrices of the linearised loop."""
        n, control, offset = self.dimension, self.loop.vehicle.control, self.offset
        if control is None:
            whole = self._flow.slope
            closed, B, C = whole[:, :n, :n], whole[:, :n, n:], whole[:, n:, :n]
            open_loop = self._across([Phase(closed - B @ C, B, C)])
            return Linearised(open_loop, None, offset, is_constant, self)
        law, seen, phases = control.clock, self._measurements, list[Phase]()
        shift = 1 if self.bases else 0  # the first base is before tick 1
        first = (law.offset - shift) % law.every
        for k in (np.arange(first, first + self.instants) % self.instants).tolist():
            tick = k + shift if law.every > 1 else k
            answer = self._answers[tick % len(self._answers)].slope
            after, B, C = answer[:, :n, :n], answer[:, :n, n:], answer[:, n:, :n]
            after, B = self.held @ (after - B @ C), self.held @ B
            M = seen[k].slope if seen else np.eye(n)
            if law.is_due(tick):
                phases.append(Phase(after @ M, B, C @ M))
            else:
                last, tick_later = phases[-1], after @ M
                phases[-1] = Phase(tick_later @ last.A, tick_later @ last.B, last.C)
        across = self._across(phases)
        # Without states that never change, as a bias that a filter takes for 0
        one = np.eye(across[0].A.shape[-1])
        changes = [np.abs(phase.closed - one).max(axis=(0, 2)) for phase in across]
        pushed = [np.abs(phase.B).max(axis=(0, 2)) for phase in across]
        # Also where it is not finite
        moves = ~(np.max(np.add(changes, pushed), axis=0) <= STILL)
        moving = (
            Phase(A[:, moves][:, :, moves], B[:, moves], C[:, :, moves]) for A, B, C in across
        )
        return Linearised(tuple(moving), control.period, offset, is_constant, self)

    def _across(self, phases: Iterable[Phase]) -> tuple[Phase, ...]:
        """Return the phases without what the task leaves free."""
        T, free = np.eye(self.dimension), self.loop.task.free(self.loop.gains)
        starts = [0, self.loop.group.dimension]  # of the pose and the velocity
        rows = starts[: len(free)]
        for row, a in zip(rows, free, strict=True):
            T[row : row + 3, row : row + 3] = np.linalg.svd(a[None])[2]
        within = np.delete(T, rows, axis=0).T
        if free:  # an estimate turns with the body
            for name in _POSES & self.others.keys():
                at = self.others[name].start
                T[at : at + 3, :3] -= np.outer(free[0], free[0])
        T = np.delete(T, rows, axis=0)
        return tuple(Phase(T @ A @ within, T @ B, C @ within) for A, B, C in phases)

    @cached_property
    def held(self) -> Array:
        """The transition matrix of x over a tick under a held command, ``(times, n, n)``."""
        from scipy.linalg import expm  # slow to import

        assert self.loop.vehicle.control is not None
        flow = self.loop.vehicle.control.tick * self.flow
        return expm(flow) if np.isfinite(flow).all() else np.full_like(flow, np.nan)

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
        if self.loop.vehicle.control is not None:  # at rest, nothing that acts changes anything
            answer, seen = self._at_once
            after, then = answer.value[:, :n], answer.slope[:, :n, :n]
            if seen is not None:
                after = after + (then @ seen.value[..., None])[..., 0]
                then = then @ seen.slope
            value = np.concatenate([value, after], axis=1)
            slope = np.concatenate([slope, then[0] - np.eye(n)])
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            return np.full((len(value), n), np.nan)
        return -np.linalg.lstsq(slope, value.T, rcond=SINGULAR)[0].T

    @cached_property
    def _at_once(self) -> tuple[_Derivative, _Derivative | None]:
        """x after the answer, and after the measurements, where all act at one tick."""
        seen = self._measurements[0] if self._measurements else None
        vehicle = self.loop.vehicle
        clocks = [*vehicle.clocks.values(), *(c.clock for c in vehicle.holding(self.loop.group))]
        if not any(clock.offset for clock in clocks):
            return self._answers[0], seen
        counts = self._counts[-vehicle.control.clock.offset if vehicle.control else 0]
        none = {f"{VEHICLE}{CLOCKS}": (0.0,) * len(vehicle.clocks)}
        answer = partial(self._change_and_command, counts=tuple((counts | none).items()))
        after = partial(self._after_measuring, instant=None)
        measured = None if seen is None else self._derivative(after, with_command=False)
        return self._derivative(answer), measured

    @cached_property
    def _flow(self) -> _Derivative:
        return self._derivative(self._rates_and_command)

    @cached_property
    def _answers(self) -> list[_Derivative]:
        """x after the answer at each tick of the cycle of law and clocks."""
        kinds = [tuple(count.items()) for count in self._counts]
        answers = {kind: partial(self._change_and_command, counts=kind) for kind in kinds}
        derivatives = {kind: self._derivative(answer) for kind, answer in answers.items()}
        return [derivatives[kind] for kind in kinds]

    @cached_property
    def _measurements(self) -> list[_Derivative]:
        """x after the measurements at each tick of a cycle; none if nothing changes it."""
        if not self.loop.changes_by_measuring:
            return []
        holding = self.loop.vehicle.holding(self.loop.group)
        derivatives: dict[Any, _Derivative] = {}
        measured = []
        for tick in range(self.instants):
            # Ticks at which the same channels measure are alike, unless an estimator differs.
            kind = tick if self.bases else tuple(sensor.clock.is_due(tick) for sensor in holding)
            if kind not in derivatives:
                after = partial(self._after_measuring, instant=tick)
                derivatives[kind] = self._derivative(after, with_command=False)
            measured.append(derivatives[kind])
        return measured

    @np.errstate(all="ignore")
    def _derivative(
        self, function: Callable[[Array], Array], with_command: bool = True
    ) -> _Derivative:
        """Differentiate a function of (x, u), or of x, ``(k, 1, n + m) -> (k, times, l)``."""
        count = self.dimension + (self.loop.group.dimension if with_command else 0)
        moved = [number * np.eye(count) for number in STENCIL]
        points = STEP * np.concatenate([np.zeros((1, count)), *moved])
        values = function(points[:, None])
        around = dict(zip(STENCIL, values[1:].reshape(-1, count, *values.shape[1:]), strict=True))
        slope = sum(weight * around[number] for number, weight in STENCIL.items()) / STEP
        near, far = ((around[k] - around[-k]) / (2 * k * STEP) for k in (1, 2))
        if not np.abs(far - near).max() <= SMOOTH * np.abs(slope).max():
            slope = np.full_like(slope, np.nan)
        return _Derivative(values[0], np.moveaxis(slope, 0, -1))

    def _flat(self, x: Array, base: Array | None = None) -> Array:
        """Return the flat states at x, ``(k, times, l)``."""
        loop, G, m = self.loop, self.loop.group, self.loop.group.dimension
        like = np.empty((len(x), *self.states.shape))
        parts = loop.layout.split(self.states if base is None else base)
        for name, where in self.others.items():
            if name in _POSES:
                parts[name] = G.pack(G.unpack(parts[name]) @ G.exp(x[..., where]))
            else:
                parts[name] = parts[name] + x[..., where]
        parts["pose"] = G.pack(self.poses @ G.exp(x[..., :m]))
        s = loop.tracking(self.times, loop.layout.join(parts, like))
        parts["momentum"] = s.inertia.momentum(s.relative.Vd + x[..., m : 2 * m])
        return loop.layout.join(parts, like)

    def _others(self, states: Array, base: Array) -> list[Array]:
        """Return x of flat states behind pose and momentum."""
        G, there, here = self.loop.group, *map(self.loop.layout.split, (states, base))
        return [
            G.log(G.inverse(G.unpack(here[name])) @ G.unpack(there[name]))
            if name in _POSES
            else there[name] - here[name]
            for name in self.others
        ]

    def _rates_and_command(self, x: Array) -> Array:
        """Return the time derivative of x, and the command."""
        loop = dataclasses.replace(self.loop, push=x[..., self.dimension :])
        states = self._flat(x)
        s, rates = loop.tracking(self.times, states), loop.vector_field(self.times, states)
        parts, r = loop.layout.split(rates), s.relative
        changing = s.inertia.rate_force(s.V) + s.inertia.leaving(s.V)
        V_dot = s.inertia.velocity(parts["momentum"] - changing)
        # The states of an estimator are held, also those that are poses.
        others = [0.0 * r.V_tilde if name in _POSES else parts[name] for name in self.others]
        command = requested_torque(self.loop.vehicle, self.loop.command(s))
        return np.concatenate([r.V_tilde, V_dot - r.Vd_dot, *others, command], axis=-1)

    def _after_measuring(self, x: Array, instant: int | None) -> Array:
        """Return x after the measurements at a tick of a cycle; None: at one with all of them."""
        before, after, number = self.states, self.states, instant
        if self.bases and instant is not None:
            before, after = self.bases[instant : instant + 2]
            number = instant + 1
        errors = _at_instant(self.loop, number)
        states = self.loop.measured(self.times, self._flat(x, before), errors)
        moved = np.zeros((*states.shape[:-1], 2 * self.loop.group.dimension))
        moved += x[..., : moved.shape[-1]]
        return np.concatenate([moved, *self._others(states, after)], axis=-1)

    def _change_and_command(
        self, x: Array, counts: Iterable[tuple[str, tuple[float, ...]]]
    ) -> Array:
        """Return x after the law has answered at a tick with these counts, and the command."""
        loop, t = self.loop, self.times
        states = self._flat(x)
        for name, value in counts:
            states[..., loop.layout.slices[name]] = value
        errors = _at_instant(loop, None) if loop.changes_by_measuring else None
        inputs, memory = loop.law_input(t, states, errors), loop.memory(states)
        command, later = loop.answer(inputs, memory, loop.period)
        after = loop.after_answer(t, states, _pushed(command, x[..., self.dimension :]), later)
        still = np.zeros((*command.shape[:-1], 2 * loop.group.dimension))
        still += x[..., : still.shape[-1]]
        torque = requested_torque(loop.vehicle, command)
        return np.concatenate([still, *self._others(after, self.states), torque], axis=-1)


@dataclass(frozen=True)
class _Begun:
    """A chart whose estimator begins; where the keys are equal, it settles to the same.

    That is so of laws that come to rest at one place, whatever their gains: a measurement reads the
    command that is held, which is one of the states, and no memory of a law.
    """

    key: Hashable
    about: _About = dataclasses.field(compare=False)

    @classmethod
    def of(cls, about: _About) -> "_Begun":
        loop = about.loop
        parts = loop.vehicle, loop.inertia
        numbers = [leaf.tobytes() for part in parts for leaf in leaves(part).values()]
        states = [about.times, about.poses, *_measured_by(loop, about.states).values()]
        key = loop.group, repr(loop.reference), about.instants, *map(structure, parts)
        return cls((*key, *numbers, *(state.tobytes() for state in states)), about)


@lru_cache(maxsize=1)
def _settled(begun: _Begun) -> tuple[list[Arrays], bool]:
    """Return the stretches before each tick of a cycle that follows many others, and at its end.

    Those of the law's memory are left out. The second value tells whether it ends as it began.
    """
    about = begun.about
    loop, times, states = about.loop, about.times, about.states
    for _ in range(about.cycles):
        bases = [states]
        for instant in range(about.instants):
            states = loop.measured(times, states, _at_instant(loop, instant + 1))
            bases.append(states)
        first, last = (loop.layout.split(bases[place]) for place in (0, -1))
        settled = all(
            np.abs(last[name] - values).max() <= SETTLED * np.abs(values).max()
            for name, values in first.items()
            if name in _SETTLE
        )
        if settled:
            break
    return [_measured_by(loop, base) for base in bases], settled


def _measured_by(loop: ClosedLoop, states: Array) -> Arrays:
    """Return the stretches of flat states that measurements read and change."""
    parts = loop.layout.split(states)
    return {name: part for name, part in parts.items() if not name.startswith(MEMORY)}


def _at_instant(loop: ClosedLoop, instant: int | None) -> Errors:
    """Return measurements without errors at a tick of a cycle; None: the first ones."""
    G, holding = loop.group, loop.vehicle.holding(loop.group)
    flags = [FIRST] * len(holding)
    if instant is not None:
        flags = [MEASURED if channel.clock.is_due(instant) else NOTHING for channel in holding]
    _, velocity, _, *others = map(np.zeros, loop.vehicle.error_lengths(G))
    return Errors(G.identity, velocity, np.array(flags), *others)
