"""Statistics of single controllers, and of pairs on the same initial states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from eqt_cli.analysis.comparison.intervals import (
    FEWEST,
    Interval,
    PairedShares,
    Resampling,
    intervals_of_means,
    runs_to_decide,
    shares,
)
from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.core.arrays import Array
from eqt_cli.results.result import PerRun

RESOLUTION = 1e-6
"""Relative difference below which two runs count as equal. Laws that coincide on a group, such as
EqT and GT on a commutative one, still differ by rounding and solver errors."""


LEAST_SEEN = 5e-4
"""Least relative difference that is called one where there is no interval."""


@dataclass(frozen=True)
class Level:
    """A measure of one controller.

    Attributes
    ----------
    measured, controller
        The measure, and the label of the controller.
    runs
        Number of good runs with a value.
    censored
        Number of these whose value lies beyond the horizon and counts as the horizon.
    failed, undefined
        Numbers of failed runs, and of good runs without a value.
    mean, low, high
        Mean over runs and its interval. For counts of runs: the share and its Wilson interval.
    standard_deviation, median
        Standard deviation and median over runs.
    """

    measured: PerRun
    controller: str
    runs: int
    censored: int
    failed: int
    undefined: int
    mean: float
    low: float
    high: float
    standard_deviation: float
    median: float


@dataclass(frozen=True)
class Pair:
    """A measure of two controllers, run by run on the same initial states.

    Attributes
    ----------
    measured, first, second
        The measure, and the labels of the controllers. Differences are first minus second.
    pairs
        Number of runs in which both have a value.
    censored
        Number of pairs with at least one value beyond the horizon, which counts as the horizon.
    failed, undefined
        Numbers of runs left out because one of the two failed, or has no value.
    difference, low, high
        Mean difference and its interval; for shares of runs the interval of Newcombe.
    mean_first, mean_second
        Means over the pairs.
    cohen_d
        Mean divided by standard deviation of the differences.
    first_better
        Share of pairs in which the first is better; ties count half.
    ties
        Number of pairs in which both are equal.
    runs_to_decide
        Number of runs that would decide the sign (`runs_needed.runs_to_decide`); None for fewer
        than `bootstrap.FEWEST` pairs, whose spread is too uncertain.
    p_value
        P-value of McNemar's test for shares of runs; else None.
    """

    measured: PerRun
    first: str
    second: str
    pairs: int
    censored: int
    failed: int
    undefined: int
    difference: float
    low: float
    high: float
    mean_first: float
    mean_second: float
    cohen_d: float
    first_better: float
    ties: int
    runs_to_decide: int | None
    p_value: float | None = None

    def __repr__(self) -> str:
        """The difference with its interval, in a line."""
        write = Plain()
        interval = write.interval(self.difference, self.low, self.high)
        measured = f"{self.measured.quantity.name} {write.window(self.measured.window)}"
        value = " ".join(filter(None, [interval, write.unit(self.measured.unit)]))
        return f"Pair({self.first} − {self.second}, {measured}: {value}, {self.pairs} pairs)"

    @property
    def relative(self) -> float:
        """The difference divided by the mean of the second."""
        return self.difference / self.mean_second if self.mean_second else float("nan")

    @property
    def differs(self) -> bool:
        """Whether a difference was seen: its interval excludes 0, or without one 0.05 % do."""
        if np.isfinite(self.low):
            return not self.low <= 0 <= self.high
        return abs(self.difference) > LEAST_SEEN * abs(self.mean_second)

    def swapped(self) -> Pair:
        """Return the pair with the two controllers exchanged."""
        return replace(
            self,
            first=self.second,
            second=self.first,
            difference=-self.difference,
            low=-self.high,
            high=-self.low,
            mean_first=self.mean_second,
            mean_second=self.mean_first,
            cohen_d=-self.cohen_d,
            first_better=1 - self.first_better,
        )


def statistics(
    measured: Sequence[PerRun], labels: Sequence[str], good: Array, how: Resampling
) -> tuple[list[Level], list[Pair], int]:
    """Return the levels of all controllers, all pairs, and the number of resamples.

    All means are resampled together: resample k draws the same runs for all numbers. Shares of runs
    have intervals in closed form.
    """
    couples = list(combinations(range(len(labels)), 2))
    resampled = [s for s in measured if not s.quantity.counts]
    columns = [
        column
        for s in resampled
        for column in (
            *s.values,
            *(resolved_differences(s.values[a], s.values[b]) for a, b in couples),
        )
    ]
    table = np.stack(columns, axis=1) if columns else np.empty((good.shape[1], 0))
    means = intervals_of_means(table, how)
    ends = iter(map(Interval, means.mean.tolist(), means.low.tolist(), means.high.tolist()))
    levels, pairs = [], []
    for s in measured:
        for c, label in enumerate(labels):
            of_runs = shares(s.values[c], how.confidence) if s.quantity.counts else next(ends)
            interval = Interval(*of_runs)
            levels.append(_level(s, c, label, good, interval))
        for a, b in couples:
            counts = PairedShares.of(s.values[a], s.values[b]) if s.quantity.counts else None
            interval = next(ends) if counts is None else counts.difference(how.confidence)
            if counts is not None and counts.runs < FEWEST:
                interval = Interval(interval.value, math.nan, math.nan)
            pair = _pair(s, a, b, labels, good, how.confidence, interval)
            pairs.append(pair if counts is None else replace(pair, p_value=counts.p_value))
    return levels, pairs, means.resamples


def _level(s: PerRun, c: int, label: str, good: Array, interval: Interval) -> Level:
    values = s.values[c][np.isfinite(s.values[c])]
    failed = int(np.count_nonzero(~good[c, : s.runs]))
    return Level(
        s,
        label,
        len(values),
        int(np.count_nonzero(s.censored[c])),
        failed,
        s.runs - failed - len(values),
        *interval,
        standard_deviation=_deviation(values),
        median=float(np.median(values)) if len(values) else float("nan"),
    )


def _pair(
    s: PerRun,
    a: int,
    b: int,
    labels: Sequence[str],
    good: Array,
    confidence: float,
    interval: Interval,
) -> Pair:
    both = np.isfinite(s.values[a]) & np.isfinite(s.values[b])
    differences = resolved_differences(s.values[a], s.values[b])[both]
    failed = int(np.count_nonzero(~(good[a] & good[b])[: s.runs]))
    deviation, mean = _deviation(differences), interval.value
    with np.errstate(invalid="ignore", divide="ignore"):
        cohen_d = float(np.float64(mean) / deviation)
    better = -differences if s.quantity.better != "higher" else differences
    first_better = _mean((better > 0) + (better == 0) / 2)
    return Pair(
        s,
        labels[a],
        labels[b],
        len(differences),
        int(np.count_nonzero((s.censored[a] | s.censored[b]) & both)),
        failed,
        s.runs - failed - len(differences),
        *interval,
        mean_first=_mean(s.values[a][both]),
        mean_second=_mean(s.values[b][both]),
        cohen_d=cohen_d,
        first_better=first_better,
        ties=int(np.count_nonzero(differences == 0)),
        runs_to_decide=runs_to_decide(cohen_d, confidence) if both.sum() >= FEWEST else None,
    )


def resolved_differences(first: Array, second: Array) -> Array:
    """Return first minus second; 0 where the difference is below `RESOLUTION`."""
    with np.errstate(invalid="ignore"):  # the rise of L relative to L(0) = 0 is infinite
        equal = np.abs(first - second) <= RESOLUTION * np.maximum(np.abs(first), np.abs(second))
        return np.where(equal, 0.0, first - second)


def _mean(values: Array) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def _deviation(values: Array) -> float:
    with np.errstate(over="ignore"):
        return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
