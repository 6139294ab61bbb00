"""Which law wins at which point, on results made up of numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import false_discovery_control, ttest_rel

from eqt_cli.analysis.comparison.intervals import Resampling
from eqt_cli.analysis.comparison.maps import NOBODY, Map, compare_map
from eqt_cli.core.errors import EqtError
from eqt_cli.results.result import Result

RUNS = 20


class Stored(Result):
    """A sweep with numbers ``(points, laws, runs)``; NaN without failure is beyond the horizon."""

    horizon = 100.0
    path = "made-up"

    def __init__(self, values: Any, name: str = "mean_pose_error", failed: Any = None) -> None:
        self.name, self.values = name, np.array(values, dtype=float)
        self.status = np.zeros(self.values.shape, dtype=int)
        if failed is not None:
            self.status[failed] = 1
        self.metrics = [name]
        self.labels = [f"law {k}" for k in range(self.values.shape[1])]
        self.title_of = {label: label for label in self.labels}
        self.dimensions = {"run": self.values.shape[2], "point": len(self.values)}

    def has(self, name: str) -> bool:
        return False

    def units(self, name: str) -> str:
        return ""

    def metric(self, name: str, controller: int | None = None) -> Any:
        values = np.isfinite(self.values) if name == "settled" else self.values
        return np.where(self.good, values, np.nan)


def compared(stored: Stored, confidence: float = 0.95, resamples: int = 999) -> Map:
    return compare_map(stored, stored.name, Resampling(confidence, resamples))


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(5)


def test_the_p_values_are_those_of_paired_t_tests_adjusted_together(
    random: np.random.Generator,
) -> None:
    values = random.normal(10, 1, (7, 2, RUNS)) + np.array([[0], [0.5]])
    raw = [ttest_rel(a, b).pvalue for a, b in values]
    found = [cell.p_value for cell in compared(Stored(values)).cells]
    assert found == pytest.approx(false_discovery_control(raw, method="by"))


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


def test_more_is_better_where_the_metric_says_so(random: np.random.Generator) -> None:
    values = random.normal(0, 0.1, (1, 2, RUNS)) + np.array([[1], [2]])
    (cell,) = compared(Stored(values, "decay_rate")).cells
    assert cell.winner == 1
    assert cell.difference.value > 0


def test_many_points_without_a_difference_have_hardly_a_winner(random: np.random.Generator) -> None:
    """Of 400 tests at 5 %, twenty would be false without adjustment."""
    assert sum(c.wins for c in compared(Stored(random.normal(0, 1, (400, 2, 30)))).cells) == 0


def test_of_two_equal_best_laws_neither_wins_where_a_third_is_worse() -> None:
    """Runs of normal numbers: without the largest p-value of a point, every third map has a win."""
    random = np.random.default_rng(11)
    offsets = np.array([[0], [0], [3], [3]])
    drawn = [random.normal(0, 1, (60, 4, RUNS)) + offsets for _ in range(15)]
    maps = [compared(Stored(values), resamples=9) for values in drawn]
    assert sum(cell.wins for found in maps for cell in found.cells) <= 1


def test_a_law_that_settles_in_no_run_does_not_win(random: np.random.Generator) -> None:
    """That also where only settling times are stored, as of vehicles without limits and noise."""
    values = random.normal(0, 0.1, (2, 2, RUNS)) + np.array([[1], [120]])
    values[0, 0] = np.nan  # the horizon of 100 counts, less than 120
    values[1, 0, 3:] = np.nan
    found = compared(Stored(values, "settling_time"))
    assert [cell.winner for cell in found.cells] == [NOBODY, 0]
    assert [cell.settled for cell in found.cells] == [0, 3]


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
