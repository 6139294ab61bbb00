"""Runs of one law as one problem, and the check of some by another engine."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any, Literal

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, maximum, sqrt, stack
from eqt_cli.base.registry import is_foreign
from eqt_cli.base.reporting import reporter
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.initial_states import PoseDistribution, Stream, generator, generator_at
from eqt_cli.components.sensors import Errors
from eqt_cli.components.vehicle import Vehicle, bias_signals
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import Compiled, Engine, Problem, SolverChecks, evaluate, hurried
from eqt_cli.engines.extrapolation import Extrapolation
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.loop.closed_loop import ClosedLoop, ReferenceSystem
from eqt_cli.numbers.leaves import leaves, structure
from eqt_cli.numbers.running import SampledRuns
from eqt_cli.results.origin import CrossCheck

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
    start
        ``pose`` and ``velocity`` of each run at its start.
    """

    rows: Array
    points: Array
    experiment: Experiment
    problem: Problem
    kind: Hashable
    start: Arrays = field(repr=False)

    @property
    def engine(self) -> Engine:
        """The engine of the experiment."""
        return self.experiment.engine

    def select(self, runs: Array) -> Batch:
        """Return the batch of some of its runs."""
        start = {name: values[runs] for name, values in self.start.items()}
        rows, points, problem = self.rows[runs], self.points[runs], self.problem.select(runs)
        return replace(self, rows=rows, points=points, problem=problem, start=start)


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


@lru_cache(maxsize=8)
def _draws(study: Study, points: tuple[int, ...], runs: tuple[int, ...]) -> list[Array]:
    """Return the random numbers of runs with starts of one kind; all laws share them."""
    drawn = []
    for point, run in zip(points, runs, strict=True):
        here = study.experiment(point)
        drawn.append(here.start.numbers(here.group, here.config.ensemble.seed, run))
    return [*map(np.array, zip(*drawn, strict=True))]


@dataclass(frozen=True)
class InitialState:
    """Gives a run its start, for floats or symbols: the engine computes Q(0), V(0) and the state.

    Attributes
    ----------
    poses
        Places Q(0) = Q_d(0) · place.
    shape
        Of the random numbers of the pose.
    key
        What the places depend on besides these numbers.
    """

    poses: PoseDistribution = field(compare=False)
    shape: tuple[int, ...]
    key: Hashable

    def __call__(self, loop: ClosedLoop, t: Any, row: Array) -> dict[str, Array]:
        """Return ``pose``, ``velocity`` and the flat ``state``.

        Parameters
        ----------
        row
            Q_d(0), V_d(0), the random numbers of the pose, and V(0) − V_d(0).
        """
        G, batch, inertia = loop.group, row.shape[:-1], loop.inertia.at(t)
        lengths = G.size**2, G.dimension, math.prod(self.shape)
        Qd, Vd, numbers, errors = np.split(row, np.cumsum(lengths), axis=-1)
        Qd, Pd = Qd.reshape(*batch, G.size, G.size), inertia.momentum(Vd)
        desired = (loop.held_reference or loop.reference).desired(G, inertia, t, Qd, Pd)
        Qd, Vd = desired.Q, Vd if desired.V is None else desired.V
        places = self.poses.place(G, numbers.reshape(-1, *self.shape))
        Q, V = Qd @ places.reshape(*batch, G.size, G.size), Vd + errors
        return {"pose": Q, "velocity": V, "state": loop.initial_state(Q, V, Qd, Vd, t)}


def _placing(poses: PoseDistribution) -> Hashable:
    """Return a key of what a distribution places by, besides its random numbers."""
    factors = getattr(poses, "factors", (poses,))
    return repr(poses) if any(is_foreign(type(x).__module__) for x in factors) else structure(poses)


def starts_of(study: Study, points: Array, runs: Array) -> tuple[InitialState, Array]:
    """Return what gives runs their start, and its row for each, ``(runs, 1, n)``."""
    distinct, which = np.unique(points, return_inverse=True)
    desired = [study.experiment(point).desired for point in distinct.tolist()]
    starts = np.array([[*state.pose.ravel(), *state.velocity] for state in desired])[which]
    at = points if study.initial_varies else np.zeros_like(points)
    poses = study.experiment(int(at[0])).start.poses
    numbers, errors = _draws(study, (*at.tolist(),), (*runs.tolist(),))
    rows = np.concatenate([starts, numbers.reshape(len(points), -1), errors], axis=1)[:, None]
    return InitialState(poses, numbers.shape[1:], _placing(poses)), rows


def _started(study: Study, problem: Problem, points: Array, runs: Array) -> dict[str, Array]:
    """Return what `InitialState` gives each run of a problem."""
    start, rows = starts_of(study, points, runs)
    engine, first = study.experiment(int(points[0])).engine, problem.times[:1]
    with hurried():
        values = evaluate(engine, start, replace(problem, times=first), rows)
    return {name: value[:, 0] for name, value in values.items()}


def batches_at(study: Study, label: str, points: Array, runs: Array) -> Iterator[Batch]:
    """Group runs of one controller, each at its point."""
    kinds: dict[Hashable, list[int]] = {}
    for point in dict.fromkeys(points.tolist()):
        kinds.setdefault(kind_of(study.experiment(point), label), []).append(point)
    for kind, members in kinds.items():
        rows = np.flatnonzero(np.isin(points, members))
        problem = problem_of(study, label, points[rows], runs[rows], kind)
        start = _started(study, problem, points[rows], runs[rows])
        problem = replace(problem, states=start["state"])
        yield Batch(rows, points[rows], study.experiment(members[0]), problem, kind, start)


def references(study: Study, points: Array) -> Iterator[Batch]:
    """Group the references of some points; all laws, and all runs of a point, have the same."""
    label = next(iter(study.base.loops))
    for batch in batches_at(study, label, points, np.zeros_like(points)):
        problem = problem_of(study, label, batch.points, None, batch.kind)
        system, parts = problem.loop, batch.problem.loop.layout.split(batch.problem.states)
        states = system.layout.join(parts, np.empty((problem.runs, system.state_length)))
        yield replace(batch, problem=replace(problem, states=states))


def problem_of(
    study: Study, label: str, points: Array, runs: Array | None, kind: Hashable
) -> Problem:
    """Return runs of one controller and kind, without their states; of no runs, references."""
    distinct, which = np.unique(points, return_inverse=True)
    experiments = [study.experiment(int(point)) for point in distinct]
    loops = [experiment.loops[label] for experiment in experiments]
    if runs is None:
        loops = [ReferenceSystem.of(loop) for loop in loops]
    # All parts share the first loop, and so what is compiled of it.
    first = study.first_loops.setdefault((label, kind, runs is None), loops[0])
    varying = differing([first, *loops], which + 1)
    if runs is not None and any(loop.vehicle.varies for loop in loops):
        named = experiments[0].loops.items()  # laws of one vehicle share what is drawn
        shared = next(name for name, loop in named if loop.vehicle is loops[0].vehicle)
        varying |= _drawn(study, shared, (*points.tolist(),), (*runs.tolist(),))
    problem = Problem(first, np.empty((len(points), 0)), experiments[0].times, varying)
    errors = None
    if runs is not None and first.vehicle.measures:
        seeds = [experiments[row].config.ensemble.seed for row in which]
        streams = [
            (seed, Stream.VEHICLE, run) for seed, run in zip(seeds, runs.tolist(), strict=True)
        ]
        errors = Draws(first.group, first.vehicle, problem.control_instants, streams)
    return replace(problem, errors=errors)


def differing(loops: list[ClosedLoop], which: Array) -> dict[str, Array]:
    """Return the leaves in which the loops differ, a row for each run; run k has loop which[k]."""
    if all(loop is loops[0] for loop in loops):
        return {}
    by_loop = [leaves(loop) for loop in loops]
    stacked = {name: np.array([values[name] for values in by_loop]) for name in by_loop[0]}
    return {name: values[which] for name, values in stacked.items() if (values != values[0]).any()}


@lru_cache(maxsize=8)
def _drawn(
    study: Study, label: str, points: tuple[int, ...], runs: tuple[int, ...]
) -> dict[str, Array]:
    """Return the numbers drawn for the vehicle of a law in each run, a row for each."""
    rows = []
    for point, run in zip(points, runs, strict=True):
        experiment = study.experiment(point)
        loop, seed = experiment.loops[label], experiment.config.ensemble.seed
        random_of = partial(generator_at, seed, Stream.VEHICLE, run)
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
        Arguments of `generator_at` of each run; runs at several points may share them.
    """

    group: MatrixLieGroup
    vehicle: Vehicle
    instants: int
    runs: list[tuple[Any, ...]]

    def of(self, rows: Array) -> Errors:
        """Return the errors of some runs, ``(rows, ticks, …)``."""
        # All that the errors of a run depend on, besides the run.
        vehicle, sensors = self.vehicle, self.vehicle.sensors()
        timing = repr(vehicle.channels(self.group)), vehicle.tick, self.instants
        parts = (self.group.name, repr(sensors), *map(type, sensors.values()))
        drawing: Hashable = (*parts, *timing, vehicle.estimates, bias_signals(vehicle))
        keys = [(drawing, *self.runs[row]) for row in rows]
        errors = {key: _errors_cache.pop(key, None) for key in dict.fromkeys(keys)}
        missing = [key for key, error in errors.items() if error is None]
        for first in range(0, len(missing), DRAWN_AT_ONCE):
            some = missing[first : first + DRAWN_AT_ONCE]
            randoms = [partial(generator_at, *run) for _, *run in some]
            drawn = vehicle.measurement_errors(self.group, self.instants, randoms)
            errors |= {
                key: Errors(*(part[k].copy() for part in drawn)) for k, key in enumerate(some)
            }
        _errors_cache.update(errors)
        bytes_kept = sum(part.nbytes for arrays in list(_errors_cache.values()) for part in arrays)
        for oldest in list(_errors_cache):
            if bytes_kept <= KEPT_BYTES:
                break
            bytes_kept -= sum(part.nbytes for part in _errors_cache.pop(oldest, ()))
        return Errors(*map(np.stack, zip(*(errors[key] for key in keys), strict=True)))


def kind_of(experiment: Experiment, label: str) -> Hashable:
    """Return a key of all that the runs of one problem share: all but leaves and initial states."""
    loop, config = experiment.loops[label], experiment.config
    parts = [structure(x) for x in (loop.inertia, loop.gains, loop.vehicle, *loop.known_forces)]
    judged = [config.settling_threshold, config.early_window, config.closing_window]
    settings = json.dumps([experiment.solver.resolved, judged, config.failed_when])
    placing = _placing(experiment.start.poses)
    law = loop.controller.structure, loop.setpoint
    return (*parts, *law, repr(loop.reference), settings, placing)


# Solves a few runs of each controller again by another method, and compares the states ------------


BOUND_PER_RTOL = 1000.0
"""Allowed difference per unit of `rtol`, with a margin for the amplification by the trajectories
themselves: 190 was measured for a run of nog in the paper's ensemble that was solved alone."""

EVALUATIONS = {"steps": 1000, "evaluations": 500}
"""Evaluations that the check may always take for loops of one structure, by what the engine counts:
at 0.06 ms each of the paper's laws, 0.06 s, and 0.03 s where SciPy is imported for it. Counts,
unlike times, are the same under any load."""

SHARE = 0.2
"""The check may also take this share of what the runs took, by their counts."""

COMPILED = 1000.0
"""Compiled evaluations of a run that take as long as one of the check's: 0.06 µs and 0.06 ms were
measured of the paper's laws."""

MOST_EVALUATIONS = 30_000
"""Evaluations up to the first sample beyond which nothing is checked."""

STAGES = 15
"""Evaluations of a compiled step; it is also some of the check's, of which there are more at
least from sample to sample."""

EVALUATIONS_PER_SAMPLE = 20
"""Evaluations of the check from one sample to the next, where steps end: 17 to 19 were measured."""

EVALUATIONS_PER_SPAN = 40
"""Evaluations that take as long as a control instant, with law, sensors and actuators: 5 were
measured of the BlueROV2, 12 of the CubeSat, 38 of the Crazyflie."""

MOST_SECONDS = 10.0
"""Longest time of this thread for each chosen run of all laws, s. It ends what takes much longer
than its counts say."""

BLOCK_RUNS = 200
"""Number of runs that share the evaluations of an engine in Python."""


def independent(engine: Engine) -> SolveIvp:
    """Return the engine that repeats runs of an engine, by another kind of method.

    Extrapolation of the midpoint rule repeats those of engines in C; it has nothing in common with
    DOP853, and SciPy, which takes longer to import, is not needed. LSODA of ODEPACK repeats those
    of SciPy's methods by multistep ones, and Radau, an implicit one-step method, those of multistep
    methods.

    The first two judge the largest error of a block, not the mean, so they need no tolerance
    divided by √B: the tolerance of their steps is `rtol`. With it, errors of up to 15 `rtol` were
    measured on `paper`, `se3`, `se3_bluerov2_flies` and `satellite_panels`: a hundredth of the
    bound.
    """
    multistep = isinstance(engine, SolveIvp) and engine.method in ("BDF", "LSODA")
    rtol = engine.rtol * (1.0 if multistep else BLOCK_RUNS**0.5)
    if not isinstance(engine, SolveIvp):
        return Extrapolation(rtol=rtol, atol=1e-3 * rtol, block=BLOCK_RUNS)
    method: Literal["Radau", "LSODA"] = "Radau" if multistep else "LSODA"
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


class _Skipped(Exception):
    """Raised with the reason where the check would take too long."""


def cross_check(
    study: Study,
    stored: Sequence[Mapping[str, Sequence[Array]]],
    longest: Sequence[Mapping[str, float]],
) -> CrossCheck | None:
    """Solve the chosen runs again and compare; None if no run is chosen.

    The default number of runs is repeated up to the last sample that `EVALUATIONS` and `SHARE`
    allow, any other number over the whole horizon.

    Parameters
    ----------
    stored
        The stored states of the chosen runs of each piece and controller, in blocks.
    longest
        The largest work of a run of each piece and controller, as the engine counts it.
    """
    base, pieces = study.base, study.pieces
    runs = sum(len(chosen_entries(piece)) for piece in pieces)
    if not runs:
        return None
    bound, method = BOUND_PER_RTOL * base.engine.rtol, str(independent(base.engine).method)
    deadline = time.thread_time() + MOST_SECONDS * runs
    apart, shortest = list[tuple[float, str]](), (np.inf, np.inf)

    def progress(done: float) -> None:
        reporter().advance(done)
        if time.thread_time() > deadline:
            raise _Skipped(f"it takes more than {MOST_SECONDS * runs:g} s of the processor")

    groups = [(k, group) for k, p in enumerate(pieces) for group in by_kind(p, chosen_entries(p))]
    for index, group in groups:
        problem = Problem.joined([batch.problem for _, batch in group])
        by_label = {label: np.concatenate(blocks) for label, blocks in stored[index].items()}
        states = np.concatenate([by_label[label][batch.rows] for label, batch in group])
        good = np.flatnonzero(np.isfinite(states).all(axis=(1, 2)))
        reporter().advance(problem.runs - len(good))
        if not len(good):
            continue
        try:
            works = {label: longest[index][label] for label, _ in group}
            entries = pieces[index].plan.entries
            samples = _samples(base, problem, max(works.values()), entries * sum(works.values()))
            begun = replace(problem.select(good), times=problem.times[:samples])
            again = independent(group[0][1].engine).solve(begun, progress=progress).states
        except _Skipped as skipped:
            if max(apart, default=(0.0, ""))[0] > bound:
                break
            return CrossCheck(f"{method}, {skipped}", runs, np.nan, bound)
        with np.errstate(all="ignore"):  # the other engine may fail or diverge
            loop = begun.batched_loop(extra_axes=1)
            distances = distance(loop, begun.times, states[good, :samples], again)
        distances = np.nan_to_num(distances, nan=np.inf)
        of_rows = np.repeat([label for label, _ in group], [len(b.rows) for _, b in group])
        apart.append((float(distances.max()), str(of_rows[good[distances.argmax()]])))
        if samples < len(problem.times):
            ends = (times[-1] - times[0] for times in (begun.times, problem.times))
            shortest = min(shortest, (*ends,))
    if shortest[0] < np.inf:
        method += f" over the first {shortest[0]:.3g} of {shortest[1]:g} s"
    difference, law = max(apart, default=(np.nan, ""))
    return CrossCheck(method, runs, difference, bound, law * (difference > bound))


def _samples(base: Experiment, problem: Problem, longest: float, total: float) -> int:
    """Return how many samples are repeated, by the work of the longest run, and of all."""
    if base.solver.judgement.cross_check != SolverChecks.cross_check:
        return len(problem.times)
    in_c, intervals = isinstance(base.engine, Compiled), len(problem.times) - 1
    evaluations = (STAGES if in_c else 1) * longest
    evaluations = max(evaluations, EVALUATIONS_PER_SAMPLE * intervals * in_c)
    per_sample = (evaluations + EVALUATIONS_PER_SPAN * len(problem.spans)) / intervals
    if per_sample > MOST_EVALUATIONS:
        raise _Skipped(f"up to the first sample it takes about {per_sample:.1g} evaluations")
    share = SHARE * total * (STAGES / COMPILED if in_c else 1 / BLOCK_RUNS)
    allowed = max(EVALUATIONS["steps" if in_c else "evaluations"], share)
    return 1 + min(max(1, int(allowed / per_sample)), intervals)


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
