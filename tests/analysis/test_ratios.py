"""Intervals of a mean difference as a share of a mean."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import ttest_1samp

from eqt_cli.analysis.comparison.intervals import relative_difference
from eqt_cli.core.arrays import Array


@pytest.fixture
def runs() -> tuple[Array, Array]:
    random = np.random.default_rng(3)
    start = random.lognormal(0, 0.5, 40)
    return start * random.normal(1.2, 0.2, 40), start


def test_the_ends_are_where_the_paired_test_begins_to_reject(runs: tuple[Array, Array]) -> None:
    first, second = runs
    found = relative_difference(first - second, second, 0.9)
    for end, bracket in ((found.low, (-1, found.value)), (found.high, (found.value, 2))):
        root = brentq(lambda x: ttest_1samp(first - second - x * second, 0).pvalue - 0.1, *bracket)
        assert end == pytest.approx(root, rel=1e-9)


def test_of_a_negative_mean_the_share_keeps_the_sign_of_the_difference(
    runs: tuple[Array, Array],
) -> None:
    first, second = runs
    plain = relative_difference(first - second, second, 0.95)
    assert relative_difference(first - second, -second, 0.95) == pytest.approx(plain)
    assert plain.low < plain.value < plain.high


def test_no_share_of_a_mean_that_may_be_0() -> None:
    random = np.random.default_rng(1)
    found = relative_difference(np.ones(30), random.normal(0.01, 1, 30), 0.95)
    assert (found.low, found.high) == (-math.inf, math.inf)


def test_equal_runs_have_a_share_of_0_without_width() -> None:
    assert relative_difference(np.zeros(9), np.arange(1.0, 10), 0.95) == pytest.approx((0, 0, 0))


def test_no_interval_from_too_few_runs() -> None:
    assert math.isnan(relative_difference(np.ones(4), np.ones(4), 0.95).low)


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.slow("many runs"))])
@pytest.mark.parametrize("kind", ["normal", "lognormal"])
def test_intervals_hold_the_true_share_as_often_as_they_say(kind: str, count: int) -> None:
    """Of runs whose spread is that of the mean itself; 2,000 samples tell 0.95 within 0.01.

    An interval of the difference that is divided by the mean holds in 0.80 to 1.00 of them.
    """
    random = np.random.default_rng(7)
    held = 0
    for _ in range(2000):
        if kind == "normal":
            second = random.normal(2, 0.8, count)
        else:
            second = random.lognormal(0, 0.5, count)
        first = second * random.normal(0.8, 0.1, count)
        found = relative_difference(first - second, second, 0.95)
        held += found.low <= -0.2 <= found.high
    assert 0.93 <= held / 2000 <= 0.97
