"""Computes one part: integrates its runs, measures them, and hands over a table."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from eqt_cli.closed_loop.signals import compute
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ResultError
from eqt_cli.engines import Problem, Solution, Status
from eqt_cli.execution.batches import Batch, batches, initial_states, reference_batches
from eqt_cli.execution.cross_check import chosen_entries, distance, reference_distance
from eqt_cli.execution.executors import TaskContext
from eqt_cli.experiment.plan import Part
from eqt_cli.experiment.study import Study
from eqt_cli.mechanics.critical_points import distance_to_unstable
from eqt_cli.results.quantities import DESIRED, MEASURED, quantities
from eqt_cli.results.quantity import Per, Quantity
from eqt_cli.store.reader import ResultFile
from eqt_cli.store.variables import Table, Variable

LEADING = {Per.TRAJECTORY: "kept", Per.RUN: "entry", Per.INITIAL: "start", Per.DESIRED: "reference"}
"""The leading dimension of each kind of variable in the table of a part."""

NUMBERS = "numbers"
"""Real numbers per run, a row for each quantity."""

ROWS = "rows_of_numbers"
"""The attribute of a part that names the quantities of these rows, in their order."""

CHECK_STATES = "check_states"
"""States of the runs that are redone when the parts are packed, ``(checked, sample, state)``."""

REFERENCE_STATES = "reference_states"
"""States of the references by themselves, ``(reference, sample, state)``."""


def reference_table(study: Study) -> Table:
    """The one reference that all runs share, by itself: its states, and what of them is kept."""
    points = np.array([0])
    states = solve_references(study, points)
    return Table(
        {
            **_desired(study, points, states),
            REFERENCE_STATES: Variable(("reference", "sample", "state"), states),
        }
    )


def solve_references(study: Study, points: Array) -> Array:
    """The references of some points by themselves, ``(points, samples, n)``, without memory.

    They are those of the first controller; a law that fails even where all errors are 0 must not
    harm the others, so then the next one is asked.
    """
    base = study.base
    loop = next(iter(base.loops.values()))
    length = loop.length_without_memory
    if not loop.reference.starts_from:  # it is no part of a state
        return np.zeros((len(points), base.config.time.samples, length))
    found = np.full((len(points), base.config.time.samples, length), np.nan)
    missing = np.arange(len(points))
    for label in base.loops:
        for batch in reference_batches(study, label, points[missing]):
            solution = batch.engine.solve(batch.problem, lambda runs: None)
            found[missing[batch.rows]] = solution.states[..., :length]
        missing = np.flatnonzero(~np.isfinite(found).all(axis=(1, 2)))
        if not len(missing):
            break
    return found


def compute_part(study: Study, part: Part, shared: Array | None, context: TaskContext) -> Table:
    """Everything that is kept of a part's runs.

    Parameters
    ----------
    shared
        The states of the reference that all points share, ``(samples, n)``; None where each point
        has its own.
    """
    gathered = PartArrays(study, part)
    points = np.unique(part.points)
    own = solve_references(study, points) if shared is None else None
    for batch in batches(study, _label(study, part), gathered.entries):
        reference = shared if own is None else own[np.searchsorted(points, batch.points)]
        gathered.add(batch, *_solved(batch, reference, context))
    return gathered.whole(points, own)


def compute_alone(
    study: Study, part: Part, rows: Array, shared: Array | None, context: TaskContext
) -> Table:
    """Some runs of a part, each integrated by itself; as `compute_part`, for these rows only."""
    gathered = PartArrays(study, part, part.start + rows)
    for row, entry in enumerate(gathered.entries):
        for batch in batches(study, _label(study, part), np.array([entry])):
            own = solve_references(study, batch.points) if shared is None else shared
            here = dataclasses.replace(batch, rows=np.array([row]))
            gathered.add(here, *_solved(batch, own, context))
    return gathered.table()


def _label(study: Study, part: Part) -> str:
    return list(study.base.loops)[part.controller]


def lost_part(study: Study, part: Part, message: str) -> Table:
    """A part whose every run counts as failed, because no worker survived it."""
    gathered = PartArrays(study, part)
    gathered.data["status"][:] = Status.WORKER_LOST
    gathered.data["message"][:] = message
    points = np.unique(part.points)
    base = study.base
    length = base.loops[_label(study, part)].length_without_memory
    states = np.full((len(points), base.config.time.samples, length), np.nan)
    return gathered.whole(points, states if study.desired_varies else None)


class PartArrays:
    """The arrays of a part while its batches come in; `entries` are all of its, or some."""

    def __init__(self, study: Study, part: Part, entries: Array | None = None) -> None:
        base, self.study, self.part = study.base, study, part
        self.entries = np.arange(part.start, part.stop) if entries is None else entries
        self.samples = slice(None, None, base.config.store.decimate)
        self.kept_rows = np.flatnonzero(self.entries % part.runs < study.kept)
        self.quantities = [
            quantity
            for quantity in quantities(base)
            if quantity.per is Per.RUN or (quantity.per is Per.TRAJECTORY and study.kept)
        ]
        times = len(base.times[self.samples])
        sizes = {"time": times, "row": base.group.size, "col": base.group.size}
        sizes["axis"] = base.group.dimension
        self.data = {entry.name: self._blank(entry, sizes) for entry in self.quantities}
        chosen = chosen_entries(study)
        here = chosen[np.isin(chosen, self.entries)]
        self.check_rows = np.searchsorted(self.entries, here)
        length = base.loops[_label(study, part)].state_length
        self.check_states = np.full((len(here), base.config.time.samples, length), np.nan)

    def _blank(self, quantity: Quantity, sizes: dict[str, int]) -> Array:
        count = len(self.entries) if quantity.per is Per.RUN else len(self.kept_rows)
        shape = (count, *(sizes[dim] for dim in quantity.dims))
        if quantity.dtype is None:
            return np.full(shape, "", dtype=object)
        missing = np.nan if quantity.dtype.kind == "f" else 0
        return np.full(shape, missing, dtype=quantity.dtype)

    def add(
        self,
        batch: Batch,
        solution: Solution,
        signals: dict[str, Array],
        metrics: dict[str, Array],
    ) -> None:
        """Keep what is asked for of some runs."""
        per_run = metrics | {
            "steps": solution.steps,
            "status": solution.status,
            "message": np.array(solution.messages, dtype=object),
        }
        # Among the kept rows of the part, those of the batch; and where they are in the batch.
        kept, inside = np.isin(self.kept_rows, batch.rows), np.isin(batch.rows, self.kept_rows)
        for quantity in self.quantities:
            if quantity.per is Per.RUN:
                self.data[quantity.name][batch.rows] = per_run[quantity.name]
            else:
                found = signals[quantity.name][inside]
                self.data[quantity.name][kept] = found[:, self.samples]
        checked, found_in = (
            np.isin(self.check_rows, batch.rows),
            np.isin(batch.rows, self.check_rows),
        )
        self.check_states[checked] = solution.states[found_in]

    def whole(self, points: Array, own: Array | None) -> Table:
        """Everything, with the initial states and references that this part is to hold."""
        variables = self._initial()
        if own is not None and self.study.keeps_desired and self.part.controller == 0:
            variables |= _desired(self.study, points, own)
        if len(self.check_states):
            dims = ("checked", "sample", "state")
            variables[CHECK_STATES] = Variable(dims, self.check_states)
        return self.table(variables)

    def table(self, more: Mapping[str, Variable] = MappingProxyType({})) -> Table:
        """What there is one of for every run, and more; all numbers are rows of one array.

        A part of many small datasets takes more time than its runs.
        """
        rows = [entry.name for entry in self.quantities if is_number(entry)]
        single = {
            entry.name: Variable((LEADING[entry.per], *entry.dims), self.data[entry.name])
            for entry in self.quantities
            if entry.name not in rows
        }
        numbers = Variable(
            ("quantity", LEADING[Per.RUN]), np.array([self.data[name] for name in rows])
        )
        return Table({**single, NUMBERS: numbers, **more}, {}, {ROWS: " ".join(rows)})

    def _initial(self) -> dict[str, Variable]:
        """Initial states, which the first controller's parts hold; of one point where all share."""
        part = self.part
        runs = part.run_numbers
        rows = (
            np.arange(len(part)) if self.study.initial_varies else np.flatnonzero(part.points == 0)
        )
        if part.controller or not len(rows):
            return {}
        Q, V = initial_states(self.study, part.points[rows], runs[rows])
        start = LEADING[Per.INITIAL]
        return {
            "initial_pose": Variable((start, "row", "col"), Q),
            "initial_velocity": Variable((start, "axis"), V),
        }


def is_number(quantity: Quantity) -> bool:
    """Whether a part keeps a quantity as a row of `NUMBERS`."""
    return quantity.per is Per.RUN and quantity.dtype is not None and quantity.dtype.kind == "f"


class OutdatedPart(ResultError):
    """A part of another version of eqt, which did not keep everything that this one keeps."""


def read_part(results: ResultFile, quantities: Sequence[Quantity]) -> dict[str, Array]:
    """Every variable that a part holds, by name.

    Raises
    ------
    OutdatedPart
        If it lacks what every run must have.
    """
    rows = check_part(results, quantities)
    numbers = results[NUMBERS]
    return {
        entry.name: numbers[rows.index(entry.name)] if is_number(entry) else results[entry.name]
        for entry in quantities
        if is_number(entry) or results.has(entry.name)
    }


def check_part(results: ResultFile, quantities: Sequence[Quantity]) -> list[str]:
    """The quantities of the rows of numbers; `read_part` says what is raised."""
    rows = str(results.attributes.get(ROWS, "")).split()
    lacking = [
        entry.name
        for entry in quantities
        if entry.per in (Per.RUN, Per.TRAJECTORY)
        and not (entry.name in rows if is_number(entry) else results.has(entry.name))
    ]
    if lacking:
        raise OutdatedPart(f"{results.path}: does not hold {', '.join(lacking)}")
    return rows


def _desired(study: Study, points: Array, states: Array) -> dict[str, Variable]:
    """What is kept of references, one for each of the points."""
    base = study.base
    found: dict[str, list[Array]] = {name: [] for name in DESIRED}
    dims = {entry.name: entry.dims for entry in quantities(base)}
    for point, flat in zip(points, states, strict=True):
        loop = next(iter(study.experiment(int(point)).loops.values()))
        s = loop.tracking(base.times, flat)
        for name, values in zip(DESIRED, (s.Qd, s.Vd, s.tau_d), strict=True):
            # A torque of numbers alone has no axis of time.
            own = values.shape[values.ndim - len(dims[name]) + 1 :]
            whole = np.broadcast_to(values, (len(base.times), *own))
            found[name].append(whole[:: base.config.store.decimate])
    return {
        name: Variable((LEADING[Per.DESIRED], *dims[name]), np.array(values))
        for name, values in found.items()
    }


def _solved(
    batch: Batch, reference: Array | None, context: TaskContext
) -> tuple[Solution, dict[str, Array], dict[str, Array]]:
    """The solution of a batch, its signals and its metrics."""
    assert reference is not None
    problem, experiment = batch.problem, batch.experiment
    solution = batch.engine.solve(problem, context.progress, context.threads)
    with np.errstate(all="ignore"):  # runs that failed are NaN, or large
        signals, metrics = measured(batch, solution, reference)
        metrics["error_estimate"] = _error_estimate(batch, solution, context.threads)
    _judge(solution, metrics["error_estimate"], experiment.solver.judgement.max_error)
    return solution, signals, metrics


def measured(
    batch: Batch, solution: Solution, reference: Array
) -> tuple[dict[str, Array], dict[str, Array]]:
    """The signals of a solution, and what of its runs is one number each."""
    problem: Problem = batch.problem
    loop, times = problem.batched_loop(extra_axes=1), problem.times
    signals = compute(loop, times, solution.states)
    s = loop.tracking(times, solution.states)
    config = batch.experiment.config
    metrics = {
        metric.name: metric.measure(
            times,
            signals,
            metric.window,
            **{name: getattr(config, key) for name, key in metric.settings.items()},
        )
        for metric in MEASURED
    }
    metrics |= {
        "group_drift": loop.group.drift(signals["pose"]).max(axis=-1),
        "unstable_distance": distance_to_unstable(loop.group, loop.gains.K, s.Q_E).min(axis=-1),
        "reference_residual": reference_distance(loop, times, solution.states, reference),
    }
    return signals, metrics


def _error_estimate(batch: Batch, solution: Solution, threads: int) -> Array:
    """The distance of every run to a solve at a tenth of the tolerance; NaN without one."""
    problem = batch.problem
    if not batch.experiment.solver.estimates_errors:
        return np.full(problem.runs, np.nan)
    tighter = batch.engine.tightened(0.1).solve(problem, lambda runs: None, threads)
    loop = problem.batched_loop(extra_axes=1)
    return distance(loop, problem.times, solution.states, tighter.states)


def _judge(solution: Solution, estimate: Array, limit: float | None) -> None:
    """Give runs whose error estimate exceeds `max_error` a status of their own."""
    if limit is None:
        return
    for run in np.flatnonzero((solution.status == Status.OK) & (estimate > limit)):
        solution.status[run] = Status.ACCURACY
        solution.messages[run] = (
            f"error estimate {estimate[run]:.2g} exceeds solver.max_error = {limit:g}"
        )
