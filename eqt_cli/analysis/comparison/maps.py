"""Laws compared at every point of a sweep: who wins where, with all the tests counted."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.comparison.bootstrap import FEWEST, Resampling, intervals_of_means
from eqt_cli.analysis.comparison.pairs import resolved_differences
from eqt_cli.analysis.comparison.ratios import relative_difference
from eqt_cli.analysis.comparison.shares import Interval
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.core.reporting import reporter, step
from eqt_cli.results.quantity import Quantity
from eqt_cli.results.result import Result, mean_over_runs

NOBODY = -1

_NUMBERS = 10_000_000
"""Resampled means that are held at once."""


@dataclass(frozen=True)
class Cell:
    """One point of a sweep.

    Attributes
    ----------
    point
        Its number.
    best
        The position of the law with the best mean; of those with the fewest failed runs.
    runner_up
        That of the next one.
    wins
        Whether the best is better than every other law there, all points of the map counted, and
        settles in some run.
    p_value
        Of the test whether it is better than all others, adjusted for the number of points.
    difference, low, high
        Best minus next, run by run, with an interval that holds by itself.
    lead
        The difference over the mean of the next, with an interval of that ratio.
    failed, censored : tuple of int
        Of each law, runs that failed, and runs whose value lies beyond the horizon.
    settled
        Runs of the best that settled; None where that was not stored.
    """

    point: int
    best: int
    runner_up: int
    wins: bool
    p_value: float
    difference: float
    low: float
    high: float
    lead: Interval
    failed: tuple[int, ...]
    censored: tuple[int, ...]
    settled: int | None

    @property
    def winner(self) -> int:
        """The position of the law that wins; `NOBODY` where the runs do not tell."""
        return self.best if self.wins else NOBODY


@dataclass(frozen=True)
class Map:
    """A metric compared at every point.

    Attributes
    ----------
    quantity, unit
        What was compared.
    labels, titles
        Of the laws.
    runs
        Of each law and point.
    means : (points, laws)
        Over the runs that did not fail; the horizon counts for what lies beyond it.
    cells
        One for each point.
    tests
        Points at which laws could be tested.
    confidence
        1 minus the share of false ones among the wins that is allowed, in expectation; and of
        every interval by itself.
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
        """At how many points a law wins."""
        return sum(cell.winner == law for cell in self.cells)


def compare_map(
    result: Result,
    metric: str,
    how: Resampling,
    laws: Sequence[int] | None = None,
) -> Map:
    """Compare the laws of a sweep at each of its points, run by run on the same initial states.

    A law wins at a point where it is better than every other one there. At each point, the law with
    the best mean is tested against each other one by the paired t-test of Student, and the largest
    p-value counts: a win is wrong if it is wrong about one of them (Berger 1982, intersection-union
    test). These p-values, one for each point, are adjusted after Benjamini and Yekutieli (2001),
    which allows for tests that depend on each other, as those on the same runs do. A law of which
    more runs failed than of another cannot win there: what its survivors do says nothing of it. Nor
    can a law that settles in no run.

    Parameters
    ----------
    result
        Open, of a sweep.
    metric
        A stored number per run.
    how
        Resamples of the intervals; and the confidence, of intervals and of the map.
    laws
        The positions of the laws to compare; all if None.

    Raises
    ------
    EqtError
        If there is one law only, or no such metric.
    """
    chosen = list(range(len(result.labels))) if laws is None else list(laws)
    if len(chosen) < 2:
        raise result.error("a map compares two laws or more, and here is one")
    quantity = result.quantity(metric)
    if quantity.better == "neither":
        raise EqtError(f"{metric}: has no better direction, so no law can win on it")
    censored = result.censored(metric)[:, chosen]
    values = result.counted(metric)[:, chosen]
    failed = result.runs - np.count_nonzero(result.good[:, chosen], axis=-1)
    means = mean_over_runs(values)
    costs = quantity.cost(means)
    # Of laws with more failed runs the survivors say nothing: they come last.
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
    ends = _intervals(differences[:, 0], how)
    settles = result.settles
    settled = None if settles is None else np.count_nonzero(settles[:, chosen], axis=-1)
    cells = [
        Cell(
            point=point,
            best=int(best[point]),
            runner_up=int(runner_up[point]),
            wins=bool(adjusted[point] <= 1 - how.confidence) and count != 0,
            p_value=float(adjusted[point]),
            difference=float(ends[point, 0]),
            low=float(ends[point, 1]),
            high=float(ends[point, 2]),
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
    """Of the tests of each point against the laws that failed as rarely as the best; 0 if none."""
    rivals = comparable[:, 1:]
    known = np.where(rivals, p_values, 0.0)  # NaN, of too few values, decides
    return known.max(axis=-1)


def _intervals(rows: Array, how: Resampling) -> Array:
    """Mean, lower and upper end of each row, some rows at a time; all are resampled alike."""
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
    """Of the paired t-test over the last axis; NaN from too few values, 1 where all are 0."""
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
    """All of them together, after Benjamini and Yekutieli."""
    from scipy.stats import false_discovery_control

    known = np.isfinite(p_values)
    found = p_values.copy()
    if known.any():
        found[known] = false_discovery_control(p_values[known], method="by")
    return found
