"""Constraints, judged by the solution between samples, of which rows may know nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.stored import Status
from eqt_cli.engines.engine import Compiled, Engine, Problem, Solution, evaluate
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.signals import Metric, values_at
from eqt_cli.numbers.running import SampledRuns, straightened
from eqt_cli.runs.batches import Batch

PER_STEP = 2
"""First times in a step of the engine; more follow where lines between them are not straight."""

EVALUATIONS = 12
"""Evaluations of a step of DOP853, by which engines in NumPy count their work."""

MOST_FIRST = 20_000
"""Most of these times in a run."""

BYTES = 64 * 2**20
"""Memory for the states of the runs that are looked at together."""


@dataclass(frozen=True)
class _Signals:
    """Returns some signals at a sample, for floats or symbols."""

    names: tuple[str, ...]

    def __call__(self, loop: ClosedLoop, t: object, states: Array) -> dict[str, Array]:
        return values_at(loop, loop.tracking(t, states), states, self.names)


def judge_constraints(
    batch: Batch, names: Sequence[str], first: Solution, threads: int
) -> Solution:
    """Return a solution with the numbers of metrics that judge constraints.

    The same runs are solved at more times, which changes no step of theirs. Lines between these
    times are straight to `numbers.running.STRAIGHT`.

    Parameters
    ----------
    names
        Names of the metrics to compute.
    first
        The solution at the samples, with the work of each run.
    """
    loop = batch.problem.loop
    chosen = [
        metric for metric in batch.experiment.metrics if metric.constraint and metric.name in names
    ]
    judged = [metric for metric in chosen if not metric.lacking(loop)]
    numbers = {metric.name: np.full(batch.problem.runs, np.nan) for metric in chosen}
    if not judged:
        return replace(first, numbers=first.numbers | numbers)
    intervals = len(batch.problem.times) - 1
    steps = first.steps.max() / (1 if isinstance(batch.engine, Compiled) else EVALUATIONS)
    parts = max(2, int(np.ceil(min(PER_STEP * steps, MOST_FIRST) / intervals)))
    size = 8 * loop.state_length * intervals * parts
    blocks = -(-batch.problem.runs * size // BYTES)
    for some in np.array_split(np.arange(batch.problem.runs), min(blocks, batch.problem.runs)):
        problem = batch.problem.select(some)
        over, values, stopped = _resolved(batch.engine, problem, judged, parts, threads)
        first.status[some[stopped]] = Status.STOPPED
        for metric in judged:
            numbers[metric.name][some] = metric.of(over, *(values[name] for name in metric.signals))
    return replace(first, numbers=first.numbers | numbers)


def _resolved(
    engine: Engine, problem: Problem, judged: Sequence[Metric], parts: int, threads: int
) -> tuple[SampledRuns, dict[str, Array], Array]:
    """Return times between which all lines are straight, signals there, and which runs stopped."""
    function = _Signals(tuple(sorted({name for metric in judged for name in metric.signals})))
    values, stopped = dict[str, Array](), np.zeros(problem.runs, dtype=bool)

    def lines(times: Array) -> Array:
        finer = replace(problem, times=times)
        solution = engine.solve(finer, threads)
        stopped[solution.status == Status.STOPPED] = True
        values.update(evaluate(engine, function, finer, solution.states))
        signals = ((values[name] for name in metric.signals) for metric in judged)
        every = [
            metric.lines(SampledRuns(times), *x) for metric, x in zip(judged, signals, strict=True)
        ]
        return np.concatenate(every, axis=-1)

    return SampledRuns(straightened(problem.times, parts, lines)), values, stopped
