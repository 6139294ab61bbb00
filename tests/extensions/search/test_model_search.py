"""The search by models on functions whose best points are known, without any run."""

import numpy as np
import pytest
from ci_cases import mostly_ci

from eqt_cli.extensions.search.fronts import Constraint
from eqt_cli.extensions.search.model_search import ModelSearch, Tried, first_points


def wheel(shares):
    """∫x² dt and ∫u² dt of ẍ = u = −k x − d ẋ from x = 1 at rest, in closed form.

    ∫x² = (d² + k)/(2 d k) and ∫ẋ² = k/(2 d); the mixed term is d k ∫(x²)˙ = −d k.
    """
    k, d = 0.1 * 100 ** shares[:, 0], 0.05 * 100 ** shares[:, 1]
    return (d**2 + k) / (2 * d * k), k * (k + d**2) / (2 * d) + d * k / 2 - d * k


def valley(shares):
    """Four gains in a curved valley along which more is spent and less is missed."""
    x = 4 * shares - 2
    across = 0.3 * (x[:, 1] - 0.5 * x[:, 2] ** 2) ** 2 + 0.1 * (x[:, 3] - 0.3) ** 2
    along = -0.25 * x[:, 0] - 0.05 * x.sum(axis=1) + 0.02 * (x[:, 0] - x[:, 1]) ** 2
    return np.exp(across + along), np.exp(x @ [0.7, 0.5, 0.3, 0.2])


def found(judge, axes, bound, lost=None, **more):
    """What a search finds: its points, its best one, how it ended, and its batches."""
    bounds = [] if bound is None else [bound]
    search = ModelSearch(axes, more.pop("budget", 100), bounds, **more)
    steps, batches = search.points(), []
    asked = next(steps)
    while True:
        batches.append(asked)
        costs, spent = judge(asked)
        failed = np.zeros(len(asked)) if lost is None else lost(asked)
        costs = np.where(failed < 1, costs, np.nan)
        measured = (
            np.where(failed < 1, spent, np.nan)[:, None] if bounds else np.empty((len(asked), 0))
        )
        try:
            asked = steps.send(Tried(asked, costs, measured, failed, 0 * failed))
        except StopIteration as end:
            return end.value, batches


def at_most(number):
    return Constraint("effort", number, above=True, every_run=False)


def equal(number):
    return Constraint("effort", number, above=True, every_run=False, equal=True)


def dense(judge, axes, most):
    """The least cost of many points, and then of more about the best one."""
    random = np.random.default_rng(0)
    points, width = random.random((200_000, axes)), 1.0
    while True:
        costs, spent = judge(points)
        best = points[np.where(spent <= most, costs, np.inf).argmin()]
        if width < 1e-3:
            return np.where(spent <= most, costs, np.inf).min()
        width /= 3
        points = np.clip(best + width * (random.random((50_000, axes)) - 0.5), 0, 1)
        points[0] = best


@mostly_ci("number", [0, 1, 4], [1], "another sample is fast")
@pytest.mark.parametrize(("judge", "axes", "bound"), [(wheel, 2, 3.0), (valley, 4, 1.0)])
def test_it_comes_within_a_hundredth_of_a_dense_search_at_equal_effort(judge, axes, bound, number):
    best, _ = found(judge, axes, equal(bound), number=number)
    tried, point = best.tried, best.point
    assert len(tried) <= 100
    assert best.ended == "sure"
    assert tried.costs[point] <= 1.01 * dense(judge, axes, bound)
    assert tried.measured[point, 0] == pytest.approx(bound, rel=0.01)


def cliff(shares):
    """The valley beside a plateau that is up to 55 times as high."""
    costs, spent = valley(shares)
    x = 4 * shares - 2
    return costs * np.exp(4 / (1 + np.exp(-6 * (x[:, 0] - x[:, 1] - 0.3)))), spent


def dear(shares):
    """Whose cost falls with the 40th power of what is spent, which is hardly ever 1.02 or less."""
    away = shares - [0.6, 0.8, 0.3, 0.35]
    spent = 1 + away**2 @ [3.0, 2.0, 1.0, 0.5]
    return spent**-40 * np.exp(away @ [0.0, 1.0, -1.0, 0.5]), spent


@pytest.mark.ci("a second")
@pytest.mark.parametrize(("judge", "bound", "number"), [(cliff, 1.0, 2), (dear, 1.02, 0)])
def test_four_gains_are_found_beside_a_cliff_and_where_little_may_be_spent(judge, bound, number):
    best, _ = found(judge, 4, equal(bound), number=number)
    assert best.tried.costs[best.point] <= 1.01 * dense(judge, 4, bound)


def test_a_bound_is_kept_and_an_equality_met():
    for bound, low, high in ((at_most(3.0), 0.99, 1.0), (equal(3.0), 0.998, 1.001)):
        best, _ = found(wheel, 2, bound)
        assert low <= best.tried.measured[best.point, 0] / 3 <= high


def test_a_slack_bound_ends_the_search_too():
    """With 1e5 to spend, the gains are at the ends of their ranges."""
    best, _ = found(wheel, 2, equal(1e5))
    assert best.ended == "sure"
    assert best.tried.costs[best.point] == pytest.approx(dense(wheel, 2, 1e5), rel=1e-3)


def test_in_a_flat_valley_it_spends_what_is_to_be_spent():
    """The cost has no slope along what is spent, so that less would do, too."""

    def flat(shares):
        return 1 + (shares[:, 1] - 0.4) ** 2, np.exp(3 * shares[:, 0])

    best, _ = found(flat, 2, equal(5.0))
    assert best.tried.measured[best.point, 0] == pytest.approx(5.0, rel=0.01)
    assert best.tried.costs[best.point] <= 1.01


def test_a_law_that_is_worse_with_more_spends_less():
    def inside(shares):
        x, y = shares.T
        return 1 + 5 * ((x - 0.4) ** 2 + (y - 0.4) ** 2), np.exp(x + y)

    best, _ = found(inside, 2, equal(np.exp(1.6)))
    assert best.tried.costs[best.point] == pytest.approx(1, rel=1e-2)
    assert best.tried.measured[best.point, 0] < 0.8 * np.exp(1.6)


@pytest.mark.parametrize(("least", "is_near"), [(1.05, True), (1.3, False)])
def test_a_law_that_cannot_spend_so_little_comes_as_near_as_it_can(least, is_near):
    def dear(shares):
        x, y = shares.T
        return 2 - x, least + (x - 0.3) ** 2 + (y - 0.6) ** 2

    best, _ = found(dear, 2, equal(1.0), budget=40)
    assert (best.point is not None) is is_near
    if is_near:
        assert best.tried.measured[best.point, 0] == pytest.approx(least, rel=1e-3)


def test_points_where_all_runs_fail_teach_where_not_to_go():
    """Half of the square fails; the best point of the rest is on its edge."""

    def lost(shares):
        return np.where(shares[:, 0] + shares[:, 1] > 1.0, 1.0, 0.0)

    def judge(shares):
        x, y = shares.T
        return 2 - x - 0.9 * y + (x - y) ** 2, np.exp(x)

    best, _ = found(judge, 2, at_most(10.0), lost)
    assert best.point is not None
    assert best.tried.lost[best.point] == 0
    points = np.random.default_rng(0).random((100_000, 2))
    least = np.where(lost(points) == 0, judge(points)[0], np.inf).min()
    assert best.tried.costs[best.point] <= 1.03 * least


def test_a_share_of_failed_runs_may_be_allowed():
    def lost(shares):
        return np.clip(shares[:, 0] - 0.5, 0, 1)  # a tenth at 0.6

    def judge(shares):
        return 2 - shares[:, 0] + (shares[:, 1] - 0.5) ** 2, 1 + 0 * shares[:, 0]

    none, _ = found(judge, 2, None, lost)
    some, _ = found(judge, 2, None, lost, allowed=0.1)
    assert none.tried.lost[none.point] == 0
    assert 0.05 < some.tried.lost[some.point] <= 0.1
    assert some.tried.costs[some.point] < none.tried.costs[none.point]


def test_without_any_number_it_looks_on_and_finds_nothing():
    best, _ = found(wheel, 2, at_most(3.0), lambda shares: np.ones(len(shares)), budget=30)
    assert (best.point, best.ended, len(best.tried)) == (None, "budget", 30)


def test_the_start_is_tried_and_no_point_twice():
    best, batches = found(wheel, 2, equal(3.0), start=(0.5, 0.65))
    assert batches[0][0].tolist() == [0.5, 0.65]
    assert len(batches[0]) == 16
    tried = best.tried.shares
    apart = np.linalg.norm(tried[:, None] - tried, axis=-1)[np.triu_indices(len(tried), 1)]
    assert apart.min() >= 1e-4


def test_whole_numbers_are_tried_once_and_then_the_search_is_over():
    def snapped(shares):
        return np.round(shares * 3) / 3

    best, _ = found(wheel, 2, at_most(3.0), snapped=snapped)
    assert len(best.tried) <= 16
    assert best.ended == "sure"
    grid = np.stack(np.meshgrid(*2 * [np.arange(4) / 3], indexing="ij"), axis=-1).reshape(-1, 2)
    costs, spent = wheel(grid)
    assert best.tried.costs[best.point] == np.where(spent <= 3, costs, np.inf).min()


@pytest.mark.parametrize("axes", [1, 2, 3, 4])
def test_each_sample_begins_at_other_points(axes):
    starts = [first_points(axes, 100, number) for number in range(5)]
    assert len({points.tobytes() for points in starts}) == 5
    for points in starts:
        assert ((points >= 0) & (points <= 1)).all()
        assert len(points) == (16 if axes == 2 else 8 * axes)
        near = np.linalg.norm(points[:, None] - points, axis=-1) + np.eye(len(points))
        assert near.min() > 0.01
    assert np.array_equal(starts[3], first_points(axes, 200, 3))
