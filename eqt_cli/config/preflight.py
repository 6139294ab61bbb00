"""Pre-flight: what eqt tries of an experiment before it integrates a run, in this order.

0. What extensions check: can parts have the numbers that each run draws?
1. `try_parts`: parts of the user's own but for laws, at the start of the reference. Are their
   arrays of the right shape, for some runs and samples?
2. `try_laws`: initial states and laws, where one of what they need is the user's own, at the start
   of run 0; the laws also with numbers that differ from run to run.
   `try_metrics`: metrics of the user's own, on samples at the start.
3. `eqt_cli.engines.horizon`: is the reference finite over the horizon, its torque below a bound?
4. `eqt_cli.config.remarks`: numbers that look wrong, rounding, stiffness, loops that are unstable
   or slow, and limits below the torque of the reference.

`eqt_cli.runs.preflight` goes on with what depends on the runs of a study:

5. `check_resources`: do its runs differ? Do its largest part and its files fit into the memory and
   on the disk?
6. `rehearse`: would a run end, and are two runs of every law together, from their own starts, what
   each is alone?
7. `estimate`: how long will it take?

Every command that builds an experiment begins with 0 to 2, at every point of a sweep. After them

- `config check` does 5, 3, 6 and 4;
- `run` and `sweep` do 4, about the reference at its start only, 5, and 6 without a solver; so do
  `verify` and `export`, but for 5;
- `tune` and `worst` do 5 for every generation;
- `--dry-run` does 7, of a sweep after 5 for the memory.
"""

import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NoReturn

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.code_files import opened_files
from eqt_cli.base.errors import EqtError, InputError, Problems, dotted
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.registry import blamed, described, is_foreign, place_of, place_of_function
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.estimators import Estimator
from eqt_cli.components.forces import Force
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.laws import Controller
from eqt_cli.components.references import Reference
from eqt_cli.components.sensors import Sensor
from eqt_cli.components.vehicle_parts import VehiclePart
from eqt_cli.config.document import Document, changed_at
from eqt_cli.config.experiment import Experiment, LastPoint, assemble, designed_laws
from eqt_cli.engines.choice import AUTO
from eqt_cli.engines.engine import Problem
from eqt_cli.loop.closed_loop import ClosedLoop, LoopPart, parts_of
from eqt_cli.loop.signals import compute
from eqt_cli.numbers.leaves import leaves, with_leaves
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
    problems = Problems(document.place)
    with opened_files() as opened:  # also where a law is called first
        experiment = assemble(document, last)
        for check in functions_for(purposes.checks_of_an_experiment):  # they note problems
            check(experiment, problems)
        problems.raise_if_any()
        try_parts(experiment, problems)
        problems.raise_if_any()
        experiment = designed_laws(experiment, problems)
        problems.raise_if_any()
        try_laws(experiment, problems)
        problems.raise_if_any()
        try_metrics(experiment, problems)
        problems.raise_if_any()
    experiment = replace(experiment, opened=opened)
    if not experiment.solver.is_auto:
        return experiment
    solver = experiment.solver.chosen(experiment.loops.values())
    named = changed_at(experiment.document, ("solver", "engine"), solver.engine.name, AUTO)
    return replace(experiment, solver=solver, document=named)


# A trial of parts of a loop, whose errors are noted at the part that they are from ----------------


WHEN = "at the start of run 0"

TOGETHER = "when runs are solved together, with every number of a law as an array (runs, 1)"

CONTRACTED = "; multiply before you contract: dot(self.k * z, z), not self.k * dot(z, z)"

MISSED = (
    "shapes {} do not meet run by run (write `[..., None]` behind what has one number a run, such "
    "as R[..., 2, 1] or s.t, or `[..., 0]` behind a number such as self.k)"
)

REAL, BOOLEAN = "fiu", "b"
"""Kinds of numbers, by the letters of NumPy."""


@dataclass
class Trial:
    """A part of a loop that is evaluated.

    Attributes
    ----------
    name
        The part, in messages.
    when
        The states and numbers with which it is evaluated now, in words.
    counts
        How many runs and samples there are now, by these words.
    """

    name: str
    when: str
    counts: dict[str, int] = field(default_factory=dict)

    def fits(
        self, value: Any, method: Any, *axes: int, kinds: str = REAL, exact: bool = False
    ) -> None:
        """Raise an `InputError` if a method returns no numbers for every run, sample and axis.

        What is the same for all runs or samples may lack their axes, unless it is to be `exact`.
        """
        shape, actual = (*self.counts.values(), *axes), np.shape(value)
        if not isinstance(value, np.ndarray | np.generic | float | int):
            returned = "None" if value is None else type(value).__name__
            self.is_wrong(method, f"{returned}; expected an array")
        if (dtype := np.asarray(value).dtype).kind not in kinds:
            numbers = "booleans" if kinds == BOOLEAN else "real numbers"
            self.is_wrong(method, f"an array of {dtype}; expected {numbers}")
        last = zip(reversed(actual), reversed(shape), strict=False)
        spreads = len(actual) <= len(shape) and all(n in (1, whole) for n, whole in last)
        if actual == shape or (not exact and spreads and actual[len(actual) - len(axes) :] == axes):
            return
        of = " of ".join(f"{count} {what}" for what, count in self.counts.items())
        self.is_wrong(method, f"an array of shape {actual} for {of}; expected {shape}")

    def is_wrong(self, method: Any, returned: str) -> NoReturn:
        """Raise an `InputError` about what a method returns."""
        place = place_of_function(getattr(method, "__func__", method))
        hint = CONTRACTED if self.when == TOGETHER else ""
        raise InputError(
            f"{self.name} is wrong {self.when}: {place}: {method.__name__} returns {returned}{hint}"
        )


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
    except (Exception, SystemExit) as error:
        if not any(part.is_foreign for part in parts):
            raise
        culprit, place = _culprit(error, parts), place_of(error)
        at = f" at {place}" if place else ""
        problems.at(*culprit.path).add(f"{culprit.name} fails {tried.when}: {described(error)}{at}")


class ShapeError(ValueError):
    """Arrays of numbers of each run that do not broadcast, or to pairs of runs."""


class Watched(np.ndarray):
    """An array that says with which other it is combined wrongly."""

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """Return what NumPy's function does, watched as well."""
        plain = [x.view(np.ndarray) if isinstance(x, Watched) else x for x in inputs]
        shapes = [np.shape(x) for x in plain]
        if into := options.pop("out", ()):
            options["out"] = tuple(x.view(np.ndarray) for x in into)
        try:
            if any((*few, 1) in shapes for few in shapes if few[-1:] > (1,)):
                raise ValueError
            result = getattr(ufunc, method)(*plain, **options)
        except ValueError:
            if ufunc.signature or len(shapes) < 2:
                raise
            raise ShapeError(MISSED.format(" and ".join(map(str, shapes)))) from None
        return result.view(Watched) if isinstance(result, np.ndarray) else result


@contextmanager
def located(
    evaluate: Callable[..., Any], loop: ClosedLoop, t: Any, states: Array
) -> Iterator[None]:
    """Where the block fails, raise an error at the line that combines arrays wrongly, if any.

    Parameters
    ----------
    evaluate
        What the block does with a loop, a time and states. It is repeated with watched arrays.
    """
    try:
        yield
    except Exception:
        numbers = {name: x.view(Watched) for name, x in leaves(loop).items()}
        try:
            evaluate(with_leaves(loop, numbers), t, states.view(Watched))
        except Exception as watched:
            if isinstance(watched, ShapeError) and place_of(watched):
                raise
        raise


def _culprit(error: BaseException, parts: Sequence[LoopPart]) -> LoopPart:
    """Return the part of the innermost line that is in the file of one that is the user's own."""
    by_module = {type(part.part).__module__: part for part in reversed(parts) if part.is_foreign}
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


def _check_alone_and_together(
    tried: Trial,
    index: int,
    loop: ClosedLoop,
    t: Any,
    states: Array,
    extra_axes: int,
    whole: Callable[..., Any] = lambda *_: None,
) -> None:
    """Check a part of a loop, and the `whole`, with one set of numbers and with those of runs."""
    numbers = {name: np.array([x] * len(states)) for name, x in leaves(loop).items()}
    together = Problem(loop, states, np.zeros(1), numbers).batched_loop(extra_axes)

    def check(loop: ClosedLoop, t: Any, states: Array) -> None:
        _check_returns(tried, parts_of(loop)[index].part, loop, t, states)
        whole(loop, t, states)

    for tried.when, one in ((WHEN, loop), (TOGETHER, together)):
        with located(check, one, t, states):
            check(one, t, states)


def _check_returns(tried: Trial, part: Any, loop: ClosedLoop, t: Any, states: Array) -> None:
    """Raise an `InputError` if what a part of a loop returns does not fit some states."""
    G, m, s = loop.group, loop.group.dimension, loop.tracking(t, states)
    tried.counts = dict(zip(("runs", "samples"), states.shape[:-1], strict=False))
    if isinstance(part, Controller):
        tried.fits(part.torque(s), part.torque, m, exact=True)
        tried.fits(part.lyapunov(s), part.lyapunov, exact=True)
        if (dissipation := part.dissipation(s)) is not None:
            tried.fits(dissipation, part.dissipation)
    elif isinstance(part, Reference | MatrixLieGroup):
        tried.fits(s.tau_d, loop.reference.driving_torque, m)
    elif isinstance(part, Force):
        for method in (part.acting, part.in_body):
            tried.fits(method(G, t, s.Q, s.V), method, m)
        if np.asarray(part.instants(G, 1.0), dtype=float).ndim != 1:
            tried.is_wrong(part.instants, "no list of times, s, in order")
    elif isinstance(part, Actuator):
        x = np.zeros((*states.shape[:-1], part.states(G)))
        tried.fits(part.output(G, s.V, x), part.output, m)
        if part.moves:
            tried.fits(part.state_rate(G, s.V, x), part.state_rate, x.shape[-1])
        if part.limits:
            tried.fits(part.at_limit(G, s.V, x), part.at_limit, kinds=REAL + BOOLEAN, exact=True)


# Tries parts of the user's own but for laws -------------------------------------------------------


MEASUREMENTS = 3, 7
"""So many are drawn at once, and then as many with the same random numbers."""


def try_parts(experiment: Experiment, problems: Problems) -> None:
    """Note what parts of the user's lack, raise, or return in a shape that does not fit."""
    loop, start = experiment.loop, (experiment.desired.pose, experiment.desired.velocity)
    random_of = partial(generator_at, experiment.config.ensemble.seed, Stream.VEHICLE, 0)
    for index, place in enumerate(parts_of(loop)):
        if index == 0 or not place.is_foreign:
            continue
        with trial([place, *parts_of(loop)], problems) as tried:
            if isinstance(place.part, VehiclePart):
                _check_declared(place.name, place.part, loop.group)
            evaluated = _repeated(loop, loop.initial_state(*start, *start))
            for axes, (t, states) in enumerate(evaluated):
                _check_alone_and_together(tried, index, loop, t, states, axes)
            tried.when = WHEN
            if isinstance(place.part, Sensor):
                _check_drawn(tried, place.part, loop, partial(random_of, dotted(place.path)))
            elif isinstance(place.part, Estimator):
                states = evaluated[0][1]
                errors = loop.vehicle.measurement_errors(loop.group, 2, [random_of])
                for tick in range(2):  # as engines call it
                    states = loop.measured(0.0, states, errors.measured(loop.group, 0, tick))
                if not np.isfinite(states).all():
                    raise InputError(
                        f"{place.name} gives no number {WHEN}: its states are not finite"
                    )


def _check_declared(name: str, part: Any, G: MatrixLieGroup) -> None:
    """Raise an `InputError` where a part has no words, or states that nothing changes."""
    if not isinstance(part.departs, str) or not part.departs.strip():
        raise InputError(
            f"{name}: `departs` is {part.departs!r}; expected text that says in a few words how "
            'the loop departs from the ideal one, such as departs: ClassVar[str] = "a tether"'
        )
    if isinstance(part, Actuator):
        count, method = part.states(G), "state_rate" if part.moves else "step"
        changes = getattr(type(part), method) is not getattr(Actuator, method)
        fits = count > 0 and changes and (part.moves or part.sampled)
        if (count or part.moves) and not fits:
            raise InputError(
                f"{name}: has {count} states, `moves` is {part.moves} and `sampled` is "
                f"{part.sampled}; give the number of states in `states`, and set `moves` and give "
                "their time derivative in `state_rate`, or set `sampled` and give the states after "
                "an instant in `step`"
            )


def _check_drawn(
    tried: Trial, sensor: Sensor, loop: ClosedLoop, random: Callable[[], np.random.Generator]
) -> None:
    """Raise an `InputError` if errors do not fit, or one depends on how many are drawn."""
    G, control = loop.group, loop.vehicle.control
    assert control is not None
    tried.counts = {"measurements": MEASUREMENTS[0]}
    errors = [np.asarray(sensor.errors(G, n, control.period, random())) for n in MEASUREMENTS]
    lost = [np.asarray(sensor.lost(n, random())) for n in MEASUREMENTS]
    tried.fits(errors[0], sensor.errors, sensor.coordinates(G), exact=True)
    tried.fits(lost[0], sensor.lost, kinds=BOOLEAN, exact=True)
    for method, (few, many) in ((sensor.errors, errors), (sensor.lost, lost)):
        if not np.array_equal(few, many[: len(few)]):
            first = "first values that depend on how many are drawn"
            tried.is_wrong(method, f"{first}; draw the numbers of each measurement in its own row")


# Tries the laws, and what they are given ----------------------------------------------------------


def try_laws(experiment: Experiment, problems: Problems) -> None:
    """Note what laws and initial states raise, or laws return in a shape that does not fit.

    Each law is evaluated for runs at one time, as engines do, and on all samples, as metrics do,
    with the numbers of the configuration, and with numbers of each run: so points of a sweep are
    solved together.
    """
    loops, Qd, Vd = experiment.loops, experiment.desired.pose, experiment.desired.velocity
    poses, velocities = experiment.start.poses, experiment.start.velocities
    needed = [part for e in loops.values() for part in (e.group, e.reference, e.controller)]
    needed += [inner for e in loops.values() if (inner := getattr(e.controller, "inner", None))]
    if not any(is_foreign(type(part).__module__) for part in [*needed, poses, velocities]):
        return
    start = [
        LoopPart(distribution, ("initial",), "the initial states")
        for distribution in (poses, velocities)
    ]
    first, seed = next(iter(loops.values())), experiment.config.ensemble.seed
    with trial([*start, *parts_of(first)], problems):
        drawn, error = experiment.start.numbers(first.group, seed, run=0)
        Q, V = Qd @ poses.place(first.group, drawn[None]), Vd + error[None]
        first.initial_state(Q, V, Qd, Vd)
    if problems:
        return
    for index, loop in enumerate(loops.values()):
        law, reference, group, *others = parts_of(loop, index)
        if (inner := getattr(loop.controller, "inner", None)) and is_foreign(
            type(inner).__module__
        ):
            law = LoopPart(inner, law.path, f"controller '{inner.name}'")
        suspect = group if group.is_foreign and not law.is_foreign else law
        with trial([suspect, law, reference, group, *others], problems) as tried:
            state = loop.initial_state(Q, V, Qd, Vd)[0]  # with this law's memory
            for axes, (t, states) in enumerate(_repeated(loop, state)):
                whole = compute if axes else ClosedLoop.vector_field
                _check_alone_and_together(tried, 0, loop, t, states, axes, whole)


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
        for loop in (
            closed_loop for closed_loop in loops if not (problems or metric.lacking(closed_loop))
        ):
            states = np.tile(loop.initial_state(*start, *start), (RUNS_TRIED, len(times), 1))
            with trial([part], problems) as tried:
                signals = metric.signals_at(loop, states, times)
                tried.counts = {"runs": RUNS_TRIED}
                tried.fits(metric.of(SampledRuns(times), *signals), metric.of, exact=True)
                if mixes_runs(metric.of, times, [signal.shape[2:] for signal in signals]):
                    tried.is_wrong(metric.of, "numbers of a run that depend on other runs")
