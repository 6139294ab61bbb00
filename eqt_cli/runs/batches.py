"""Runs of one law as one problem, and the check of some by another engine."""

from __future__ import annotations

import json
import time
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import groupby
from operator import itemgetter
from typing import Any, Literal

import numpy as np

from eqt_cli.base.arrays import Array, maximum, sqrt, stack
from eqt_cli.base.reporting import reporter
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.initial_states import Stream, draw_initial_states, generator, generator_at
from eqt_cli.components.sensors import Errors
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import Engine, Problem, SolverChecks
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.loop.closed_loop import STARTS, ClosedLoop, OwnStarts, ReferenceSystem
from eqt_cli.numbers.leaves import leaves, structure
from eqt_cli.numbers.running import SampledRuns
from eqt_cli.results.origin import OUT_OF_TIME, CrossCheck

# Groups runs of equal structure, also of different points, into problems for the engine -----------


@dataclass(frozen=True)
class Batch:
    """Runs that one engine solves as one problem.

    Attributes
    ----------
    rows
        Rows of the runs among the requested entries.
    points
        The point of each run.
    experiment
        The experiment at the first point; its engine and its judgement are those of all points.
    kind
        Equal for batches, of any controller, that could be joined into one problem.
    """

    rows: Array
    points: Array
    experiment: Experiment
    problem: Problem
    kind: Hashable

    @property
    def engine(self) -> Engine:
        """The engine of the experiment."""
        return self.experiment.engine

    def select(self, runs: Array) -> Batch:
        """Return the batch of some of its runs."""
        problem = self.problem.select(runs)
        return replace(self, rows=self.rows[runs], points=self.points[runs], problem=problem)


def batches(study: Study, label: str, entries: Array) -> Iterator[Batch]:
    """Group runs of one controller, numbered over all points, into problems of equal structure.

    Within a problem the runs keep the order of `entries`.
    """
    yield from batches_at(study, label, *np.divmod(entries, study.plan.runs))


def by_kind(study: Study, entries: Array) -> list[list[tuple[str, Batch]]]:
    """Group some runs of all controllers that one solve can take, each batch with its label."""
    groups: dict[Hashable, list[tuple[str, Batch]]] = {}
    for label in study.base.loops:
        for batch in batches(study, label, entries):
            groups.setdefault(batch.kind, []).append((label, batch))
    return list(groups.values())


def initial_states(study: Study, points: Array, runs: Array) -> tuple[Array, Array]:
    """Return the initial poses and velocities of some runs, each at its point."""
    if study.initial_varies:
        return _starts(study, tuple(points.tolist()), tuple(runs.tolist()))
    wanted, where = np.unique(runs, return_inverse=True)
    Q, V = _starts(study, (0,) * len(wanted), tuple(wanted.tolist()))
    return Q[where], V[where]


@lru_cache(maxsize=8)
def _starts(study: Study, points: tuple[int, ...], runs: tuple[int, ...]) -> tuple[Array, Array]:
    drawn = []
    for point, entries in groupby(zip(points, runs, strict=True), key=itemgetter(0)):
        experiment = study.experiment(point)
        states = draw_initial_states(
            experiment.group,
            experiment.poses,
            experiment.velocities,
            Qd=experiment.initial_pose,
            Vd=experiment.initial_velocity,
            seed=experiment.config.ensemble.seed,
            runs=[run for _, run in entries],
        )
        drawn.append(states)
    return np.concatenate([Q for Q, _ in drawn]), np.concatenate([V for _, V in drawn])


def batches_at(
    study: Study, label: str, points: Array, runs: Array | None = None
) -> Iterator[Batch]:
    """Group runs of one controller, each at its point; without runs, the references of points."""
    kinds: dict[Hashable, list[int]] = {}
    for point in dict.fromkeys(points.tolist()):
        kinds.setdefault(_kind(study.experiment(point), label), []).append(point)
    for kind, members in kinds.items():
        rows = np.flatnonzero(np.isin(points, members))
        run_numbers = None if runs is None else runs[rows]
        problem = _problem(study, label, points[rows], run_numbers, kind)
        experiment = study.experiment(members[0])
        yield Batch(rows, points[rows], experiment, problem, kind)


def _problem(
    study: Study, label: str, points: Array, runs: Array | None, kind: Hashable
) -> Problem:
    distinct, which = np.unique(points, return_inverse=True)
    experiments = [study.experiment(int(point)) for point in distinct]
    loops = [experiment.loops[label] for experiment in experiments]
    if runs is None:
        loops = [ReferenceSystem.of(loop) for loop in loops]
    Qd = np.array([experiment.initial_pose for experiment in experiments])[which]
    Vd = np.array([experiment.initial_velocity for experiment in experiments])[which]
    Q, V = (Qd, Vd) if runs is None else initial_states(study, points, runs)
    # All parts share the first loop, and so what is compiled of it.
    first = study.first_loops.setdefault((label, kind, runs is None), loops[0])
    varying = differing([first, *loops], which + 1)
    if runs is not None and any(loop.vehicle.varies for loop in loops):
        varying |= _drawn(study, tuple(points.tolist()), tuple(runs.tolist()))
    problem = Problem(first, Q, experiments[0].times, varying)
    states = problem.batched_loop().initial_state(Q, V, Qd, Vd)
    errors = draws = None
    if runs is not None and loops[0].vehicle.measures:
        errors, draws = _errors(problem, [experiments[row] for row in which], runs.tolist())
    return replace(problem, states=states, errors=errors, draws=draws)


def differing(loops: list[ClosedLoop], which: Array) -> dict[str, Array]:
    """Return the leaves in which the loops differ, a row for each run; run k has loop which[k]."""
    if all(loop is loops[0] for loop in loops):
        return {}
    by_loop = [leaves(loop) for loop in loops]
    stacked = {name: np.array([values[name] for values in by_loop]) for name in by_loop[0]}
    return {name: values[which] for name, values in stacked.items() if (values != values[0]).any()}


@lru_cache(maxsize=8)
def _drawn(study: Study, points: tuple[int, ...], runs: tuple[int, ...]) -> dict[str, Array]:
    """Return the numbers drawn for the vehicle of each run, a row for each; all laws share them."""
    experiments = [study.experiment(point) for point in points]
    rows = []
    for experiment, random_of in zip(experiments, _randoms(experiments, runs), strict=True):
        loop = experiment.loop
        rows.append(leaves(loop.vehicle.of_run(loop.group, random_of)))
    return {f"vehicle.{path}": np.array([row[path] for row in rows]) for path in rows[0]}


KEPT_BYTES = 32 * 2**20
"""Most memory for errors of runs that are kept: those of 110 runs of 6 s at 500 Hz on SE(3)."""

DRAWN_AT_ONCE = 16
"""Number of runs whose errors are drawn in one array, before each has its own."""

_errors_cache: dict[Hashable, Errors] = {}  # of single runs; the last used ones come last


@dataclass(frozen=True)
class Draws:
    """Sensor errors of many runs, drawn where they are read, so that few are in memory at a time.

    Attributes
    ----------
    instants
        Number of ticks.
    runs
        Arguments of `generator_at` of each distinct run.
    """

    group: MatrixLieGroup
    vehicle: Vehicle
    instants: int
    runs: list[tuple[Any, ...]]

    @cached_property
    def _known(self) -> tuple[Hashable, ...]:
        """All that the errors of a run depend on, besides the run."""
        vehicle, sensors = self.vehicle, self.vehicle.sensors()
        timing = repr(vehicle.channels(self.group)), vehicle.tick, self.instants
        parts = (self.group.name, repr(sensors), *map(type, sensors.values()))
        return (*parts, *timing, vehicle.estimates)

    def of(self, rows: Array) -> Errors:
        """Return the errors of some runs, ``(rows, ticks, …)``."""
        keys = [(*self._known, *self.runs[row]) for row in rows]
        errors = {key: _errors_cache.pop(key, None) for key in keys}
        missing = [key for key, each in errors.items() if each is None]
        for first in range(0, len(missing), DRAWN_AT_ONCE):
            some = missing[first : first + DRAWN_AT_ONCE]
            randoms = [partial(generator_at, *key[len(self._known) :]) for key in some]
            drawn = self.vehicle.measurement_errors(self.group, self.instants, randoms)
            errors |= {
                key: Errors(*(part[k].copy() for part in drawn)) for k, key in enumerate(some)
            }
        _errors_cache.update(errors)
        bytes_kept = sum(part.nbytes for each in list(_errors_cache.values()) for part in each)
        for oldest in list(_errors_cache):
            if bytes_kept <= KEPT_BYTES:
                break
            bytes_kept -= sum(part.nbytes for part in _errors_cache.pop(oldest, ()))
        return Errors(*map(np.stack, zip(*(errors[key] for key in keys), strict=True)))


def _errors(
    problem: Problem, experiments: Sequence[Experiment], runs: Sequence[int]
) -> tuple[Draws, Array]:
    """Return the sensor errors of the distinct runs, and the row of each run among them."""
    all_runs = [random_of.args for random_of in _randoms(experiments, runs)]
    distinct = sorted(set(all_runs))
    rows = {run: row for row, run in enumerate(distinct)}
    loop, instants = problem.loop, problem.control_instants
    draws = Draws(loop.group, loop.vehicle, instants, distinct)
    return draws, np.array([rows[run] for run in all_runs])


def _randoms(
    experiments: Sequence[Experiment], runs: Sequence[int]
) -> list[partial[np.random.Generator]]:
    """Return the random streams for the vehicle of each run, each of its experiment."""
    seeds = (experiment.config.ensemble.seed for experiment in experiments)
    both = zip(seeds, runs, strict=True)
    return [partial(generator_at, seed, Stream.VEHICLE, run) for seed, run in both]


def _kind(experiment: Experiment, label: str) -> Hashable:
    """Return a key of all that the runs of one problem share: all but leaves and initial states."""
    loop, config = experiment.loops[label], experiment.config
    parts = [structure(part) for part in (loop.inertia, loop.gains, loop.vehicle)]
    judged = [config.settling_threshold, config.early_window, config.closing_window]
    known = json.dumps([experiment.solver.resolved, judged])
    return (*parts, loop.controller.structure, repr(loop.reference), known)


# Solves a few runs of each controller again by another method, and compares the states ------------


BOUND_PER_RTOL = 1000.0
"""Allowed difference per unit of `rtol`, with a margin for the amplification by the trajectories
themselves: 190 was measured for a run of nog in the paper's ensemble that was solved alone."""

MOST_SPANS = 200
"""Largest number of spans between known instants that an engine in Python repeats. Each span takes
at least one step, some milliseconds. A motion through thousands of waypoints would take minutes,
and would show the same faults as its beginning."""

WORK_SHARE = 0.1
"""Largest cost of the check with the default number of runs, as a share of the runs' work."""

FREE_STEPS = 75_000
"""Cost that the check may always have, in compiled steps: a twentieth of a second, which is a tenth
of the time that any experiment needs to start."""

STEPS_PER_EVALUATION = 200
"""Number of compiled steps that take as long as one evaluation of a vectorised law in Python: 133
to 299 were measured of six shipped loops, 825 of the Crazyflie. The check is limited by counts, not
by times, so that it is the same on every machine."""

EVALUATIONS_PER_STEP = 28
"""Evaluations by LSODA per compiled step (2,500 and 100 in 20 s of the paper's runs)."""

EVALUATIONS_PER_INSTANT = 15
"""Evaluations by LSODA that take as long as a control instant, with law, sensors and actuators: 5
were measured of the BlueROV2, 12 of the CubeSat, 38 of the Crazyflie."""

METHOD_FACTOR = 2
"""Evaluations by LSODA per evaluation by DOP853: 0.4 to 1, and 2.3 with a law at 50 Hz."""

BLOCK_RUNS = 200
"""Number of runs that share the evaluations of an engine in Python."""

RATE_TOLERANCE = 1e-9
"""Tolerance, relative and in SI units, for rates computed together with other pieces."""

MOST_PIECES = 16
"""Largest number of pieces of the horizon that an engine in Python repeats side by side, each from
its stored state. So the whole horizon is checked with the evaluations of one piece."""

LEAST_SECONDS = 10.0
"""Least wall time that a check may take, however little the runs took, s. The budget in counts is
for loops that both methods integrate with similar steps; this limit is for the others, such as
stiff or unstable ones."""

SHORTER = 0.8
"""Share of the time reached that is repeated, after a first attempt has run out of time."""


def independent(engine: Engine) -> SolveIvp:
    """Return the engine that repeats runs of an engine, by another kind of method.

    LSODA of ODEPACK repeats them by multistep methods: those of Adams, or backward differences
    where the loop is stiff. Radau, an implicit one-step method, repeats those of multistep methods.

    LSODA judges the largest error of a block, not the mean, so it needs no tolerance divided by √B:
    the tolerance of its steps is `rtol`. With it, errors of up to 12 `rtol` were measured on
    `paper`, `se3`, `se3_bluerov2_flies` and `satellite_panels`: a hundredth of the bound.
    """
    multistep = isinstance(engine, SolveIvp) and engine.method in ("BDF", "LSODA")
    method: Literal["Radau", "LSODA"] = "Radau" if multistep else "LSODA"
    rtol = engine.rtol * (1.0 if multistep else BLOCK_RUNS**0.5)
    return SolveIvp(method=method, rtol=rtol, atol=1e-3 * rtol, block=BLOCK_RUNS)


@lru_cache(maxsize=8)
def chosen_entries(study: Study) -> Array:
    """Return the runs of each controller to repeat, numbered over all points.

    The choice depends only on the seed and on the number of runs.
    """
    entries, base = study.plan.entries, study.base
    count = min(base.solver.judgement.cross_check, entries)
    random = generator(base.config.ensemble.seed, Stream.CROSS_CHECK, entries)
    return np.sort(random.choice(entries, size=count, replace=False))


def cross_check(
    study: Study,
    stored: Mapping[str, Sequence[Array]],
    work: Mapping[str, Sequence[Array]],
    deadline: float = np.inf,
) -> CrossCheck | None:
    """Solve the chosen runs again and compare; None if no run is chosen.

    Parameters
    ----------
    found
        The stored states of the chosen runs of each controller, in blocks.
    work
        The work of all runs of each controller, as the engine counts it, in blocks.
    deadline
        Time of `time.monotonic` by which it ends. What was compared until then is said.
    """
    chosen = chosen_entries(study)
    if not len(chosen):
        return None
    groups = by_kind(study, chosen)
    states, steps = (
        {label: np.concatenate(each) for label, each in blocks.items()} for blocks in (stored, work)
    )
    differences, redone = _differences(study, groups, states, steps, deadline)
    other = independent(study.base.engine)
    method = " ".join(filter(None, (other.method, redone.words(study.base.times))))
    method += f", {OUT_OF_TIME}" if redone.out_of_time else ""
    largest = float(differences.max()) if len(differences) else float("nan")
    bound = BOUND_PER_RTOL * study.base.engine.rtol
    return CrossCheck(method, len(chosen), largest, bound)


def combined(checks: Sequence[CrossCheck | None]) -> CrossCheck | None:
    """Combine the checks of several pieces: the sum of the runs, and the worst difference."""
    done = [check for check in checks if check is not None]
    if not done:
        return None
    worst = max(done, key=lambda check: np.nan_to_num(check.difference / check.bound, nan=-1.0))
    return replace(worst, runs=sum(check.runs for check in done))


def _affordable(study: Study, groups: int, steps: Mapping[str, Array], instants: int = 0) -> float:
    """Return the share of the horizon that the check can repeat within its budget.

    The budget is `WORK_SHARE` of the work of the runs, but at least `FREE_STEPS`. The whole horizon
    is repeated if the configuration sets another number of runs than the default.
    """
    base = study.base
    if base.solver.judgement.cross_check != SolverChecks.cross_check:
        return 1.0
    counted = [np.nan_to_num(each) for each in steps.values()]
    longest = max((float(each.max(initial=0.0)) for each in counted), default=0.0)
    if base.engine.threads:
        solves = 2 if base.solver.estimates_errors else 1
        work = solves * sum(float(each.sum()) for each in counted)
        evaluations = longest * EVALUATIONS_PER_STEP + instants * EVALUATIONS_PER_INSTANT
        cost = groups * evaluations * STEPS_PER_EVALUATION
    else:
        blocks = [each.mean() * -(-each.size // BLOCK_RUNS) for each in counted if each.size]
        work = STEPS_PER_EVALUATION * float(sum(blocks))
        cost = groups * longest * METHOD_FACTOR * STEPS_PER_EVALUATION
    budget = max(WORK_SHARE * work, FREE_STEPS / len(study.shapes))
    return min(1.0, budget / cost) if cost else 1.0


class _OutOfTime(Exception):
    """Raised within a solve at its deadline; its argument is the number of runs done."""


@dataclass(frozen=True)
class _Pieces:
    """Pieces of the horizon to repeat, each from the stored state at its start.

    Attributes
    ----------
    starts
        Samples at which the pieces start.
    length
        Number of samples of each piece, including the first.
    out_of_time
        Whether it is shorter than planned, because the time ran out.
    """

    starts: tuple[int, ...]
    length: int
    out_of_time: bool = False

    @staticmethod
    def of(problem: Problem, engine: Engine, part: float) -> _Pieces:
        """Return pieces that cover the horizon, or as much of it as `part` affords.

        The pieces share the evaluations of one block of the engine. If the engine solves runs one
        by one, or the vector field changes at known instants, there is one piece of at most
        `MOST_SPANS` spans; so there is if a command is held, which a later start would renew.
        """
        steps, side_by_side = len(problem.times) - 1, engine.runs_at_once(1) // problem.runs
        number = min(steps, MOST_PIECES, int(np.ceil(1 / part)), max(1, side_by_side))
        held = problem.loop.vehicle.control is not None
        if held or len(problem.spans) > 1 or number == 1:
            return _Pieces.beginning(problem, part)
        length = min(-(-steps // number), int(np.ceil(part * steps)))
        starts = np.linspace(0, steps - length, number).round().astype(int)
        return _Pieces(tuple(starts.tolist()), length + 1)

    @staticmethod
    def beginning(problem: Problem, part: float) -> _Pieces:
        """Return the beginning of the horizon: at most `MOST_SPANS` spans, at least two samples."""
        times = problem.times
        end = times[0] + part * (times[-1] - times[0])
        if len(problem.spans) > MOST_SPANS:
            end = min(end, problem.spans[MOST_SPANS].start)
        reached = int(np.searchsorted(times, end, side="right"))
        return _Pieces((0,), len(times) if end >= times[-1] else max(reached, 2))

    def can_share_evaluations(self, whole: Problem, states: Array) -> bool:
        """Whether the field accepts a time for each piece; a plugin may accept only one time."""
        if len(self.starts) == 1:
            return True
        t, together = float(whole.times[0]), self.problem(whole, states)
        loop, alone = whole.batched_loop(), []
        with np.errstate(all="ignore"):
            try:
                rates = together.batched_loop().vector_field(t, together.states)
            except Exception:
                return False
            for start in self.starts:
                t = float(whole.times[start])
                alone.append(loop.holding(t).vector_field(t, states[:, start]))
        expected = np.concatenate(alone)
        return rates.shape == expected.shape and np.allclose(
            rates, expected, RATE_TOLERANCE, RATE_TOLERANCE
        )

    def problem(self, whole: Problem, states: Array) -> Problem:
        """Return all pieces of all runs as one problem; `states` are the stored ones."""
        times = whole.times[: self.length]
        if len(self.starts) == 1:
            return replace(whole, times=times)
        number = len(self.starts)
        varying = {name: np.concatenate([rows] * number) for name, rows in whole.varying.items()}
        later = whole.times[list(self.starts)] - whole.times[0]
        return Problem(
            OwnStarts.of(whole.loop),
            np.concatenate([states[:, start] for start in self.starts]),
            times,
            varying | {STARTS: np.repeat(later, whole.runs)[:, None]},
        )

    def differences(self, whole: Problem, states: Array, again: Array) -> Array:
        """Return the sum of the differences of the pieces of each run."""
        loop, total = whole.batched_loop(extra_axes=1), np.zeros(whole.runs)
        for start, redone in zip(self.starts, np.split(again, len(self.starts)), strict=True):
            samples = slice(start, start + self.length)
            total += distance(loop, whole.times[samples], states[:, samples], redone)
        return total

    def reach(self) -> int:
        """Return the number of intervals between samples that the pieces cover."""
        return len(self.starts) * (self.length - 1)

    def words(self, times: Array) -> str:
        """Describe the repeated part of the horizon; empty for all of it in one piece, or none."""
        seconds = f"{times[max(self.length, 1) - 1] - times[0]:.3g} s"
        if self.length < 2:
            return ""
        if len(self.starts) > 1:
            return f"in {len(self.starts)} pieces of {seconds}"
        return f"over the first {seconds}" if self.length < len(times) else ""


def _differences(
    study: Study,
    groups: list[list[tuple[str, Batch]]],
    stored: Mapping[str, Array],
    steps: Mapping[str, Array],
    deadline: float,
) -> tuple[Array, _Pieces]:
    """Return the difference of each run that did not fail, and the pieces that were repeated."""
    instants = max(batch.problem.control_instants for group in groups for _, batch in group)
    part = _affordable(study, len(groups), steps, instants)
    differences, redone = [np.empty(0)], []
    everything = _Pieces((0,), len(study.base.times))
    for group in groups:
        engine = independent(group[0][1].engine)
        problem = Problem.joined([batch.problem for _, batch in group])
        pieces = _Pieces.of(problem, engine, part)
        states = np.concatenate([stored[label][batch.rows] for label, batch in group])
        good = np.flatnonzero(np.isfinite(states).all(axis=(1, 2)))
        reporter().advance(problem.runs - len(good))
        if not len(good):
            continue
        whole, states = problem.select(good), states[good]
        if not pieces.can_share_evaluations(whole, states):
            pieces = _Pieces.beginning(problem, part)
        pieces, again = _again(engine, pieces, whole, states, deadline)
        redone.append(pieces)
        if again is None:
            continue
        with np.errstate(all="ignore"):  # the other engine may fail or diverge
            distances = pieces.differences(whole, states, again)
        differences.append(np.nan_to_num(distances, nan=np.inf))
    return np.concatenate(differences), min(redone, key=_Pieces.reach, default=everything)


def _again(
    engine: Engine, pieces: _Pieces, whole: Problem, states: Array, deadline: float
) -> tuple[_Pieces, Array | None]:
    """Solve pieces again; return those that were solved in time, and their states, if any.

    If they take more than half of the time that is left, shorter ones are solved instead.
    """
    here, share = reporter(), 1 / len(pieces.starts)
    for first in (True, False):
        now, done = time.monotonic(), 0.0
        ends = (now + deadline) / 2 if first and pieces.length > 2 else deadline

        def counted(runs: float, ends: float = ends) -> None:
            nonlocal done
            done += runs
            here.advance(share * runs)
            if time.monotonic() > ends:
                raise _OutOfTime

        problem = pieces.problem(whole, states)
        try:
            return pieces, engine.solve(problem, progress=counted).states
        except _OutOfTime:
            here.advance(-share * done)
            reached = SHORTER * done / problem.runs
            pieces = replace(
                pieces, length=1 + int(reached * (pieces.length - 1)), out_of_time=True
            )
            if pieces.length < 2:
                break
    here.advance(whole.runs)
    return replace(pieces, length=1), None


def distance(loop: ClosedLoop, times: Array, one: Array, other: Array) -> Array:
    """Return max over samples of max(‖ΔQ‖_F, ‖ΔV‖), ``(runs, samples, n) -> (runs,)``."""
    a, b = loop.tracking(times, one), loop.tracking(times, other)
    return largest(SampledRuns(times), squares(a.Q - b.Q, a.V - b.V))


def squares(pose: Array, velocity: Array) -> Array:
    """Return ‖ΔQ‖_F² and ‖ΔV‖² at every sample, ``(..., 2)``, for floats or symbols."""
    return stack([(pose * pose).sum(axis=(-2, -1)), (velocity * velocity).sum(axis=-1)])


def largest(over: SampledRuns, squares: Array) -> Any:
    """Return the root of the largest square over all samples."""
    return sqrt(over.largest(maximum(squares[..., 0], squares[..., 1])))
