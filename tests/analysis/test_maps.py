"""Which law wins at which point, on results made up of numbers."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from case_tables import in_ci
from scipy.stats import binomtest

from eqt_cli.analysis.intervals import Resampling
from eqt_cli.analysis.maps import NOBODY, Map, _notes, compare_map
from eqt_cli.extend import EqtError
from eqt_cli.results.result import Result

RUNS = 20


class Stored(Result):
    """A sweep with numbers ``(points, laws, runs)``; NaN without failure is beyond the horizon."""

    horizon = 100.0
    path = "made-up"
    attributes: ClassVar[Any] = {}
    arrived: Any = None

    def __init__(self, values: Any, name: str = "mean_pose_error", failed: Any = None) -> None:
        self.name, self.values = name, np.array(values, dtype=float)
        self.status = np.zeros(self.values.shape, dtype=int)
        if failed is not None:
            self.status[failed] = 1
        self.metrics = [name, *(["settled"] if name == "settling_time" else [])]
        self.labels = [f"law {k}" for k in range(self.values.shape[1])]
        self.title_of = {label: label for label in self.labels}
        self.dimensions = {"run": self.values.shape[2], "point": len(self.values)}

    def has(self, name: str) -> bool:
        return False

    def units(self, name: str) -> str:
        return ""

    def metric(self, name: str, controller: int | None = None) -> Any:
        settled = np.isfinite(self.values) if self.arrived is None else self.arrived
        values = settled if name == "settled" else self.values
        return np.where(self.good, values, np.nan)


def compared(stored: Stored, confidence: float = 0.95, resamples: int = 999) -> Map:
    return compare_map(stored, stored.name, Resampling(confidence, resamples))


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(5)


def test_the_p_values_are_those_of_sign_tests_times_the_points(random: np.random.Generator) -> None:
    values = random.normal(10, 1, (7, 2, RUNS)) + np.array([[0], [0.5]])
    values[3, :, :4] = 1.0  # ties speak for neither law
    most = [max(np.sum(a < b), np.sum(a > b)) for a, b in values]
    one_sided = [binomtest(each, RUNS, alternative="greater").pvalue for each in most]
    found = [cell.p_value for cell in compared(Stored(values)).cells]
    assert found == pytest.approx(np.minimum(1, 7 * 2 * np.array(one_sided)))


NULLS = {
    "normal": lambda random, shape: random.normal(0, 1, shape),
    "lognormal": lambda random, shape: random.lognormal(0, 2, shape),
    "skewed": lambda random, shape: np.stack(
        [random.exponential(1, shape[::2]), np.full(shape[::2], np.log(2))], axis=1
    ),
    "5 % failures": lambda random, shape: np.where(
        random.random(shape) < 0.05, np.nan, random.normal(0, 1, shape)
    ),
    "30 % ties": lambda random, shape: np.where(
        random.random(shape[::2])[:, None] < 0.3, 1.0, random.normal(0, 1, shape)
    ),
}
"""Values of two laws of which each is better with probability ½; of the skewed ones, not in the
mean."""


@pytest.mark.parametrize(
    ("null", "runs"),
    [
        in_ci(
            "others are fast",
            null,
            runs,
            unless=(null, runs) in (("skewed", 10), ("5 % failures", 50)),
        )
        for null in NULLS
        for runs in (10, 50, 200)
    ],
)
def test_maps_without_a_better_law_have_few_false_wins(null: str, runs: int) -> None:
    """Of 100 maps, 13 are beyond 5 % with a probability of 0.15 %; by t-tests, up to all."""
    random, false = np.random.default_rng(3), 0
    for _ in range(100):
        values = NULLS[null](random, (25, 2, runs))
        stored = Stored(values, failed=np.isnan(values))
        found = compare_map(stored, stored.name, Resampling(), intervals=False)
        false += any(cell.winner != NOBODY for cell in found.cells)
    assert false < 13


def test_a_law_that_is_better_in_nearly_all_runs_wins_nearly_all_points(
    random: np.random.Generator,
) -> None:
    better = random.random((25, 1, 20)) < 0.95
    values = np.concatenate([np.where(better, 0.9, 1.1), np.ones((25, 1, 20))], axis=1)
    assert compared(Stored(values), resamples=9).wins(0) >= 24


def test_a_law_that_is_better_in_most_runs_but_not_in_the_mean_does_not_win() -> None:
    """Nineteen runs are a little better, one is much worse."""
    values = np.ones((1, 2, RUNS))
    values[0, 0] = [0.9] * (RUNS - 1) + [9.0]
    found = compared(Stored(values))
    (cell,) = found.cells
    assert (cell.winner, cell.best, cell.in_most_runs) == (NOBODY, 1, 0)
    assert found.verdict(cell) == "law 0 in most runs, law 1 in the mean"


def test_a_law_that_is_better_in_most_runs_but_fails_does_not_win() -> None:
    values = np.array([[[0.9] * RUNS, [1.0] * RUNS]])
    found = compared(Stored(values, failed=np.s_[0, 0, :2]))
    (cell,) = found.cells
    assert (cell.winner, cell.best, cell.in_most_runs) == (NOBODY, 1, 0)
    assert found.verdict(cell) == "law 0 in most runs, but law 1 fails less"


@pytest.mark.parametrize(("points", "fewest"), [(1, 6), (25, 10), (100, 12)])
def test_too_few_runs_are_said(points: int, fewest: int) -> None:
    """All runs alike give p = 2^(1-n), which is multiplied by the number of points."""
    for runs, wins in ((fewest - 1, 0), (fewest, points)):
        values = np.tile([[1.0], [2.0]], (points, 1, runs))
        found = compared(Stored(values), resamples=9)
        assert (found.fewest, found.wins(0)) == (fewest, wins)
        assert found.verdict(found.cells[0]) == ("law 0" if wins else "too few runs")


def test_a_law_wins_only_where_it_is_better_than_every_other(random: np.random.Generator) -> None:
    start = random.normal(10, 1, RUNS)
    noise = random.normal(0, 0.1, (2, 3, RUNS))
    values = start + noise + np.array([[[0], [1], [1]], [[0], [0], [1]]])
    found = compared(Stored(values), confidence=0.99)
    assert [cell.winner for cell in found.cells] == [0, NOBODY]
    assert [found.wins(law) for law in range(3)] == [1, 0, 0]
    cell = found.cells[0]
    assert cell.difference.low < cell.difference.value < cell.difference.high < -0.9
    assert cell.lead.value == pytest.approx(-1 / 11, rel=0.1)
    assert cell.lead.low < cell.lead.value < cell.lead.high < 0


def test_a_median_within_one_per_cent_is_no_difference(random: np.random.Generator) -> None:
    start = random.normal(10, 1, (2, 1, RUNS))
    values = start * np.array([[[1.0], [1.001]], [[1.0], [1.1]]])
    found = compared(Stored(values))
    assert [found.verdict(cell) for cell in found.cells] == ["no difference", "law 0"]


def test_more_is_better_where_the_metric_says_so(random: np.random.Generator) -> None:
    values = random.normal(0, 0.1, (1, 2, RUNS)) + np.array([[1], [2]])
    (cell,) = compared(Stored(values, "decay_rate")).cells
    assert cell.winner == 1
    assert cell.difference.value > 0


def test_of_two_equal_best_laws_neither_wins_where_a_third_is_worse() -> None:
    """Runs of normal numbers: without the largest p-value of a point, every third map has a win."""
    random = np.random.default_rng(11)
    offsets = np.array([[0], [0], [3], [3]])
    drawn = [random.normal(0, 1, (60, 4, RUNS)) + offsets for _ in range(15)]
    maps = [compared(Stored(values), resamples=9) for values in drawn]
    assert sum(cell.winner != NOBODY for found in maps for cell in found.cells) <= 1


def test_a_law_that_does_not_settle_is_not_ranked_where_others_settle(
    random: np.random.Generator,
) -> None:
    """That also where only settling times are stored, as of vehicles without limits and noise."""
    values = random.normal(0, 0.1, (2, 2, RUNS)) + np.array([[1], [120]])
    values[0, 0] = np.nan  # the horizon of 100 counts, less than 120
    values[1, 0, 3:] = np.nan
    found = compared(Stored(values, "settling_time"))
    assert [cell.winner for cell in found.cells] == [1, 0]
    assert [cell.unranked for cell in found.cells] == [(True, False), (False, False)]
    said = "\n".join(_notes(found))
    assert "Points at which a law is not ranked, and loses: law 0 1; more than 10 % of its" in said
    assert "fewer settle where another law settles in 90 %." in said


def test_errors_need_no_settled_runs(random: np.random.Generator) -> None:
    """A law wins where no law settles, and one that fails in most runs is not ranked."""
    values = random.normal(0, 0.1, (2, 2, RUNS)) + np.array([[1], [2]])
    stored = Stored(values, failed=np.s_[1, 0, :3])
    stored.metrics = ["settled", "mean_pose_error"]
    stored.arrived = np.zeros(values.shape)
    found = compared(stored)
    assert [cell.winner for cell in found.cells] == [0, NOBODY]
    assert [cell.unranked for cell in found.cells] == [(False, False), (True, False)]


def test_equal_laws_do_not_win(random: np.random.Generator) -> None:
    same = np.repeat(random.normal(10, 1, (1, 1, RUNS)), 2, axis=1)
    (cell,) = compared(Stored(same)).cells
    assert (cell.winner, cell.p_value, cell.difference.value) == (NOBODY, 1.0, 0.0)


def test_the_survivors_of_a_law_do_not_win(random: np.random.Generator) -> None:
    values = random.normal(0, 0.1, (1, 2, RUNS)) + np.array([[1], [9]])
    failed = np.s_[0, 0, :3]
    (cell,) = compared(Stored(values, failed=failed)).cells
    assert cell.best == 1
    assert cell.failed == (3, 0)


def test_a_run_that_does_not_settle_counts_with_the_horizon(random: np.random.Generator) -> None:
    """Law 0 settles sooner where it settles; but only in one run of twenty."""
    values = random.normal(0, 0.1, (1, 2, RUNS)) + np.array([[1], [5]])
    values[0, 0, 1:] = np.nan
    (cell,) = compared(Stored(values, "settling_time")).cells
    assert cell.winner == 1
    assert cell.censored == (RUNS - 1, 0)


def test_one_law_is_no_comparison() -> None:
    with pytest.raises(EqtError, match="a map needs at least two laws, and this result has one"):
        compared(Stored(np.ones((2, 1, RUNS))))
