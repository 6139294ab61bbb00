"""Confidence intervals by the bootstrap, and paired differences of laws."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import reporter, step
from eqt_cli.results.quantity import Quantity

# Intervals of means, ratios and shares, by bootstrap and in closed form, and the runs needed ------


FEWEST = 5
"""Least number of values for an interval: fewer have too few distinct resamples for quantiles."""

MOST_DRAWS = 100_000_000
"""Largest number of runs drawn over all resamples, which takes some seconds. With many runs there
are fewer resamples, but at least `FEWEST_RESAMPLES`."""

FEWEST_RESAMPLES = 999

LARGE = 1e100
"""Columns with larger values are divided by their largest one, since cubes would overflow."""

_CHUNK = 400_000
"""Number of runs drawn at once: their counts fit a cache."""


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
    sequential
        Whether words hold at every look at runs that grow in number.
    """

    confidence: float = 0.95
    resamples: int = 9999
    seed: int = 0
    sequential: bool = False


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
    largest = np.abs(columns).max(axis=0, initial=0.0, where=np.isfinite(columns))
    size = np.where(largest > LARGE, largest, 1.0)
    columns = columns / size
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
    with np.errstate(over="ignore"):
        return Intervals(mean * size, low * size, high * size, resamples)


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


class Interval(NamedTuple):
    """A number with the ends of its interval; NaN without runs."""

    value: float
    low: float
    high: float


UNKNOWN = Interval(math.nan, math.nan, math.nan)


def share(count: int, runs: int, confidence: float, *, exact: bool = False) -> Interval:
    """Return the share of runs with the score interval of Wilson (1927), without correction.

    Its ends stay within [0, 1], and it has a positive width even for shares of 0 and 1.

    Parameters
    ----------
    exact
        Whether to use the interval of Clopper and Pearson (1934), which also holds for rare events.
    """
    if not runs:
        return UNKNOWN
    from scipy.special import betaincinv, ndtri  # slow to import, and most tables do not need it

    of, tail = count / runs, (1 - confidence) / 2
    if exact:
        low = betaincinv(count, runs - count + 1, tail)
        high = betaincinv(count + 1, runs - count, 1 - tail)
    else:
        z = ndtri(1 - tail)
        middle, half = 2 * count + z * z, z * np.sqrt(4 * count * (1 - of) + z * z)
        low, high = np.array([middle - half, middle + half]) / (2 * (runs + z * z))
    return Interval(of, float(low) if count else 0.0, float(high) if count < runs else 1.0)


def shares(values: Array, confidence: float = Resampling.confidence) -> Array:
    """Return `share` over the last axis of zeros and ones, NaN for no value; ``(..., 3)``."""
    finite = np.isfinite(values)
    counts, runs = np.where(finite, values, 0).sum(axis=-1), finite.sum(axis=-1)
    rows = [
        share(int(count), int(of), confidence)
        for count, of in zip(counts.ravel(), runs.ravel(), strict=True)
    ]
    return np.reshape(np.array(rows, dtype=float), (*counts.shape, len(Interval._fields)))


def difference_of_shares(first: Array, second: Array, confidence: float) -> tuple[Interval, float]:
    """Return the share of runs under the first less that under the second, and a p-value.

    Method 10 of Newcombe (1998), Statistics in Medicine 17, 2635-2650. It combines the Wilson
    intervals of both shares with their correlation, with a correction if that is positive. The
    p-value is that of McNemar's exact two-sided test that the shares are equal. Under this
    hypothesis, each run in which the two differ is equally likely to go either way (McNemar 1947).

    Parameters
    ----------
    first, second : (runs,)
        0 or 1 of the same runs; NaN for no value.
    confidence
        Confidence of the interval.

    Returns
    -------
    Interval, float
        The ends are NaN for fewer than `FEWEST` runs; without runs all numbers are NaN.
    """
    finite = np.isfinite(first) & np.isfinite(second)
    x, y, n = first[finite] > 0, second[finite] > 0, int(finite.sum())
    if not n:
        return UNKNOWN, math.nan
    a, b, c, d = (int(np.count_nonzero(outcome)) for outcome in (x & y, x & ~y, ~x & y, ~x & ~y))
    value, p_value = (b - c) / n, float(sign_test(max(b, c), b + c))
    if n < FEWEST:
        return Interval(value, math.nan, math.nan), p_value
    product, excess = (a + b) * (c + d) * (a + c) * (b + d), a * d - b * c
    corrected = max(excess - n / 2, 0.0) if excess > 0 else excess
    correlation = corrected / math.sqrt(product) if product else 0.0
    one, other = share(a + b, n, confidence), share(a + c, n, confidence)
    down = _joined(one.value - one.low, other.high - other.value, correlation)
    up = _joined(one.high - one.value, other.value - other.low, correlation)
    return Interval(value, value - down, value + up), p_value


def _joined(one: float, other: float, correlation: float) -> float:
    """Combine the distances to the ends of both intervals into that of the difference."""
    return math.sqrt(max(one**2 - 2 * correlation * one * other + other**2, 0.0))


def student(freedom: int, confidence: float, size: float = 0.0) -> float:
    """Return the two-sided quantile of Student's t, or a larger one, valid at every look.

    The latter is for the mean of `size` numbers, or of the difference of n and m by nm/(n + m).
    There, an effect of standard deviation 1 has at most 1/(1 − confidence) times the likelihood of
    none, with the scale integrated out (Gönen et al. 2005, Lindon et al. 2022).
    """
    from scipy.special import stdtrit  # slow to import

    if not size:
        return float(stdtrit(freedom, (1 + confidence) / 2))
    spread = 1 + size
    bound = float((spread / (1 - confidence) ** 2) ** (1 / (freedom + 1)))
    return math.sqrt(freedom * (bound - 1) / (1 - bound / spread)) if bound < spread else math.inf


def relative_difference(
    differences: Array, second: Array, confidence: float, sequential: bool = False
) -> Interval:
    """Return the mean difference over the absolute mean of the second, with Fieller's interval.

    The interval contains the ratios θ for which Student's paired t-test does not reject that the
    differences have the mean θ |mean of the second| (Fieller 1954). It is unbounded if the mean of
    the second may be 0.

    Parameters
    ----------
    differences, second : (runs,)
        First minus second, and second, of the same runs; NaN where a run has no value.
    confidence
        Confidence of the interval.

    Returns
    -------
    Interval
        The ends are NaN for fewer than `FEWEST` runs, ±∞ if unbounded, and not below −1 if no value
        of both is below 0.
    """
    finite = np.isfinite(differences) & np.isfinite(second)
    d, y = (
        differences[finite],
        second[finite] * np.sign(second[finite].mean() if finite.any() else math.nan),
    )
    n, share = len(d), float(d.mean() / y.mean()) if y.any() else math.nan
    if n < FEWEST or not y.any():
        return Interval(share, math.nan, math.nan)
    t = student(n - 1, confidence, n if sequential else 0)
    if math.isinf(t):
        return Interval(share, math.nan, math.nan)
    # (d̄ − θ ȳ)² ≤ t² var(d − θ y)/n: a θ² − 2 b θ + c ≤ 0.
    covariance = t**2 / n * np.cov(d, y)
    a = y.mean() ** 2 - covariance[1, 1]
    b = d.mean() * y.mean() - covariance[0, 1]
    c = d.mean() ** 2 - covariance[0, 0]
    least = -1.0 if min(y.min(), (d + y).min()) >= 0 else -math.inf
    if a <= 0:
        return Interval(share, least, math.inf)
    half = math.sqrt(max(b**2 - a * c, 0.0))
    return Interval(share, max(float((b - half) / a), least), float((b + half) / a))


def sign_test(ahead: Array | int, runs: Array | int, sequential: bool = False) -> Array:
    """Return the exact p-value that a law is ahead in half of all runs at most, for either law.

    If it is to hold at every look, it is one divided by the wealth of bets on the law, with all
    probabilities alike: 2^n B(k + 1, n − k + 1) (Ville 1939; Robbins 1970).
    """
    from scipy.special import bdtr, betaln  # unlike scipy.stats, quick to import

    if sequential:
        n = np.asarray(runs)
        return np.minimum(1.0, np.exp(-n * math.log(2) - betaln(ahead + 1, n - ahead + 1)))
    return np.minimum(1.0, 2 * bdtr(np.asarray(runs) - ahead, np.maximum(runs, 1), 0.5))


def median_of_runs(values: Array, confidence: float, sequential: bool = False) -> Interval:
    """Return the median with the interval that `sign_test` inverts, for any distribution.

    Its ends are the values of equal rank from below and from above that are so far from the median
    as the test allows (Thompson 1936); NaN for fewer runs than that takes, such as 6 for 95 %.
    """
    ordered = np.sort(values)
    n = len(ordered)
    if not n:
        return UNKNOWN
    ranks = np.arange(1, n // 2 + 1)
    allowed = np.count_nonzero(sign_test(n + 1 - ranks, n, sequential) <= 1 - confidence)
    with np.errstate(invalid="ignore"):  # between −∞ and ∞
        middle = float(np.median(ordered))
    if not allowed:
        return Interval(middle, math.nan, math.nan)
    return Interval(middle, float(ordered[allowed - 1]), float(ordered[n - allowed]))


def holm(p_values: Array) -> Array:
    """Return p-values adjusted after Holm (1979), for dependent tests, too; NaN is no test."""
    order = np.argsort(p_values)  # NaN last
    tests = np.count_nonzero(~np.isnan(p_values))
    steps = p_values[order] * np.maximum(tests - np.arange(len(p_values)), 1)
    adjusted = np.empty_like(p_values)
    adjusted[order] = np.minimum(1, np.maximum.accumulate(steps))
    return adjusted


POWER = 0.8
"""Probability that so many runs decide, if the effect is as large as measured."""

MOST_RUNS = 1e9
"""Largest number of runs to report; an effect that needs more counts as none."""

SHARE = 0.95
"""Share of all initial states for which a claim about every run must hold."""


def runs_to_decide(effect: float, confidence: float) -> int | None:
    """Return the runs after which the interval of a mean excludes 0 with probability `POWER`.

    Parameters
    ----------
    effect
        Measured mean of the paired differences divided by their standard deviation.
    confidence
        Confidence of the interval.

    Returns
    -------
    int or None
        ((z_{1−α/2} + z_power)/d)² + z²_{1−α/2}/2, the normal approximation with the usual
        correction for an estimated spread (Guenther 1981); None if it exceeds `MOST_RUNS`.
    """
    from scipy.special import ndtri  # slow to import

    z = float(ndtri((1 + confidence) / 2))
    distance = z + float(ndtri(POWER))
    if not abs(effect) > distance / math.sqrt(MOST_RUNS):
        return None
    return max(FEWEST, math.ceil((distance / effect) ** 2 + z**2 / 2))


def runs_without_exception(confidence: float) -> int:
    """Return the runs without exception that show `SHARE` of all without one, with confidence."""
    return math.ceil(math.log(1 - confidence) / math.log(SHARE))


# Differences of two laws on the same initial states -----------------------------------------------


RESOLUTION = 1e-6
"""Relative difference below which two runs count as equal. Laws that coincide on a group, such as
EqT and GT on a commutative one, still differ by rounding and solver errors."""


NEGLIGIBLE = 0.01
"""Relative difference that nobody minds; of shares, one point of 100."""


class Word(StrEnum):
    """What most runs say of a law against another one."""

    BETTER = "better"
    WORSE = "worse"
    ALIKE = "no difference"
    UNDECIDED = "undecided"


def median_difference(
    quantity: Quantity, values: Array, failed: Array, confidence: float, sequential: bool = False
) -> Interval:
    """Return the median over runs of the difference of two laws, relative to the second.

    A run that failed is worse than any other; where both did, neither is better. Of shares of time,
    it is the median of the difference itself; of shares of runs, the difference of the shares.

    Parameters
    ----------
    values, failed : (2, runs)
        Of the first law and of the second.
    """
    if quantity.counts:
        return difference_of_shares(values[0], values[1], confidence)[0]
    differences = resolved_differences(values[0], values[1])
    if not quantity.name.endswith("_share"):
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = differences / np.abs(values[1])
        differences = np.where(differences == 0, 0.0, relative)  # not 0/0
    lost = np.repeat(quantity.cost(np.array([-np.inf, np.inf])), runs_alone(values, failed))
    differences = np.r_[differences[np.isfinite(values).all(axis=0)], lost]
    return median_of_runs(differences, confidence, sequential)


def runs_alone(values: Array, failed: Array) -> Array:
    """Return the number of runs in which the other of two laws failed, for each law."""
    return (np.isfinite(values) & failed[::-1]).sum(axis=-1)


def resolved_differences(first: Array, second: Array) -> Array:
    """Return first minus second; 0 where the difference is below `RESOLUTION`."""
    with np.errstate(invalid="ignore"):  # the rise of L relative to L(0) = 0 is infinite
        equal = np.abs(first - second) <= RESOLUTION * np.maximum(np.abs(first), np.abs(second))
        return np.where(equal, 0.0, first - second)
