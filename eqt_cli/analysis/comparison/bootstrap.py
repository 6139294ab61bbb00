"""Bootstrap intervals for the means of many columns at once.

This does not use `scipy.stats.bootstrap` for three reasons. All columns are resampled with the same
runs, so that all rows of a table refer to the same resamples. A missing value drops out of its own
column only. The acceleration of a mean has a closed form, so that all columns together cost one
matrix product instead of a jackknife each.
"""

from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.reporting import reporter, step

FEWEST = 5
"""Least number of values for an interval: fewer have too few distinct resamples for quantiles."""

MOST_DRAWS = 100_000_000
"""Largest number of runs drawn over all resamples, which takes some seconds. With many runs there
are fewer resamples, but at least `FEWEST_RESAMPLES`."""

FEWEST_RESAMPLES = 999

_CHUNK = 4_000_000


@dataclass(frozen=True)
class Resampling:
    """Settings of the bootstrap.

    Attributes
    ----------
    confidence
        Share of repeated experiments whose interval contains the true mean, such as 0.95.
    resamples
        Number of resamples with replacement; limited by `MOST_DRAWS`.
    seed
        Seed of NumPy's PCG64DXSM.
    """

    confidence: float = 0.95
    resamples: int = 9999
    seed: int = 0


@dataclass(frozen=True)
class Intervals:
    """Means of columns with their intervals.

    Attributes
    ----------
    mean, low, high : (columns,)
        Mean and ends of the interval. The ends are NaN for fewer than `FEWEST` values.
    resamples
        Number of resamples.
    """

    mean: Array
    low: Array
    high: Array
    resamples: int


def intervals_of_means(columns: Array, how: Resampling) -> Intervals:
    """Return expanded BCa intervals of the mean of every column.

    Bias-corrected and accelerated (Efron 1987), with the normal quantiles z replaced by
    sqrt(n/(n − 1)) t_{n−1} (Hesterberg 2015): the spread of resampled means is too small by the
    former factor, and the spread of few values is uncertain. This widens the intervals by 1 % for
    n = 200 and by 22 % for n = 10.

    Parameters
    ----------
    columns : (runs, columns)
        One row per run; NaN where a column has no value.
    """
    runs = len(columns)
    resamples = min(how.resamples, max(FEWEST_RESAMPLES, MOST_DRAWS // max(runs, 1)))
    valid = np.isfinite(columns)
    count = valid.sum(axis=0)
    filled = np.where(valid, columns, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = filled.sum(axis=0) / count
        deviations = np.where(valid, columns - mean, 0.0)
    low, high = mean.copy(), mean.copy()
    pairs = zip(columns.T, valid.T, strict=True)
    spread = np.array([np.ptp(column[ok]) if ok.any() else 0.0 for column, ok in pairs])
    low[count < FEWEST] = high[count < FEWEST] = np.nan
    varying = np.flatnonzero((count >= FEWEST) & (spread > 0))
    if varying.size:
        # Sums of deviations are more accurate than sums of values.
        with step("resamples", resamples):
            drawn = _resampled_means(deviations[:, varying], valid[:, varying], resamples, how.seed)
        offsets = _bca(deviations[:, varying], count[varying], drawn, how.confidence)
        low[varying] += offsets[0]
        high[varying] += offsets[1]
    return Intervals(mean, low, high, resamples)


def _resampled_means(values: Array, valid: Array, resamples: int, seed: int) -> Array:
    """Return the means over resampled runs, ``(resamples, columns)``."""
    runs = len(values)
    complete = bool(valid.all())
    generator = np.random.Generator(np.random.PCG64DXSM(seed))
    at_once = max(1, _CHUNK // runs)
    means = []
    for start in range(0, resamples, at_once):
        rows = min(at_once, resamples - start)
        draws = generator.integers(runs, size=(rows, runs)) + runs * np.arange(rows)[:, None]
        times_drawn = np.bincount(draws.ravel(), minlength=rows * runs).reshape(rows, runs)
        weights = times_drawn.astype(float)
        number = float(runs) if complete else weights @ valid
        with np.errstate(invalid="ignore", divide="ignore"):
            means.append(weights @ values / number)
        reporter().advance(rows)
    return np.concatenate(means)


def _bca(deviations: Array, count: Array, drawn: Array, confidence: float) -> Array:
    """Return the lower and upper ends relative to the mean, ``(2, columns)``."""
    from scipy.special import ndtr, ndtri, stdtrit  # slow to import

    cubes, squares = (deviations**3).sum(axis=0), (deviations**2).sum(axis=0)
    acceleration = cubes / (6 * squares**1.5)
    below = (drawn < 0).mean(axis=0) + (drawn == 0).mean(axis=0) / 2
    edge = 0.5 / len(drawn)
    bias = ndtri(np.clip(below, edge, 1 - edge))
    tail = (1 - confidence) / 2
    ends = np.empty((2, deviations.shape[1]))
    for end, level in zip(ends, (tail, 1 - tail), strict=True):
        shifted = bias + np.sqrt(count / (count - 1)) * stdtrit(count - 1, level)
        levels = ndtr(bias + shifted / (1 - acceleration * shifted))
        for column in range(len(end)):
            some = drawn[:, column]
            end[column] = np.quantile(some[np.isfinite(some)], levels[column])
    return ends
