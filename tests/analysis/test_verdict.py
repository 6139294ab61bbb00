"""The answer that `eqt compare` begins with."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.intervals import Resampling, Word
from eqt_cli.analysis.verdict import answers, lines

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
    """Of a mean of 1, so that a difference is relative; within 1 % there is none."""
    (pair, *_) = compared([spread(1.0), spread(1.0)], [spread(1.0), spread(1.0)]).pairs
    quantity = replace(pair.measured.quantity, better=better)
    pair = replace(pair, measured=replace(pair.measured, quantity=quantity))
    pair = replace(pair, low=low, high=high, relative_low=low, relative_high=high)
    assert pair.word() is expected


def test_the_lines_of_the_answer(compared):
    torque, pose = [spread(2.0), spread(2.5)], [spread(1.0), spread(0.8, width=0.1)]
    found = lines(compared(torque, pose))
    assert found[0] == "B against A"
    assert found[1].startswith("  better: mean ‖I − Q_E‖ −19.2 % [−20.8")
    assert found[2].startswith("  worse: effort +5")
    assert found[-1].startswith("30 runs per law from the same starts; ")


def test_better_in_the_mean_only_is_not_decided(compared):
    """One run in ten is much worse: the mean decides against the law, most runs do not."""
    first = spread(1.0, 40, 0.01)
    second = np.where(np.arange(40) % 4 == 3, 3.0, 0.97 * first)
    of_error = [
        each
        for each in answers(compared([first, first], [first, second]))
        if each.pair.measured.quantity.name == "mean_pose_error"
    ]
    assert [(each.word, each.decided) for each in of_error] == [(Word.WORSE, False)]


def test_a_table_of_pairs_has_the_answer_and_the_word_of_the_row_alone(compared):
    """Worse in the mean and its interval, by few runs: 10 of 40, the rest better."""
    first = spread(1.0, 40, 0.01)
    second = np.where(np.arange(40) % 4 == 3, 3.0, 0.97 * first)
    rows = compared([first, first], [first, second]).records()
    [row] = [each for each in rows if each["metric"] == "mean_pose_error"]
    assert (row["word"], row["answer"]) == ("worse", "undecided")
    # Two-sided, of 40 fair coins at least 30 alike; Holm makes it larger, at most by the tests.
    one = 2 * sum(math.comb(40, k) for k in range(11)) / 2**40
    assert one <= row["adjusted_p"] <= len(rows) * one


def test_few_runs_have_no_statistics(compared):
    few = np.array([[1.0, 1.5], [2.0, 2.5]])
    found = lines(compared(few, few))
    assert found[1] == "  mean ‖I − Q_E‖ +80 % (2.250 against 1.250)"
    assert found[-1] == "2 runs per law: too few for statistics; `ensemble.runs` sets how many"


def test_too_few_runs_for_so_many_numbers_are_said(compared):
    """n runs that all go one way have p = 2/2ⁿ, and Holm's smallest is p times the numbers."""
    torque, pose = [spread(2.0, 5), spread(2.5, 5)], [spread(1.0, 5), spread(0.8, 5, 0.1)]
    comparison = compared(torque, pose)
    tests = sum(each.p_value >= 0 for each in answers(comparison))
    needed = next(n for n in range(1, 99) if tests * 2 / 2**n <= 0.05)
    assert needed > 5
    said = f"5 runs are too few to call any of {tests} numbers better or worse: take {needed} or"
    assert any(line.startswith(said) for line in lines(comparison))


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
        said = answers(compared(*drawn, resamples=99))
        false += any(each.decided and each.word is not Word.ALIKE for each in said)
    assert false <= 26
