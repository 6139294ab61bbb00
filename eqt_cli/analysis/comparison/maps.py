"""Laws compared at every point of a sweep: who wins where, with all the tests counted."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from eqt_cli.analysis.comparison.bootstrap import FEWEST, Resampling, intervals_of_means
from eqt_cli.analysis.comparison.pairs import resolved_differences
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.execution.steps import SILENT, Steps
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
        Whether the best is better than every other law there, all tests of the map counted.
    p_value
        The largest adjusted one of its tests.
    difference, low, high
        Best minus next, run by run, with an interval that holds by itself.
    relative
        The difference over the mean of the next.
    failed, censored : tuple of int
        Of each law, runs that failed, and runs whose value lies beyond the horizon.
    """

    point: int
    best: int
    runner_up: int
    wins: bool
    p_value: float
    difference: float
    low: float
    high: float
    relative: float
    failed: tuple[int, ...]
    censored: tuple[int, ...]

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
        How many there were.
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
    steps: Steps = SILENT,
) -> Map:
    """Compare the laws of a sweep at each of its points, run by run on the same initial states.

    Each pair of laws at each point is tested by the paired t-test of Student. The p-values of the
    whole map are adjusted after Benjamini and Yekutieli (2001), which allows for tests that depend
    on each other, as those on the same runs do. A law wins at a point where it is better than every
    other one there. A law of which more runs failed than of another cannot win there: what its
    survivors do says nothing of it.

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
    steps
        Told of the resampling.

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
    couples = list(combinations(range(len(chosen)), 2))
    first, second = (values[:, [pair[k] for pair in couples]] for k in (0, 1))
    differences = resolved_differences(first, second)  # (points, pairs, runs)
    ends = _intervals(differences.reshape(-1, result.runs), how, steps)
    adjusted = _adjusted(_p_values(differences))
    means = mean_over_runs(values)
    cells = [
        _cell(
            point,
            quantity.cost(means[point]),
            means[point],
            {pair: place for place, pair in enumerate(couples)},
            ends.reshape(len(values), len(couples), 3)[point],
            adjusted[point],
            1 - how.confidence,
            failed[point],
            np.count_nonzero(censored[point], axis=-1),
        )
        for point in range(len(values))
    ]
    labels, titles = ([names[k] for k in chosen] for names in (result.labels, result.titles))
    unit = result.units(metric)
    tests = int(np.isfinite(adjusted).sum())
    return Map(quantity, unit, labels, titles, result.runs, means, cells, tests, how.confidence)


def _intervals(rows: Array, how: Resampling, steps: Steps) -> Array:
    """Mean, lower and upper end of each row, some rows at a time; all are resampled alike."""
    at_once = max(1, _NUMBERS // how.resamples)
    advance, parts = steps.begin("intervals", len(rows)), []
    for start in range(0, len(rows), at_once):
        some = rows[start : start + at_once]
        parts.append(intervals_of_means(some.T, how))
        advance(len(some))
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


def _cell(
    point: int,
    costs: Array,
    means: Array,
    places: dict[tuple[int, int], int],
    ends: Array,
    adjusted: Array,
    level: float,
    failed: Array,
    censored: Array,
) -> Cell:
    # Of laws with more failed runs the survivors say nothing: they come last.
    order = np.lexsort((np.where(np.isfinite(costs), costs, np.inf), failed))
    best, runner_up = int(order[0]), int(order[1])
    rivals = [law for law in order[1:].tolist() if failed[law] == failed[best]]
    tests = [adjusted[places[min(best, law), max(best, law)]] for law in rivals]
    p_value = max(tests, default=0.0 if np.isfinite(costs[best]) else np.nan)
    end = ends[places[min(best, runner_up), max(best, runner_up)]]
    mean, low, high = end if best < runner_up else -end[[0, 2, 1]]
    relative = mean / means[runner_up] if means[runner_up] else np.nan
    return Cell(
        point=point,
        best=best,
        runner_up=runner_up,
        wins=bool(p_value <= level),
        p_value=float(p_value),
        difference=float(mean),
        low=float(low),
        high=float(high),
        relative=float(relative),
        failed=tuple(map(int, failed)),
        censored=tuple(map(int, censored)),
    )
