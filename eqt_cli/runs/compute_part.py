"""Computes parts: integrates their runs, measures them, and saves a table of each."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from pathlib import Path
from typing import Any, Self

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, Arrays, distinct, less, minimum, sqrt, where
from eqt_cli.base.errors import ComponentError, ResultError, TraceError
from eqt_cli.base.extensions import function_for
from eqt_cli.base.registry import blamed, described, place_of
from eqt_cli.base.reporting import working_for
from eqt_cli.base.store_reader import read_arrays
from eqt_cli.base.store_writer import Assembly, write_arrays
from eqt_cli.base.stored import LAW_OUTPUT, Status
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import common_weight, distance_to_unstable
from eqt_cli.components.laws import RunsCode
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.tasks import TRACK
from eqt_cli.config.parts import StudyPart
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import (
    Compiled,
    Problem,
    Query,
    Solution,
    Stopped,
    evaluate,
    hurried,
    measure,
)
from eqt_cli.loop.bounds import bounds_of
from eqt_cli.loop.closed_loop import ClosedLoop, parts_of
from eqt_cli.loop.signals import holds, knows_energy, of_pose, output_names, values_at
from eqt_cli.numbers.running import Running, SampledRuns, goes_by_samples
from eqt_cli.results.metrics import DESIRED, ESTIMATE_SETTLING, SETTLING
from eqt_cli.results.quantity import WHOLE, Measure, ValuePer
from eqt_cli.runs.arithmetic import by
from eqt_cli.runs.batches import (
    BOUND_PER_RTOL,
    Batch,
    batches,
    chosen_entries,
    kind_of,
    largest,
    references,
    squares,
)
from eqt_cli.runs.bounds import end_runs, largest_share
from eqt_cli.runs.executors import TaskContext
from eqt_cli.runs.folder import measured_of, outputs_of_laws, sizes_of, stored_quantities
from eqt_cli.runs.part_files import FinishedPart, PartFiles
from eqt_cli.runs.provenance import versions

ENDED, CHECKED, STUDY, SECONDS = ".ended", ".states", ".study", ".seconds"
"""Arrays in the file of a slab that are no quantities, whose names have no dots: whether each run
has ended, the states of the runs to cross-check, the digest of the study, CPU times of calls."""

LARGEST_TORQUE = "largest torque"
"""Of all samples of a run, whatever the window of its metrics."""

POSE_ERROR, DRIFT = "pose error", "drift from the group"
RESIDUAL, ERROR = "residual of the reference, squared", "error, squared"
VELOCITIES, STILL = "velocities that may stay", "least change of velocities at first"
MOTION = "pose and velocity"
"""Inputs of metrics at every sample that are not signals. Names of signals have no spaces."""

Desired = Arrays
"""The quantities `DESIRED` at every sample, ``(samples, …)``, with an axis for several points."""


def shared_reference(study: Study) -> dict[str, Array]:
    """Solve the reference that all runs share."""
    with hurried(), working_for("the reference"):
        return {name: values[0] for name, values in solve_references(study, np.array([0])).items()}


def solve_references(study: Study, points: Array) -> dict[str, Array]:
    """Solve the references of some points: `DESIRED` as ``(points, samples, …)``."""
    desired: dict[str, Array] = {}
    for batch in references(study, points):
        states = np.empty((len(batch.rows), len(study.base.times), 0))
        if batch.problem.loop.state_length:  # a reference without states needs no integration
            states = batch.engine.solve(batch.problem).states
        for name, values in evaluate(batch.engine, _desired, batch.problem, states).items():
            blank = np.empty((len(points), *values.shape[1:]))
            desired.setdefault(name, blank)[batch.rows] = values
    return desired


def _desired(system: ClosedLoop, t: Any, states: Array) -> dict[str, Array]:
    """Return `DESIRED` of a reference at a sample, or at each of many, for floats or symbols."""
    s = system.tracking(t, states)
    # A constant value has no axis of time.
    return {
        name: np.broadcast_to(values, (*states.shape[:-1], *values.shape[values.ndim - axes :]))
        for name, values, axes in zip(DESIRED, (s.Qd, s.Vd, s.tau_d), (2, 1, 1), strict=True)
    }


@np.errstate(all="ignore")  # starts may be absurd; states of failed runs are NaN or very large
def compute_part(
    study: Study,
    part: StudyPart,
    shared: Desired | None,
    context: TaskContext,
    begun: Path | None = None,
) -> Slab:
    """Compute everything that is stored of a part's runs.

    Parameters
    ----------
    shared
        The reference that all points share; None if each point has its own.
    begun
        File of the runs that had ended when the part was stopped; None without one.

    Raises
    ------
    StoppedPart
        If it is stopped, with the slab of the runs that have ended.
    """
    slab = Slab(study, part)
    if begun is not None:
        with suppress(ResultError):  # they are computed again
            slab = Slab.stored(study, part, begun)
            context.progress(float(slab.ended.sum()))
    left = np.flatnonzero(~slab.ended)
    desired = None
    if shared is None:
        desired = solve_references(study, slab.points)
        for name in DESIRED.keys() & slab.data.keys():
            slab.data[name][:] = desired[name][:, slab.samples]
    laws = list(study.base.loops)
    which = f"law {laws.index(slab.label) + 1} of {len(laws)} ({slab.label})"
    with working_for(which):
        for batch in batches(study, slab.label, slab.entries[left]):
            batch = replace(batch, rows=left[batch.rows])
            for block in slab.blocks(batch, context.threads):
                reference = shared
                if desired is not None:
                    where = np.searchsorted(slab.points, block.points)
                    reference = {name: values[where] for name, values in desired.items()}
                assert reference is not None
                law = block.problem.loop.controller
                code = law if isinstance(law, RunsCode) else None
                if code is not None:
                    code.drained()  # of earlier attempts
                slab.add(block, solved(block, reference, *slab.wanted(block), context))
                if code is not None:
                    slab.seconds = np.append(slab.seconds, code.drained())
                if not slab.ended[block.rows].all():
                    raise StoppedPart(slab)
    return slab


class StoppedPart(Stopped):
    """A part was stopped.

    Attributes
    ----------
    slab
        The arrays of the runs that have ended.
    """

    def __init__(self, slab: Slab) -> None:
        super().__init__()
        self.slab = slab


class Slab:
    """The rows of the result's arrays that belong to a part; missing until its runs are added.

    Slabs of the first controller also hold the initial states (of the first point if all points
    share them), and the references if each point has its own.

    Parameters
    ----------
    arrays
        All arrays, as they were saved; None for missing values.

    Attributes
    ----------
    data
        The rows of each stored quantity, by name.
    ended
        Whether each run has ended.
    check_states
        States of the runs to cross-check, ``(runs, samples, n)``.
    seconds
        CPU times of the calls of code, s; not part of the result.
    """

    def __init__(self, study: Study, part: StudyPart, arrays: Arrays | None = None) -> None:
        self.study, self.part, base = study, part, study.base
        self.label = list(base.loops)[part.controller]
        self.entries = np.arange(part.start, part.stop)
        self.points = distinct(part.points)
        self.samples = slice(None, None, base.config.store.decimate)
        stored = np.flatnonzero(part.run_numbers < study.trajectories)
        is_first = part.controller == 0
        starts = np.flatnonzero(is_first & (study.initial_varies | (part.points == 0)))
        counts = {
            ValuePer.TRAJECTORY: len(stored),
            ValuePer.RUN: len(part),
            ValuePer.INITIAL: len(starts),
            ValuePer.DESIRED: len(self.points) if is_first and study.desired_varies else 0,
        }
        always, self.outputs = (ValuePer.RUN, ValuePer.TRAJECTORY), outputs_of_laws(base)
        self.quantities = [
            entry for entry in stored_quantities(study) if counts[entry.per] or entry.per in always
        ]
        self._starts, self._stored = _positions(starts, len(part)), _positions(stored, len(part))
        checked = np.flatnonzero(np.isin(self.entries, chosen_entries(study)))
        self._checked = _positions(checked, len(part))
        self.seconds = np.empty(0) if arrays is None else arrays.get(SECONDS, np.empty(0))
        states = base.config.time.samples, base.loops[self.label].state_length
        shapes, sizes = {CHECKED: (len(checked), *states), ENDED: (len(part),)}, sizes_of(study)
        for entry in self.quantities:
            shapes[entry.name] = (counts[entry.per], *(sizes[dim] for dim in entry.dims))
        if arrays is None:
            self.check_states = np.full(shapes[CHECKED], np.nan)
            self.ended = np.zeros(len(part), dtype=bool)
            self.data = {}
            for entry in self.quantities:
                dtype = entry.dtype or np.dtype(object)
                missing: Any = {"O": "", "f": np.nan}.get(dtype.kind, 0)
                self.data[entry.name] = np.full(shapes[entry.name], missing, dtype)
            return
        for name, shape in shapes.items():
            if name not in arrays or arrays[name].shape != shape:
                raise ResultError(f"does not hold '{name}' of shape {shape}")
        self.check_states, self.ended = arrays[CHECKED], arrays[ENDED]
        self.data = {entry.name: arrays[entry.name] for entry in self.quantities}

    @classmethod
    def stored(cls, study: Study, part: StudyPart, path: Path) -> Self:
        """Read what `save` wrote.

        Raises
        ------
        ResultError
            If the file is damaged, of another study, or does not hold every quantity.
        """
        arrays = read_arrays(path)
        if STUDY not in arrays or arrays[STUDY].tolist() != [_digest(study)]:
            raise ResultError(f"{path}: is a part of another experiment")
        try:
            return cls(study, part, arrays)
        except ResultError as error:
            raise ResultError(f"{path}: {error}") from error

    def save(self, path: Path) -> None:
        """Write all arrays, whole or not at all."""
        texts = {name: x.astype(str) for name, x in self.data.items() if x.dtype == object}
        more = {CHECKED: self.check_states, ENDED: self.ended, SECONDS: self.seconds}
        more[STUDY] = np.array([_digest(self.study)])
        write_arrays(path, self.data | texts | more)

    @property
    def nbytes(self) -> int:
        """The size of all arrays, bytes."""
        return self.check_states.nbytes + sum(array.nbytes for array in self.data.values())

    @property
    def failed(self) -> int:
        """The number of failed runs."""
        return int(np.count_nonzero(self.data["status"]))

    def blocks(self, batch: Batch, threads: int) -> Iterator[Batch]:
        """Divide a batch into blocks; compiled runs of which numbers suffice are by themselves."""
        if not isinstance(batch.engine, Compiled):  # whose runs may share their steps
            yield batch
            return
        whole = (self._stored[batch.rows] >= 0) | (self._checked[batch.rows] >= 0)
        for some in (batch.select(np.flatnonzero(kind)) for kind in (whole, ~whole)):
            if some.problem.runs:
                yield from map(some.select, batch.engine.blocks(some.problem, threads))

    def wanted(self, batch: Batch) -> tuple[list[str], bool]:
        """Return the quantities to store of a batch: signals only if it has stored trajectories.

        Whether some of its runs need signals or states in addition to numbers.
        """
        stored = (self._stored[batch.rows] >= 0).any()
        kinds = {ValuePer.RUN, ValuePer.TRAJECTORY} if stored else {ValuePer.RUN}
        names = [entry.name for entry in self.quantities if entry.per in kinds]
        return names, bool(stored or (self._checked[batch.rows] >= 0).any())

    def add(self, batch: Batch, solution: Solution) -> None:
        """Store the required quantities of a batch."""
        values = solution.arrays | solution.numbers
        values["steps"], values["status"] = solution.steps, solution.status
        values["message"] = np.array(solution.messages, dtype=object)
        stored, checked = self._stored[batch.rows], self._checked[batch.rows]
        starts = self._starts[batch.rows]
        if (starts >= 0).any():
            for name in ("pose", "velocity"):
                self.data[f"initial_{name}"][starts[starts >= 0]] = batch.start[name][starts >= 0]
        for quantity in self.quantities:
            if quantity.per is ValuePer.RUN:
                self.data[quantity.name][batch.rows] = values[quantity.name]
            elif quantity.per is ValuePer.TRAJECTORY and (stored >= 0).any():
                self._keep(batch, quantity.name, stored, values)
        self.ended[batch.rows] = solution.status != Status.STOPPED
        checked[solution.status != Status.OK] = -1
        if (checked >= 0).any():
            self.check_states[checked[checked >= 0]] = solution.states[checked >= 0]

    def _keep(self, batch: Batch, name: str, stored: Array, values: Arrays) -> None:
        """Store a signal of the runs with trajectories; of outputs, those that each law has."""
        dataset, rows = self.data[name], stored[stored >= 0]
        if name != LAW_OUTPUT:
            dataset[rows] = values[name][stored >= 0][:, self.samples]
            return
        loop = batch.problem.loop
        for k, output in enumerate(output_names(loop.controller, loop.group)):
            if output in self.outputs:
                signal = values[name][stored >= 0][:, self.samples, k]
                dataset[rows, :, list(self.outputs).index(output)] = signal

    def put_into(self, file: Assembly) -> None:
        """Write every quantity into its place in the result file."""
        study, part = self.study, self.part
        for entry in self.quantities:
            data = self.data[entry.name]
            if entry.per is ValuePer.DESIRED:  # a point cut by parts belongs to its first one
                begins_here = self.points * part.runs >= part.start
                if begins_here.any():
                    first, last = self.points[begins_here][[0, -1]].tolist()
                    file.put(entry.name, data[begins_here], (slice(first, last + 1),))
            elif entry.per is ValuePer.INITIAL and not study.initial_varies:
                file.put(entry.name, data, (slice(part.start, part.start + len(data)),))
            else:
                law = () if entry.per is ValuePer.INITIAL else (part.controller,)
                runs = study.trajectories if entry.per is ValuePer.TRAJECTORY else part.runs
                for box in part.boxes(runs):
                    block = data[box.rows].reshape(*box.shape, *data.shape[1:])
                    if study.sweep:
                        file.put(entry.name, block, (box.points, *law, box.runs))
                    else:
                        file.put(entry.name, block[0], (*law, box.runs))


def is_of(study: Study, path: Path) -> bool:
    """Whether a file is of a part of this study, as it says itself."""
    with suppress(ResultError):
        return bool(read_arrays(path).get(STUDY, np.empty(0))[:1].tolist() == [_digest(study)])
    return False


def _digest(study: Study) -> str:
    return (study.whole or study).digest


def _positions(chosen: Array, count: int) -> Array:
    """Return the index of each of `count` rows among the chosen ones; −1 for the other rows."""
    places = np.full(count, -1)
    places[chosen] = np.arange(len(chosen))
    return places


def solved(
    batch: Batch, reference: Desired, names: Sequence[str], whole: bool, context: TaskContext
) -> Solution:
    """Solve a batch; return the solution with its metrics and, if `whole`, all signals."""
    engine, solver = batch.engine, batch.experiment.solver
    # An error estimate solves a run twice; each solution counts as half of the run.
    share = 0.5 if solver.estimates_errors else 1.0
    returned = None if whole else (MOTION,)
    how = context.threads, lambda runs: context.progress(share * runs)
    query = Query(*functions_of(batch, names), [_in_rows(reference)], returned)
    first = measure(engine, batch.problem, query, *how)
    estimate = np.full(batch.problem.runs, np.nan)
    if solver.estimates_errors:
        again = replace(batch.problem, halved=True)
        query = Query(difference, largest_difference, [first.arrays[MOTION]])
        # Of few steps in a hold the last is cut: a tenth may need no other number of them.
        tighter = engine.tightened(0.05 if batch.problem.loop.period else 0.1)
        second = measure(tighter, again, query, *how)
        estimate = np.maximum(second.numbers[ERROR], np.finfo(float).eps)  # both are rounded
        first.status[second.status == Status.STOPPED] = Status.STOPPED
    if any(row.constraint for row in batch.experiment.metrics):
        judge = function_for(purposes.judge_constraints)
        first = judge(batch, names, first, context.threads)
    _find_undefined(first)
    _find_by_rounding(batch, first, context.threads)
    first = replace(first, numbers=first.numbers | {"error_estimate": estimate})
    if most := batch.experiment.config.failed_when:
        end_runs(bounds_of(most, batch.problem.loop), batch, first)
    limit = solver.judgement.max_error
    if solver.estimates_errors and limit is not None:
        _judge(first, estimate, limit)
    return first


def measured(
    batch: Batch, solution: Solution, reference: Desired, names: Sequence[str]
) -> dict[str, Array]:
    """Return the signals and the metrics of a solution, by name.

    Parameters
    ----------
    reference
        The reference solved without runs, with which the reference of every run is compared.
    names
        Names of the signals and metrics to compute.
    """
    function, reduction = functions_of(batch, names)
    sampled = evaluate(batch.engine, function, batch.problem, solution.states, _in_rows(reference))
    return sampled | reduction(SampledRuns(batch.problem.times), sampled)


def _in_rows(reference: Desired) -> Array:
    """Join the flat desired pose and the desired velocity: ``(samples, n)``, or for every run."""
    pose, velocity = reference["desired_pose"], reference["desired_velocity"]
    return np.concatenate([pose.reshape(*velocity.shape[:-1], -1), velocity], axis=-1)


def functions_of(batch: Batch, names: Sequence[str]) -> tuple[SampledSignals, Numbers]:
    """Return the functions that measure a batch: at every sample, and per run.

    What judges constraints is left to `purposes.judge_constraints`.
    """
    problem, config = batch.problem, batch.experiment.config
    judged = {row.name for row in batch.experiment.metrics if row.constraint}
    names = [name for name in names if name not in judged]
    metrics = [row for row in measured_of(batch.experiment) if row.name in names]
    own_metrics = [row for row in batch.experiment.metrics if row.name in names]
    without = {name for own_metric in own_metrics for name in own_metric.lacking(problem.loop)}
    # A metric of a law without a number that it reads is NaN.
    none: dict[str, Any] = {"of": lambda over, error: np.nan * over.final(error)}
    none["signals"] = ("pose_error",)
    metrics = [replace(row, **none) if without & set(row.signals) else row for row in metrics]
    if config.failed_when:
        metrics.append(largest_share(bounds_of(config.failed_when, problem.loop)))
    wanted = {*names, *(name for metric in metrics for name in metric.signals)}
    keys = sorted({key for m in metrics for key in (*m.settings.values(), *m.choices.values())})
    values = {key: getattr(config, key) for key in keys}
    K = common_weight(problem.batched_loop(extra_axes=1).gains.K)
    balanced = knows_energy(problem.loop, problem.times, problem.states[:1, None])
    held = holds(problem.loop.vehicle)
    control, times = problem.loop.vehicle.control, problem.times
    wait = 0.0 if control is None else (control.delay + 2) * control.period
    first = float(times[1:][np.searchsorted(times[1:-1], times[0] + wait)])
    formulas = ((type(own_metric).__module__, repr(own_metric)) for own_metric in own_metrics)
    windows = sorted({repr(metric.window) for metric in metrics})
    fixed = (K.tobytes(), balanced, first, *held.items(), *formulas, *windows)
    key = tuple(m.name for m in metrics), tuple(values.items()), fixed
    numbers = Numbers(key, tuple(metrics), values, problem.loop.group, K, balanced, held, first)
    limits = config.settling_threshold
    thresholds = tuple(limits.items()) if isinstance(limits, dict) else ()
    return SampledSignals(tuple(sorted(wanted)), thresholds), numbers


@dataclass(frozen=True)
class SampledSignals:
    """Computes the signals at a sample, for floats or symbols.

    Attributes
    ----------
    names
        Names of the required signals. Other names are ignored.
    most
        Settling thresholds by part; empty if one threshold holds for the pose error.
    """

    names: tuple[str, ...]
    most: tuple[tuple[str, float], ...] = ()

    def __call__(self, loop: ClosedLoop, t: Any, states: Array, desired: Array) -> dict[str, Array]:
        """Return the signals and the other inputs of metrics, by name.

        Parameters
        ----------
        desired
            The flat desired pose, followed by the desired velocity.
        """
        s, G, most = loop.tracking(t, states), loop.group, dict(self.most)
        sampled = values_at(loop, s, states, self.names)
        if SETTLING in self.names:
            sampled[SETTLING] = loop.task.settling_error(G, s.Q, s.Qd, most, s.V_tilde)
        if ESTIMATE_SETTLING in self.names:
            error = G.exp(of_pose(s))
            sampled[ESTIMATE_SETTLING] = TRACK.settling_error(G, error, G.identity, most)
        pose, velocity = np.split(desired, [G.size**2], axis=-1)
        pose = pose.reshape(*pose.shape[:-1], G.size, G.size)
        integrated = [s.Vd] if "velocity" in loop.reference.starts_from else []
        return sampled | {
            POSE_ERROR: loop.task.pose_error(s, loop.controller),
            DRIFT: G.drift(s.Q),
            VELOCITIES: np.concatenate([s.V_tilde, *integrated], axis=-1),
            RESIDUAL: squares(s.Qd - pose, s.Vd - velocity),
            MOTION: _motion(s),
        }


@dataclass(frozen=True)
class Numbers:
    """Reduces signals to one number of each run.

    Attributes
    ----------
    key
        Identifies the metrics and their settings; compiled reductions are cached by it.
    metrics
        The metrics to compute.
    keys
        Values of the keys of the configuration that metrics use, by name.
    K
        The gain K of the runs, or one with its critical points.
    balanced
        Whether the energy balance L + W is known.
    holds
        Signals that are held between ticks, with the time between two changes.
    first
        The first sample by which the law has moved the body, s.
    """

    key: Hashable
    metrics: tuple[Measure, ...] = field(compare=False)
    keys: Mapping[str, float] = field(compare=False)
    group: MatrixLieGroup = field(compare=False)
    K: Array = field(compare=False)
    balanced: bool = field(compare=False)
    holds: Mapping[str, float] = field(compare=False)
    first: float = field(compare=False)

    def __call__(self, over: SampledRuns, sampled: Mapping[str, Any]) -> dict[str, Any]:
        """Return the metrics and the indicators of their reliability, by name."""
        signals, over.holds = dict(sampled), self.holds
        if not self.balanced:
            signals["energy_balance"] = np.nan * signals["energy_balance"]
        if isinstance(over, Running):
            for metric in self.metrics:
                shapes = {name: np.shape(signals[name])[1:] for name in metric.signals}
                whole = partial(metric.measure, window=WHOLE)
                if metric.is_own and not goes_by_samples(whole, shapes):
                    raise TraceError(f"metric {metric.name} does not go from sample to sample")
        numbers = {metric.name: self._number(metric, over, signals) for metric in self.metrics}
        away = distance_to_unstable(self.group, self.K, signals[POSE_ERROR])
        if "torque_norm" in signals:
            numbers[LARGEST_TORQUE] = over.largest(signals["torque_norm"])
        return numbers | {
            "group_drift": over.largest(signals[DRIFT]),
            "unstable_distance": over.smallest(away),
            STILL: self._least_change(over, signals[VELOCITIES]),
            "reference_residual": largest(over, signals[RESIDUAL]),
        }

    def _number(self, metric: Measure, over: SampledRuns, signals: Mapping[str, Any]) -> Any:
        """Return a metric of each run; what one of the user's own raises is said with its name."""
        settings = {name: self.keys[key] for name, key in metric.settings.items()}
        try:
            number = metric.measure(over, signals, metric.window, **settings)
        except (Exception, SystemExit) as error:
            if not metric.is_own:
                raise
            at = f" at {place}" if (place := place_of(error)) else ""
            said = f"metric '{metric.name}' fails on the samples of runs: {described(error)}{at}"
            raise ComponentError(said) from error
        if metric.is_own and np.shape(number) != (expected := np.shape(signals[DRIFT])[:1]):
            raise ComponentError(
                f"metric '{metric.name}' returns an array of shape {np.shape(number)} for the "
                f"samples of {expected[0]} runs; expected {expected}"
            )
        return number

    def _least_change(self, over: SampledRuns, velocities: Any) -> Any:
        """Return the least change of the velocity of a part until `first`."""
        count, m = velocities.shape[-1], self.group.dimension
        parts = [range(m)[part.axes] for part in self.group.parts]
        changes = []
        for axes in parts + ([range(m, count)] if count > m else []):
            columns = (velocities[..., k] for k in axes)
            squares = sum((x - over.initial(x)) ** 2 for x in columns)
            changes.append(over.largest(where(less(self.first, over.time), 0.0, squares)))
        return sqrt(reduce(minimum, changes))


def difference(loop: ClosedLoop, t: Any, states: Array, other: Array) -> dict[str, Array]:
    """Return the squared differences of pose and velocity at a sample, for floats or symbols.

    Parameters
    ----------
    other
        The motion of the other solution.
    """
    apart = _motion(loop.tracking(t, states)) - other
    pose, velocity = np.split(apart, [loop.group.size**2], axis=-1)
    return {ERROR: squares(pose[..., None], velocity)}


def largest_difference(over: SampledRuns, sampled: Mapping[str, Any]) -> dict[str, Any]:
    """Return the largest difference of pose or velocity over all samples."""
    return {ERROR: largest(over, sampled[ERROR])}


def _motion(s: Tracking) -> Array:
    """Return the flat pose, followed by the velocity."""
    # A constant pose or velocity has no axis of time.
    Q, V = s.Q.reshape(*s.Q.shape[:-2], -1), s.V
    shape = np.broadcast_shapes(Q.shape[:-1], V.shape[:-1])
    pieces = [np.broadcast_to(piece, (*shape, piece.shape[-1])) for piece in (Q, V)]
    return np.concatenate(pieces, axis=-1)


NEAR = 1e-9
"""Change of a velocity, or distance of a pose, that may be rounding; and the error tried."""

LARGE = 1e-3
"""Error, rad or m, that is no longer small; to grow to it from `NEAR` takes 14 time constants."""


def _find_undefined(first: Solution) -> None:
    """Set the status `NON_FINITE` for runs whose steps missed a torque that is not finite."""
    peaks = first.numbers.get(LARGEST_TORQUE, np.zeros(len(first.status)))
    for run in np.flatnonzero((first.status == Status.OK) & ~np.isfinite(peaks)):
        first.status[run] = Status.NON_FINITE
        first.messages[run] = (
            "the torque is not finite at a sample, between steps; lower solver.rtol to find when"
        )


def _find_by_rounding(batch: Batch, first: Solution, threads: int) -> None:
    """Set the status `BY_ROUNDING` for runs that start within rounding of an unstable motion.

    In such a motion, the velocity stays or the pose is critical; an error of `NEAR` at the start
    becomes `LARGE`. So it does even where a run, by rounding, does not leave it until its end.
    """
    still = np.fmin(first.numbers[STILL], first.numbers["unstable_distance"])
    near = np.flatnonzero((first.status == Status.OK) & (still <= NEAR))
    if not len(near):
        return
    problem, limit = batch.problem.select(near), max(LARGE, BOUND_PER_RTOL * batch.engine.rtol)
    query = Query(difference, largest_difference, [first.arrays[MOTION][near]])
    apart = np.zeros(len(near))
    loop, t = problem.batched_loop(), float(problem.times[0])
    s = loop.tracking(t, problem.states)
    for error in (NEAR, -NEAR):  # of a law that jumps, one of them is on the other side
        # In all directions of body and reference
        x = error * np.cos(np.arange(loop.group.dimension))
        start = loop.initial_state(s.Q @ loop.group.exp(x), s.V + x, s.Qd, s.Vd + x, t)
        other = replace(problem, states=start)
        solved = measure(batch.engine, other, query, threads)
        ends = solved.status == Status.OK  # or the error has made it diverge
        first.status[near[solved.status == Status.STOPPED]] = Status.STOPPED
        apart = np.fmax(apart, np.where(ends, solved.numbers[ERROR], np.inf))
    for run in near[(apart > limit) & (first.status[near] == Status.OK)]:
        first.status[run] = Status.BY_ROUNDING
        first.messages[run] = (
            f"rounding decides: at its start, an error of {NEAR:g} grows beyond {limit:g}; no "
            "solver.rtol helps; start it elsewhere"
        )


def _judge(solution: Solution, estimate: Array, limit: float) -> None:
    """Set the status `ACCURACY` for runs whose error estimate is above `max_error`, or is NaN."""
    for run in np.flatnonzero((solution.status == Status.OK) & ~(estimate <= limit)):
        solution.status[run] = Status.ACCURACY
        solution.messages[run] = (
            f"error estimate {estimate[run]:.2g} exceeds solver.max_error = {limit:g}"
            if estimate[run] > limit
            else f"no error estimate for solver.max_error = {limit:g}: the second solve failed"
        )


MEMORY_BYTES = 64 * 2**20
"""Largest size of finished parts kept in memory, so that packing need not read their files."""

UNSAVED_SECONDS = 1.0
"""Time after its start for which a session writes no files of such parts. One that has computed
all parts by then writes every number once; a kill loses at most the work of that time."""


BRIEF = 20_000
"""Most samples and control instants of all runs for which it pays to compile quickly."""


def is_brief(study: Study) -> bool:
    """Return whether compiled code takes less time to run than it takes to be compiled well."""
    times, period = study.base.times, study.base.loop.period
    return bool(study.plans.total * (len(times) + times[-1] / (period or np.inf)) <= BRIEF)


def _compile(study: Study, label: str) -> None:
    """Compile what stored runs of a law need, by a run up to its first sample after the start.

    What fails here fails again where it is said.
    """
    with suppress(Exception), np.errstate(all="ignore"):
        loop, wanted = study.base.loops[label], [entry.name for entry in stored_quantities(study)]
        if any(part.is_foreign for part in parts_of(loop)) or isinstance(loop.controller, RunsCode):
            return  # a user's code is called for results only
        start = Problem(loop, np.zeros((1, loop.state_length)), study.base.times[:2])
        study.base.engine.integrator(start)  # while others compile what starts and references need
        [batch] = batches(study, label, np.array([0]))
        problem = replace(batch.problem, times=start.times)
        states, m = batch.engine.solve(problem).states, loop.group.dimension
        motion = np.zeros((1, 2, loop.group.size**2 + m))
        evaluate(batch.engine, functions_of(batch, wanted)[0], problem, states, motion[0])
        if batch.experiment.solver.estimates_errors:
            evaluate(batch.engine, difference, problem, states, motion)


@dataclass(frozen=True, eq=False)
class PartTask:
    """Computes parts of a study into a folder; it can be sent to other processes.

    Attributes
    ----------
    chosen
        The parts to compute, each with the index of its piece of the study; None for all parts of
        the study's plan.
    keeps
        Whether finished parts stay in memory, up to `MEMORY_BYTES`, until they are packed; `save`
        writes their files. Copies of the task in other processes keep none and write at once.
    stopped
        Files of parts that were stopped, by number.
    """

    study: Study
    files: PartFiles
    chosen: tuple[tuple[int, StudyPart], ...] | None = None
    keeps: bool = False
    stopped: dict[int, Path] = field(default_factory=dict)
    _slabs: dict[int, Slab] = field(default_factory=dict, init=False)
    """Finished parts in memory, by number."""
    _unsaved: dict[int, FinishedPart] = field(default_factory=dict, init=False)
    """Those of them that have no file yet, with the file that each will have."""
    _references: dict[int, Desired] = field(default_factory=dict, init=False)
    """References that have been read, by piece."""

    def __len__(self) -> int:
        return len(self.study.plans) if self.chosen is None else len(self.chosen)

    def part(self, item: int) -> tuple[int, StudyPart]:
        """Return the index of the piece of the study, and the part."""
        if self.chosen is not None:
            return self.chosen[item]
        index, number = self.study.plans.where(item)
        return index, self.study.piece(index).plan.part(number)

    def runs_of(self, item: int) -> int:
        """Return the number of runs of a part."""
        return len(self.part(item)[1])

    def origin(self) -> dict[str, Any]:
        """Return what the last bits depend on in this process."""
        return versions() | by(self.study)

    def missing(self, wanted: Iterable[int] | None = None) -> list[int]:
        """Return the numbers of the missing parts, among all or the wanted ones."""
        there = self.finished()
        return [n for n in (range(len(self)) if wanted is None else wanted) if n not in there]

    def finished(self) -> dict[int, FinishedPart]:
        """Return the finished parts, by number."""
        return self.files.listed() | self._unsaved

    @blamed()
    def __call__(self, item: int, context: TaskContext) -> int:
        """Compute and keep one part; returns how many of its runs failed."""
        index, part = self.part(item)
        piece, shared = self.study.piece(index), self.shared(index)
        try:
            with hurried(is_brief(self.study)):
                slab = compute_part(piece, part, shared, context, self.stopped.get(item))
        except StoppedPart as stopped:
            if runs := int(stopped.slab.ended.sum()):
                stopped.slab.save(self.files.part(item, runs, "r"))
            raise
        return self._keep(item, slab)

    def lose(self, item: int, message: str) -> int:
        """Keep a part whose workers were lost; returns the number of its runs, which all fail."""
        index, part = self.part(item)
        slab = Slab(self.study.piece(index), part)
        slab.data["status"][:], slab.data["message"][:] = Status.WORKER_LOST, message
        return self._keep(item, slab)

    def _keep(self, item: int, slab: Slab) -> int:
        path = self.files.part(item, slab.failed)
        self._slabs.pop(item, None)
        slabs = [slab, *self._slabs.values()]  # at once, since other threads keep theirs
        size = sum(other.nbytes for other in slabs)
        if self.keeps and size <= MEMORY_BYTES:
            self._slabs[item], self._unsaved[item] = slab, FinishedPart(path, slab.failed)
        else:
            slab.save(path)
        return slab.failed

    def save(self) -> None:
        """Write the parts that are only in memory."""
        for item, part in list(self._unsaved.items()):
            if not part.path.exists():  # else it was interrupted after it had written the file
                self._slabs[item].save(part.path)
            del self._unsaved[item]

    def slab(self, item: int, path: Path) -> Slab:
        """Return a finished part: from memory the first time if it is there, else from its file."""
        if item in self._unsaved:
            return self._slabs[item]
        index, part = self.part(item)
        if item in self._slabs:
            return self._slabs.pop(item)
        return Slab.stored(self.study.piece(index), part, path)

    @blamed()
    def prepare(self, threads: int = 0) -> None:
        """Look for stopped parts, and save the shared references that have no complete file yet.

        Parameters
        ----------
        threads
            Number of threads that compile the laws beside, for parts in this process.
        """
        if self.chosen is None:
            self.stopped.update((item, path) for item, (path, _) in self.files.stopped().items())
        base, piece = self.study.base, self.study.piece(0)
        kinds = {kind_of(piece.experiment(0), label): label for label in base.loops}
        with hurried(is_brief(self.study)), ThreadPoolExecutor(max(1, threads)) as pool:
            if threads and isinstance(base.engine, Compiled):
                for label in kinds.values():
                    pool.submit(copy_context().run, _compile, piece, label)
            self._save_references()

    def _save_references(self) -> None:
        for index in range(len(self.study.shapes)):
            piece, path = self.study.piece(index), self.files.reference(index)
            if piece.desired_varies:
                continue
            of_piece = [_digest(piece), str(index)]
            with suppress(ResultError, KeyError):
                if read_arrays(path)[STUDY].tolist() == of_piece:
                    continue
            write_arrays(path, {**shared_reference(piece), STUDY: np.array(of_piece)})

    def shared(self, index: int) -> Desired | None:
        """Return the reference that all points of a piece share; None if each has its own."""
        if index not in self._references and not self.study.piece(index).desired_varies:
            arrays = read_arrays(self.files.reference(index))
            self._references[index] = {name: arrays[name] for name in DESIRED}
        return self._references.get(index)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"keeps": False, "_slabs": {}, "_unsaved": {}, "_references": {}}
