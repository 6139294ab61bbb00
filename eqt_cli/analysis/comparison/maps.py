"""Compares laws at every point of a sweep, with p-values adjusted for the number of points."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.comparison.intervals import (
    FEWEST,
    Interval,
    Resampling,
    intervals_of_means,
    relative_difference,
)
from eqt_cli.analysis.comparison.pairs import resolved_differences
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.core.reporting import reporter, step
from eqt_cli.results.quantity import Quantity
from eqt_cli.results.result import Result, mean_over_runs

NOBODY = -1

_NUMBERS = 10_000_000
"""Largest number of resampled means in memory."""


@dataclass(frozen=True)
class Cell:
    """One point of a sweep.

    Attributes
    ----------
    point
        Number of the point.
    best
        Index of the law with the best mean among the laws with the fewest failed runs.
    runner_up
        Index of the next best law.
    wins
        Whether the best law is better than every other law at this point, after the adjustment for
        all points, and settles in at least one run.
    p_value
        P-value that the best law is better than all others, adjusted for the number of points.
    difference
        Paired difference best minus next, with an unadjusted interval.
    lead
        The difference divided by the mean of the next law, with the interval of the ratio.
    failed, censored : tuple of int
        Numbers of runs of each law that failed, and whose value lies beyond the horizon.
    settled
        Number of runs of the best law that settled; None if this is not stored.
    """

    point: int
    best: int
    runner_up: int
    wins: bool
    p_value: float
    difference: Interval
    lead: Interval
    failed: tuple[int, ...]
    censored: tuple[int, ...]
    settled: int | None

    @property
    def winner(self) -> int:
        """Index of the winner; `NOBODY` if the runs do not decide."""
        return self.best if self.wins else NOBODY


@dataclass(frozen=True)
class Map:
    """The comparison of laws by a metric at every point.

    Attributes
    ----------
    quantity, unit
        The metric and its unit.
    labels, titles
        Labels and display names of the laws.
    runs
        Number of runs of each law at each point.
    means : (points, laws)
        Means over the runs that did not fail. A value beyond the horizon counts as the horizon.
    cells
        The comparison at each point.
    tests
        Number of points at which laws could be tested.
    confidence
        Confidence of each interval, and 1 minus the allowed expected share of false wins.
    """

    quantity: Quantity
    unit: str
    labels: list[str]
    titles: list[str]
    runs: int
    means: Array
    cells: list[Cell]
    tests: int
    confidence: float

    def wins(self, law: int) -> int:
        """Return the number of points that a law wins."""
        return sum(cell.winner == law for cell in self.cells)


def compare_map(
    result: Result,
    metric: str,
    how: Resampling,
    laws: Sequence[int] | None = None,
    *,
    intervals: bool = True,
) -> Map:
    """Compare the laws of a sweep at each of its points, run by run on the same initial states.

    A law wins at a point if it is better than every other law there. The law with the best mean is
    tested against each other law by Student's paired t-test, and the largest p-value counts: a win
    is false if it is false for any other law (intersection-union test, Berger 1982). The p-values
    of all points are adjusted after Benjamini and Yekutieli (2001), which is valid for dependent
    tests such as those on the same runs. A law with more failed runs than another cannot win at a
    point, because its other runs are a biased sample. A law that settles in no run cannot win.

    Parameters
    ----------
    result
        An open result of a sweep.
    metric
        A stored number per run.
    how
        Settings of the intervals; the confidence also holds for the map.
    laws
        Indices of the laws to compare; all if None.
    intervals
        Whether differences have intervals, which take most of the time.

    Raises
    ------
    EqtError
        If there are fewer than two laws, or no such metric.
    """
    chosen = list(range(len(result.labels))) if laws is None else list(laws)
    if len(chosen) < 2:
        raise result.error("a map needs at least two laws, and this result has one")
    quantity = result.quantity(metric)
    if quantity.better == "neither":
        raise EqtError(f"{metric}: has no better direction, so no law can win on it")
    censored = result.censored(metric)[:, chosen]
    values = result.counted(metric)[:, chosen]
    failed = result.runs - np.count_nonzero(result.good[:, chosen], axis=-1)
    means = mean_over_runs(values)
    costs = quantity.cost(means)
    # Laws with more failed runs come last: their other runs are a biased sample.
    order = np.lexsort((np.where(np.isfinite(costs), costs, np.inf), failed), axis=-1)
    points = np.arange(len(values))
    best, runner_up = order[:, 0], order[:, 1]
    others = values[points[:, None], order[:, 1:]]
    # Best minus each of the others, (points, laws - 1, runs).
    differences = resolved_differences(values[points, best][:, None], others)
    tests = _p_values(differences)
    p_values = _largest(tests, failed[points[:, None], order] == failed[points, best][:, None])
    p_values = np.where(np.isfinite(costs[points, best]), p_values, np.nan)
    adjusted = _adjusted(p_values)
    ends = _intervals(differences[:, 0], how) if intervals else np.full((len(points), 3), np.nan)
    settles = result.settles
    settled = None if settles is None else np.count_nonzero(settles[:, chosen], axis=-1)
    cells = [
        Cell(
            point=point,
            best=int(best[point]),
            runner_up=int(runner_up[point]),
            wins=bool(adjusted[point] <= 1 - how.confidence) and count != 0,
            p_value=float(adjusted[point]),
            difference=Interval(*ends[point].tolist()),
            lead=relative_difference(differences[point, 0], others[point, 0], how.confidence),
            failed=tuple(map(int, failed[point])),
            censored=tuple(map(int, np.count_nonzero(censored[point], axis=-1))),
            settled=count,
        )
        for point in points.tolist()
        for count in [None if settled is None else int(settled[point, best[point]])]
    ]
    labels, titles = ([names[k] for k in chosen] for names in (result.labels, result.titles))
    unit = result.units(metric)
    tested = int(np.isfinite(adjusted).sum())
    return Map(quantity, unit, labels, titles, result.runs, means, cells, tested, how.confidence)


def _largest(p_values: Array, comparable: Array) -> Array:
    """Return the largest p-value against laws with as few failed runs as the best; 0 if none."""
    rivals = comparable[:, 1:]
    known = np.where(rivals, p_values, 0.0)  # NaN (too few values) is kept
    return known.max(axis=-1)


def _intervals(rows: Array, how: Resampling) -> Array:
    """Return mean, lower and upper end of each row, with the same resamples for all rows."""
    at_once = max(1, _NUMBERS // how.resamples)
    parts = []
    with step("intervals", len(rows)):
        for start in range(0, len(rows), at_once):
            some = rows[start : start + at_once]
            parts.append(intervals_of_means(some.T, how))
            reporter().advance(len(some))
    columns = [np.stack([part.mean, part.low, part.high], axis=-1) for part in parts]
    return np.concatenate(columns)


def _p_values(differences: Array) -> Array:
    """Return the p-values of paired t-tests over the last axis; NaN for too few values."""
    from scipy.special import stdtr

    known = np.isfinite(differences)
    count = known.sum(axis=-1)
    filled = np.where(known, differences, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = filled.sum(axis=-1) / count
        spread = np.where(known, differences - mean[..., None], 0.0)
        error = np.sqrt((spread**2).sum(axis=-1) / (count - 1) / count)
        found = 2 * stdtr(count - 1, -np.abs(mean) / error)
    found = np.where(mean == 0, 1.0, np.where(error == 0, 0.0, found))
    return np.where(count >= FEWEST, found, np.nan)


def _adjusted(p_values: Array) -> Array:
    """Adjust p-values after Benjamini and Yekutieli."""
    from scipy.stats import false_discovery_control

    known = np.isfinite(p_values)
    found = p_values.copy()
    if known.any():
        found[known] = false_discovery_control(p_values[known], method="by")
    return found
