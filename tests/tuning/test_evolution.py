"""Searches on functions whose best points are known, without any run."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import differential_evolution

from eqt_cli.core.arrays import Array
from eqt_cli.tuning.evolution import Population, first_points, generator, selected, trials
from eqt_cli.tuning.ranking import Scores

KEYS = ["gains.kp", "gains.kd"]

Judged = Callable[[Array], Scores]


def scored(objectives: Array, violation: Array | None = None) -> Scores:
    none = np.zeros(len(objectives))
    return Scores(objectives, none if violation is None else violation, none, none)


def searched(judge: Judged, dimensions: int, generations: int, count: int = 32) -> Population:
    shares = first_points(count, KEYS[:dimensions], None, 3)
    population = Population(shares, judge(shares))
    for number in range(1, generations):
        shares = trials(population, generator(3, "f", number))
        population = selected(population, Population(shares, judge(shares)))
    return population


def rosenbrock(shares: Array) -> Array:
    x, y = (4 * shares - 2).T
    found: Array = (1 - x) ** 2 + 100 * (y - x**2) ** 2
    return found


def test_it_comes_as_close_as_the_search_of_scipy() -> None:
    def batch(shares: Array) -> Array:
        return rosenbrock(shares.T)

    start = first_points(32, KEYS, None, 3)
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


def test_the_best_feasible_point_on_the_edge_of_a_constraint() -> None:
    def judge(shares: Array) -> Scores:
        x, y = shares.T
        outside = np.maximum((x - 0.3) ** 2 + (y - 0.3) ** 2 - 0.04, 0)
        return scored((x + y)[:, None], outside)

    population = searched(judge, 2, 60)
    found = population.shares[population.best]
    assert population.scores.feasible[population.best]
    assert found == pytest.approx(0.3 - 0.2 / np.sqrt(2), abs=1e-3)


def test_a_front_is_found_as_a_whole() -> None:
    """Of x² and (x − 2)² over [−4, 6], the front is x in [0, 2]: √f₁ + √f₂ = 2."""

    def judge(shares: Array) -> Scores:
        x = 10 * shares[:, 0] - 4
        return scored(np.stack([x**2, (x - 2) ** 2], axis=1))

    population = searched(judge, 1, 30)
    front = population.scores.objectives[population.front]
    assert np.sqrt(front).sum(axis=1) == pytest.approx(2, abs=0.01)  # the ends are beyond it
    assert len(front) == 32
    assert np.diff(np.sqrt(front[:, 0])).max() < 0.2  # without a large gap


def test_a_generation_depends_on_seed_name_and_number_only() -> None:
    shares = first_points(8, KEYS, None, 1)
    population = Population(shares, scored(rosenbrock(shares)[:, None]))
    again = trials(population, generator(1, "eqt", 5))
    assert np.array_equal(trials(population, generator(1, "eqt", 5)), again)
    for other in (generator(2, "eqt", 5), generator(1, "gt", 5), generator(1, "eqt", 6)):
        assert not np.array_equal(trials(population, other), again)


def test_trials_that_leave_the_box_are_drawn_anew_or_become_its_ends() -> None:
    shares = np.array([[0.0], [0.1], [0.9], [1.0], [0.95]])
    population = Population(shares, scored(-shares))  # the best is at the end
    drawn, kept = (trials(population, generator(1, "eqt", 5), ends) for ends in (False, True))
    assert not (drawn == 1).any()
    assert (kept[drawn != kept] % 1 == 0).all()
    assert (kept == 1).sum() >= 1


def test_the_start_is_among_the_first_points() -> None:
    shares = first_points(8, KEYS, (0.25, 0.5), 1)
    assert shares[0].tolist() == [0.25, 0.5]
    assert ((shares >= 0) & (shares <= 1)).all()


def test_laws_start_from_the_same_values_of_the_keys_that_they_share() -> None:
    shares = first_points(8, KEYS, None, 1)
    more = first_points(8, ["controllers[0].slope", *KEYS], None, 1)
    assert np.array_equal(more[:, 1:], shares)
    for column in more.T:  # a Latin hypercube: one value in each eighth
        assert sorted((8 * column).astype(int)) == list(range(8))
    assert not np.array_equal(first_points(8, KEYS, None, 2), shares)
