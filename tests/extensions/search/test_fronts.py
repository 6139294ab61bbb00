"""Laws at equal cost, on fronts whose difference is known."""

from dataclasses import replace

import numpy as np
import pytest

from eqt_cli.analysis.intervals import Resampling
from eqt_cli.extensions.search.fronts import Front, at_equal_cost

RUNS = 400
HOW = Resampling(resamples=999)


def front(law, costs, scale, noise=0.0, seed=0):
    """Errors scale/cost in the mean; each run is larger or smaller in both as a whole."""
    random = np.random.default_rng(seed)
    spread = random.normal(0, noise, RUNS)
    spread -= spread.mean()
    cost = np.array(costs)[:, None] * (1 + spread)
    error = scale / np.array(costs)[:, None] * (1 - spread)
    return Front(law, [f"{law} {k + 1}" for k in range(len(costs))], cost, error)


def fine(low, high):
    found = np.geomspace(low, high, 60)
    return found.tolist()


def test_a_law_with_a_fifth_less_error_is_found_to_have_it():
    one, other = front("a", fine(1, 10), 1.0), front("b", fine(2, 20), 1.25)
    for pair in at_equal_cost([one, other], HOW):
        assert (pair.better, pair.worse) == ("a", "b")
        assert pair.relative == pytest.approx(0.2, abs=1e-3)
        assert 2 < pair.cost < 10
        assert pair.wins


def test_the_order_of_the_laws_does_not_matter():
    one, other = front("a", fine(1, 10), 1.0, 0.1), front("b", fine(2, 20), 1.25, 0.1, seed=1)
    # As text, since a number that is absent is not equal to itself.
    assert str(at_equal_cost([one, other], HOW)) == str(at_equal_cost([other, one], HOW))


def test_what_is_not_known_of_the_cost_is_in_the_interval():
    """Errors without spread, along a front of slope −1 whose costs spread by 0.5: so does e."""
    random = np.random.default_rng(2)
    spread = random.normal(0, 0.5, (2, RUNS))
    spread -= spread.mean(axis=1, keepdims=True)
    costs = np.array([[1.0], [3.0]])
    errors = np.broadcast_to([[3.0], [1.0]], (2, RUNS))
    one = Front("a", ["a 1", "a 2"], costs + spread[0], errors)
    sure = Front("b", ["b 1", "b 2"], np.broadcast_to(costs, (2, RUNS)), errors)
    assert one.at(2.0).mean() == pytest.approx(2.0)
    assert one.at(2.0).std() == pytest.approx(spread[0].std())
    (pair,) = at_equal_cost([one, sure], HOW, (0.5,))
    assert pair.low <= 0
    assert pair.winner == "undecided"
    assert (pair.high - pair.low) / 2 * sure.at(pair.cost).mean() == pytest.approx(
        1.96 * spread[0].std() / np.sqrt(RUNS), rel=0.1
    )


def test_a_front_wins_by_the_rule_of_maps_with_all_costs_counted():
    """Three costs take 7 runs, since 2^(1-7) ≤ 0.05/3; each has then an adjusted p of 3/64."""

    def few(law, scale, runs):
        found = front(law, fine(1, 10), scale)
        return replace(found, cost=found.cost[:, :runs], error=found.error[:, :runs])

    for runs, verdict in ((6, "too few runs"), (7, "a")):
        pairs = at_equal_cost([few("a", 1.0, runs), few("b", 1.25, runs)], HOW)
        assert [pair.winner for pair in pairs] == [verdict] * 3
    assert [pair.p_value for pair in pairs] == pytest.approx([3 / 64] * 3)


def test_fronts_that_do_not_overlap_are_not_compared():
    assert at_equal_cost([front("a", [1, 2], 1.0), front("b", [3, 4], 1.0)], HOW) == []


def test_a_winner_that_another_betters_on_held_out_runs_is_not_on_the_front():
    found = front("a", [1, 2, 4], 1.0)
    worse = Front("a", found.labels, found.cost, found.error + np.array([[0], [5], [0]]))
    assert worse.best.tolist() == [0, 2]


def test_a_winner_with_a_failed_run_is_not_on_the_front():
    found = front("a", [1, 2, 4], 1.0)
    cost = found.cost.copy()
    cost[1, 7] = np.nan
    assert Front("a", found.labels, cost, found.error).best.tolist() == [0, 2]


def test_the_fronts_of_single_searches_show_the_luck_of_the_search():
    """At a cost of 2, searches found errors of 0.8 and 1 of one law, 1.25 and 1.6 of the other."""
    laws = (("a", 1.0, [0.8, 1.0]), ("b", 1.25, [1.25, 1.6]))
    one, other = (
        replace(
            front(law, fine(1, 4), scale),
            searches=[np.array([[1, 2 * e], [2, e], [4, e / 2]]) for e in errors],
        )
        for law, scale, errors in laws
    )
    (pair,) = at_equal_cost([one, other], HOW, (0.5,))
    assert (pair.smallest, pair.largest) == pytest.approx((0.2, 0.5))
    assert pair.over_searches == "20.0 to 50.0 %"
    short = replace(one, searches=[np.array([[3.0, 1.0], [4.0, 0.5]])])  # does not reach 2
    assert at_equal_cost([short, other], HOW, (0.5,))[0].over_searches == "-"
