"""Runs that end as failed where an error crosses a bound of the section `failed_when`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, distinct, maximum
from eqt_cli.base.stored import Status
from eqt_cli.engines.engine import Engine, Problem, Solution, evaluate
from eqt_cli.loop.bounds import Bounds
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.signals import values_at
from eqt_cli.numbers.running import SampledRuns
from eqt_cli.results.quantity import Measure
from eqt_cli.runs.batches import Batch

POINTS, ROUNDS = 65, 2
"""Times at which a run is looked at between two samples, and how often: the last ones are 1/4096 of
two samples apart. Between them the error is a straight line, which of an error e(t) moves the time
by less than ë/ė times 8e-9 of the square of the time between samples."""

AT_ONCE = 32
"""Runs that are looked at together: their times are those of all of them."""


@dataclass(frozen=True)
class Signals:
    """Signals of the loop by name at a sample, for floats or symbols."""

    names: tuple[str, ...]

    def __call__(self, loop: ClosedLoop, t: Any, states: Array) -> dict[str, Array]:
        """Return them."""
        return values_at(loop, loop.tracking(t, states), states, self.names)


def largest_share(bounds: Bounds) -> Measure:
    """Return as a number of a run the largest share of its bound that an error has at a sample."""
    words, of = f"failed when {dict(bounds.most)}", partial(_largest, bounds)
    return Measure(words, words, signals=tuple(bounds.most), of=of)


def _largest(bounds: Bounds, over: SampledRuns, *values: Any) -> Any:
    return over.largest(reduce(maximum, bounds.shares(values)))


def _shares(bounds: Bounds, engine: Engine, problem: Problem) -> Array:
    """Solve, and return the shares of bounds at the samples, ``(bounds, runs, samples)``."""
    states = engine.solve(problem).states
    values = evaluate(engine, Signals(tuple(bounds.most)), problem, states)
    shape = states.shape[:2]
    return np.array(bounds.shares([np.broadcast_to(values[k], shape) for k in bounds.most]))


def end_runs(bounds: Bounds, batch: Batch, solution: Solution) -> None:
    """End the runs of a solution that cross a bound, at the moment at which they do.

    A run that has failed later for another reason has crossed it first.
    """
    status, share = solution.status, solution.numbers[largest_share(bounds).name]
    stays = np.isin(status, (Status.STOPPED, Status.BY_ROUNDING)) | (share <= 1.0)
    suspects = np.flatnonzero(~stays)
    for first in range(0, len(suspects), AT_ONCE):
        some = suspects[first : first + AT_ONCE]
        for place, (t, name) in crossings(bounds, batch.engine, batch.problem.select(some)).items():
            _end(bounds, solution, int(some[place]), batch.problem.times, t, name)


def crossings(bounds: Bounds, engine: Engine, problem: Problem) -> dict[int, tuple[float, str]]:
    """Return when runs cross a bound, and which, by their index; of those that do."""
    shares, times = _shares(bounds, engine, problem), problem.times
    beyond = shares.max(axis=0) > 1.0
    runs = np.flatnonzero(beyond.any(axis=1))
    after = beyond[runs].argmax(axis=1)
    problem, low, high = problem.select(runs), times[np.maximum(after - 1, 0)], times[after]
    for _ in range(ROUNDS if len(runs) else 0):
        grid = np.linspace(low, high, POINTS, axis=1)
        looked_at = distinct([*grid.ravel(), *times[:2]])
        shares = _shares(bounds, engine, replace(problem, times=looked_at))
        here = np.searchsorted(looked_at, grid)
        inside = np.take_along_axis(shares, here[None], axis=2)
        beyond = inside.max(axis=0) > 1.0
        beyond[:, 0], beyond[:, -1] = False, True  # as before, but for rounding
        at, rows = beyond.argmax(axis=1), np.arange(len(runs))
        low, high = grid[rows, at - 1], grid[rows, at]
        before, behind = inside[:, rows, at - 1], inside[:, rows, at]
    moments = {}
    for k, run in enumerate(runs):
        which = int(behind[:, k].argmax())
        rise = behind[which, k] - before[which, k]
        way = (1.0 - before[which, k]) / rise if rise > 0.0 else 1.0
        t = low[k] + min(max(way, 0.0), 1.0) * (high[k] - low[k])
        moments[int(run)] = float(t), list(bounds.most)[which]
    return moments


def _end(bounds: Bounds, solution: Solution, run: int, times: Array, t: float, name: str) -> None:
    """Note that a run has ended; what follows is NaN, and so are its numbers."""
    most = f"{bounds.most[name]:.6g} {bounds.units[name]}".removesuffix(" 1")
    solution.status[run] = Status.BOUND_CROSSED
    solution.messages[run] = f"t = {t:.9g} s: {name} exceeds {most} (failed_when)"
    for name, values in solution.numbers.items():
        solution.numbers[name] = values = np.array(values, dtype=float)
        values[run] = np.nan
    for name, values in solution.arrays.items():
        solution.arrays[name] = values = np.array(values)
        values[run, times > t] = np.nan
