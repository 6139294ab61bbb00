"""The answer that `eqt compare` begins with."""

import math
import re
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pytest
from said import says

from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.comparison import Comparison, Numbers
from eqt_cli.analysis.comparison_tables import answer_lines, mean_in_words
from eqt_cli.analysis.intervals import Resampling, Word
from eqt_cli.results.metrics import METRICS
from eqt_cli.results.quantity import WHOLE
from eqt_cli.results.result import PerRun

RUNS = 30


@pytest.fixture
def compared(make_result):
    """A comparison of two laws whose pose errors and torques are constant in each run."""

    def of(torque, pose, **how):
        constant = make_result.constant
        signals = {
            "torque_norm": constant(*torque),
            "pose_error": constant(*pose),
            "velocity_error": constant(*pose),
            "lyapunov": constant(*pose),
        }
        metrics = {"mean_pose_error": pose, "early_torque": torque}
        result = make_result(["a", "b"], signals, metrics, units={"torque_norm": "N m"})
        result.title_of = {"a": "A", "b": "B"}
        return compare(result, how=Resampling(**how))

    return of


def spread(mean, runs=RUNS, width=0.2):
    """Numbers around a mean, no two alike."""
    return mean + width * np.sin(np.arange(1.0, runs + 1) ** 2)


@pytest.mark.parametrize(
    ("low", "high", "better", "expected"),
    [
        (-0.05, -0.02, "lower", Word.BETTER),
        (0.02, 0.05, "lower", Word.WORSE),
        (0.02, 0.05, "higher", Word.BETTER),
        (-0.05, 0.02, "lower", Word.UNDECIDED),
        (-0.009, 0.009, "lower", Word.ALIKE),
        (0.002, 0.008, "lower", Word.ALIKE),
        (0.002, 0.012, "lower", Word.WORSE),
        (0.02, 0.05, "neither", Word.UNDECIDED),
        (np.nan, np.nan, "lower", Word.UNDECIDED),
    ],
)
def test_a_pair_is_called_by_one_of_four_words(compared, low, high, better, expected):
    """By the interval of the median; within 1 % there is no difference."""
    comparison = compared([spread(1.0), spread(1.0)], [spread(1.0), spread(1.0)])
    (pair, *_) = comparison.pairs
    quantity = replace(pair.measured.quantity, better=better)
    middle, measured = (low + high) / 2, replace(pair.measured, quantity=quantity)
    pair = replace(pair, measured=measured, median=middle, median_low=low, median_high=high)
    p_value = math.nan if better == "neither" else 0.01
    assert comparison._judged(replace(pair, difference=middle), p_value).word is expected


@pytest.mark.parametrize("counts", [False, True])
def test_a_law_all_of_whose_runs_failed_has_no_mean(compared, counts):
    (level, *_) = compared([spread(1.0), spread(1.0)], [spread(1.0), spread(1.0)]).levels
    quantity = replace(level.measured.quantity, counts=counts)
    measured = replace(level.measured, quantity=quantity)
    assert mean_in_words(replace(level, measured=measured, mean=math.nan)) == "-"


def test_the_lines_of_the_answer(compared):
    torque, pose = [spread(2.0), spread(2.5)], [spread(1.0), spread(0.8, width=0.1)]
    comparison = compared(torque, pose)
    # 30 runs one way have p = 2/2³⁰ = 1.9e-9, of which Holm takes one for each number.
    first, second = comparison.rows()[:2]
    assert (f"{first.adjusted_p:.0e}", f"{second.adjusted_p:.0e}") == ("2e-08", "2e-08")
    base, law, *rest = answer_lines(comparison)
    assert re.fullmatch(r"A: mean ‖I − Q_E‖ [\d.]+, effort [\d.]+ \(N m\)² s", base)
    assert re.fullmatch(r"B: mean ‖I − Q_E‖ −18 % \[−21, −16\] ✓, effort \+5\d % \[.+\] ✗", law)
    assert says(rest[-1], "A: …30 runs…")


def test_better_in_the_mean_only_is_not_decided(compared):
    """One run in four is much worse: most runs are for the law, and their mean against it."""
    first = spread(1.0, 40, 0.01)
    second = np.where(np.arange(40) % 4 == 3, 3.0, 0.97 * first)
    comparison = compared([first, first], [first, second])
    # Two-sided, of 40 fair coins at least 30 alike, times the tests (Holm).
    [pair] = [x for x in comparison.rows() if x.contradicted == "not in the mean"][:1]
    tests = sum(each.adjusted_p >= 0 for each in comparison.rows())
    p = tests * 2 * sum(math.comb(40, k) for k in range(11)) / 2**40
    assert pair.adjusted_p == pytest.approx(p)
    said = answer_lines(comparison)
    assert said[1].startswith("B: mean ‖I − Q_E‖ −3 % [−3, −3] ?, effort ")
    assert "B: mean ‖I − Q_E‖ better in 30 of 40, but not in the mean" in said
    [row] = [each for each in comparison.records() if each["metric"] == "mean_pose_error"]
    assert (row["word"], row["adjusted_p"]) == ("undecided", pytest.approx(p))
    assert [row["median_low"], row["median_high"]] == pytest.approx([-0.03, -0.03])


def test_more_runs_than_those_of_the_other_law_are_not_most_runs(compared):
    """Of 100 runs 60 are equal: 32 of the 40 others are no majority, though p = 2e-4 among them."""
    first = spread(1.0, 100, 0.01)
    second = first * np.repeat([1.0, 0.9, 1.1], [60, 32, 8])  # the median is 0
    said = compared([first, first], [first, second]).rows()
    assert {each.word for each in said} == {Word.ALIKE}


FALSE = {
    "normal": (lambda random, size: random.normal(size=size), 0.0),
    "lognormal, σ = 2": (lambda random, size: random.lognormal(0, 2, size), 1.0),
    "exponential": (lambda random, size: random.exponential(size=size), math.log(2)),
    "one run in 20 is bad": (
        lambda random, size: np.where(
            random.random(size) < 0.05, 20.0, 0.2 * random.normal(size=size)
        ),
        0.2 * NormalDist().inv_cdf(0.5 / 0.95),
    ),
    "two values": (
        lambda random, size: random.choice([-1, 1], size) + 0.2 * random.normal(size=size),
        0.0,
    ),
    "Cauchy": (lambda random, size: random.standard_cauchy(size), 0.0),
}
"""Distributions of the difference of two laws, with their medians."""


NOT_READ = ("title", "group", "titles", "runs", "kinds", "horizon", "missing", "sentences")
"""Fields of a comparison that its words do not need."""


def words_of(quantity, first, second):
    """The word for each row of runs, as in an answer about this number alone."""
    good, more = np.ones((2, first.shape[1]), dtype=bool), dict.fromkeys(NOT_READ)
    for values in zip(second, first, strict=True):
        measured = PerRun(quantity, WHOLE, "1", np.array(values), ~good, good.shape[1])
        numbers = Numbers(["b", "a"], good, [measured], Resampling(resamples=1))
        failed = {"a": 0, "b": 0}
        compared = Comparison(**more, labels=["b", "a"], failed=failed, numbers=numbers, shown=1)
        [pair] = compared.rows()
        yield pair.word


@pytest.mark.ci("8,000 comparisons")
@pytest.mark.parametrize("column", [0, 1])
@pytest.mark.parametrize("name", FALSE)
def test_the_documentation_says_how_often_words_are_false(name, column):
    """Of two laws of which neither is better in most runs; and that differ by 1.01 % in them.

    The other columns are of the same lines, and take as long.
    """
    (draw, median), runs = FALSE[name], [8, 20, 60, 200][column]
    [effort] = (quantity for quantity in METRICS if quantity.name == "effort")
    random = np.random.default_rng(runs)
    base = 1 + 0.01 * random.normal(size=(4000, runs))
    drawn = draw(random, base.shape) - median
    even = [*words_of(effort, base * (1 + 0.05 * drawn), base)]
    apart = [*words_of(effort, base * (1.0101 + 0.0025 * drawn), base)]
    false = sum(word in (Word.BETTER, Word.WORSE) for word in even)
    page = Path(__file__).parents[2] / "docs/explanation/statistics.md"
    section = page.read_text("utf-8").split("\n## Intervals")[0]  # later tables have this row, too
    [row] = [x for x in section.splitlines() if x.startswith(f"| {name} |")]
    cell = row.split("|")[2 + column].strip()
    assert cell == f"{false / 40:.1f}, {apart.count(Word.ALIKE) / 40:.1f}"


def test_few_runs_have_no_statistics(compared):
    few = np.array([[1.0, 1.5], [2.0, 2.5]])
    found = answer_lines(compared(few, few))
    assert found[1].startswith("B: mean ‖I − Q_E‖ +80 %, ")
    assert found[-1] == "2 runs per law: too few for statistics; `ensemble.runs` sets how many"


def test_too_few_runs_for_so_many_numbers_are_said(compared):
    """n runs that all go one way have p = 2/2ⁿ, and Holm's smallest is p times the numbers."""
    torque, pose = [spread(2.0, 5), spread(2.5, 5)], [spread(1.0, 5), spread(0.8, 5, 0.1)]
    comparison = compared(torque, pose)
    tests = sum(each.adjusted_p >= 0 for each in comparison.rows())
    needed = next(n for n in range(1, 99) if tests * 2 / 2**n <= 0.05)
    assert needed > 5
    said = f"5 runs…{tests} comparisons…{needed} or more…ensemble.runs={needed}…"
    assert any(says(line, said) for line in answer_lines(comparison))


@pytest.mark.ci("compares 300 times")
def test_where_no_law_is_better_few_answers_say_so(compared):
    """Whole runs of both laws are exchanged at random: false words in at most 5 % of comparisons.

    Of 300, at most 15 + 3 √(300 · 0.05 · 0.95) = 26.
    """
    random = np.random.default_rng(5)
    torque, pose = random.lognormal(0, 1, (2, 2, 20))
    false = 0
    for _ in range(300):
        swap = random.random(20) < 0.5
        drawn = (np.where(swap, each[::-1], each) for each in (torque, pose))
        said = compared(*drawn, resamples=99).rows()
        false += any(each.word in (Word.BETTER, Word.WORSE) for each in said)
    assert false <= 26
