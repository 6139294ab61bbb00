"""What an experiment does over its horizon: whether small errors decay, and how often to sample."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import reduce
from math import log
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.base.arrays import Array, apply_matrix, frobenius, norm
from eqt_cli.base.errors import ComponentError, EqtWarning, KeyPath, Problems, dotted, parse_key
from eqt_cli.base.registry import blamed
from eqt_cli.components.inertia import over_horizon
from eqt_cli.components.initial_states import pose_distributions
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.pose_notation import ANGLES, many_turns
from eqt_cli.components.vehicle import ACTUATORS, ESTIMATOR
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.engine import Problem, Status
from eqt_cli.engines.solve_ivp import SolveIvp, solve
from eqt_cli.loop.closed_loop import ClosedLoop, ReferenceSystem
from eqt_cli.loop.linearised import Linearised, flow, linearised

# Determines whether the linearised loops of an experiment are stable ------------------------------


DERIVATIVE = 1e-10
"""Largest error of an entry of a matrix, relative to its row: a hundred times that of the
differences."""

DEFECTIVE = 1e6
"""Condition number of an eigenvalue above which it counts as one of several that are equal. They
move as a root of the error, how far is tried."""

TRIALS = 4
"""Number of matrices, off by ten times the error, with which that is tried."""

MOST_ENTRIES = 100_000
"""Largest number of matrix entries over all times; at 9 times, this allows 105 states."""


class Along(NamedTuple):
    """The reference at some times.

    Attributes
    ----------
    times : (n,)
        Times, s.
    poses, velocities
        Q_d and V_d, ``(n, d, d)`` and ``(n, m)``.
    """

    times: Array
    poses: Array
    velocities: Array


class Growth(NamedTuple):
    """The growth of small errors of a linearised loop.

    Attributes
    ----------
    eigenvalue
        Eigenvalue of all times with the largest real part or, for a sampled law, modulus.
    at
        Time of this eigenvalue, s.
    rate
        Growth rate of its errors, 1/s; negative if they decay.
    is_stable
        Whether the errors decay; None if the errors of the matrix leave that open.
    """

    eigenvalue: complex
    at: float
    rate: float
    is_stable: bool | None


def growth(loop: Linearised, times: Array) -> Growth:
    """Return the growth of the errors of a loop at the worst time."""
    at_times = [_grown(loop, place) for place in range(len(loop.closed))]
    place = max(range(len(at_times)), key=lambda k: at_times[k].rate)
    stable = {each.is_stable for each in at_times}
    is_stable = False if False in stable else None if None in stable else True
    return at_times[place]._replace(at=float(times[place]), is_stable=is_stable)


def _grown(loop: Linearised, place: int) -> Growth:
    """Return the growth at one of the times.

    Each eigenvalue is known up to its condition number times the error of the matrix. LAPACK
    balances the matrix; that error is relative to each row, and so no fast state hides a slow one.
    """
    matrix = loop.closed[place]
    size = reduce(
        lambda M, phase: np.abs(phase.closed[place]) @ M, loop.phases, np.eye(len(matrix))
    )
    error = DERIVATIVE * size.max(axis=1, keepdims=True)
    eigenvalues, right = np.linalg.eig(matrix)
    eigenvalues = eigenvalues.astype(complex)
    scale = np.abs(right).max(axis=1, keepdims=True)
    scale[scale == 0] = 1.0
    try:
        left = np.abs(np.linalg.inv(right / scale)) / scale.T
    except np.linalg.LinAlgError:
        left = np.full(right.shape, np.inf)
    with np.errstate(invalid="ignore", over="ignore"):
        moves = (left @ error)[:, 0] * np.abs(right).sum(axis=0)
        rounding = np.finfo(float).eps * np.abs(eigenvalues).max()
        moves += len(matrix) * rounding * (left * np.abs(right).T).sum(axis=1)
    beyond = _beyond(loop, eigenvalues)
    doubtful = ~(np.abs(beyond) > moves)
    several = ~(moves < DEFECTIVE * DERIVATIVE * np.abs(eigenvalues).max())  # in any units
    if (doubtful & several).any():
        random = np.random.default_rng(0)
        shape = (TRIALS, *matrix.shape)
        tried = matrix + 10 * error * random.uniform(-1, 1, shape) * (matrix != 0)
        worst = _beyond(loop, np.linalg.eigvals(tried)).max()
        doubtful &= ~(several & (beyond < 0)) | (worst >= 0)
    rates = beyond
    if loop.cycle is not None:
        rates = np.log(np.maximum(np.abs(eigenvalues), np.finfo(float).tiny)) / loop.cycle
    which = int(rates.argmax())
    certain = beyond[~doubtful]
    is_stable = False if (certain > 0).any() else None if doubtful.any() else True
    return Growth(complex(eigenvalues[which]), 0.0, float(rates[which]), is_stable)


def _beyond(loop: Linearised, eigenvalues: Array) -> Array:
    """Return how far eigenvalues are beyond the edge of stability; negative within."""
    return eigenvalues.real if loop.cycle is None else np.abs(eigenvalues) - 1.0


def unstable_or_slow(experiment: Experiment, along: Along) -> Iterator[str]:
    """Yield sentences on unstable loops, and on slow ones, that do not depend on time."""
    horizon = experiment.config.time.duration
    for label, loop in small_loops(experiment, along).items():
        with np.errstate(all="ignore"):
            linear = linearised(loop, *along)
        if not (linear.is_constant and np.isfinite(linear.closed).all()):
            continue
        largest = growth(linear, along.times)
        if largest.is_stable and -largest.rate * horizon < log(2.0):
            yield (
                f"the loop of '{label}' is slower than the runs last: small errors take "
                f"{log(2.0) / -largest.rate:.3g} s to halve, and time.duration is {horizon:g} s; "
                "check the sizes of its gains, or take a longer duration"
            )
        if largest.is_stable is not False:
            continue
        size = size_of(largest, linear)
        per = "a period" if linear.period == linear.cycle else f"in {linear.cycle:g} s"
        many = "" if linear.period is None else f" (eigenvalue {size:.4g} {per})"
        omitted = ", ".join(each.words for each in left_out(loop))
        yield (
            f"the loop of '{label}' is unstable: small errors grow at {largest.rate:.3g} 1/s{many}"
            + (f", leaving out {omitted}" if omitted else "")
            + "; check the signs and sizes of its gains, and the delays; `eqt margins` shows more"
        )


def small_loops(experiment: Experiment, along: Along) -> dict[str, ClosedLoop]:
    """Return the loops whose matrices at all times are small enough, by label."""
    return {
        label: loop
        for label, loop in experiment.loops.items()
        if len(along.times) * loop.state_length**2 <= MOST_ENTRIES
    }


def size_of(grown: Growth, loop: Linearised) -> float:
    """Return the real part of the eigenvalue or, for a sampled law, its modulus."""
    return grown.eigenvalue.real if loop.period is None else abs(grown.eigenvalue)


class LeftOut(NamedTuple):
    """A part that a linearised loop leaves out.

    Attributes
    ----------
    words
        Its place in the configuration, and what it does.
    stabilises, destabilises
        Whether an unstable loop could be stable with it, and a stable one unstable.
    """

    words: str
    stabilises: bool = True
    destabilises: bool = True


def left_out(loop: ClosedLoop, linear: Linearised | None = None) -> Iterator[LeftOut]:
    """Yield the parts that a linearised loop leaves out."""
    vehicle = loop.vehicle
    for index, actuator in enumerate(vehicle.actuators):
        if actuator.linear_part is not actuator or actuator.limits:
            what = "only the limits of the " * isinstance(actuator.linear_part, type(actuator))
            # At a limit no loop is pushed harder: what grows from small errors, grows.
            yield LeftOut(f"{ACTUATORS}[{index}] ({what}{actuator.departs})", not actuator.limits)
    for place, sensor in vehicle.sensors().items():
        loses = ["dropout"] if getattr(sensor, "dropout", None) else []
        if sensor.states(loop.group) and not loses:
            continue  # its states are part of the loop
        yield LeftOut(f"{place} ({', '.join([sensor.departs, *loses])})", bool(loses), bool(loses))
    if vehicle.estimator is not None and not (linear and linear.about.loop.vehicle.estimator):
        yield LeftOut(f"{ESTIMATOR} ({vehicle.estimator.departs})")
    elif linear and not linear.about.is_settled:
        yield LeftOut(f"{ESTIMATOR} (its covariance has not settled)")
    if vehicle.varies:
        yield LeftOut("what is drawn for each run (means are used)")


# Checks an experiment before any run: its reference over the horizon, and its numerics ------------


EPSILON = float(np.finfo(float).eps)

ORDINARY = 20_000
"""Largest number of evaluations of the vector field, or of steps, without a remark: two seconds for
a single run. For stability, most shipped experiments need some hundreds, `se3_survey` 14,000."""

TRIAL = 1_500
"""Number of evaluations of a trial with an implicit method: half a second."""

ENOUGH = 0.02
"""Share of the horizon that a trial must reach to extrapolate its evaluations. On SO(3), a
trial over 1 % of the horizon was right to 20 %. On the submersible, the first millisecond alone
takes 3,000 evaluations."""

TRIAL_SAMPLES = 4_001
"""Number of samples that show how far the trial came."""


def ill_conditioned(experiment: Experiment) -> str:
    """Return the words for a remark on an ill-conditioned inertia; empty if it is not.

    V = 𝕀⁻¹P is accurate to about ε κ, with ε = 2.2e-16 and the condition number κ of the inertia in
    units that make its diagonal 1 (Higham 2002, Theorem 7.2 and Section 7.3). So units do not
    matter, but nearly dependent axes do. If ε κ exceeds `rtol`, no step can be that accurate.
    """
    loop, rtol = next(iter(experiment.loops.values())), experiment.engine.rtol
    times, matrices = over_horizon(loop.inertia, experiment.config.time.duration)
    roots = np.sqrt(np.diagonal(matrices, axis1=-2, axis2=-1))
    numbers = np.linalg.cond(matrices / (roots[:, :, None] * roots[:, None, :]))
    worst = int(numbers.argmax())
    if numbers[worst] * EPSILON <= rtol:
        return ""
    when = "" if len(times) == 1 else f" at t = {times[worst]:.4g} s"
    return (
        f"its condition number is {numbers[worst]:.2g}{when}, so that rounding alone changes "
        f"velocities by {numbers[worst] * EPSILON:.1g} of their size, more than solver.rtol = "
        f"{rtol:g}; choose other axes, or increase solver.rtol"
    )


def stiff(experiment: Experiment, along: Along) -> str:
    """Return the words for a remark on the work for a stiff loop; empty if no loop is stiff.

    A loop is stiff if the fastest decay of its errors needs more than `ORDINARY` evaluations, and
    an implicit method needs fewer (Hairer and Wanner 1996, Section IV.1).

    Parameters
    ----------
    along
        Points of the reference at which loops are linearised.
    """
    candidates, chosen = [], experiment.engine
    duration = experiment.config.time.duration
    for label, loop in small_loops(experiment, along).items():
        matrices = flow(loop, *along)
        if np.isfinite(matrices).all():
            rates = np.linalg.eigvals(matrices)
            candidates.append((chosen.work_for_stability(rates, duration), label, rates))
    if not candidates:
        return ""
    work, label, rates = max(candidates, key=lambda each: each[0])
    if work <= ORDINARY:
        return ""
    explicit = SolveIvp(rtol=chosen.rtol).work_for_stability(rates, duration)
    implicit, reached = _radau_evaluations(experiment, experiment.loops[label])
    # With fewer evaluations by the explicit method, the horizon is long, but the loop is not stiff.
    if not implicit < min(explicit, work):
        return ""
    count = f"about {_rounded(implicit)} evaluations" if reached > ENOUGH else "fewer"
    return (
        f"the loop of '{label}' is stiff: its errors decay at up to "
        f"{np.abs(rates).max():.2g} 1/s, for which engine {chosen.name} takes about "
        f"{_rounded(work)} {chosen.counted} a run; `solver.method: Radau` {count}"
    )


def _rounded(count: float) -> str:
    """Format a number with two digits: ``46,000``."""
    return f"{float(f'{count:.2g}'):,.0f}"


def _radau_evaluations(experiment: Experiment, loop: ClosedLoop) -> tuple[float, float]:
    """Estimate the evaluations of a run by an implicit method from the progress of a trial.

    The trial starts without errors, because fast errors decay at once. The estimate is infinite if
    the trial makes no progress. The second value is the share of the horizon that it reached.
    """
    Qd, Vd, stop = experiment.initial_pose, experiment.initial_velocity, experiment.times[-1]
    engine = SolveIvp(method="Radau", rtol=experiment.engine.rtol, max_steps=TRIAL)
    states = loop.initial_state(Qd, Vd, Qd, Vd)[None]
    problem = Problem(loop, states, np.linspace(0.0, stop, TRIAL_SAMPLES))
    solution = engine.solve(problem)
    known = int(np.isfinite(solution.states[0]).all(axis=-1).sum()) - 1
    reached = known / (TRIAL_SAMPLES - 1)
    return (solution.steps[0] / reached if known else np.inf), reached


SAMPLES = 2001
"""Number of times at which the reference is evaluated, besides both sides of known instants."""

RTOL = 1e-8
"""Relative tolerance for the integration of a reference."""

MOST_EVALUATIONS = 10_000
"""Largest number of evaluations of an integrated reference, so that a check takes seconds."""

MOST_WRITTEN = 1_000
"""Characters of a configuration above which the number of evaluations is reduced."""

LINEARISED = 9
"""Number of times at which a loop is linearised."""

MOST_NOISE = 1.0
"""Largest standard deviation of a measured rotation without a remark, rad."""

GOLDEN = (5**0.5 - 1) / 2
"""Golden ratio. The fractional parts of its multiples are spread evenly without equal gaps."""

JUMP = 1e-6
"""Least jump relative to the largest value on the horizon."""


@dataclass(frozen=True)
class Horizon:
    """The reference at some times.

    Attributes
    ----------
    times : (n,)
        Times in increasing order, s.
    pose : (n, d, d)
        Q_d.
    velocity, acceleration, torque : (n, m)
        V_d, V̇_d and τ_d in the body frame; NaN where the reference is not finite.
    jumps
        Jumps of Q_d, V_d or τ_d as (time, name, size with its unit if all coordinates share it).
    spent
        Number of evaluations after which the integration stopped, at the last of the times; None if
        it reached the end.
    """

    times: Array
    pose: Array
    velocity: Array
    acceleration: Array
    torque: Array
    jumps: list[tuple[float, str, str]]
    spent: int | None = None

    @property
    def finite(self) -> Array:
        """Whether the reference is finite at each time."""
        parts = (frobenius(self.pose), norm(self.velocity), norm(self.torque))
        return np.isfinite(np.array(parts)).all(axis=0)


class _Light(SolveIvp):
    """The engine of references: DOP853 without SciPy."""

    solver = staticmethod(solve)


def reference_over_horizon(experiment: Experiment, also: Iterable[float] = ()) -> Horizon:
    """Compute Q_d, V_d, V̇_d and τ_d over the horizon, `also` at some times."""
    system = ReferenceSystem.of(next(iter(experiment.loops.values())))
    stop = float(experiment.times[-1])
    instants = np.array([t for t in system.instants(stop) if 0 < t < stop])
    times = np.unique([*np.linspace(0.0, stop, SAMPLES), *instants, *also])
    Qd, Vd = experiment.initial_pose, experiment.initial_velocity
    state = system.initial_state(Qd, Vd, Qd, Vd)
    states = np.broadcast_to(state, (len(times), len(state)))
    spent = None
    if len(state):
        engine = _Light(rtol=RTOL, atol=1e-3 * RTOL, max_steps=_affordable(experiment))
        solution = engine.solve(Problem(system, state[None], times))
        states = solution.states[0]
        if solution.status[0] == Status.STEP_LIMIT:
            spent = engine.max_steps
            known = int(np.isfinite(states).all(axis=-1).sum())
            times, states = times[:known], states[:known]
            instants = instants[instants <= times[-1]]
    with np.errstate(all="ignore"):
        s = system.tracking(times, states)
        torque = s.tau_d + 0 * s.P
        shown = Horizon(times, s.Qd, s.Vd, s.Vd_dot, torque, [], spent)
        if not len(instants):
            return shown
        where = np.searchsorted(times, instants)
        sides = [
            system.tracking(np.nextafter(instants, towards), states[where])
            for towards in (-np.inf, np.inf)
        ]
        parts = experiment.group.parts
        units = (parts[0].velocity_unit, parts[0].force_unit) if len(parts) == 1 else ("", "")
        jumps = list(_jumps(shown, instants, units, *sides))
    return replace(shown, jumps=sorted(jumps))


def _affordable(experiment: Experiment) -> int:
    """Return the allowed number of evaluations of the reference."""
    written = len(json.dumps(experiment.resolved))
    return int(MOST_EVALUATIONS * min(1.0, MOST_WRITTEN / written))


def _jumps(
    shown: Horizon, instants: Array, units: tuple[str, str], left: Tracking, right: Tracking
) -> Iterator[tuple[float, str, str]]:
    for what, scale, size, unit in (
        ("Q_d", shown.pose, frobenius(right.Qd - left.Qd), ""),
        ("V_d", shown.velocity, norm(right.Vd - left.Vd), units[0]),
        ("τ_d", shown.torque, norm(right.tau_d - left.tau_d + 0 * left.P), units[1]),
    ):
        largest = np.nanmax(np.abs(scale)) if np.isfinite(scale).any() else 0.0
        for t, by in zip(instants, size, strict=True):
            if by > JUMP * largest:
                yield float(t), what, f"{by:.3g} {unit}".strip()


def check_reference(shown: Horizon, most_torque: float | None, problems: Problems) -> list[str]:
    """Note where the reference is not finite, or needs more than a given torque.

    Returns
    -------
    list of str
        Remarks on jumps, which may be intended, and on a check that did not reach the end.
    """
    finite, sizes = shown.finite, norm(shown.torque)
    if not finite.all():
        t = shown.times[np.flatnonzero(~finite)[0]]
        problems.add(f"has no finite real value at about t = {t:.4g} s; correct its expressions")
    elif most_torque is not None and sizes.max() > most_torque:
        t = shown.times[sizes.argmax()]
        problems.add(
            f"needs a torque of {sizes.max():.4g} at t = {t:.4g} s, more than {most_torque:g}"
        )
    at: dict[str, list[str]] = {}
    for t, what, by in shown.jumps:
        at.setdefault(f"{what} jumps by {by} at t =", []).append(f"{t:g}")
    remarks = [f"{jump} {', '.join(instants)} s" for jump, instants in at.items()]
    if shown.spent is not None:
        until = f"t = {shown.times[-1]:.4g} s only, after {shown.spent:,} evaluations"
        remarks.append(f"checked until {until}")
    return remarks


def remarks(experiment: Experiment, shown: Horizon | None = None) -> list[EqtWarning]:
    """Return remarks on an experiment and its reference, to be shown before it is run."""
    placed = [
        *_angle_remarks(experiment),
        *_component_remarks(experiment),
        *_noise_remarks(experiment),
        *_numerical_remarks(experiment, shown),
    ]
    return [
        *experiment.remarks,
        *(EqtWarning(f"{experiment.source.place(k)}: {dotted(k)}: {text}") for k, text in placed),
        *map(EqtWarning, limits_below_reference(experiment, shown)),
    ]


Placed = Iterator[tuple[KeyPath, str]]
"""Remarks, each with the key that it is about."""


def _angle_remarks(experiment: Experiment) -> Placed:
    """Remark on angles that are written as numbers and exceed a full turn."""
    data = experiment.source.data
    own = {*ANGLES, *(name for kind in pose_distributions.all() for name in kind.angles)}
    for section, angles in (("reference", ANGLES), ("target", ANGLES), ("initial", own)):
        yield from many_turns(data.get(section), angles, (section,))


def _component_remarks(experiment: Experiment) -> Placed:
    """Yield the remarks of the reference, the actuators and the estimator."""
    loops, G = experiment.loops.values(), experiment.group
    loop = next(iter(loops))
    yield from ((("reference",), text) for text in loop.reference.remarks(G))
    wanted = max((loop.controller.directions(G) for loop in loops), key=len)
    for index, actuator in enumerate(loop.vehicle.actuators if len(wanted) else ()):
        for text in actuator.remarks(G, wanted):
            yield (ACTUATORS, index), f"{actuator.name} {text}"
    for part in loop.vehicle.schedule(G).unmeasured if loop.vehicle.estimator else ():
        yield (
            ("estimator",),
            f"nothing measures the {part}, so that the error of its estimate "
            "grows without bound; add an entry for it to sensors.pose",
        )


def _noise_remarks(experiment: Experiment) -> Placed:
    """Remark on a noise of measured rotations that says nothing about them."""
    vehicle, G = next(iter(experiment.loops.values())).vehicle, experiment.group
    for path, sensor in vehicle.sensors().items():
        if vehicle.control is None or not path.startswith("sensors.pose"):
            continue
        std = sensor.drawn(None).white_deviation(G, sensor.period or vehicle.control.period)
        own = [part for part in G.parts if part.name == sensor.of] or G.parts
        turns = [part.turns for part in own for _ in range(G.dimension)[part.axes]]
        most = 0.0 if std is None else np.max(std, where=turns, initial=0.0)
        if most > MOST_NOISE:
            yield (
                parse_key(path),
                f"a noise of {most:g} rad leaves nothing of a measured rotation; "
                f"if degrees or arc seconds were meant, write '{most:g} deg' or '{most:g} arcsec'",
            )


def _numerical_remarks(experiment: Experiment, shown: Horizon | None) -> Placed:
    """Remark on the effects of rounding, stiffness and instability, at the section to change."""
    along, texts = (along_reference(experiment, shown), [("inertia", ill_conditioned(experiment))])
    try:
        with blamed(), threadpool_limits(1):  # threads slow down small matrices
            texts.append(("gains", stiff(experiment, along)))
            if len(along.times) > 1:
                texts += [("controllers", text) for text in unstable_or_slow(experiment, along)]
    except ComponentError as error:
        texts.append(("controllers", f"loops cannot be linearised: {error}"))
    yield from (((section,), text) for section, text in texts if text)


def along_reference(experiment: Experiment, shown: Horizon | None) -> Along:
    """Return the reference at its start or, if it is known, at times spread over the horizon.

    The times are not multiples of each other, so that a rotating reference is sampled at different
    angles.
    """
    finite = np.flatnonzero(shown.finite) if shown is not None else ()
    if shown is None or not 1 < len(finite) == len(shown.times):
        start = np.zeros(1), experiment.initial_pose[None], experiment.initial_velocity[None]
        return Along(*start)
    shares = np.sort(np.arange(LINEARISED) * GOLDEN % 1.0)
    where = np.searchsorted(shown.times, shares * shown.times[-1])
    return Along(shown.times[where], shown.pose[where], shown.velocity[where])


class WheelsNeeded(NamedTuple):
    """What each wheel needs to follow the reference exactly, under the forces of the plant.

    Attributes
    ----------
    momentum, torque : (times, k)
        N m s and N m.
    limits
        Largest momentum and torque, ``(k,)`` each; None without one.
    """

    times: Array
    momentum: Array
    torque: Array
    limits: tuple[Array | None, Array | None]

    @property
    def in_words(self) -> str:
        """``8.2 of 15 mN m s (wheel 1, t = 120 s) and 0.9 of 4 mN m (wheel 2, t = 35 s)``."""
        words = []
        pairs = zip((self.momentum, self.torque), self.limits, ("mN m s", "mN m"), strict=True)
        for values, limit, unit in pairs:
            share = np.abs(values) / (1.0 if limit is None else limit)
            when, wheel = np.unravel_index(np.argmax(share), share.shape)
            of = "" if limit is None else f" of {1e3 * limit[wheel]:.3g}"
            size = 1e3 * abs(values[when, wheel])
            words.append(f"{size:.3g}{of} {unit} (wheel {wheel + 1}, t = {self.times[when]:.4g} s)")
        return " and ".join(words)

    @property
    def are_too_much(self) -> bool:
        """Whether a limit is below what is needed."""
        pairs = zip((self.momentum, self.torque), self.limits, strict=True)
        return any(bool((np.abs(v) > limit).any()) for v, limit in pairs if limit is not None)


def wheels_needed(experiment: Experiment, shown: Horizon) -> WheelsNeeded | None:
    """Return what wheels need along the reference, by the balance of momentum; None without any.

    In space, the momentum of body and wheels is that of the start and the integral of all forces.
    Numbers that are drawn for each run have their mean values.
    """
    loop = next(iter(experiment.loops.values()))
    if loop.vehicle.wheels is None or not shown.finite.all():
        return None
    G, wheels, t, Q, V = loop.group, loop.vehicle.wheels[1], shown.times, shown.pose, shown.velocity
    forces = np.zeros_like(V)
    for force in loop.vehicle.forces:
        forces = forces + force.in_body(G, t, Q, V)
    body = loop.inertia.at(t).momentum(V)
    there = G.Ad_star(G.inverse(Q), forces)
    gained = np.cumsum(np.diff(t)[:, None] * (there[1:] + there[:-1]) / 2, axis=0)
    start = wheels.matrix @ wheels.start
    total = G.Ad_star(G.inverse(Q), body + start)[:1]
    total = total + np.concatenate([0.0 * gained[:1], gained])
    carried = G.Ad_star(Q, total) - body
    torque = shown.torque - forces - G.ad_star(V, carried)
    limits = wheels.momentum, wheels.limit
    momentum = wheels.start + apply_matrix(wheels.inverse, carried - start)
    return WheelsNeeded(t, momentum, wheels.allocated(torque), limits)


def limits_below_reference(experiment: Experiment, shown: Horizon | None = None) -> list[str]:
    """Return sentences on actuators whose limits are below the torque of the reference alone.

    Numbers that are drawn for each run have their mean values.
    """
    loop = next(iter(experiment.loops.values()))
    if not loop.vehicle.limits:
        return []
    shown = shown or reference_over_horizon(experiment)
    parts = (shown.times, shown.torque, shown.pose, shown.velocity)
    times, torque, pose, velocity = (part[shown.finite] for part in parts)
    for force in loop.reference.known_forces:
        torque = torque - force.in_body(loop.group, times, pose, velocity)
    texts, wheels = [], wheels_needed(experiment, shown)
    if wheels is not None and wheels.are_too_much:
        texts.append(
            f"{ACTUATORS}: the reference, with the forces of the plant, needs {wheels.in_words}; "
            "no law can follow it there"
        )
    for index, actuator in enumerate(loop.vehicle.actuators):
        sizes = actuator.most(loop.group, times, torque) if actuator.limits else None
        if sizes is None or not len(sizes[0]):
            continue
        needed, limits = sizes
        with np.errstate(divide="ignore", invalid="ignore"):  # a limit may be 0
            over = np.where(needed > limits, needed / np.maximum(limits, 0.0), 0.0)
        when, axis = np.unravel_index(np.argmax(over), needed.shape)
        limit = float(np.broadcast_to(limits, needed.shape)[when, axis])
        if needed[when, axis] > limit:
            t = times[len(times) - len(needed) + when]
            names = actuator.thruster_names
            name, unit = (f"'{names[axis]}'", " N") if names else (actuator.name, "")
            texts.append(
                f"{ACTUATORS}[{index}]: {name} gives at most {actuator.limited}{limit:.4g}{unit}, "
                f"but the reference alone needs {needed[when, axis]:.4g}{unit} at t = {t:.4g} s; "
                "no law can follow it there"
            )
    return texts
