"""Samples that exchange their best points, and numbers of laws that can be absent."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from eqt_cli.api.loading import document_from
from eqt_cli.base.errors import ConfigError
from eqt_cli.extensions.search.exchanges import ending, larger, rounds_of
from eqt_cli.extensions.search.model_search import Tried
from eqt_cli.extensions.search.training import Training, _course
from eqt_cli.extensions.search.tune import Search

CONFIG = {
    "name": "t",
    "group": "SO3",
    "inertia": [2, 1, 3],
    "gains": {"kp": 2.0, "kd": 0.5},
    "reference": {"torque": ["0", "0", "0"]},
    "controllers": [{"kind": "goodarzi2013", "c2": 0.5, "ki": 0.2}],
    "initial": {"pose": "haar"},
    "ensemble": {"runs": 2, "seed": 1},
    "time": {"duration": 1, "samples": 6},
}
OVER = {
    "gains.kp": {"log": [0.1, 10]},
    "gains.kd": {"log": [0.1, 10]},
    "controllers[0].ki": {"log": [0.01, 1], "times": "kp", "off": 0},
}


def search(**changes):
    tune = {"over": OVER, "objective": "mean_pose_error", "equal": {"effort": 1.0}} | changes
    return Search.read(document_from(CONFIG | {"tune": tune}, {}))


def searched(one, judge):
    """What is found on each sample where a function says how good points are."""
    keys = {sample: Training(one.laws[0], sample) for sample in one.samples}
    with threadpool_limits(1):
        return driven(_course(one, keys, {}), judge)


def driven(course, judge):
    answers = None
    while True:
        try:
            asked = course.send(answers)
        except StopIteration as stopped:
            return stopped.value
        answers = {}
        for sample, points in asked.items():
            costs, spent = judge(points, sample)
            none = np.zeros(len(points))
            answers[sample] = Tried(points, costs, spent[:, None], none, none)


def bowl(points, sample):
    """Costs of a bowl, the same on all samples."""
    away = points - np.array([0.31, 0.72, 0.4])
    costs = 1 + (away**2) @ [3.0, 5.0, 1.0]
    return costs, 0.5 + 0.1 * points[:, 0]


def test_an_absent_number_is_at_the_end_of_its_range_and_others_are_multiples():
    (law,) = search().laws
    assert law.values([0.5, 0.5, 0.0]) == {
        "gains.kp": pytest.approx(1.0),
        "gains.kd": pytest.approx(1.0),
        "controllers[0].ki": 0.0,
    }
    assert law.values([1.0, 0.5, 0.5])["controllers[0].ki"] == pytest.approx(10 * 0.1)
    assert law.start[2] == pytest.approx(0.5)  # 0.2 is a tenth of kp
    assert (law.optional, law.contained) == ((2,), 2)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"log": [0.01, 1], "times": "kq"}, "times: expected another number of this law"),
        ({"log": [0.01, 1], "times": "ki"}, "times: expected another number of this law"),
    ],
)
def test_a_number_that_is_no_multiple_of_another_is_refused(changed, expected):
    with pytest.raises(ConfigError, match=expected):
        search(over=OVER | {"controllers[0].ki": changed})


@pytest.mark.ci("a second of models")
def test_samples_end_where_the_best_of_them_is_and_say_what_they_gained():
    found = searched(search(budget=50, samples=3), bowl)
    assert [*found] == [1, 2, 3]
    for best in found.values():
        assert best.tried.costs[best.point] <= 1.001
        assert best.gained <= 0.005
    again = searched(search(budget=50, samples=3), bowl)
    assert all(np.array_equal(again[k].tried.shares, found[k].tried.shares) for k in found)


def test_a_search_of_too_few_points_does_not_say_how_far_it_is():
    """Each sample has its start alone, which the others confirm, and it is far from the best."""
    found = searched(search(budget=1, samples=3), bowl)
    assert all(best.tried.costs[best.point] > 1.005 for best in found.values())
    assert [best.gained for best in found.values()] == [None] * 3
    few = "search not finished: EqT has too few points for 3 numbers; set tune.budget to 100"
    assert ending("EqT", [None] * 3, 49, 3) == few
    assert ending("EqT", [0.0] * 3, 50, 3) == ""


def test_two_samples_exchange_nothing():
    found = searched(search(budget=20, samples=2), bowl)
    assert [best.gained for best in found.values()] == [None, None]


@pytest.mark.ci("a second of models")
def test_a_law_is_never_worse_than_the_one_that_it_contains():
    """A number whose presence costs 0.3 is left out, though its range never reaches 0."""

    def costly(points, sample):
        costs, spent = bowl(points, sample)
        return costs + 0.3 * (points[:, 2] > 0), spent

    for best in searched(search(budget=20, samples=3), costly).values():
        assert best.tried.shares[best.point, 2] == 0


@pytest.mark.ci("a second of models")
def test_a_sample_without_any_point_within_its_bound_takes_over_one_of_another():
    """On sample 2, only points near the best one of the others spend little enough."""

    def narrow(points, sample):
        away = np.abs(points - [0.31, 0.72]).max(axis=1)
        costs, spent, near = 1 + away**2, 0.5 + 0 * away, away < 0.02
        return costs, np.where(near | (sample != 2), spent, 2.0)

    over = {key: OVER[key] for key in ("gains.kp", "gains.kd")}
    found = searched(search(budget=20, samples=3, over=over), narrow)
    assert found[2].point is not None
    assert found[2].tried.costs[found[2].point] <= 1.005


def test_a_larger_budget_has_a_further_exchange():
    for budget in (20, 60, 100, 150):
        assert rounds_of(larger(budget)) == rounds_of(budget) + 1
        assert rounds_of(larger(budget) - 1) == rounds_of(budget)
