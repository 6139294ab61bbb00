"""Groups runs of equal structure, also of different points, into problems for the engine."""

import json
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from eqt_cli.closed_loop import ClosedLoop, ReferenceSystem
from eqt_cli.core.arrays import Array
from eqt_cli.core.leaves import leaves, structure
from eqt_cli.engines import Engine, Problem
from eqt_cli.ensemble.initial import draw_initial_states
from eqt_cli.ensemble.spread import Stream, generator_at
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.study import Study
from eqt_cli.vehicle.sensors.channels import Errors


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

    def select(self, runs: Array) -> "Batch":
        """Return the batch of some of its runs."""
        problem = self.problem.select(runs)
        return replace(self, rows=self.rows[runs], points=self.points[runs], problem=problem)


def batches(study: Study, label: str, entries: Array) -> Iterator[Batch]:
    """Group runs of one controller, numbered over all points, into problems of equal structure.

    Within a problem the runs keep the order of `entries`.
    """
    yield from batches_at(study, label, *np.divmod(entries, study.plan.runs))


def initial_states(study: Study, points: Array, runs: Array) -> tuple[Array, Array]:
    """Return the initial poses and velocities of some runs, each at its point."""
    if not study.initial_varies:
        wanted, where = np.unique(runs, return_inverse=True)
        Q, V = _draw(study, 0, tuple(wanted.tolist()))
        return Q[where], V[where]
    drawn = [_draw(study, int(p), tuple(runs[points == p].tolist())) for p in _distinct(points)]
    return np.concatenate([Q for Q, _ in drawn]), np.concatenate([V for _, V in drawn])


@lru_cache(maxsize=8)
def _draw(study: Study, point: int, runs: tuple[int, ...]) -> tuple[Array, Array]:
    experiment = study.experiment(point)
    return draw_initial_states(
        experiment.group,
        experiment.poses,
        experiment.velocities,
        Qd=experiment.initial_pose,
        Vd=experiment.initial_velocity,
        seed=experiment.config.ensemble.seed,
        runs=runs,
    )


def batches_at(
    study: Study, label: str, points: Array, runs: Array | None = None
) -> Iterator[Batch]:
    """Group runs of one controller, each at its point; without runs, the references of points."""
    kinds: dict[Hashable, list[int]] = {}
    for point in _distinct(points):
        kinds.setdefault(_kind(study.experiment(point), label), []).append(point)
    for kind, members in kinds.items():
        rows = np.flatnonzero(np.isin(points, members))
        own = None if runs is None else runs[rows]
        problem = _problem(study, label, points[rows], own, kind)
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
        varying |= _drawn(experiments, label, which, runs)
    problem = Problem(first, Q, experiments[0].times, varying)
    states = problem.batched_loop().initial_state(Q, V, Qd, Vd)
    errors = None
    if runs is not None and loops[0].vehicle.measures:
        errors = _errors(problem, experiments, which, runs)
    return replace(problem, states=states, errors=errors)


def differing(loops: list[ClosedLoop], which: Array) -> dict[str, Array]:
    """Return the leaves in which the loops differ, a row for each run; run k has loop which[k]."""
    if all(loop is loops[0] for loop in loops):
        return {}
    by_loop = [leaves(loop) for loop in loops]
    stacked = {name: np.array([values[name] for values in by_loop]) for name in by_loop[0]}
    return {name: values[which] for name, values in stacked.items() if (values != values[0]).any()}


def _drawn(
    experiments: list[Experiment], label: str, which: Array, runs: Array
) -> dict[str, Array]:
    """Return the numbers drawn for the vehicle of each run, a row for each run."""
    rows = []
    for experiment, random_of in _by_run(experiments, which, runs):
        loop = experiment.loops[label]
        rows.append(leaves(loop.vehicle.of_run(loop.group, random_of)))
    return {f"vehicle.{path}": np.array([row[path] for row in rows]) for path in rows[0]}


def _errors(problem: Problem, experiments: list[Experiment], which: Array, runs: Array) -> Errors:
    """Return the measurement errors of each run."""
    G, vehicle, instants = problem.loop.group, problem.loop.vehicle, problem.control_instants
    randoms = (random_of for _, random_of in _by_run(experiments, which, runs))
    found = [vehicle.measurement_errors(G, instants, random_of) for random_of in randoms]
    return Errors(*map(np.array, zip(*found, strict=True)))


def _by_run(
    experiments: list[Experiment], which: Array, runs: Array
) -> Iterator[tuple[Experiment, Callable[[str], np.random.Generator]]]:
    """Yield the experiment of each run, and the random streams for its vehicle."""
    for index, run in zip(which.tolist(), runs.tolist(), strict=True):
        seed = experiments[index].config.ensemble.seed
        yield experiments[index], partial(generator_at, seed, Stream.VEHICLE, run)


def _kind(experiment: Experiment, label: str) -> Hashable:
    """Return a key of all that the runs of one problem share: all but leaves and initial states."""
    loop, config = experiment.loops[label], experiment.config
    parts = [structure(part) for part in (loop.inertia, loop.gains, loop.vehicle)]
    judged = [config.settling_threshold, config.early_window, config.closing_window]
    known = json.dumps([experiment.solver.resolved, judged])
    return (*parts, loop.controller.structure, repr(loop.reference), known)


def _distinct(points: Array) -> list[int]:
    """Return the distinct points in the order of their first occurrence."""
    return list(dict.fromkeys(points.tolist()))
