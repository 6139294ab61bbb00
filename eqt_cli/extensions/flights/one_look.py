"""Statistics of flights whose number was planned: intervals, exact tests, a model as covariate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, product
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import FEWEST, Interval
from eqt_cli.base.arrays import Array

RESAMPLES = 9_999
"""Largest number of permutations that are all tried; else so many are drawn."""

LEAST_PAIRS_OF_A_MODEL = 12
"""Fewer pairs lose more by fitting a model than it gives: 5 of them, a third of the precision."""

SPREAD = 1e-20
"""Least squared spread of predictions, relative to their squares, that is none of rounding."""

SPLITS = 60
"""Number of ways in which the flights of a side are halved."""


def difference(x: Array, y: Array, paired: bool, confidence: float) -> tuple[Interval, Any]:
    """Return the difference of two means, with Student's interval, of Welch (1947) without pairs.

    Of logarithms, it is the logarithm of the ratio of geometric means.

    Parameters
    ----------
    x, y : (..., n), (..., m)
        Numbers of both sides.
    paired
        Whether number k of both belong together.

    Returns
    -------
    Interval, float
        Its ends are NaN for fewer than `FEWEST` numbers. The standard deviation of pairs, or of
        the difference of a number of each side; infinite if it is unknown or 0.
    """
    from scipy.special import stdtrit  # slow to import

    parts, value = [x - y] if paired else [x, y], x.mean(axis=-1) - y.mean(axis=-1)
    if min(x.shape[-1], y.shape[-1]) < FEWEST:
        return Interval(value, math.nan, math.nan), math.inf
    variances = [part.var(axis=-1, ddof=1) for part in parts]
    squares = [v / part.shape[-1] for v, part in zip(variances, parts, strict=True)]
    freedoms = [s**2 / (part.shape[-1] - 1) for s, part in zip(squares, parts, strict=True)]
    with np.errstate(invalid="ignore"):  # where all numbers of a side are equal
        t = stdtrit(sum(squares) ** 2 / sum(freedoms), (1 + confidence) / 2)
    half = np.nan_to_num(t) * np.sqrt(sum(squares))
    spread = np.sqrt(sum(variances))
    return Interval(value, value - half, value + half), np.where(spread > 0, spread, np.inf)


def permutation_test(x: Array, y: Array, paired: bool) -> Any:
    """Return the exact p-value that two sides are alike, by the difference of their means.

    All ways to deal the numbers out to two sides, or to swap the sides of pairs (Fisher 1935),
    are as likely; beyond `RESAMPLES` ways, so many are drawn. It is NaN for few numbers, too.
    """
    from scipy import stats  # slow to import

    def distance(x: Array, y: Array, axis: int) -> Any:
        return abs(x.mean(axis=axis) - y.mean(axis=axis))

    how: Any = {"permutation_type": "samples" if paired else "independent", "axis": -1, "rng": 0}
    how |= {"n_resamples": RESAMPLES, "alternative": "greater", "vectorized": True}
    is_enough = min(x.shape[-1], y.shape[-1]) >= FEWEST
    return stats.permutation_test((x, y), distance, **how).pvalue if is_enough else math.nan


# A model as control variate -----------------------------------------------------------------------


def difference_by_model(
    x: Array, y: Array, of_x: Array, of_y: Array, paired: bool, confidence: float
) -> tuple[Interval, Any]:
    """Return the difference of two means, less what the predictions of a model explain.

    Numbers are regressed on predictions, with one slope within both sides (analysis of covariance,
    Fisher 1932), differences of pairs on differences of predictions. The predictions must not
    depend on the side: those of one law in the start, wind and setpoints of every flight. Then the
    difference is unbiased, whatever the model, if it was drawn which flight is of which side.

    Parameters
    ----------
    x, y : (..., n), (..., m)
        Numbers of both sides.
    of_x, of_y
        Predictions of them, of the same shapes.
    """
    from scipy.special import stdtrit  # slow to import

    sides = [(x - y, of_x - of_y)] if paired else [(x, of_x), (y, of_y)]
    means = [(z.mean(axis=-1), c.mean(axis=-1)) for z, c in sides]
    within = [
        (z - m[..., None], c - k[..., None]) for (z, c), (m, k) in zip(sides, means, strict=True)
    ]
    both = sum((z * c).sum(axis=-1) for z, c in within)
    squares = sum((c**2).sum(axis=-1) for _, c in within)
    least = SPREAD * sum((c**2).sum(axis=-1) for _, c in sides)
    slope = np.divide(both, squares, where=squares > least, out=np.zeros_like(both))
    rest = [((z - slope[..., None] * c) ** 2).sum(axis=-1) for z, c in within]
    apart = means[0][1] if paired else means[0][1] - means[1][1]
    value = (means[0][0] if paired else means[0][0] - means[1][0]) - slope * apart
    sizes = [z.shape[-1] for z, _ in sides]
    freedom = sum(size - 1 for size in sizes)
    fewer = freedom / (freedom - 1)
    parts = [s / (size - 1) * fewer / size for s, size in zip(rest, sizes, strict=True)]
    with np.errstate(invalid="ignore", divide="ignore"):
        welch = sum(parts) ** 2 / sum(p**2 / (n - 1) for p, n in zip(parts, sizes, strict=True))
        more = np.where(squares > least, apart**2 * sum(rest) / (freedom - 1) / squares, 0)
        t = np.nan_to_num(stdtrit(welch - 1, (1 + confidence) / 2))
    half, spread = (
        t * np.sqrt(sum(parts) + more),
        np.sqrt(sum(p * n for p, n in zip(parts, sizes, strict=True))),
    )
    return Interval(value, value - half, value + half), np.where(spread > 0, spread, np.inf)


def permutation_test_by_model(x: Array, y: Array, of_x: Array, of_y: Array, paired: bool) -> float:
    """Return the p-value of `permutation_test`, by the difference of `difference_by_model`.

    Flights keep their predictions when they are dealt out, so that it is exact, too.
    """
    rng, (n, m) = np.random.default_rng(0), (len(x), len(y))
    if paired:
        few = 2**n <= RESAMPLES
        signs = (
            [*product((1.0, -1.0), repeat=n)] if few else rng.choice((1.0, -1.0), (RESAMPLES, n))
        )
        ways, (z, c), size = np.array(signs) / n, (x - y, of_x - of_y), float(n)
    else:
        few, (z, c) = math.comb(n + m, n) <= RESAMPLES, (np.r_[x, y], np.r_[of_x, of_y])
        z, c, size = z - z.mean(), c - c.mean(), n * m / (n + m)
        start = np.r_[np.full(n, 1 / n), np.full(m, -1 / m)]
        if few:
            ways = np.full((math.comb(n + m, n), n + m), -1 / m)
            for row, side in zip(ways, combinations(range(n + m), n), strict=True):
                row[[*side]] = 1 / n
        else:
            ways = rng.permuted(np.tile(start, (RESAMPLES, 1)), axis=1)
    flown = np.ones(n) / n if paired else start
    ways = np.vstack([flown, ways])
    apart, of_model = ways @ z, ways @ c
    squares = (c**2).sum() - size * of_model**2
    some = squares > 1e-14 * (c**2).sum()  # a difference of sums
    slope = np.divide((z * c).sum() - size * of_model * apart, squares, where=some, out=0 * apart)
    distance = np.abs(apart - slope * of_model)
    further = np.count_nonzero(distance[1:] >= distance[0] * (1 - 1e-12))
    return further / len(ways[1:]) if few else (further + 1) / len(ways)


# What flights are worth ---------------------------------------------------------------------------


def halves(x: Array, seed: int = 0) -> Iterator[tuple[Array, Array]]:
    """Yield `SPLITS` ways to halve numbers, drawn; an odd one is in neither half."""
    rng, half = np.random.default_rng(seed), len(x) // 2
    for _ in range(SPLITS):
        order = rng.permutation(x)
        yield order[:half], order[half : 2 * half]


def null_splits(x: Array, confidence: float) -> tuple[int, float]:
    """Return how many `halves` of a side are called different, and how far 95 % are apart at most.

    They are called so by the interval and the test, as two sides are.
    """
    splits = [np.stack(part) for part in zip(*halves(x), strict=True)]
    ends, _ = difference(splits[0], splits[1], False, confidence)
    apart = np.abs(ends.value)
    p = _of_equal_halves(x, apart)
    different = ((ends.low > 0) | (ends.high < 0)) & (p <= 1 - confidence)
    return int(np.count_nonzero(different)), float(np.quantile(apart, confidence))


def _of_equal_halves(x: Array, apart: Array) -> Array:
    """Return the p-values of differences of halves, which have one permutation distribution."""
    half = len(x) // 2
    drawn = np.random.default_rng(1).permuted(np.tile(x, (RESAMPLES, 1)), axis=1)
    every = np.sort(abs(drawn[:, :half].mean(axis=1) - drawn[:, half : 2 * half].mean(axis=1)))
    further = len(every) - np.searchsorted(every, apart * (1 - 1e-12))
    p: Array = (further + 1) / (len(every) + 1)
    return p


def drift(sides: Sequence[Array], places: Sequence[Sequence[int]]) -> tuple[float, float]:
    """Return by how much numbers grow from flight to flight, within sides, and the p-value of 0.

    By least squares, with one slope and a mean for each side, and Student's t. `places` are the
    numbers of the flights of each side in the order flown.
    """
    from scipy.special import stdtr  # slow to import

    times = [np.array(place) - np.mean(place) for place in places]
    squares = sum(float(t @ t) for t in times)
    freedom = sum(len(x) - 1 for x in sides) - 1
    if freedom < 1 or not squares:
        return 0.0, 1.0
    slope = sum(float(t @ x) for t, x in zip(times, sides, strict=True)) / squares
    rest = sum(
        float(((x - x.mean() - slope * t) ** 2).sum()) for t, x in zip(times, sides, strict=True)
    )
    if rest <= 0:
        return slope, 0.0 if slope else 1.0
    return slope, float(2 * stdtr(freedom, -abs(slope) / math.sqrt(rest / freedom / squares)))
