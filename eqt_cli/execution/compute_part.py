"""Computes one part: integrates its runs, measures them, and hands over a table."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop, ReferenceSystem, StateLayout
from eqt_cli.closed_loop.signals import at_state, knows_energy
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ResultError
from eqt_cli.core.over_time import OverTime, Samples
from eqt_cli.engines import Solution, Status
from eqt_cli.execution.batches import Batch, batches, initial_states, reference_batches
from eqt_cli.execution.cross_check import chosen_entries, largest, squares
from eqt_cli.execution.executors import TaskContext
from eqt_cli.execution.result_layout import Layout
from eqt_cli.experiment.parts import StudyPart
from eqt_cli.experiment.study import Study
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.critical_points import distance_to_unstable
from eqt_cli.mechanics.settling import settling_error
from eqt_cli.mechanics.tracking import Tracking
from eqt_cli.results.metrics import SETTLING
from eqt_cli.results.quantity import Quantity, ValuePer
from eqt_cli.results.quantity_table import DESIRED, measured_of
from eqt_cli.store.reader import ResultFile
from eqt_cli.store.table import Attribute, Table, Variable

LEADING = {
    ValuePer.TRAJECTORY: "kept",
    ValuePer.RUN: "entry",
    ValuePer.INITIAL: "start",
    ValuePer.DESIRED: "reference",
}
"""The leading dimension of each kind of variable in the table of a part."""

NUMBERS = "numbers"
"""Real numbers per run, a row for each quantity."""

ROWS = "rows_of_numbers"
"""The attribute of a part that names the quantities of these rows, in their order."""

CHECKED = "checked_"
"""What begins the names of the stretches of states, ``(checked, sample, …)``, of the runs that are
redone when the parts are packed."""

POSE_ERROR, DRIFT = "pose error", "drift from the group"
RESIDUAL, ERROR = "residual of the reference, squared", "error, squared"
MOTION = "pose and velocity"
"""What metrics are made of at every sample and no signal, which has a name without spaces."""

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
            for entry in Layout(study).of(ValuePer.DESIRED)
        }
    )


def solve_references(study: Study, points: Array) -> dict[str, Array]:
    """The references of some points by themselves, `DESIRED` as ``(points, samples, …)``."""
    times, label = study.base.times, next(iter(study.base.loops))  # all laws have the same
    systems = [ReferenceSystem.of(study.experiment(int(point)).loops[label]) for point in points]
    states = np.empty((len(points), len(times), systems[0].state_length))
    if systems[0].state_length:  # else it is evaluated
        for batch in reference_batches(study, points):
            states[batch.rows] = batch.engine.solve(batch.problem).states
    found = [_desired(system, times, own) for system, own in zip(systems, states, strict=True)]
    return {name: np.array([own[name] for own in found]) for name in DESIRED}


def _desired(system: ReferenceSystem, times: Array, states: Array) -> dict[str, Array]:
    """`DESIRED` of a reference at every sample, ``(samples, …)`` each."""
    s = system.tracking(times, states)
    # What is made of numbers alone has no axis of time.
    return {
        name: np.broadcast_to(values, (len(times), *values.shape[values.ndim - axes :]))
        for name, values, axes in zip(DESIRED, (s.Qd, s.Vd, s.tau_d), (2, 1, 1), strict=True)
    }


def compute_part(
    study: Study, part: StudyPart, shared: Desired | None, context: TaskContext
) -> Table:
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
        for runs in batch.engine.blocks(batch.problem, context.threads):
            block, reference = batch.select(runs), shared
            if own is not None:
                where = np.searchsorted(gathered.points, block.points)
                reference = {name: values[where] for name, values in own.items()}
            assert reference is not None
            names, whole = gathered.names(block), gathered.wants_states(block)
            gathered.add(block, *_solved(block, reference, names, whole, context))
    return gathered.table()


def lost_part(study: Study, part: StudyPart, message: str) -> Table:
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

    def __init__(self, study: Study, part: StudyPart) -> None:
        base = study.base
        self.label = list(base.loops)[part.controller]
        self.entries = np.arange(part.start, part.stop)
        self.points = np.unique(part.points)
        self.samples = slice(None, None, base.config.store.decimate)
        self.kept_rows = np.flatnonzero(part.run_numbers < study.kept)
        is_first = part.controller == 0
        starts = np.flatnonzero(is_first & (study.initial_varies | (part.points == 0)))
        counts = {
            ValuePer.TRAJECTORY: len(self.kept_rows),
            ValuePer.RUN: len(part),
            ValuePer.INITIAL: len(starts),
            ValuePer.DESIRED: len(self.points) if is_first and study.desired_varies else 0,
        }
        always = (ValuePer.RUN, ValuePer.TRAJECTORY)
        layout = Layout(study)
        self.quantities = [
            entry for entry in layout.quantities if counts[entry.per] or entry.per in always
        ]
        sizes = layout.sizes
        self.data = {
            entry.name: _blank(entry, (counts[entry.per], *(sizes[dim] for dim in entry.dims)))
            for entry in self.quantities
        }
        if len(starts):
            Q, V = initial_states(study, part.points[starts], part.run_numbers[starts])
            self.data |= {"initial_pose": Q, "initial_velocity": V}
        self._kept = _places(self.kept_rows, len(part))
        check_rows = np.flatnonzero(np.isin(self.entries, chosen_entries(study)))
        self._checked = _places(check_rows, len(part))
        self.state_layout = base.loops[self.label].layout
        shape = (len(check_rows), base.config.time.samples, self.state_layout.length)
        self.check_states = np.full(shape, np.nan)

    def add_references(self, found: Desired) -> None:
        """Keep what is asked for of the references of the points."""
        for name in DESIRED:
            if name in self.data:
                self.data[name][:] = found[name][:, self.samples]

    def names(self, batch: Batch) -> tuple[str, ...]:
        """The quantities that are kept of some runs: no signals where no trajectory is."""
        kept = (
            {ValuePer.RUN}
            if (self._kept[batch.rows] < 0).all()
            else {ValuePer.RUN, ValuePer.TRAJECTORY}
        )
        return tuple(entry.name for entry in self.quantities if entry.per in kept)

    def wants_states(self, batch: Batch) -> bool:
        """Whether more is kept of some of these runs than numbers."""
        return bool((np.maximum(self._kept, self._checked)[batch.rows] >= 0).any())

    def add(self, batch: Batch, solution: Solution, found: dict[str, Array]) -> None:
        """Keep what is asked for of some runs."""
        found = found | {
            "steps": solution.steps,
            "status": solution.status,
            "message": np.array(solution.messages, dtype=object),
        }
        kept, checked = self._kept[batch.rows], self._checked[batch.rows]
        for quantity in self.quantities:
            if quantity.per is ValuePer.RUN:
                self.data[quantity.name][batch.rows] = found[quantity.name]
            elif quantity.per is ValuePer.TRAJECTORY and (kept >= 0).any():
                signal = found[quantity.name][kept >= 0]
                self.data[quantity.name][kept[kept >= 0]] = signal[:, self.samples]
        if (checked >= 0).any():
            self.check_states[checked[checked >= 0]] = solution.states[checked >= 0]

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
        variables[NUMBERS] = Variable(("quantity", LEADING[ValuePer.RUN]), numbers)
        if len(self.check_states):
            for name, values in self.state_layout.split(self.check_states).items():
                dims = ("checked", "sample", f"entry_of_{name}")
                variables[CHECKED + name] = Variable(dims, values)
        return Table(variables, {}, {ROWS: " ".join(rows)})


def _places(chosen: Array, count: int) -> Array:
    """The place of each of `count` rows among the chosen ones; −1 where it is none of them."""
    places = np.full(count, -1)
    places[chosen] = np.arange(len(chosen))
    return places


def _blank(quantity: Quantity, shape: tuple[int, ...]) -> Array:
    if quantity.dtype is None:
        return np.full(shape, "", dtype=object)
    missing = np.nan if quantity.dtype.kind == "f" else 0
    return np.full(shape, missing, dtype=quantity.dtype)


@dataclass(frozen=True)
class KeptPart:
    """A part in memory, which is in a file as well; it is read as that file is."""

    path: Path
    table: Table

    @property
    def attributes(self) -> Mapping[str, Attribute]:
        """Those of the table."""
        return self.table.attributes

    def has(self, name: str) -> bool:
        """Whether the table has such a variable."""
        return name in self.table.variables

    def __getitem__(self, name: str) -> Array:
        return self.table.variables[name].data


StoredPart = KeptPart | ResultFile
"""A finished part, wherever it is read from."""


def checked_states(results: StoredPart, layout: StateLayout) -> Array:
    """The states that a part holds of the runs that are redone, ``(checked, samples, n)``."""
    return np.concatenate([results[CHECKED + name] for name in layout.lengths], axis=-1)


def is_number(quantity: Quantity) -> bool:
    """Whether a part keeps a quantity as a row of `NUMBERS`."""
    return (
        quantity.per is ValuePer.RUN and quantity.dtype is not None and quantity.dtype.kind == "f"
    )


def read_part(results: StoredPart, quantities: Sequence[Quantity]) -> dict[str, Array]:
    """Every variable that a part holds, by name.

    Raises
    ------
    ResultError
        If it lacks what every run must have.
    """
    rows, numbers = str(results.attributes.get(ROWS, "")).split(), results[NUMBERS]
    missing = [
        entry.name
        for entry in quantities
        if entry.per in (ValuePer.RUN, ValuePer.TRAJECTORY)
        and not (entry.name in rows if is_number(entry) else results.has(entry.name))
    ]
    if missing:
        raise ResultError(f"{results.path}: does not hold {', '.join(missing)}")
    return {
        entry.name: numbers[rows.index(entry.name)] if is_number(entry) else results[entry.name]
        for entry in quantities
        if is_number(entry) or results.has(entry.name)
    }


def _solved(
    batch: Batch, reference: Desired, names: Sequence[str], whole: bool, context: TaskContext
) -> tuple[Solution, dict[str, Array]]:
    """The solution of a batch, with its metrics and, where `whole`, all signals."""
    engine, solver = batch.engine, batch.experiment.solver
    # To estimate its error, a run is solved twice; it counts as done after both.
    share = 0.5 if solver.estimates_errors else 1.0
    kept = None if whole else (MOTION,)
    rows, ways = (
        [_in_rows(reference)],
        (
            context.threads,
            lambda runs: context.progress(share * runs),
        ),
    )
    first = engine.measured(*_functions(batch, names), batch.problem, rows, kept, *ways)
    estimate = np.full(batch.problem.runs, np.nan)
    if solver.estimates_errors:
        compared, motion = Difference(), [first.arrays[MOTION]]
        second = engine.tightened(0.1).measured(
            compared, Difference.largest, batch.problem, motion, (), *ways
        )
        estimate = second.numbers[ERROR]
    _judge(first.solution, estimate, solver.judgement.max_error)
    return first.solution, first.arrays | first.numbers | {"error_estimate": estimate}


def measured(
    batch: Batch, solution: Solution, reference: Desired, names: Sequence[str]
) -> dict[str, Array]:
    """The signals of a solution, and what of its runs is one number each, by name.

    Parameters
    ----------
    reference
        By itself, which the reference of every run is compared with.
    names
        The signals and metrics that are wanted.
    """
    function, reduction = _functions(batch, names)
    states, times = solution.states, batch.problem.times
    with np.errstate(all="ignore"):  # runs that failed are NaN, or large
        found = batch.engine.evaluate(function, batch.problem, states, _in_rows(reference))
        return found | reduction(Samples(times), found)


def _in_rows(reference: Desired) -> Array:
    """The desired pose and velocity at every sample: ``(samples, n)``, or of every run."""
    pose, velocity = reference["desired_pose"], reference["desired_velocity"]
    return np.concatenate([pose.reshape(*velocity.shape[:-1], -1), velocity], axis=-1)


def _functions(batch: Batch, names: Sequence[str]) -> tuple[SampledSignals, Numbers]:
    """What is measured of a batch: at every sample, and of each run."""
    problem, config = batch.problem, batch.experiment.config
    metrics = [row for row in measured_of(config, problem.loop.group) if row.name in names]
    wanted = {*names, *(name for metric in metrics for name in metric.signals)}
    keys = {key for m in metrics for key in (*m.settings.values(), *m.choices.values())}
    values = {key: getattr(config, key) for key in sorted(keys)}
    K = problem.batched_loop(extra_axes=1).gains.K
    balanced = knows_energy(problem.loop, problem.times, problem.states[:1, None])
    key = tuple(m.name for m in metrics), tuple(values.items()), K.tobytes(), balanced
    numbers = Numbers(key, tuple(metrics), values, problem.loop.group, K, balanced)
    limits = config.settling_threshold
    thresholds = tuple(limits.items()) if isinstance(limits, dict) else ()
    return SampledSignals(tuple(sorted(wanted)), thresholds), numbers


@dataclass(frozen=True)
class SampledSignals:
    """What is measured at a sample, of floats or symbols.

    Attributes
    ----------
    names
        The signals that are wanted, among other names.
    thresholds
        Of settling, by parts; none where there is one for the pose error.
    """

    names: tuple[str, ...]
    thresholds: tuple[tuple[str, float], ...] = ()

    def __call__(self, loop: ClosedLoop, t: Any, states: Array, desired: Array) -> dict[str, Array]:
        """The signals, and what else metrics are made of, by name.

        Parameters
        ----------
        desired
            The desired pose, flat, and behind it the desired velocity.
        """
        s, G = loop.tracking(t, states), loop.group
        signals = at_state(loop, s, loop.work(states))
        found = {name: values for name, values in signals if name in self.names}
        if SETTLING in self.names:
            found[SETTLING] = settling_error(G, s.Q, s.Qd, dict(self.thresholds))
        pose, velocity = np.split(desired, [G.size**2], axis=-1)
        pose = pose.reshape(*pose.shape[:-1], G.size, G.size)
        return found | {
            POSE_ERROR: s.Q_E,
            DRIFT: G.drift(s.Q),
            RESIDUAL: squares(s.Qd - pose, s.Vd - velocity),
            MOTION: _motion(s),
        }


@dataclass(frozen=True)
class Numbers:
    """What is one number of each run, of the signals that metrics are made of.

    Attributes
    ----------
    key
        What tells these numbers from others.
    keys
        The values of keys of the configuration, by name.
    K
        That of the runs.
    balanced
        Whether L + W is a balance.
    """

    key: Hashable
    metrics: tuple[Quantity, ...] = field(compare=False)
    keys: Mapping[str, float] = field(compare=False)
    group: MatrixLieGroup = field(compare=False)
    K: Array = field(compare=False)
    balanced: bool = field(compare=False)

    def __call__(self, over: OverTime, found: Mapping[str, Any]) -> dict[str, Any]:
        """The metrics, and what tells whether they can be relied on, by name."""
        signals = dict(found)
        if not self.balanced:
            signals["energy_balance"] = np.nan * signals["energy_balance"]
        numbers = {
            metric.name: metric.measure(
                over,
                signals,
                metric.window,
                **{name: self.keys[key] for name, key in metric.settings.items()},
            )
            for metric in self.metrics
        }
        away = distance_to_unstable(self.group, self.K, signals[POSE_ERROR])
        return numbers | {
            "group_drift": over.largest(signals[DRIFT]),
            "unstable_distance": over.smallest(away),
            "reference_residual": largest(over, signals[RESIDUAL]),
        }


@dataclass(frozen=True)
class Difference:
    """How far a solution is from another at a sample, of floats or symbols."""

    def __call__(self, loop: ClosedLoop, t: Any, states: Array, other: Array) -> dict[str, Array]:
        """Its square, of the pose and of the velocity.

        Parameters
        ----------
        other
            The motion of the other solution.
        """
        difference = _motion(loop.tracking(t, states)) - other
        pose, velocity = np.split(difference, [loop.group.size**2], axis=-1)
        return {ERROR: squares(pose[..., None], velocity)}

    @staticmethod
    def largest(over: OverTime, found: Mapping[str, Any]) -> dict[str, Any]:
        """The largest of both over all samples."""
        return {ERROR: largest(over, found[ERROR])}


def _motion(s: Tracking) -> Array:
    """The pose, flat, and behind it the velocity."""
    # One of them may be the same at every sample.
    Q, V = s.Q.reshape(*s.Q.shape[:-2], -1), s.V
    shape = np.broadcast_shapes(Q.shape[:-1], V.shape[:-1])
    parts = [np.broadcast_to(part, (*shape, part.shape[-1])) for part in (Q, V)]
    return np.concatenate(parts, axis=-1)


def _judge(solution: Solution, estimate: Array, limit: float | None) -> None:
    """Give runs whose error estimate exceeds `max_error` a status of their own."""
    if limit is None:
        return
    for run in np.flatnonzero((solution.status == Status.OK) & (estimate > limit)):
        solution.status[run] = Status.ACCURACY
        solution.messages[run] = (
            f"error estimate {estimate[run]:.2g} exceeds solver.max_error = {limit:g}"
        )
