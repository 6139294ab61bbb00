"""Pre-flight: what eqt tries of an experiment before it integrates a run, in this order.

1. `try_vehicle`: forces, actuators, sensors and estimators of the user's own, at the start of the
   reference. Are their arrays of the right shape, for some runs and samples?
2. `try_laws`: initial states, group, reference and laws, where one is the user's own, at the start
   of run 0; the laws also with numbers that differ from run to run.
   `try_metrics`: metrics of the user's own, on samples at the start.
3. `eqt_cli.engines.horizon`: is the reference finite over the horizon, its torque below a bound?
4. `eqt_cli.config.remarks`: numbers that look wrong, rounding, stiffness, loops that are unstable
   or slow, and limits below the torque of the reference.

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

import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, NoReturn

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, EqtWarning, InputError, Problems, dotted
from eqt_cli.base.registry import blamed, described, is_foreign, place_of, place_of_function
from eqt_cli.base.reporting import reporter
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.estimators import Estimator
from eqt_cli.components.forces import Force
from eqt_cli.components.initial_states import Stream, draw_initial_states, generator_at
from eqt_cli.components.sensors import Sensor
from eqt_cli.components.vehicle import RandomOf
from eqt_cli.config.experiment import Experiment, assemble, designed_laws
from eqt_cli.config.source import AUTO, ConfigSource
from eqt_cli.engines.engine import Problem
from eqt_cli.engines.native import Native, refusal
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.loop.closed_loop import ClosedLoop, LoopPart, parts_of, vehicle_parts
from eqt_cli.loop.signals import compute
from eqt_cli.numbers.leaves import leaves
from eqt_cli.numbers.running import SampledRuns, mixes_runs

# Builds an experiment, and tries it ---------------------------------------------------------------


def build(source: ConfigSource, *, trust_plugins: bool = False) -> Experiment:
    """Check a configuration and make an experiment of it, whose source names its engine.

    Parameters
    ----------
    trust_plugins
        Execute plugin sources that are stored in a result file.

    Raises
    ------
    ConfigError
        With every problem, each at its place in the file.
    ComponentError
        If a component of the user's own fails while it is made.
    """
    if source.engine != AUTO:
        return _tried(source, trust_plugins)
    if source.chosen:
        problems = Problems(source.place)
        problems.at("solver", "engine").add("must be named where a point or a case sets the solver")
        problems.raise_if_any()
    if not (why := refusal()):
        experiment = _tried(source.by_engine(Native.name), trust_plugins)
        if not (why := refusal(experiment.loops.values())):
            return experiment
    slower = f"engine {SolveIvp.name}, 2 to 17 times slower than native: {why.args[0]}"
    reporter().remark(EqtWarning(slower, *why.remedies, lines=why.lines))
    return _tried(source.by_engine(SolveIvp.name), trust_plugins)


@blamed()
@np.errstate(all="ignore")  # what overflows is found by the checks, and said by them alone
def _tried(source: ConfigSource, trust_plugins: bool) -> Experiment:
    """Return the experiment of a configuration that names its engine, once it was tried."""
    experiment, problems = assemble(source, trust_plugins), Problems(source.place)
    try_vehicle(experiment, problems)
    problems.raise_if_any()
    experiment = designed_laws(experiment, problems)
    problems.raise_if_any()
    try_laws(experiment, problems)
    problems.raise_if_any()
    try_metrics(experiment, problems)
    problems.raise_if_any()
    return experiment


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
                "draw the numbers of each measurement in a separate row"
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
