"""Searches on functions whose best points are known, without any run."""

import numpy as np
import pytest
from scipy.optimize import differential_evolution

from eqt_cli.extensions.search.fronts import (
    Population,
    Scores,
    first_points,
    generator,
    ranks,
    selected,
    survivors,
    trials,
)


def scored(objectives, violation=0):
    objectives, none = np.array(objectives, float), np.zeros(len(objectives))
    return Scores(objectives, violation + none, none, none)


def searched(judge, dimensions, generations, count=32):
    shares = first_points(count, dimensions, None, 3)
    population = Population(shares, judge(shares))
    for number in range(1, generations):
        shares = trials(population, generator(3, number))
        population = selected(population, Population(shares, judge(shares)))
    return population


def rosenbrock(shares):
    x, y = (4 * shares - 2).T
    found = (1 - x) ** 2 + 100 * (y - x**2) ** 2
    return found


def test_it_comes_as_close_as_the_search_of_scipy():
    def batch(shares):
        return rosenbrock(shares.T)

    start = first_points(32, 2, None, 3)
    theirs = differential_evolution(
        batch,
        [(0, 1)] * 2,
        init=start,
        maxiter=39,
        tol=0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=1,
    )
    ours = searched(lambda shares: scored(rosenbrock(shares)[:, None]), 2, 40)
    assert ours.scores.objectives[ours.best, 0] < 1e-6
    assert theirs.fun < 1e-6


def test_the_best_feasible_point_on_the_edge_of_a_constraint():
    def judge(shares):
        x, y = shares.T
        outside = np.maximum((x - 0.3) ** 2 + (y - 0.3) ** 2 - 0.04, 0)
        return scored((x + y)[:, None], outside)

    population = searched(judge, 2, 60)
    found = population.shares[population.best]
    assert population.scores.feasible[population.best]
    assert found == pytest.approx(0.3 - 0.2 / np.sqrt(2), abs=1e-3)


def test_a_front_is_found_as_a_whole():
    """Of x² and (x − 2)² over [−4, 6], the front is x in [0, 2]: √f₁ + √f₂ = 2."""

    def judge(shares):
        x = 10 * shares[:, 0] - 4
        return scored(np.stack([x**2, (x - 2) ** 2], axis=1))

    population = searched(judge, 1, 30)
    front = population.scores.objectives[population.front]
    assert np.sqrt(front).sum(axis=1) == pytest.approx(2, abs=0.01)  # the ends are beyond it
    assert len(front) == 32
    assert np.diff(np.sqrt(front[:, 0])).max() < 0.2  # without a large gap


def test_a_generation_depends_on_seed_and_number_only():
    shares = first_points(8, 2, None, 1)
    population = Population(shares, scored(rosenbrock(shares)[:, None]))
    again = trials(population, generator(1, 5))
    assert np.array_equal(trials(population, generator(1, 5)), again)
    for other in (generator(2, 5), generator(1, 6)):
        assert not np.array_equal(trials(population, other), again)


def test_trials_that_leave_the_box_are_drawn_anew_or_become_its_ends():
    shares = np.array([[0.0], [0.1], [0.9], [1.0], [0.95]])
    population = Population(shares, scored(-shares))  # the best is at the end
    drawn, kept = (trials(population, generator(1, 5), ends) for ends in (False, True))
    assert not (drawn == 1).any()
    assert (kept[drawn != kept] % 1 == 0).all()
    assert (kept == 1).sum() >= 1


def test_the_start_is_among_the_first_points():
    shares = first_points(8, 2, (0.25, 0.5), 1)
    assert shares[0].tolist() == [0.25, 0.5]
    assert ((shares >= 0) & (shares <= 1)).all()


def test_laws_start_from_the_same_values_of_the_keys_that_they_share():
    shares = first_points(8, 2, None, 1)
    more = first_points(8, 3, None, 1)
    assert np.array_equal(more[:, :2], shares)
    for column in more.T:  # a Latin hypercube: one value in each eighth
        assert sorted((8 * column).astype(int)) == list(range(8))
    assert not np.array_equal(first_points(8, 2, None, 2), shares)


# Which of scored points is better


@pytest.mark.parametrize(
    ("objectives", "violation", "best"),
    [
        ([1, 5, 4], [0.1, 0, 0], 2),  # a feasible one, whatever less an infeasible one has
        ([1, 5, 4], [0.3, 0.1, 0.2], 1),  # of infeasible ones, that which violates least
        ([np.nan, 5], [1.0, 0], 1),  # never one without a value
    ],
)
def test_the_best_point_is_feasible_or_violates_least(objectives, violation, best):
    points = np.zeros((len(objectives), 1))
    scores = scored(np.array(objectives)[:, None], violation)
    assert Population(points, scores).best == best


def test_of_each_point_and_its_trial_the_better_survives_and_of_equals_the_trial():
    points = scored([[1], [1], [1], [1]], [0, 0, 0, 0.5])
    tried = scored([[2], [0], [1], [9]], [0, 0, 0, 0])
    assert survivors(points, tried).tolist() == [0, 5, 6, 7]


def test_fronts_are_ranked_one_after_the_other():
    found = ranks(scored([[1, 3], [2, 2], [3, 1], [3, 3], [0, 0]], [0, 0, 0, 0, 0.1]))
    assert found.tolist() == [0, 0, 0, 1, 2]


def test_the_front_is_feasible_in_order_and_without_twins():
    scores = scored([[3, 1], [1, 3], [1, 3], [2, 4], [0, 0]], [0, 0, 0, 0, 0.1])
    assert Population(np.zeros((5, 1)), scores).front.tolist() == [1, 0]


def test_a_crowded_front_is_thinned_where_it_is_dense():
    points = scored([[0, 10], [10, 0], [5, 5]], [0, 0, 0])
    tried = scored([[5.1, 4.9], [5.2, 4.8], [2, 8]], [0, 0, 0])
    kept = set(survivors(points, tried).tolist())
    assert {0, 1} <= kept  # the ends stay
    assert len(kept) == 3
