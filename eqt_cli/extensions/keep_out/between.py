"""Constraints, judged by the solution between samples, of which rows may know nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.stored import Status
from eqt_cli.engines.engine import Compiled, Engine, Problem, Solution, evaluate
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.signals import Metric, values_at
from eqt_cli.numbers.running import SampledRuns
from eqt_cli.runs.batches import Batch

PER_STEP = 2
"""First times in a step of the engine; more follow where lines between them are not straight."""

EVALUATIONS = 12
"""Evaluations of a step of DOP853, by which engines in NumPy count their work."""

MOST_FIRST = 20_000
"""Most of these times in a run."""

BYTES = 64 * 2**20
"""Memory for the states of the runs that are looked at together."""

STRAIGHT = 1e-6
"""Allowed distance of a line between two times from the curve that it stands for."""

MOST_TIMES = 200_000
"""Times of a run beyond which no more are added."""

MOST_ROUNDS = 8
"""Rounds after which a curve that is not straight yet jumps."""


def straightened(times: Array, parts: int, lines: Callable[[Array], Array]) -> Array:
    """Return times, and others between them where the lines from one to the next are not straight.

    A line over a time h is h²/8 |x″| away from its curve. Three neighbouring values tell |x″|.

    Parameters
    ----------
    times : (n,)
        Increasing times, s.
    parts
        Parts into which the time between two of them is divided at first.
    lines
        Returns the values at some times, ``(runs, times, k)``; the last call is of those returned.
    """
    divisions = np.full(len(times) - 1, parts)
    for _ in range(MOST_ROUNDS):
        ends = np.repeat(times[:-1], divisions), np.repeat(np.diff(times) / divisions, divisions)
        within = np.arange(len(ends[0])) - np.repeat(np.cumsum(divisions) - divisions, divisions)
        times = np.append(ends[0] + within * ends[1], times[-1])
        steps, x = np.diff(times), lines(times)
        rates = np.diff(x, axis=1) / steps[:, None]
        bends = np.abs(np.diff(rates, axis=1)) / (steps[1:] + steps[:-1])[:, None] * 2
        bends = np.pad(np.nan_to_num(bends).max(axis=(0, 2), initial=0.0), 1, mode="edge")
        away = steps**2 / 8 * np.maximum(bends[1:], bends[:-1])
        divisions = np.clip(np.ceil(np.sqrt(away / STRAIGHT)), 1, 8).astype(int)
        if (divisions == 1).all() or divisions.sum() > MOST_TIMES:
            break
    return times


@dataclass(frozen=True)
class _Signals:
    """Returns some signals at a sample, for floats or symbols."""

    names: tuple[str, ...]

    def __call__(self, loop: ClosedLoop, t: object, states: Array) -> dict[str, Array]:
        return values_at(loop, loop.tracking(t, states), states, self.names)


@purposes.judge_constraints
def judge_constraints(
    batch: Batch, names: Sequence[str], first: Solution, threads: int
) -> Solution:
    """Return a solution with the numbers of metrics that judge constraints.

    The same runs are solved at more times, which changes no step of theirs. Lines between these
    times are straight to `STRAIGHT`.

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
