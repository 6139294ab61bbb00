"""Evidence that holds at every look: bets on signs, and a t-test of that kind.

Who compares after each flight and stops when a difference shows, finds one too often by tests for a
number of flights that was planned. Here a gambler bets on which side is worse, in a game that is
fair if both sides are alike. Then his wealth is above 1/α at any time with probability α at most
(Ville 1939), however long one plays and whenever one looks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.analysis.intervals import POWER, Interval, runs_to_decide, student
from eqt_cli.base.arrays import Array

BETS = {0.125: 0.08, 0.25: 0.08, 0.5: 0.28, 1.0: 0.28, 2.0: 0.28}
"""Effects for which a bet is best, in standard deviations, with the share of the wealth that is bet
so. Flights show large effects, hundreds of laps also small ones."""

LARGEST = 1.5
"""Largest difference that counts, in standard deviations, so that no single one loses all."""

MOST_IN_A_BLOCK = 8
"""Largest number of flights of a block: its ways to deal them out are all tried."""

_STEPS, _HALVINGS, _FAR = 160, 40, 1e3


class Blocks(NamedTuple):
    """The differences of the means of two sides in blocks, for all ways to deal out the sides.

    Attributes
    ----------
    differences : (..., blocks, ways)
        A less B; the first way is that which was flown.
    moved : (blocks, ways)
        By how much each grows if the numbers of A grow by one.
    weights : (blocks, ways)
        One divided by the number of ways of the block; 0 for those that a smaller one lacks.
    """

    differences: Array
    moved: Array
    weights: Array


def pairs(differences: Array) -> Blocks:
    """Return pairs, of which each may be swapped, by their differences ``(..., pairs)``."""
    signs = np.array([1.0, -1.0])
    every = np.ones((differences.shape[-1], 1))
    return Blocks(differences[..., None] * signs, every * signs, every * [0.5, 0.5])


def blocks_of(x: Array, y: Array, sizes: Sequence[tuple[int, int]]) -> Blocks:
    """Return blocks of so many flights of A and of B, in order; one of each is a pair."""
    if all(size == (1, 1) for size in sizes):
        return pairs(x - y)
    ways = [[*combinations(range(a + b), a)] for a, b in sizes]
    most, at = max(map(len, ways)), np.cumsum([(0, 0), *sizes], axis=0)
    differences = np.zeros((*x.shape[:-1], len(sizes), most))
    moved, weights = np.zeros((2, len(sizes), most))
    for k, ((a, b), (i, j), some) in enumerate(zip(sizes, at, ways, strict=False)):
        in_a = np.array([np.isin(range(a + b), way) for way in some])
        deal = np.where(in_a, 1 / a, -1 / b)
        flown = np.concatenate([x[..., i : i + a], y[..., j : j + b]], axis=-1)
        differences[..., k, : len(some)] = flown @ deal.T
        moved[k, : len(some)] = deal[:, :a].sum(axis=1)
        weights[k, : len(some)] = 1 / len(some)
    return Blocks(differences, moved, weights)


def wealth(blocks: Blocks, sign: float = 1.0) -> Array:
    """Return the logarithm of the wealth of who bets that A is larger (−1: smaller) than B.

    Construction: given the numbers in a block, but not which is whose, and all blocks before, all
    ways to deal the sides out are as likely. So a bet that multiplies the wealth by
    exp(δz)/mean exp(δz'), z' over all ways, is fair. For a pair this is 1 + tanh δz: a bet on the
    sign of a symmetric difference (Efron 1969; de la Peña 1999; Ramdas, Ruf, Larsson and Koolen
    2020). z is the difference divided by the root mean square of all ways so far, this block
    included, which dealing does not change, within ±`LARGEST`.

    Assumption: within a pair or block, which flight is of A might as well have been the other way
    round, as if sides were drawn. No law of the numbers, and no equal variance of blocks, is
    assumed. A drift with one side always first is not covered.

    Returns
    -------
    Array, (..., blocks)
        After each block.
    """
    squares = (blocks.weights * blocks.differences**2).sum(axis=-1)
    count = np.arange(1, squares.shape[-1] + 1)
    spread = np.sqrt(np.cumsum(squares, axis=-1) / count)[..., None]
    scaled = np.divide(blocks.differences, spread, where=spread > 0, out=0 * blocks.differences)
    z = sign * np.clip(scaled, -LARGEST, LARGEST)
    gains = [
        math.log(share)
        + np.cumsum(d * z[..., 0] - np.log((blocks.weights * np.exp(d * z)).sum(axis=-1)), axis=-1)
        for d, share in BETS.items()
    ]
    total: Array = np.logaddexp.reduce(gains, axis=0)
    return total


def p_value(blocks: Blocks) -> Any:
    """Return the p-value that both sides are alike, valid at every look: 2 / the largest wealth."""
    best = np.maximum(wealth(blocks), wealth(blocks, -1.0)).max(axis=-1, initial=0.0)
    return np.minimum(1.0, 2 * np.exp(-best))


def interval(blocks: Blocks, confidence: float) -> Interval:
    """Return the differences of A and B that no bet has refuted so far, each end on its own.

    With A moved by the true difference, both sides are alike. The interval of all looks holds it
    with the confidence. An end is infinite as long as the blocks are too few.
    """
    limit = math.log(2 / (1 - confidence))
    value = float(blocks.differences[..., 0].mean())
    ends = [_end(blocks, sign, limit) for sign in (1.0, -1.0)]
    return Interval(value, min(ends[0], value), max(ends[1], value))


def _end(blocks: Blocks, sign: float, limit: float) -> float:
    """Return the outermost difference that is not refuted: below for 1, above for −1."""

    def refuted(places: Array) -> Array:
        moved = blocks.differences - places[:, None, None] * blocks.moved
        return wealth(blocks._replace(differences=moved), sign).max(axis=-1, initial=0.0) >= limit

    flown = blocks.differences[:, 0]
    room = float(np.ptp(flown)) + float(np.abs(blocks.differences).max()) * 1e-9
    far, near = (flown.min(), flown.max()) if sign > 0 else (flown.max(), flown.min())
    places = far - sign * room * np.geomspace(_FAR, 1, _STEPS // 4)
    places = np.r_[places, np.linspace(places[-1], near, _STEPS)]
    out = refuted(places)
    if not out[0]:
        return -sign * math.inf
    if out.all():
        return float(near)
    k = int(np.argmin(out))
    low, high = places[[k - 1, k]]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if refuted(np.array([middle]))[0] else (low, middle)
    return float(high)


# A t-test that holds at every look ----------------------------------------------------------------


def safe_t(x: Array, y: Array, paired: bool, confidence: float) -> tuple[Interval, Any]:
    """Return the difference of two means with its interval, and the p-value, valid at every look.

    The wealth is the likelihood ratio of an effect, normal with the deviation 1, and of none,
    with the scale (and the common mean) integrated out by the right Haar measure (Gönen et al.
    2005; that it may be looked at any time: Lindon et al. 2022; Pérez-Ortiz et al. 2024).

    Assumption: normal numbers, those of both sides with one variance; of pairs, normal differences.
    Numbers of sides may differ, and may grow in any way that does not depend on the errors.

    Parameters
    ----------
    x, y : (..., n), (..., m)
        Numbers of both sides.

    Returns
    -------
    Interval, Any
        Its ends are infinite as long as the numbers are too few.
    """
    n, m = x.shape[-1], y.shape[-1]
    parts = [x - y] if paired else [x, y]
    freedom = n - 1 if paired else n + m - 2
    size = n if paired else n * m / (n + m)
    value = x.mean(axis=-1) - y.mean(axis=-1)
    squares = sum(((z - z.mean(axis=-1, keepdims=True)) ** 2).sum(axis=-1) for z in parts)
    if freedom < 1:
        return Interval(value, -np.inf, np.inf), np.ones_like(value)
    error, spread = np.sqrt(squares / freedom / size), 1 + size
    with np.errstate(divide="ignore", invalid="ignore"):
        t2 = np.where(error > 0, (value / error) ** 2, np.where(value == 0, 0, np.inf)) / freedom
        ratio = np.where(np.isinf(t2), spread, (1 + t2) / (1 + t2 / spread))
    gain = (freedom + 1) / 2 * np.log(ratio) - math.log(spread) / 2
    t = student(freedom, confidence, size)
    half = t * error if math.isfinite(t) else np.full_like(value, np.inf)
    return Interval(value, value - half, value + half), np.minimum(1.0, np.exp(-gain))


# How many flights ---------------------------------------------------------------------------------

_CAMPAIGNS, _MOST_PAIRS = 400, 1_000


@cache
def pairs_to_decide(effect: float, confidence: float, *, normal: bool = False) -> int | None:
    """Return the pairs by which a look after each has decided with probability `POWER`.

    By campaigns that are simulated, with normal differences of 1 and this mean; beyond
    `_MOST_PAIRS`, twice the number of a fixed design. None if that has none.
    """
    fixed = runs_to_decide(effect, confidence)
    if fixed is None or 4 * fixed > _MOST_PAIRS:
        return None if fixed is None else 2 * fixed
    most = max(40, 4 * fixed)
    d = abs(effect) + np.random.default_rng(0).normal(size=(_CAMPAIGNS, most))
    if normal:
        looks = [safe_t(d[:, :n], 0 * d[:, :n], True, confidence)[1] for n in range(2, most + 1)]
        decided = np.stack([np.ones(_CAMPAIGNS), *looks], axis=1) <= 1 - confidence
    else:
        decided = wealth(pairs(d)) >= math.log(2 / (1 - confidence))
    first = np.where(decided.any(axis=1), decided.argmax(axis=1) + 1, most)
    return int(np.quantile(first, POWER, method="higher"))
