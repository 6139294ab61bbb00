"""Shares of runs: their intervals, and paired differences between two controllers."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from eqt_cli.analysis.comparison.bootstrap import Resampling
from eqt_cli.core.arrays import Array


class Interval(NamedTuple):
    """A number with the ends of its interval; NaN without runs."""

    value: float
    low: float
    high: float


def share(count: int, runs: int, confidence: float, *, exact: bool = False) -> Interval:
    """Return the share of runs with the score interval of Wilson (1927), without correction.

    Its ends stay within [0, 1], and it has a positive width even for shares of 0 and 1.

    Parameters
    ----------
    exact
        Whether to use the interval of Clopper and Pearson (1934), which also holds for rare events.
    """
    if not runs:
        return Interval(math.nan, math.nan, math.nan)
    from scipy.stats import binomtest  # slow to import, and most tables do not need it

    method = "exact" if exact else "wilson"
    found = binomtest(count, runs).proportion_ci(confidence, method=method)
    return Interval(count / runs, float(found.low), float(found.high))


def shares(values: Array, confidence: float = Resampling.confidence) -> Array:
    """Return `share` over the last axis of zeros and ones, NaN for no value; ``(..., 3)``."""
    known = np.isfinite(values)
    counts, runs = np.where(known, values, 0).sum(axis=-1), known.sum(axis=-1)
    found = [
        share(int(count), int(of), confidence)
        for count, of in zip(counts.ravel(), runs.ravel(), strict=True)
    ]
    return np.reshape(np.array(found, dtype=float), (*counts.shape, len(Interval._fields)))


@dataclass(frozen=True)
class PairedShares:
    """Counts of an event under two controllers on the same runs.

    Attributes
    ----------
    both, first, second, neither
        Numbers of runs with the event under both, only the first, only the second, and neither.
    """

    both: int
    first: int
    second: int
    neither: int

    @classmethod
    def of(cls, first: Array, second: Array) -> Self:
        """Count the runs from arrays of 0 or 1, ``(runs,)``."""
        a, b = first > 0, second > 0
        counts = (a & b, a & ~b, ~a & b, ~a & ~b)
        return cls(*(int(np.count_nonzero(found)) for found in counts))

    @property
    def runs(self) -> int:
        """Number of all runs."""
        return self.both + self.first + self.second + self.neither

    def difference(self, confidence: float) -> Interval:
        """Return the share under the first minus that under the second, with its interval.

        Method 10 of Newcombe (1998), Statistics in Medicine 17, 2635-2650. It combines the Wilson
        intervals of both shares with their correlation, with a correction if that is positive.
        """
        n = self.runs
        if not n:
            return Interval(math.nan, math.nan, math.nan)
        one = share(self.both + self.first, n, confidence)
        other = share(self.both + self.second, n, confidence)
        correlation = self._correlation()
        down = _joined(one.value - one.low, other.high - other.value, correlation)
        up = _joined(one.high - one.value, other.value - other.low, correlation)
        value = (self.first - self.second) / n
        return Interval(value, value - down, value + up)

    def _correlation(self) -> float:
        a, b, c, d = self.both, self.first, self.second, self.neither
        product = (a + b) * (c + d) * (a + c) * (b + d)
        if not product:
            return 0.0
        found = a * d - b * c
        return (max(found - self.runs / 2, 0.0) if found > 0 else found) / math.sqrt(product)

    @property
    def p_value(self) -> float:
        """P-value of McNemar's exact two-sided test that the two shares are equal.

        Under this hypothesis, each run in which the two differ is equally likely to go either way
        (McNemar 1947).
        """
        differing = self.first + self.second
        if not differing:
            return 1.0 if self.runs else math.nan
        from scipy.stats import binomtest

        return float(binomtest(self.first, differing).pvalue)


def _joined(one: float, other: float, correlation: float) -> float:
    """Combine the distances to the ends of both intervals into that of the difference."""
    return math.sqrt(max(one**2 - 2 * correlation * one * other + other**2, 0.0))
