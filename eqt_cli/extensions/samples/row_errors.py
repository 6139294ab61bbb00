"""How much metrics err since their samples are far apart, measured on a few runs of each law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, distinct
from eqt_cli.base.stored import Attribute
from eqt_cli.components.laws import RunsCode
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import Compiled, Problem, evaluate
from eqt_cli.extensions.samples.unjudged import UNJUDGED_ROWS
from eqt_cli.numbers.running import SampledRuns
from eqt_cli.results.metrics import INTEGRALS, QUANTITIES, peak, settling_time
from eqt_cli.results.quantity import Measure, ValuePer
from eqt_cli.runs.batches import Batch, batches
from eqt_cli.runs.compute_part import functions_of
from eqt_cli.runs.folder import stored_quantities, with_keys_of

TOLD = 0.0075
"""Relative error from which it is told, which the proposed number of samples stays below. That of a
few runs is not that of all: so all with 1 % are told, and none with 0.5 %."""

RUNS = 3
"""Runs of each law that are solved again."""

PER_STEP = 4
"""Samples in a step of the engine of which metrics are taken to be exact, if half as many agree."""

MOST_SAMPLES, MOST_BY_NUMPY = 200_000, 4_000
"""Most samples of a run; by engines in NumPy, where each may cost a step of its own, of 2 ms."""

SMALL = 1e-5
"""Share of the largest value of a signal, or of the run, below which a metric counts as this."""

UNJUDGED = "unjudged"
"""In place of the name of a metric, where that takes more samples; no metric of eqt has it."""

EVALUATIONS = 12
"""Evaluations of a step of DOP853, by which engines in NumPy count their work."""


@purposes.errors_of_a_result
def row_errors(study: Study) -> dict[str, Attribute]:
    """Return the attributes of a result of which a metric errs by its samples; empty if none does.

    A few runs are solved at many more samples, which changes no step of theirs. Commands are held
    from tick to tick there, as in the runs. Where noise is measured at ticks that samples skip,
    nothing is said: their error is then random, and `eqt config check` says that they skip. Nor is
    it of loops with a sample at every tick whose torque is held from tick to tick. A lag or a rate
    limit moves the torque between ticks, and samples at them then miss how.
    """
    names = [
        entry.name
        for entry in stored_quantities(study)
        if entry.per in (ValuePer.RUN, ValuePer.TRAJECTORY)
    ]  # of which the run has compiled the program
    worst: tuple[float, str, str] = (0.0, "", "")
    needed, unjudged = 0, list[str]()
    for piece in study.pieces:
        entries = distinct(np.linspace(0, piece.plan.entries - 1, RUNS).astype(int))
        for label in piece.base.loops:
            for batch in batches(piece, label, entries):
                for name, error, samples in _errors_of(batch, names):
                    if name == UNJUDGED:
                        engine = "; solver.engine native does" if samples < MOST_SAMPLES else ""
                        unjudged.append(
                            f"eqt does not judge whether samples of {label} are too far apart, "
                            f"which takes more than {samples:,} samples of a run{engine}"
                        )
                        continue
                    if name in names:
                        worst = max(worst, (error, name, label))
                    needed = max(needed, samples)
    error, name, law = worst
    if error <= TOLD:
        return {UNJUDGED_ROWS: unjudged[0]} if unjudged else {}
    return {"row_error": error, "row_metric": name, "row_law": law, "row_samples": needed}


def _errors_of(batch: Batch, names: Sequence[str]) -> Iterator[tuple[str, float, int]]:
    """Yield the name of each metric, its relative error, and samples that would do."""
    problem, loop = batch.problem, batch.problem.loop
    parts = _parts(problem)
    intervals = len(problem.times) - 1
    has_every_tick = loop.vehicle.control is not None and parts == 1 and not loop.vehicle.moving
    is_random = problem.errors is not None and parts > 1
    # A law of a plugin may end the process that calls it: workers call it, or C does.
    is_eqts = type(loop.controller).__module__.startswith("eqt_cli.")
    may_end = not (is_eqts or isinstance(batch.engine, Compiled))
    if isinstance(loop.controller, RunsCode) or may_end or has_every_tick or is_random:
        return
    function, reduction = functions_of(batch, names)
    stored = [row for row in reduction.metrics if row.name in names]
    # What `eqt compare` computes where somebody asks: of few runs, its error may be by chance, so
    # that it only counts for the number of samples that would do.
    others = [row for row in QUANTITIES.values() if row.of and row.per is ValuePer.RUN]
    config, signals = batch.experiment.config, {*names}
    further = [with_keys_of(config, x) for x in others if not x.stored and {*x.signals} <= signals]
    rows = [row for row in (*stored, *further) if _of(row) in JUDGED]
    reduction = replace(reduction, metrics=tuple(rows))
    width = loop.group.size**2 + loop.group.dimension
    begins = problem.times
    per_step = PER_STEP / (1 if isinstance(batch.engine, Compiled) else EVALUATIONS)
    while parts < 4:
        parts *= 2
    most = MOST_SAMPLES if isinstance(batch.engine, Compiled) else MOST_BY_NUMPY
    while parts * intervals <= most:
        times = np.interp(np.arange(parts * intervals + 1) / parts, np.arange(len(begins)), begins)
        finer = replace(problem, times=times)
        solution = batch.engine.solve(finer)
        if solution.status.any():
            return
        if parts * intervals < (work := solution.steps.max() * per_step):
            while parts * intervals < work:
                parts *= 2
            continue
        sampled = evaluate(
            batch.engine, function, finer, solution.states, np.zeros((len(times), width))
        )
        with np.errstate(all="ignore"):  # few samples may leave one in a window: NaN
            numbers = {
                step: reduction(
                    SampledRuns(times[::step]), {name: x[:, ::step] for name, x in sampled.items()}
                )
                for step in range(1, parts + 1)
                if parts % step == 0
            }
        errors = {
            row.name: {
                step: _relative(values[row.name], numbers[1][row.name], _least(row, sampled, times))
                for step, values in numbers.items()
            }
            for row in rows
        }
        apart = max((of[2] for name, of in errors.items() if name in names), default=0.0)
        if apart < TOLD / (4 if 4 * parts * intervals <= most else 1):
            for name, of in errors.items():
                steps = [step for step in sorted(of, reverse=True) if of[step] <= TOLD]
                yield name, of[parts], parts // steps[0] * intervals + 1
            return
        parts *= 4
    ends = replace(problem, times=begins[[0, -1]])
    if intervals < batch.engine.solve(ends).steps.max() * per_step:
        yield UNJUDGED, 0.0, most


def _of(row: Measure) -> object:
    return getattr(row.of, "func", row.of)


JUDGED = (*INTEGRALS, peak, settling_time)
"""Formulas that samples may be too far apart for; others are of single samples, or no numbers."""


def _parts(problem: Problem) -> int:
    """Return into how many parts the time between two samples falls, so that ticks are samples."""
    control = problem.loop.vehicle.control
    ratio = 1.0 if control is None else float(problem.times[1] - problem.times[0]) / control.tick
    return max(1, round(ratio)) if abs(ratio - round(ratio)) < 1e-6 else int(np.ceil(ratio))


def _least(row: Measure, sampled: dict[str, Array], times: Array) -> float:
    """Return the size below which a metric is not judged by its own."""
    duration = float(times[-1] - times[0])
    if _of(row) is settling_time:
        return SMALL * duration
    largest = float(np.max(np.abs(sampled[row.signals[0]]), initial=0.0))
    squares = row.units.startswith("({})^2")
    return (SMALL * largest) ** 2 * duration if squares else SMALL * largest


def _relative(values: Array, exact: Array, least: float) -> float:
    """Return the relative error of the mean over runs; 0 if none has a number."""
    both = np.isfinite(values) & np.isfinite(exact)
    if not both.any():
        return 0.0
    size = max(abs(float(exact[both].mean())), least, np.finfo(float).tiny)
    return abs(float(values[both].mean() - exact[both].mean())) / size
