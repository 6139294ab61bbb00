"""Statistics of planned numbers of flights, against plain programs and simulated flights."""

from itertools import combinations, product

import numpy as np
import pytest
from scipy import stats

from eqt_cli.extensions.flights.one_look import (
    difference,
    difference_by_model,
    drift,
    halves,
    null_splits,
    permutation_test,
    permutation_test_by_model,
)

RNG = np.random.default_rng(0)
X, Y, OF_X, OF_Y = RNG.normal(size=(4, 6))


def regressed(z, side, c):
    """The coefficient of a side in a linear regression, by least squares."""
    columns = np.c_[np.ones(len(z)), side, c]
    return np.linalg.lstsq(columns, z, rcond=None)[0][1]


def test_the_difference_by_a_model_is_that_of_a_regression():
    value = difference_by_model(X, Y, OF_X, OF_Y, False, 0.95)[0].value
    side = np.repeat([1.0, 0.0], 6)
    assert value == pytest.approx(regressed(np.r_[X, Y], side, np.r_[OF_X, OF_Y]))
    pairs = stats.linregress(OF_X - OF_Y, X - Y)
    ends = difference_by_model(X, Y, OF_X, OF_Y, True, 0.95)[0]
    half = stats.t.ppf(0.975, 4) * pairs.intercept_stderr
    assert ends == pytest.approx((pairs.intercept, pairs.intercept - half, pairs.intercept + half))


def test_predictions_that_differ_by_rounding_explain_nothing():
    """The differences of pairs are ln 0.1 − ln 0.15 but for rounding."""
    x, y = RNG.normal(size=(2, 14))
    of_x, of_y = np.log(0.1 * np.arange(1, 15)), np.log(0.15 * np.arange(1, 15))
    plain, _ = difference(x, y, True, 0.95)
    ends, _ = difference_by_model(x, y, of_x, of_y, True, 0.95)
    assert ends.value == pytest.approx(plain.value)
    assert ends.high - ends.low == pytest.approx(plain.high - plain.low, rel=0.06)
    assert 0 < permutation_test_by_model(x, y, of_x, of_y, True) <= 1


def test_the_test_by_a_model_tries_all_ways():
    z, c = np.r_[X, Y], np.r_[OF_X, OF_Y]
    flown = abs(regressed(z, np.repeat([1.0, 0.0], 6), c)) - 1e-12
    further = []
    for of in combinations(range(12), 6):
        side = np.isin(np.arange(12), of) * 1.0
        further.append(abs(regressed(z, side, c)) >= flown)
    assert permutation_test_by_model(X, Y, OF_X, OF_Y, False) == pytest.approx(np.mean(further))
    d, e = X - Y, OF_X - OF_Y
    swaps = [
        abs(stats.linregress(s * e, s * d).intercept)
        for s in map(np.array, product([1, -1], repeat=6))
    ]
    expected = np.mean(np.array(swaps) >= abs(stats.linregress(e, d).intercept) - 1e-12)
    assert permutation_test_by_model(X, Y, OF_X, OF_Y, True) == pytest.approx(expected)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
@pytest.mark.parametrize(("paired", "n"), [(False, 5), (False, 10), (True, 12)])
def test_a_model_keeps_the_coverage_and_gives_what_the_formula_says(correlation, paired, n):
    """The interval shrinks by the root of 1 − ρ², but for the loss of a degree of freedom."""
    rng = np.random.default_rng(3)
    z = rng.normal(size=(2, 4_000, n))
    c = correlation * z + np.sqrt(1 - correlation**2) * rng.normal(size=z.shape)
    (_, low, high), _ = difference_by_model(*z, *c, paired, 0.95)
    (_, plain_low, plain_high), _ = difference(*z, paired, 0.95)
    assert 0.93 <= np.mean((low <= 0) & (high >= 0)) <= 0.97
    wider = np.mean(high - low) / np.mean(plain_high - plain_low)
    assert np.sqrt(1 - correlation**2) <= wider <= 1.12 * np.sqrt(1 - correlation**2)


def test_halves_of_equal_flights_are_seldom_called_different():
    counts = [null_splits(RNG.normal(size=12), 0.95)[0] for _ in range(20)]
    assert 0 < np.mean(counts) <= 0.08 * 60


def test_a_split_is_called_different_as_two_sides_are():
    x = np.r_[np.zeros(6), np.ones(6)] + 0.1 * RNG.normal(size=12)
    count, apart = null_splits(x, 0.95)
    expected = [
        not low <= 0 <= high and permutation_test(a, b, False) <= 0.05
        for a, b in halves(x)
        for _, low, high in [difference(a, b, False, 0.95)[0]]
    ]
    assert count == sum(expected)
    assert apart == pytest.approx(
        np.quantile([abs(a.mean() - b.mean()) for a, b in halves(x)], 0.95)
    )


def test_a_drift_is_the_slope_of_a_regression():
    places = [[6, 8, 9, 11, 14, 15], [0, 1, 2, 3, 4, 5]]
    columns = np.c_[np.repeat([1.0, 0.0], 6), np.repeat([0.0, 1.0], 6), np.ravel(places)]
    z = np.r_[X, Y] + 0.3 * np.ravel(places)
    fit, rest, *_ = np.linalg.lstsq(columns, z, rcond=None)
    error = np.sqrt(rest[0] / 9 * np.linalg.inv(columns.T @ columns)[2, 2])
    slope, p = drift([z[:6], z[6:]], places)
    assert (slope, p) == pytest.approx((fit[2], 2 * stats.t.sf(abs(fit[2]) / error, 9)))
