"""Shares of runs in which something happened: their intervals, and paired differences of two."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from eqt_cli.analysis.comparison.bootstrap import Resampling
from eqt_cli.core.arrays import Array


class Interval(NamedTuple):
    """A number with the ends of its interval; NaN where there are no runs."""

    value: float
    low: float
    high: float


def share(count: int, runs: int, confidence: float, *, exact: bool = False) -> Interval:
    """The share of runs, with the score interval of Wilson (1927), without continuity correction.

    Its ends stay within [0, 1], and it has a width where no run or every run counts.

    Parameters
    ----------
    exact
        The interval of Clopper and Pearson (1934) instead, which holds for rare events, too.
    """
    if not runs:
        return Interval(math.nan, math.nan, math.nan)
    from scipy.stats import binomtest  # slow to import, and most tables do without

    method = "exact" if exact else "wilson"
    found = binomtest(count, runs).proportion_ci(confidence, method=method)
    return Interval(count / runs, float(found.low), float(found.high))


def shares(values: Array, confidence: float = Resampling.confidence) -> Array:
    """`share` over the last axis, of 0 and 1 for each run and NaN for none; ``(..., 3)``."""
    known = np.isfinite(values)
    counts, runs = np.where(known, values, 0).sum(axis=-1), known.sum(axis=-1)
    found = [
        share(int(count), int(of), confidence)
        for count, of in zip(counts.ravel(), runs.ravel(), strict=True)
    ]
    return np.reshape(np.array(found, dtype=float), (*counts.shape, len(Interval._fields)))


@dataclass(frozen=True)
class PairedShares:
    """In how many runs something happened under two controllers, on the same runs.

    Attributes
    ----------
    both, first, second, neither
        Runs in which it happened under both, under the first only, the second only, none.
    """

    both: int
    first: int
    second: int
    neither: int

    @classmethod
    def of(cls, first: Array, second: Array) -> Self:
        """Count the runs; 0 or 1 for each of them, ``(runs,)``."""
        a, b = first > 0, second > 0
        counts = (a & b, a & ~b, ~a & b, ~a & ~b)
        return cls(*(int(np.count_nonzero(found)) for found in counts))

    @property
    def runs(self) -> int:
        """All of them."""
        return self.both + self.first + self.second + self.neither

    def difference(self, confidence: float) -> Interval:
        """The share under the first minus that under the second, with its interval.

        Newcombe (1998), Statistics in Medicine 17, 2635-2650, method 10: from the Wilson intervals
        of both shares, and their correlation, for which a positive numerator is corrected.
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
        """McNemar's test, exact and two-sided: whether the two shares may be equal.

        Of the runs in which the two differ, each would be as likely either way (McNemar 1947).
        """
        differing = self.first + self.second
        if not differing:
            return 1.0 if self.runs else math.nan
        from scipy.stats import binomtest

        return float(binomtest(self.first, differing).pvalue)


def _joined(one: float, other: float, correlation: float) -> float:
    """The distance to an end of the difference, from those to the ends of both shares."""
    return math.sqrt(max(one**2 - 2 * correlation * one * other + other**2, 0.0))
