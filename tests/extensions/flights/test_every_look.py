"""Evidence that holds at every look, against plain programs, closed forms and simulated flights."""

import math
from itertools import combinations, product

import numpy as np
import pytest
from scipy import integrate, stats

from eqt_cli.extensions.flights.every_look import (
    BETS,
    LARGEST,
    blocks_of,
    interval,
    p_value,
    pairs,
    pairs_to_decide,
    safe_t,
    wealth,
)

D = np.array([0.3, -0.1, 0.4, 0.2, 0.25, -0.05, 0.5, 0.1, 0.35, 0.2])


def plain_wealth(d):
    """Pair for pair, with a plain loop: the stake is tanh δz of the wealth."""
    purses = dict.fromkeys(BETS, 1.0)
    for k, x in enumerate(d):
        z = min(abs(x) / math.sqrt(sum(y * y for y in d[: k + 1]) / (k + 1)), LARGEST)
        for bet in BETS:
            purses[bet] *= 1 + math.copysign(1, x) * math.tanh(bet * z)
    return sum(BETS[bet] * purse for bet, purse in purses.items())


def test_the_wealth_is_that_of_a_plain_loop():
    assert np.exp(wealth(pairs(D))[-1]) == pytest.approx(plain_wealth(D))
    assert np.exp(wealth(pairs(D), -1.0)[-1]) == pytest.approx(plain_wealth(-D))


def test_the_game_is_fair_whatever_the_sizes():
    """Over all signs of these differences, the mean wealth is 1 after every pair."""
    every = np.array([*product([1, -1], repeat=8)]) * D[:8]
    assert np.exp(wealth(pairs(every))).mean(axis=0) == pytest.approx(np.ones(8))


def test_the_game_in_blocks_is_fair():
    """Over all ways to deal out a block of 2 and 1 and one of 1 and 3, the mean wealth is 1."""
    first, second = D[:3], D[3:7]
    total = []
    for a, b in product(combinations(range(3), 2), range(4)):
        x = np.r_[first[list(a)], second[b]]
        y = np.r_[np.delete(first, a), np.delete(second, b)]
        total.append(np.exp(wealth(blocks_of(x, y, [(2, 1), (1, 3)]))[-1]))
    assert np.mean(total) == pytest.approx(1)


def test_blocks_of_one_each_are_pairs():
    x, y = D, np.roll(D, 3) / 2
    one = blocks_of(x, y, [(1, 1)] * 10)
    assert wealth(one) == pytest.approx(wealth(pairs(x - y)))


def test_the_interval_inverts_the_test():
    low, high = interval(pairs(D), 0.95)[1:]
    for end, sign in ((low, 1.0), (high, -1.0)):
        inner, outer = end + sign * 1e-6, end - sign * 1e-6
        assert (
            wealth(pairs(D - inner), sign).max()
            < math.log(40)
            <= wealth(pairs(D - outer), sign).max()
        )
    assert low < D.mean() < high
    assert interval(pairs(D[:6]), 0.95)[1:] == (-math.inf, math.inf)


def test_a_shift_of_a_moves_the_interval_of_blocks():
    x, y = np.r_[D, D[:5]], 0.3 * np.roll(D, 4)
    sizes = [(2, 1)] * 5 + [(1, 1)] * 5
    one, other = (interval(blocks_of(x + move, y, sizes), 0.9) for move in (0.0, 0.7))
    assert np.array(other) == pytest.approx(np.array(one) + 0.7, abs=1e-6)


def test_seven_pairs_are_the_least():
    assert p_value(pairs(np.ones(6))) > 0.05 > p_value(pairs(np.ones(7)))


def test_the_t_test_is_the_ratio_of_two_likelihoods_of_t():
    """By quadrature over the effects: noncentral against central t (of 10, and of 10 and 6)."""
    x, y = D, np.roll(D, 3)[:6] / 2
    for a, b, paired, size, t in (
        (x, 0 * x, True, 10, stats.ttest_1samp(x, 0)),
        (x, y, False, 60 / 16, stats.ttest_ind(x, y)),
    ):
        freedom = t.df

        def weighted(effect, t=t.statistic, freedom=freedom, size=size):
            return stats.nct.pdf(t, freedom, effect * math.sqrt(size)) * stats.norm.pdf(effect)

        ratio = integrate.quad(weighted, -8, 8)[0] / stats.t.pdf(t.statistic, freedom)
        ends, p = safe_t(a, b, paired, 0.95)
        assert p == pytest.approx(min(1, 1 / ratio), rel=1e-6)
        assert safe_t(a - ends.low, b, paired, 0.95)[1] == pytest.approx(0.05)


def looked(kind, campaigns=2_000, most=20, seed=0):
    """Differences of campaigns with equal settings, as logarithms of errors of pairs."""
    rng = np.random.default_rng(seed)
    size = (campaigns, most)
    if kind == "normal":
        return 0.33 * (rng.normal(size=size) - rng.normal(size=size))
    if kind == "heavy tails":
        return rng.standard_t(2, size=size) - rng.standard_t(2, size=size)
    wind = rng.gamma(
        2.0, 1.0, size=size
    )  # of pairs: what multiplies errors of both, and their spread
    return np.log1p(0.3 * wind * rng.gamma(2.0, size=size)) - np.log1p(
        0.3 * wind * rng.gamma(2.0, size=size)
    )


@pytest.mark.parametrize("kind", ["normal", "heavy tails", "pairs"])
def test_looks_after_each_flight_find_few_false_differences(kind):
    """2,000 campaigns of up to 20 pairs: 5 %, and 3 standard errors of that."""
    assert np.mean(p_value(pairs(looked(kind))) <= 0.05) <= 0.06


def test_unequal_numbers_find_few_false_differences():
    """Blocks of two flights of A and one of B, with a skewed law of errors."""
    rng = np.random.default_rng(1)
    x, y = (
        np.log(0.2 + rng.gamma(2.0, 0.08, size=(2_000, 40))),
        np.log(0.2 + rng.gamma(2.0, 0.08, size=(2_000, 20))),
    )
    assert np.mean(p_value(blocks_of(x, y, [(2, 1)] * 20)) <= 0.05) <= 0.06


def test_the_t_test_at_every_look_finds_few_false_differences():
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(2, 2_000, 20))
    p = np.min(
        [safe_t(x[:, :n], y[:, : max(2, n // 2)], False, 0.95)[1] for n in range(3, 21)], axis=0
    )
    assert np.mean(p <= 0.05) <= 0.06


def test_the_number_of_pairs_decides_in_four_of_five_campaigns():
    n = pairs_to_decide(1.0, 0.95)
    d = 1 + np.random.default_rng(5).normal(size=(2_000, n))
    assert np.mean(p_value(pairs(d)) <= 0.05) == pytest.approx(0.8, abs=0.06)
    assert 10 < n < 20 < pairs_to_decide(0.6, 0.95)
    assert pairs_to_decide(0.01, 0.95) > 100_000
    assert pairs_to_decide(0.0, 0.95) is None
