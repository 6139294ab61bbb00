"""Computes one part: integrates its runs, measures them, and hands over a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop, StateLayout
from eqt_cli.closed_loop.signals import at_state, knows_energy
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ResultError
from eqt_cli.engines import Problem, Solution, Status
from eqt_cli.execution.batches import Batch, batches, initial_states, reference_batches
from eqt_cli.execution.cross_check import chosen_entries, difference, distance
from eqt_cli.execution.executors import TaskContext
from eqt_cli.execution.result_layout import Layout
from eqt_cli.experiment.parts import Part
from eqt_cli.experiment.study import Study
from eqt_cli.mechanics.critical_points import distance_to_unstable
from eqt_cli.results.quantity import Per, Quantity
from eqt_cli.results.quantity_table import DESIRED, MEASURED, with_keys_of
from eqt_cli.store.reader import ResultFile
from eqt_cli.store.table import Table, Variable

LEADING = {Per.TRAJECTORY: "kept", Per.RUN: "entry", Per.INITIAL: "start", Per.DESIRED: "reference"}
"""The leading dimension of each kind of variable in the table of a part."""

NUMBERS = "numbers"
"""Real numbers per run, a row for each quantity."""

ROWS = "rows_of_numbers"
"""The attribute of a part that names the quantities of these rows, in their order."""

CHECKED = "checked_"
"""What begins the names of the stretches of states, ``(checked, sample, …)``, of the runs that are
redone when the parts are packed."""

Desired = Mapping[str, Array]
"""The quantities `DESIRED` at every sample, ``(samples, …)``, or of several points."""


def shared_reference(study: Study) -> dict[str, Array]:
    """The one reference that all runs share, by itself."""
    return {name: values[0] for name, values in solve_references(study, np.array([0])).items()}


def reference_table(study: Study) -> Table:
    """The one reference that all runs share, as it is kept until the parts are packed."""
    found = shared_reference(study)
    return Table(
        {
            entry.name: Variable(("sample", *entry.dims[1:]), found[entry.name])
            for entry in Layout(study).of(Per.DESIRED)
        }
    )


def solve_references(study: Study, points: Array) -> dict[str, Array]:
    """The references of some points by themselves, `DESIRED` as ``(points, samples, …)``.

    They are those of the first controller; a law that fails even where all errors are 0 must not
    harm the others, so then the next one is asked.
    """
    times = study.base.times
    found: list[tuple[Array, ...]] = [()] * len(points)
    label, first = next(iter(study.base.loops.items()))
    if not first.reference.starts_from:  # it is no part of a state
        for row, point in enumerate(points):
            loop = study.experiment(int(point)).loops[label]
            found[row] = _desired(loop, times, np.zeros((len(times), loop.state_length)))
        return _by_name(found)
    missing = np.arange(len(points))
    for label in study.base.loops:
        failed: list[int] = []
        for batch in reference_batches(study, label, points[missing]):
            solution = batch.engine.solve(batch.problem, lambda runs: None)
            for row, states in zip(missing[batch.rows], solution.states, strict=True):
                loop = study.experiment(int(points[row])).loops[label]
                found[row] = _desired(loop, times, states)
                if not np.isfinite(states).all():
                    failed.append(int(row))
        missing = np.array(sorted(failed), dtype=int)
        if not failed:
            break
    return _by_name(found)


def _desired(loop: ClosedLoop, times: Array, states: Array) -> tuple[Array, ...]:
    """`DESIRED` of a flat state at every sample, ``(samples, …)`` each."""
    s = loop.tracking(times, states)
    # What is made of numbers alone has no axis of time.
    return tuple(
        np.broadcast_to(values, (len(times), *values.shape[values.ndim - axes :]))
        for values, axes in ((s.Qd, 2), (s.Vd, 1), (s.tau_d, 1))
    )


def _by_name(found: list[tuple[Array, ...]]) -> dict[str, Array]:
    columns = zip(*found, strict=True)
    return {name: np.array(values) for name, values in zip(DESIRED, columns, strict=True)}


def compute_part(study: Study, part: Part, shared: Desired | None, context: TaskContext) -> Table:
    """Everything that is kept of a part's runs.

    Parameters
    ----------
    shared
        The reference that all points share; None where each point has its own.
    """
    gathered = PartArrays(study, part)
    own = None
    if shared is None:
        own = solve_references(study, gathered.points)
        gathered.add_references(own)
    for batch in batches(study, gathered.label, gathered.entries):
        reference = shared
        if own is not None:
            where = np.searchsorted(gathered.points, batch.points)
            reference = {name: values[where] for name, values in own.items()}
        assert reference is not None
        gathered.add(batch, *_solved(batch, reference, context))
    return gathered.table()


def lost_part(study: Study, part: Part, message: str) -> Table:
    """A part whose every run counts as failed, because no worker survived it."""
    gathered = PartArrays(study, part)
    gathered.data["status"][:] = Status.WORKER_LOST
    gathered.data["message"][:] = message
    return gathered.table()


class PartArrays:
    """The arrays of a part while its batches come in; what does not come is missing.

    The first controller's parts hold the initial states (of one point where all share them), and
    the references where each point has its own.
    """

    def __init__(self, study: Study, part: Part) -> None:
        base = study.base
        self.label = list(base.loops)[part.controller]
        self.entries = np.arange(part.start, part.stop)
        self.points = np.unique(part.points)
        self.samples = slice(None, None, base.config.store.decimate)
        self.kept_rows = np.flatnonzero(part.run_numbers < study.kept)
        is_first = part.controller == 0
        starts = np.flatnonzero(is_first & (study.initial_varies | (part.points == 0)))
        counts = {
            Per.TRAJECTORY: len(self.kept_rows),
            Per.RUN: len(part),
            Per.INITIAL: len(starts),
            Per.DESIRED: len(self.points) if is_first and study.desired_varies else 0,
        }
        always = (Per.RUN, Per.TRAJECTORY)
        self.quantities = [
            entry for entry in Layout(study).quantities if counts[entry.per] or entry.per in always
        ]
        sizes = {"time": len(base.times[self.samples]), "axis": base.group.dimension}
        sizes |= {"row": base.group.size, "col": base.group.size}
        self.data = {
            entry.name: _blank(entry, (counts[entry.per], *(sizes[dim] for dim in entry.dims)))
            for entry in self.quantities
        }
        if len(starts):
            Q, V = initial_states(study, part.points[starts], part.run_numbers[starts])
            self.data |= {"initial_pose": Q, "initial_velocity": V}
        self.check_rows = np.flatnonzero(np.isin(self.entries, chosen_entries(study)))
        self.state_layout = base.loops[self.label].layout
        shape = (len(self.check_rows), base.config.time.samples, self.state_layout.length)
        self.check_states = np.full(shape, np.nan)

    def add_references(self, found: Desired) -> None:
        """Keep what is asked for of the references of the points."""
        for name in DESIRED:
            if name in self.data:
                self.data[name][:] = found[name][:, self.samples]

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
            elif quantity.per is Per.TRAJECTORY:
                found = signals[quantity.name][inside]
                self.data[quantity.name][kept] = found[:, self.samples]
        checked = np.isin(self.check_rows, batch.rows)
        self.check_states[checked] = solution.states[np.isin(batch.rows, self.check_rows)]

    def table(self) -> Table:
        """All of it; the numbers per run are rows of one array.

        A part of many small datasets takes more time than its runs.
        """
        rows = [entry.name for entry in self.quantities if is_number(entry)]
        variables = {
            entry.name: Variable((LEADING[entry.per], *entry.dims), self.data[entry.name])
            for entry in self.quantities
            if entry.name not in rows
        }
        numbers = np.array([self.data[name] for name in rows])
        variables[NUMBERS] = Variable(("quantity", LEADING[Per.RUN]), numbers)
        if len(self.check_rows):
            for name, values in self.state_layout.split(self.check_states).items():
                dims = ("checked", "sample", f"entry_of_{name}")
                variables[CHECKED + name] = Variable(dims, values)
        return Table(variables, {}, {ROWS: " ".join(rows)})


def _blank(quantity: Quantity, shape: tuple[int, ...]) -> Array:
    if quantity.dtype is None:
        return np.full(shape, "", dtype=object)
    missing = np.nan if quantity.dtype.kind == "f" else 0
    return np.full(shape, missing, dtype=quantity.dtype)


def checked_states(results: ResultFile, layout: StateLayout) -> Array:
    """The states that a part holds of the runs that are redone, ``(checked, samples, n)``."""
    return np.concatenate([results[CHECKED + name] for name in layout.lengths], axis=-1)


def is_number(quantity: Quantity) -> bool:
    """Whether a part keeps a quantity as a row of `NUMBERS`."""
    return quantity.per is Per.RUN and quantity.dtype is not None and quantity.dtype.kind == "f"


def read_part(results: ResultFile, quantities: Sequence[Quantity]) -> dict[str, Array]:
    """Every variable that a part holds, by name.

    Raises
    ------
    ResultError
        If it lacks what every run must have.
    """
    if missing := lacking(results, quantities):
        raise ResultError(f"{results.path}: does not hold {', '.join(missing)}")
    rows, numbers = _rows(results), results[NUMBERS]
    return {
        entry.name: numbers[rows.index(entry.name)] if is_number(entry) else results[entry.name]
        for entry in quantities
        if is_number(entry) or results.has(entry.name)
    }


def lacking(results: ResultFile, quantities: Sequence[Quantity]) -> list[str]:
    """What every run must have and a part does not hold, as it is of another version of eqt."""
    rows = _rows(results)
    return [
        entry.name
        for entry in quantities
        if entry.per in (Per.RUN, Per.TRAJECTORY)
        and not (entry.name in rows if is_number(entry) else results.has(entry.name))
    ]


def _rows(results: ResultFile) -> list[str]:
    """The quantities of the rows of numbers."""
    return str(results.attributes.get(ROWS, "")).split()


def _solved(
    batch: Batch, reference: Desired, context: TaskContext
) -> tuple[Solution, dict[str, Array], dict[str, Array]]:
    """The solution of a batch, its signals and its metrics."""
    problem, experiment = batch.problem, batch.experiment
    solution = batch.engine.solve(problem, context.progress, context.threads)
    with np.errstate(all="ignore"):  # runs that failed are NaN, or large
        signals, metrics = measured(batch, solution, reference)
        metrics["error_estimate"] = _error_estimate(batch, solution, context.threads)
    _judge(solution, metrics["error_estimate"], experiment.solver.judgement.max_error)
    return solution, signals, metrics


def measured(
    batch: Batch, solution: Solution, reference: Desired
) -> tuple[dict[str, Array], dict[str, Array]]:
    """The signals of a solution, and what of its runs is one number each."""
    problem: Problem = batch.problem
    times = problem.times
    signals = batch.engine.evaluate(_sampled, problem, solution.states)
    loop = problem.batched_loop(extra_axes=1)
    if not knows_energy(loop, times, solution.states):
        signals["energy_balance"] = np.full_like(signals["energy_balance"], np.nan)
    config = batch.experiment.config
    metrics = {
        metric.name: metric.measure(
            times,
            signals,
            metric.window,
            **{name: getattr(config, key) for name, key in metric.settings.items()},
        )
        for metric in (with_keys_of(config, metric) for metric in MEASURED)
    }
    metrics |= {
        "group_drift": loop.group.drift(signals["pose"]).max(axis=-1),
        "unstable_distance": distance_to_unstable(
            loop.group, loop.gains.K, signals["pose_error_matrix"]
        ).min(axis=-1),
        "reference_residual": difference(
            signals["desired_pose"] - reference["desired_pose"],
            signals["desired_velocity"] - reference["desired_velocity"],
        ),
    }
    return signals, metrics


def _sampled(loop: ClosedLoop, t: Any, states: Array) -> dict[str, Array]:
    """The signals, and what else is measured at every sample: Q_E, Q_d and V_d."""
    s = loop.tracking(t, states)
    found = dict(at_state(loop, s, loop.work(states)))
    return found | {"pose_error_matrix": s.Q_E, "desired_pose": s.Qd, "desired_velocity": s.Vd}


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
