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
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NoReturn

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, InputError, Problems, dotted
from eqt_cli.base.registry import blamed, described, is_foreign, place_of, place_of_function
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.estimators import Estimator
from eqt_cli.components.forces import Force
from eqt_cli.components.initial_states import Stream, draw_initial_states, generator_at
from eqt_cli.components.sensors import Sensor
from eqt_cli.components.vehicle import RandomOf
from eqt_cli.config.document import Document, changed_at
from eqt_cli.config.experiment import Experiment, LastPoint, assemble, designed_laws
from eqt_cli.engines.choice import AUTO
from eqt_cli.engines.engine import Problem
from eqt_cli.loop.closed_loop import ClosedLoop, LoopPart, parts_of, vehicle_parts
from eqt_cli.loop.signals import compute
from eqt_cli.numbers.leaves import leaves
from eqt_cli.numbers.running import SampledRuns, mixes_runs

# Builds an experiment, and tries it ---------------------------------------------------------------


@blamed()
@np.errstate(all="ignore")  # what overflows is found by the checks, and said by them alone
def build(document: Document, last: LastPoint | None = None) -> Experiment:
    """Check a configuration and make an experiment of it, whose document names its engine.

    Parameters
    ----------
    last
        The last point of a sweep, whose parts are taken over where their sections are the same.

    Raises
    ------
    ConfigError
        With every problem, each at its place in the file.
    ComponentError
        If a component of the user's own fails while it is made.
    """
    experiment, problems = assemble(document, last), Problems(document.place)
    try_vehicle(experiment, problems)
    problems.raise_if_any()
    experiment = designed_laws(experiment, problems)
    problems.raise_if_any()
    try_laws(experiment, problems)
    problems.raise_if_any()
    try_metrics(experiment, problems)
    problems.raise_if_any()
    if not experiment.solver.is_auto:
        return experiment
    solver = experiment.solver.chosen(experiment.loops.values())
    named = changed_at(experiment.document, ("solver", "engine"), solver.engine.name, AUTO)
    return replace(experiment, solver=solver, document=named)


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
        shape, actual = (*states.shape[:-1], *axes), np.shape(value)
        if not isinstance(value, np.ndarray | np.generic | float | int):
            returned = "None" if value is None else type(value).__name__
            self.is_wrong(function, f"{returned}; expected an array")
        if (kind := np.asarray(value).dtype).kind not in "fiu":
            self.is_wrong(function, f"an array of {kind}; expected real numbers")
        last = zip(reversed(actual), reversed(shape), strict=False)
        spreads = len(actual) <= len(shape) and all(n in (1, whole) for n, whole in last)
        if actual == shape or (not exact and spreads and actual[len(actual) - len(axes) :] == axes):
            return
        counts = zip(shape[: states.ndim - 1], ("runs", "samples"), strict=False)
        of = " of ".join(f"{n} {what}" for n, what in counts)
        self.is_wrong(function, f"an array of shape {actual} for {of}; expected {shape}")

    def is_wrong(self, function: Any, returned: str) -> NoReturn:
        """Raise an `InputError` about what a function returns."""
        place = f"{place_of_function(function)}: {function.__name__}"
        hint = CONTRACTED if self.when == TOGETHER else ""
        raise InputError(f"{self.name} is wrong {self.when}: {place} returns {returned}{hint}")


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
    loops, Qd, Vd = experiment.loops, experiment.desired.pose, experiment.desired.velocity
    poses, velocities = experiment.start.poses, experiment.start.velocities
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
    kind = type(loop.controller)
    for extra_axes, (t, states) in enumerate(_repeated(loop, state)):
        numbers = {name: np.array([number] * len(states)) for name, number in leaves(loop).items()}
        together = Problem(loop, states, np.zeros(1), numbers).batched_loop(extra_axes)
        for when, each in ((WHEN, loop), (TOGETHER, together)):
            law, s = each.controller, each.tracking(t, states)
            tried.when = when
            tried.fits(law.torque(s), kind.torque, states, loop.group.dimension, exact=True)
            tried.fits(law.lyapunov(s), kind.lyapunov, states, exact=True)
            if (dissipation := law.dissipation(s)) is not None:
                tried.fits(dissipation, kind.dissipation, states)
            if extra_axes:
                compute(each, t, states)
            else:
                each.vector_field(t, states)


# Tries the parts of the vehicle -------------------------------------------------------------------


MEASUREMENTS = 3, 7
"""So many are drawn at once, and then as many with the same random numbers."""


def try_vehicle(experiment: Experiment, problems: Problems) -> None:
    """Note what parts of the user's lack, raise, or return in a shape that does not fit."""
    loop, start = experiment.loop, (experiment.desired.pose, experiment.desired.velocity)
    random_of = partial(generator_at, experiment.config.ensemble.seed, Stream.VEHICLE, 0)
    for place in vehicle_parts(loop):
        if not place.is_foreign:
            continue
        part, words = place.part, place.part.departs
        with trial([place, *parts_of(loop)], problems) as tried:
            if not isinstance(words, str) or not words.strip():
                raise InputError(
                    f"{place.name}: `departs` is {words!r}; expected text that says in a few words "
                    "how the loop departs from the ideal one, such as departs: ClassVar[str] = "
                    '"a tether"'
                )
            evaluated = _repeated(loop, loop.initial_state(*start, *start))
            if isinstance(part, Sensor):
                _try_sensor(loop, place, random_of)
            elif isinstance(part, Estimator):
                states = evaluated[0][1]
                errors = loop.vehicle.measurement_errors(loop.group, 2, [random_of])
                for tick in range(2):  # as engines call it
                    states = loop.measured(0.0, states, errors.measured(loop.group, 0, tick))
                if not np.isfinite(states).all():
                    raise InputError(
                        f"{place.name} gives no number {WHEN}: its states are not finite"
                    )
            elif isinstance(part, Force):
                _try_force(tried, loop, part, evaluated)
            else:
                _try_actuator(tried, loop, part, evaluated)


def _try_sensor(loop: ClosedLoop, place: LoopPart, random_of: RandomOf) -> None:
    """Raise where its errors do not fit, or one depends on how many are drawn."""
    sensor, path, G, control = place.part, dotted(place.path), loop.group, loop.vehicle.control
    assert control is not None
    count, period = MEASUREMENTS[0], control.period
    errors = [np.asarray(sensor.errors(G, n, period, random_of(path))) for n in MEASUREMENTS]
    lost = [np.asarray(sensor.lost(n, random_of(path))) for n in MEASUREMENTS]
    for method, (few, many), shape, dtype, booleans in (
        ("errors", errors, (count, sensor.coordinates(G)), "", ""),
        ("lost", lost, (count,), f"{lost[0].dtype} of ", "booleans of shape "),
    ):
        where = f"{place.name}: {place_of_function(getattr(type(sensor), method))}: {method}"
        if few.shape != shape or (booleans and few.dtype != bool):
            raise InputError(
                f"{where} returns an array of {dtype}shape {few.shape} for {count} measurements; "
                f"expected {booleans}{shape}"
            )
        if not np.array_equal(few, many[:count]):
            raise InputError(
                f"{where}: the first values depend on how many are drawn; "
                "draw the numbers of each measurement in a separate row"
            )


def _try_force(
    tried: Trial, loop: ClosedLoop, force: Force, evaluated: list[tuple[Any, Array]]
) -> None:
    """Raise where its wrench does not fit, or its instants are no list."""
    G, kind = loop.group, type(force)
    for t, states in evaluated:
        s = loop.tracking(t, states)
        tried.fits(force.in_body(G, t, s.Q, s.V), kind.acting, states, G.dimension)
    if np.asarray(force.instants(G, 1.0), dtype=float).ndim != 1:
        tried.is_wrong(kind.instants, "no list of times, s, in order")


def _try_actuator(
    tried: Trial, loop: ClosedLoop, actuator: Actuator, evaluated: list[tuple[Any, Array]]
) -> None:
    """Raise where it has states that nothing moves, or moves none, or its output does not fit."""
    G, kind, count = loop.group, type(actuator), actuator.states(loop.group)
    if count and not actuator.moves and not actuator.sampled:
        raise InputError(
            f"{tried.name}: has {count} states, but neither `moves` nor `sampled` is True; set "
            "`moves`, and give their time derivative in `state_rate`, or `sampled`, and give the "
            "states after an instant in `step`"
        )
    if actuator.moves and (not count or kind.state_rate is Actuator.state_rate):
        raise InputError(
            f"{tried.name}: `moves` is True; give the number of its states in `states` and their "
            "time derivative in `state_rate`"
        )
    if count and not actuator.moves and kind.step is Actuator.step:
        raise InputError(f"{tried.name}: has {count} states; give them after an instant in `step`")
    for t, states in evaluated:
        V, x = loop.tracking(t, states).V, np.zeros((*states.shape[:-1], count))
        tried.fits(actuator.output(G, V, x), kind.output, states, G.dimension)
        if actuator.moves:
            tried.fits(actuator.state_rate(G, V, x), kind.state_rate, states, count)
        limited = np.shape(np.asarray(actuator.at_limit(G, V, x)))
        if actuator.limits and limited != x.shape[:-1]:
            tried.is_wrong(kind.at_limit, f"an array of shape {limited}; expected {x.shape[:-1]}")


# Tries metrics ------------------------------------------------------------------------------------


RUNS_TRIED, MOST_TRIED = 3, 1000
"""Numbers of runs, and of samples at most, on which metrics are tried."""


def try_metrics(experiment: Experiment, problems: Problems) -> None:
    """Note metrics of the user's own that fail, or return no number for each run."""
    loops, times = list(experiment.loops.values()), experiment.times[:MOST_TRIED]
    start = experiment.desired.pose, experiment.desired.velocity
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
