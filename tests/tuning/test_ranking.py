"""Which of scored points is better."""

from __future__ import annotations

import numpy as np

from eqt_cli.tuning.ranking import Scores, best_of, first_front, ranks, survivors


def scored(objectives: list[list[float]], violation: list[float]) -> Scores:
    none = np.zeros(len(violation))
    return Scores(np.array(objectives, dtype=float), np.array(violation, dtype=float), none, none)


def test_a_feasible_point_is_better_than_a_lesser_objective() -> None:
    assert best_of(scored([[1], [5], [4]], [0.1, 0, 0])) == 2


def test_of_infeasible_points_the_one_that_violates_least() -> None:
    assert best_of(scored([[1], [5], [4]], [0.3, 0.1, 0.2])) == 1


def test_a_point_without_a_value_is_never_the_best() -> None:
    assert best_of(scored([[np.nan], [5]], [1.0, 0])) == 1


def test_of_each_point_and_its_trial_the_better_survives_and_of_equals_the_trial() -> None:
    points = scored([[1], [1], [1], [1]], [0, 0, 0, 0.5])
    tried = scored([[2], [0], [1], [9]], [0, 0, 0, 0])
    assert survivors(points, tried).tolist() == [0, 5, 6, 7]


def test_fronts_are_ranked_one_after_the_other() -> None:
    found = ranks(scored([[1, 3], [2, 2], [3, 1], [3, 3], [0, 0]], [0, 0, 0, 0, 0.1]))
    assert found.tolist() == [0, 0, 0, 1, 2]


def test_the_front_is_feasible_in_order_and_without_twins() -> None:
    found = first_front(scored([[3, 1], [1, 3], [1, 3], [2, 4], [0, 0]], [0, 0, 0, 0, 0.1]))
    assert found.tolist() == [1, 0]


def test_a_crowded_front_is_thinned_where_it_is_dense() -> None:
    points = scored([[0, 10], [10, 0], [5, 5]], [0, 0, 0])
    tried = scored([[5.1, 4.9], [5.2, 4.8], [2, 8]], [0, 0, 0])
    kept = set(survivors(points, tried).tolist())
    assert {0, 1} <= kept  # the ends stay
    assert len(kept) == 3
