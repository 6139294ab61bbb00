"""Pre-flight: what eqt tries of an experiment before it integrates a run, in this order.

1. `try_vehicle`: forces, actuators, sensors and estimators of the user's own, at the start of the
   reference. Are their arrays of the right shape, for some runs and samples?
2. `try_laws`: initial states, group, reference and laws, where one is the user's own, at the start
   of run 0; the laws also with numbers that differ from run to run.
   `try_metrics`: metrics of the user's own, on samples at the start.
3. `check_reference`: is the reference finite over the horizon, and its torque below a bound?
4. `remarks`: numbers that look wrong, rounding, stiffness, loops that are unstable or slow, and
   limits below the torque of the reference.

`eqt_cli.runs.preflight` goes on with what depends on the runs of a study:

5. `check_resources`: do its largest part and its files fit into the memory and on the disk?
6. `rehearse`: two runs of every law together, from their own starts, as the engine takes them.
7. `estimate`: how long will it take?

Every command that builds an experiment (`export` does no more) begins with 1 and 2, at every point
of a sweep. After them

- `config check` does 5, 3, 6 and 4;
- `run` does 4, about the reference at its start only, and 5, as `sweep`, too;
- `tune` and `worst` do 5 for every generation;
- `--dry-run` does 7, of a sweep after 5 for the memory.
"""

from __future__ import annotations

import json
import traceback
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from math import log
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.base.arrays import Array, apply_matrix, frobenius, norm
from eqt_cli.base.errors import (
    ComponentError,
    EqtError,
    EqtWarning,
    InputError,
    KeyPath,
    Problems,
    dotted,
    parse_key,
)
from eqt_cli.base.option_types import Kind
from eqt_cli.base.registry import blamed, described, is_foreign, place_of, place_of_function
from eqt_cli.base.reporting import reporter
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.estimators import Estimator
from eqt_cli.components.forces import Force
from eqt_cli.components.inertia import in_other_order, over_horizon
from eqt_cli.components.initial_states import Stream, draw_initial_states, generator_at
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.sensors import Sensor
from eqt_cli.components.vehicle import ACTUATORS, RandomOf
from eqt_cli.components.vehicle_parts import PlantInertia
from eqt_cli.engines.engine import Problem, Status
from eqt_cli.engines.solve_ivp import SolveIvp, solve
from eqt_cli.loop.closed_loop import ClosedLoop, LoopPart, ReferenceSystem, parts_of, vehicle_parts
from eqt_cli.loop.linearised import Along, flow, growth, left_out, linearised, size_of
from eqt_cli.loop.signals import Metric, compute, metrics
from eqt_cli.numbers.leaves import leaves
from eqt_cli.numbers.running import SampledRuns, mixes_runs

if TYPE_CHECKING:
    from eqt_cli.config.experiment import Experiment

# A trial of parts of a loop, whose errors are noted at the part that they are from ----------------


WHEN = "at the start of run 0"

TOGETHER = "when runs are solved together, with every number of a law as an array (runs, 1)"

CONTRACTED = "; multiply before you contract: dot(self.k * z, z), not self.k * dot(z, z)"


@dataclass
class Trial:
    """A part of a loop that is evaluated.

    Attributes
    ----------
    name
        The part, in messages.
    when
        The states and numbers with which it is evaluated now, in words.
    """

    name: str
    when: str

    def fits(
        self, value: Any, function: Any, states: Array, *axes: int, exact: bool = False
    ) -> None:
        """Raise an `InputError` if a function returns no numbers for every run, sample and axis.

        What is the same for all runs or samples may lack their axes, unless it is to be `exact`.
        """
        wrong = _unfit(value, states.shape[:-1], axes, exact)
        if wrong:
            hint = CONTRACTED if self.when == TOGETHER else ""
            self.is_wrong(function, f"{wrong}{hint}")

    def is_wrong(self, function: Any, returned: str) -> NoReturn:
        """Raise an `InputError` about what a function returns."""
        place = f"{place_of_function(function)}: {function.__name__}"
        raise InputError(f"{self.name} is wrong {self.when}: {place} returns {returned}")


@contextmanager
def trial(parts: Sequence[LoopPart], problems: Problems, when: str = WHEN) -> Iterator[Trial]:
    """Note an exception at the part whose code raised it, with its line; else at the first part.

    What only eqt's own code can have raised is raised again.
    """
    tried = Trial(parts[0].name, when)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield tried
    except EqtError as error:
        problems.at(*_culprit(error.__cause__ or error, parts).path).add(str(error))
    except Exception as error:
        if not any(part.is_foreign for part in parts):
            raise
        culprit, place = _culprit(error, parts), place_of(error)
        at = f" at {place}" if place else ""
        problems.at(*culprit.path).add(f"{culprit.name} fails {tried.when}: {described(error)}{at}")


def _culprit(error: BaseException, parts: Sequence[LoopPart]) -> LoopPart:
    """Return the part of the innermost line that is in the file of one that is the user's own."""
    by_module = {type(each.part).__module__: each for each in reversed(parts) if each.is_foreign}
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    modules = [str(frame.f_globals.get("__name__", "")) for frame in reversed(frames)]
    return next((by_module[module] for module in modules if module in by_module), parts[0])


def _unfit(value: Any, leading: tuple[int, ...], axes: tuple[int, ...], exact: bool) -> str | None:
    """Return what is wrong with a value, in words; None if nothing is."""
    if not isinstance(value, np.ndarray | np.generic | float | int):
        return f"{'None' if value is None else type(value).__name__}; expected an array"
    actual, kind = np.shape(value), np.asarray(value).dtype
    if kind.kind not in "fiu":
        return f"an array of {kind}; expected real numbers"
    shape = (*leading, *axes)
    try:
        spread = np.broadcast_shapes(actual, shape) == shape
        fits = actual == shape if exact else spread and actual[len(actual) - len(axes) :] == axes
    except ValueError:
        fits = False
    counts = " of ".join(f"{n} {w}" for n, w in zip(leading, ("runs", "samples"), strict=False))
    return None if fits else f"an array of shape {actual} for {counts}; expected {shape}"


def _repeated(loop: ClosedLoop, state: Array) -> list[tuple[Any, Array]]:
    """Return a state as engines take it, for runs at one time, and as metrics do, at all samples.

    There are as many runs and samples as nothing else in the loop has.
    """
    m = loop.group.dimension
    whole = np.broadcast_to(state, (m + 2, m + 3, len(state))).copy()
    return [(0.0, whole[:, 0]), (np.zeros(m + 3), whole)]


# Tries the laws, and what they are given ----------------------------------------------------------


def try_laws(experiment: Experiment, problems: Problems) -> None:
    """Note what components of the user's raise, or return in a shape that does not fit."""
    loops, Qd, Vd = experiment.loops, experiment.initial_pose, experiment.initial_velocity
    poses, velocities = experiment.poses, experiment.velocities
    every = [part for e in loops.values() for part in (e.group, e.reference, e.controller)]
    if not any(is_foreign(type(part).__module__) for part in [*every, poses, velocities]):
        return
    first, seed = next(iter(loops.values())), experiment.config.ensemble.seed
    start = [LoopPart(each, ("initial",), "the initial states") for each in (poses, velocities)]
    _, reference, *others = parts_of(first)
    with trial([*start, reference, *others], problems):
        Q, V = draw_initial_states(
            first.group, poses, velocities, Qd=Qd, Vd=Vd, seed=seed, runs=[0]
        )
        state = first.initial_state(Q, V, Qd, Vd)[0]
    if not problems:
        with trial(_suspects(reference, *others), problems) as tried:
            (_, states), _ = _repeated(first, state)
            torque = first.tracking(0.0, states).tau_d
            function = type(first.reference).driving_torque
            tried.fits(torque, function, states, first.group.dimension)
    if problems:
        return
    for index, loop in enumerate(loops.values()):
        with trial(_suspects(*parts_of(loop, index)), problems) as tried:
            _try_law(tried, loop, loop.initial_state(Q, V, Qd, Vd)[0])  # with this law's memory


def _suspects(part: LoopPart, *others: LoopPart) -> list[LoopPart]:
    """Return the parts; the group comes first where it is the user's own, and the part is not."""
    group = next(each for each in others if each.path == ("group",))
    return [group if group.is_foreign and not part.is_foreign else part, part, *others]


def _try_law(tried: Trial, loop: ClosedLoop, state: Array) -> None:
    """Evaluate the law for runs at one time, as engines do, and on all samples, as metrics do.

    Each with the numbers of the configuration, and with numbers of each run: so points of a sweep
    are solved together.
    """
    at_once = _repeated(loop, state)
    (_, starts), (times, _) = at_once
    numbers = {
        path: np.repeat(number[None], len(starts), axis=0) for path, number in leaves(loop).items()
    }
    together = Problem(loop, starts, times, numbers)
    for extra_axes, (t, states) in enumerate(at_once):
        for when, each in ((WHEN, loop), (TOGETHER, together.batched_loop(extra_axes))):
            tried.when = when
            _evaluate(tried, each, t, states)


def _evaluate(tried: Trial, loop: ClosedLoop, t: Any, states: Array) -> None:
    """Raise an `InputError` if the law fails, or returns no numbers for every run."""
    law, s = loop.controller, loop.tracking(t, states)
    kind = type(law)
    tried.fits(law.torque(s), kind.torque, states, loop.group.dimension, exact=True)
    tried.fits(law.lyapunov(s), kind.lyapunov, states, exact=True)
    dissipation = law.dissipation(s)
    if dissipation is not None:
        tried.fits(dissipation, kind.dissipation, states)
    if states.ndim == 2:
        loop.vector_field(t, states)
    else:
        compute(loop, t, states)


# Tries the parts of the vehicle -------------------------------------------------------------------


MEASUREMENTS = 3, 7
"""So many are drawn at once, and then as many with the same random numbers."""


def try_vehicle(experiment: Experiment, problems: Problems) -> None:
    """Note what parts of the user's lack, raise, or return in a shape that does not fit."""
    loop = experiment.loop
    Qd, Vd = experiment.initial_pose, experiment.initial_velocity
    for each in vehicle_parts(loop):
        if not each.is_foreign:
            continue
        with trial([each, *parts_of(loop)], problems) as tried:
            _require_words(each)
            state = loop.initial_state(Qd, Vd, Qd, Vd)
            random_of = partial(generator_at, experiment.config.ensemble.seed, Stream.VEHICLE, 0)
            if isinstance(each.part, Sensor):
                _try_sensor(loop, each, random_of)
            elif isinstance(each.part, Estimator):
                _try_estimator(loop, each.name, random_of, _repeated(loop, state)[0][1])
            else:
                for t, states in _repeated(loop, state):
                    _try_part(tried, loop, each.part, t, states)


def _require_words(part: LoopPart) -> None:
    """Raise where a report has no words for it."""
    words = part.part.departs
    if not isinstance(words, str) or not words.strip():
        raise InputError(
            f"{part.name}: `departs` is {words!r}; expected text that says in a few words how the "
            'loop departs from the ideal one, such as departs: ClassVar[str] = "a tether"'
        )


def _try_sensor(loop: ClosedLoop, each: LoopPart, random_of: RandomOf) -> None:
    """Raise where its errors do not fit, or one depends on how many are drawn."""
    sensor, place, G, control = each.part, dotted(each.path), loop.group, loop.vehicle.control
    assert control is not None
    drawn: list[tuple[Array, Array]] = []
    for count in MEASUREMENTS:
        errors = sensor.errors(G, count, control.period, random_of(place))
        lost = np.asarray(sensor.lost(count, random_of(place)))
        shape = (count, sensor.coordinates(G))
        if np.shape(errors) != shape:
            raise InputError(
                f"{each.name}: {place_of_function(type(sensor).errors)}: errors returns an array "
                f"of shape {np.shape(errors)} for {count} measurements; expected {shape}"
            )
        if lost.shape != (count,) or lost.dtype != bool:
            raise InputError(
                f"{each.name}: {place_of_function(type(sensor).lost)}: lost returns an array of "
                f"{lost.dtype} of shape {lost.shape} for {count} measurements; expected booleans "
                f"of shape ({count},)"
            )
        drawn.append((errors, lost))
    for method, few, many in zip(("errors", "lost"), *drawn, strict=True):
        if not np.array_equal(few, many[: len(few)]):
            where = place_of_function(getattr(type(sensor), method))
            raise InputError(
                f"{each.name}: {where}: {method}: the first values depend on how many are drawn; "
                "draw the numbers of each measurement in a row of its own"
            )


def _try_estimator(loop: ClosedLoop, name: str, random_of: RandomOf, states: Array) -> None:
    """At two instants, as engines call it."""
    errors = loop.vehicle.measurement_errors(loop.group, 2, [random_of])
    for tick in range(2):
        states = loop.measured(0.0, states, errors.measured(loop.group, 0, tick))
    if not np.isfinite(states).all():
        raise InputError(f"{name} gives no number {WHEN}: its states are not finite")


def _try_part(tried: Trial, loop: ClosedLoop, part: Any, t: Any, states: Array) -> None:
    """Raise where the output of a force or an actuator does not fit."""
    G, s, kind = loop.group, loop.tracking(t, states), type(part)
    if isinstance(part, Force):
        tried.fits(part.in_body(G, t, s.Q, s.V), kind.acting, states, G.dimension)
        if np.asarray(part.instants(G, 1.0), dtype=float).ndim != 1:
            tried.is_wrong(kind.instants, "no list of times, s, in order")
        return
    _require_states(part, part.states(G), tried.name)
    x = np.zeros((*states.shape[:-1], part.states(G)))
    tried.fits(part.output(G, s.V, x), kind.output, states, G.dimension)
    rate, limited = part.state_rate(G, s.V, x), np.shape(part.at_limit(G, s.V, x))
    if part.moves:
        tried.fits(rate, kind.state_rate, states, x.shape[-1])
    if part.limits and limited != x.shape[:-1]:
        tried.is_wrong(kind.at_limit, f"an array of shape {limited}; expected {x.shape[:-1]}")


def _require_states(part: Actuator, count: int, name: str) -> None:
    """Raise where it has states that nothing moves, or moves none."""
    if count and not part.moves and not part.sampled:
        raise InputError(
            f"{name}: has {count} states, but neither `moves` nor `sampled` is True; set `moves`, "
            "and give their time derivative in `state_rate`, or `sampled`, and give the states "
            "after an instant in `step`"
        )
    if part.moves and (not count or type(part).state_rate is Actuator.state_rate):
        raise InputError(
            f"{name}: `moves` is True; give the number of its states in `states` and their time "
            "derivative in `state_rate`"
        )
    if count and not part.moves and type(part).step is Actuator.step:
        raise InputError(f"{name}: has {count} states; give them after an instant in `step`")


# Tries metrics ------------------------------------------------------------------------------------


RUNS_TRIED, MOST_TRIED = 3, 1000
"""Numbers of runs, and of samples at most, on which metrics are tried."""


def metrics_of(
    listed: Sequence[Metric | None] | None,
    plugins: Mapping[str, str],
    loops: Collection[ClosedLoop],
    problems: Problems,
) -> list[Metric]:
    """Return the metrics that are listed, or those of the plugins whose signals a loop has."""
    if listed is None:
        names = metrics.defined_by(plugins.values())
        made = filter(None, (Kind(metrics).read(n, problems.at("metrics")) for n in names))
        return [each for each in made if not each.unknown(loops)]
    names = [each.name for each in listed if each is not None]
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        problems.at("metrics").add(f"{name} is listed twice; a result has one number of a name")
    return [each for each in listed if each is not None]


def try_metrics(experiment: Experiment, problems: Problems) -> None:
    """Note metrics of the user's own that fail, or return no number for each run."""
    loops, times = list(experiment.loops.values()), experiment.times[:MOST_TRIED]
    start = experiment.initial_pose, experiment.initial_velocity
    for index, metric in enumerate(experiment.metrics):
        part = LoopPart(metric, ("metrics", index), f"metric {metric.name}")
        for wrong in filter(None, (metric.unknown(loops), *metric.wrong(loops))):
            problems.at(*part.path).add(wrong)
        for loop in (each for each in loops if not (problems or metric.lacking(each))):
            states = np.tile(loop.initial_state(*start, *start), (RUNS_TRIED, len(times), 1))
            with trial([part], problems) as tried:
                signals, of = metric.signals_at(loop, states, times), type(metric).of
                tried.fits(metric.of(SampledRuns(times), *signals), of, states[:, 0], exact=True)
                if mixes_runs(metric.of, times, [each.shape[2:] for each in signals]):
                    tried.is_wrong(of, "numbers of a run that depend on other runs")


# Checks the reference over the horizon ------------------------------------------------------------


SAMPLES = 2001
"""Number of times at which the reference is evaluated, besides both sides of known instants."""

RTOL = 1e-8
"""Relative tolerance for the integration of a reference."""

MOST_EVALUATIONS = 10_000
"""Largest number of evaluations of an integrated reference, so that a check takes seconds."""

MOST_WRITTEN = 1_000
"""Characters of a configuration above which the number of evaluations is reduced."""

JUMP = 1e-6
"""Least jump relative to the largest value on the horizon."""

LEAST_JUMP = 1e-12
"""Least jump in SI units; smaller ones are those of rounding."""


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
    system = ReferenceSystem.of(experiment.loop)
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
            if by > max(JUMP * largest, LEAST_JUMP):
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


# Remarks on an experiment -------------------------------------------------------------------------


FORCE_SAMPLES = 4_001
"""Times over the horizon at which a user's force is compared with itself."""

FORCE_JUMP = 0.2
"""Share of its range by which a force that changes between two of these times jumps."""

MOST_NOISE = 1.0
"""Largest standard deviation of a measured rotation without a remark, rad."""


def remarks(experiment: Experiment, shown: Horizon | None = None) -> list[EqtWarning]:
    """Return remarks on an experiment and its reference, to be shown before it is run."""
    placed = [
        *experiment.remarks(),
        *_component_remarks(experiment),
        *_noise_remarks(experiment),
        *_numerical_remarks(experiment, shown),
    ]
    return [
        *(EqtWarning(f"{experiment.source.place(k)}: {dotted(k)}: {text}") for k, text in placed),
        *map(EqtWarning, limits_below_reference(experiment, shown)),
    ]


def remark_on(experiment: Experiment) -> None:
    """Tell the reporter the remarks on an experiment of which runs or loops are computed."""
    for known in remarks(experiment):
        reporter().remark(known)


Placed = Iterator[tuple[KeyPath, str]]
"""Remarks, each with the key that it is about."""


def _component_remarks(experiment: Experiment) -> Placed:
    """Yield the remarks of the reference, the actuators, the forces and the estimator."""
    loops, G = experiment.loops.values(), experiment.group
    loop = next(iter(loops))
    yield from ((("reference",), text) for text in loop.reference.remarks(G))
    yield from ((("initial", "file"), text) for text in getattr(experiment.poses, "notes", ()))
    wanted = max((loop.controller.directions(G) for loop in loops), key=len)
    for index, actuator in enumerate(loop.vehicle.actuators if len(wanted) else ()):
        for text in actuator.remarks(G, wanted):
            yield (ACTUATORS, index), f"{actuator.name} {text}"
    now, true, plant = loop.inertia.at(0.0), loop.vehicle.inertia, experiment.config.plant
    now = true.at(now, 0.0) if isinstance(true, PlantInertia) else now
    section = "plant" if plant and plant.forces else "model"
    kinds = [force.name for force in loop.vehicle.forces]
    for index, force in enumerate(loop.vehicle.forces):
        for key, text in force.remarks(G, now):
            if key != "weight" or kinds.count(force.name) == 1:  # several weights are one in all
                yield (section, "forces", index, key), text
        if is_foreign(type(force).__module__) and (t := _jump(experiment, force)) is not None:
            yield (
                (section, "forces", index),
                f"jumps at about t = {t:.4g} s, which engines may step over; give its times in "
                "`instants(self, G, until)`",
            )
    for part in loop.vehicle.schedule(G).unmeasured if loop.vehicle.estimator else ():
        yield (
            ("estimator",),
            f"nothing measures the {part}, so that the error of its estimate "
            "grows without bound; add an entry for it to sensors.pose",
        )


def _jump(experiment: Experiment, force: Force) -> float | None:
    """Return where a force jumps in time, at the start of the runs, though it gives no instant."""
    G, Q, V = experiment.group, experiment.initial_pose[None], experiment.initial_velocity[None]
    times = np.linspace(0.0, experiment.config.time.duration, FORCE_SAMPLES)
    with np.errstate(all="ignore"):  # of one run, as engines call it
        values = np.array([force.in_body(G, t, Q, V)[0] for t in times.tolist()])
    steps = np.abs(np.diff(values, axis=0)).max(axis=-1)
    known = np.searchsorted(times, force.instants(G, times[-1]))
    steps[np.clip(known, 1, len(steps)) - 1] = 0.0
    jumps = steps.max() > FORCE_JUMP * np.ptp(values, axis=0).max()
    return float(times[steps.argmax()]) if jumps else None


def _noise_remarks(experiment: Experiment) -> Placed:
    """Remark on a noise of measured rotations that says nothing about them."""
    vehicle, G = experiment.loop.vehicle, experiment.group
    for path, sensor in vehicle.sensors().items():
        if vehicle.control is None or not path.startswith("sensors.pose"):
            continue
        std = sensor.drawn(None).white_deviation(G, sensor.period or vehicle.control.period)
        measured = [part for part in G.parts if part.name == sensor.of] or G.parts
        turns = [part.turns for part in measured for _ in range(G.dimension)[part.axes]]
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
    loop = experiment.loop
    texts.append(("inertia", in_other_order(loop.group, loop.inertia)))
    try:
        with blamed(), threadpool_limits(1):  # threads slow down small matrices
            texts.append(("gains", stiff(experiment, along)))
            texts += [("controllers", text) for text in unstable_or_slow(experiment, along)]
    except ComponentError as error:
        texts.append(("controllers", f"loops cannot be linearised: {error}"))
    yield from (((section,), text) for section, text in texts if text)


# Remarks on its numerics: rounding, stiffness, and loops that are unstable or slow ----------------


EPSILON = float(np.finfo(float).eps)

ORDINARY = 20_000
"""Largest number of evaluations of the vector field, or of steps, without a remark: two seconds for
a single run. For stability, most shipped experiments need some hundreds, `se3_survey` 14,000."""

CERTAINLY = 3.0
"""Ratio of estimated to allowed work beyond which no run ends, with a margin for the estimate."""

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
    loop, rtol = experiment.loop, experiment.engine.rtol
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
    chosen, (work, label, rates) = experiment.engine, _most_work(experiment, along)
    if work <= ORDINARY:
        return ""
    explicit = SolveIvp(rtol=chosen.rtol).work_for_stability(rates, experiment.config.time.duration)
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


def _most_work(experiment: Experiment, along: Along) -> tuple[float, str, Array]:
    """Return the most work that the decay of a loop demands, its label and its eigenvalues."""
    chosen = experiment.engine
    worst: tuple[float, str, Array] = (0.0, "", np.zeros(1))
    for label, loop in small_loops(experiment, along).items():
        matrices = flow(loop, *along)
        if np.isfinite(matrices).all():
            rates = np.linalg.eigvals(matrices)
            work = chosen.work_for_stability(rates, experiment.config.time.duration)
            worst = max(worst, (work, label, rates), key=lambda each: each[0])
    return worst


def check_steps(experiment: Experiment, problems: Problems) -> None:
    """Note a loop that needs many more steps than a run may take, so that no run would end."""
    most = getattr(experiment.engine, "max_steps", np.inf)
    with blamed(), threadpool_limits(1):
        work, label, rates = _most_work(experiment, along_reference(experiment, None))
    if work > CERTAINLY * most:
        problems.at("time", "duration").add(
            f"no run of '{label}' would end: its errors decay at up to {np.abs(rates).max():.2g} "
            f"1/s, for which {experiment.config.time.duration:g} s take about {_rounded(work)} "
            f"{experiment.engine.counted}, and solver.max_steps is {most:,}; check gains, inertia "
            "and time constants, take a shorter duration, or `solver.method: Radau`"
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


LINEARISED = 9
"""Number of times at which a loop is linearised."""

GOLDEN = (5**0.5 - 1) / 2
"""Golden ratio. The fractional parts of its multiples are spread evenly without equal gaps."""

CERTAIN = 1.1
"""Growth in a cycle, at each single time, beyond which a sampled loop that changes is unstable."""

HOPELESS = 100.0
"""Growth in a cycle at the start of the reference alone, beyond which a run will not recover."""

MOST_ENTRIES = 200_000
"""Largest number of matrix entries over all times; at 9 times, this allows 149 states."""


def unstable_or_slow(experiment: Experiment, along: Along) -> Iterator[str]:
    """Yield sentences on unstable loops, and on slow ones, that do not depend on time."""
    horizon = experiment.config.time.duration
    for label, loop in small_loops(experiment, along).items():
        with np.errstate(all="ignore"):
            linear = linearised(loop, *along)
        if not np.isfinite(linear.closed).all():
            continue
        begins = len(along.times) == 1
        if begins or not linear.is_constant:
            sizes = np.abs(np.linalg.eigvals(linear.closed)).max(axis=-1)
            if linear.cycle is not None and sizes.min() > (HOPELESS if begins else CERTAIN):
                where = "where the reference begins" if begins else "wherever the reference is held"
                yield (
                    f"the loop of '{label}' is unstable {where}: small "
                    f"errors grow by {sizes.min():.4g} or more in {linear.cycle:g} s; check the "
                    "sizes of its gains, and the delays; `eqt margins` shows more"
                )
            continue
        largest = growth(linear)
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


# Remarks on limits below the torque of the reference ----------------------------------------------


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
    loop = experiment.loop
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
    loop = experiment.loop
    if not loop.vehicle.limits:
        return []
    shown = shown or reference_over_horizon(experiment)
    parts = (shown.times, shown.torque, shown.pose, shown.velocity)
    times, torque, pose, velocity = (part[shown.finite] for part in parts)
    for force in loop.reference.known_forces:
        torque = torque - force.in_body(loop.group, times, pose, velocity)
    texts, wheels = [], wheels_needed(experiment, shown)
    if wheels is not None and wheels.are_too_much and not loop.vehicle.magnet:  # which dumps it
        place = experiment.source.place((ACTUATORS,))
        texts.append(
            f"{place}: {ACTUATORS}: the reference, with the forces of the plant, needs "
            f"{wheels.in_words}; no law can follow it there"
        )
    for index, actuator in enumerate(loop.vehicle.actuators):
        found = actuator.needed(loop.group, times, torque) if actuator.limits else None
        if found is None or not len(found[0]):
            continue
        needed, low, high = np.broadcast_arrays(*found)
        beyond = np.maximum(needed - high, low - needed)
        limits = np.where(needed > high, high, low)
        with np.errstate(divide="ignore", invalid="ignore"):  # a limit may be 0
            share = np.where(beyond > 0, beyond / np.abs(limits), 0.0)
        axis = int(np.argmax(share.max(axis=0)))
        when = int(np.argmax(beyond[:, axis]))
        if beyond[when, axis] > 0:
            t = times[len(times) - len(needed) + when]
            most = "most" if needed[when, axis] > high[when, axis] else "least"
            names = actuator.thruster_names
            name, unit = (f"'{names[axis]}'", " N") if names else (actuator.name, "")
            place = experiment.source.place((ACTUATORS, index))
            texts.append(
                f"{place}: {ACTUATORS}[{index}]: {name} gives at {most} {actuator.limited}"
                f"{limits[when, axis]:.4g}{unit}, but the reference alone needs "
                f"{needed[when, axis]:.4g}{unit} at t = {t:.4g} s; no law can follow it there"
            )
    return texts
