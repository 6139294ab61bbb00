"""Ratios of tuned laws: what samples and held-out runs leave open."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from eqt_cli.analysis.intervals import Word
from eqt_cli.extensions.search.ratios import (
    endings,
    joined,
    ratio,
    ratios,
    sentences,
    unequal,
    worse_than_started,
)
from eqt_cli.results.metrics import QUANTITIES

METRIC = "mean_pose_error"


def tuned(label, count):
    labels = [label, *(f"{label}, sample {k}" for k in range(2, count + 1))]
    one = {"measured": [50.0], "gained": 0.0, "values": {"gains.kp": 2.0}}
    searches = [{"sample": k + 1, "label": each} | one for k, each in enumerate(labels)]
    over = {"gains.kp": [0.1, 10.0]}
    return {"label": label, "over": over, "winners": [{"label": label}], "searches": searches}


def compared(first, second):
    """A result and a record of two laws a and b with the runs ``(samples, runs)`` of each."""
    laws = [tuned("a", len(first)), tuned("b", len(second))]
    values = np.concatenate([first, second])
    result = SimpleNamespace(
        labels=[search["label"] for law in laws for search in law["searches"]],
        counted=lambda name: values,
        quantity=lambda name: QUANTITIES[name],
    )
    return result, {"laws": laws, "objectives": [METRIC], "constraints": []}


def test_without_noise_of_the_runs_it_is_students_interval_over_samples():
    numbers = np.array([0.1, 0.2, 0.4, 0.25, 0.3])
    low, high = stats.t.interval(0.95, 4, numbers.mean(), stats.sem(numbers))
    assert joined(numbers, np.zeros(9), 0.95) == pytest.approx((numbers.mean(), low, high))


def test_without_noise_of_the_samples_it_is_students_interval_over_runs():
    runs = np.random.default_rng(1).normal(size=30)
    runs -= runs.mean()
    low, high = stats.t.interval(0.95, 29, 0.1, stats.sem(runs))
    assert joined(np.full(5, 0.1), runs, 0.95) == pytest.approx((0.1, low, high))
    assert joined(np.array([0.1]), runs, 0.95) == pytest.approx((0.1, low, high))


def test_both_noises_are_joined_as_by_welch():
    """As scipy's test of two independent means, of which one is each part."""
    random = np.random.default_rng(2)
    samples, runs = random.normal(size=5), random.normal(size=20)
    runs -= runs.mean()
    welch = stats.ttest_ind(samples, runs, equal_var=False).confidence_interval(0.95)
    assert joined(samples, runs, 0.95)[1:] == pytest.approx(tuple(welch))


@pytest.mark.parametrize(("spread", "between"), [(0.3, 0.0), (0.3, 0.05), (0.1, 0.2)])
def test_the_interval_covers_the_ratio_in_95_of_100(spread, between):
    """Runs differ by a factor, which both laws share in half, and samples by another one."""
    random, covered, count = np.random.default_rng(3), 0, 400
    for _ in range(count):
        runs = np.exp(spread * random.normal(size=(3, 60)))
        samples = np.exp(between * random.normal(size=(5, 1)))
        a, b = samples * runs[0] * runs[1] * np.ones((5, 1)), 1.0 * runs[0] * runs[2]
        one = ratio(*_pair(a, np.broadcast_to(b, a.shape)), METRIC)
        covered += one.low <= 1 <= one.high
    # 3 standard deviations of 400 trials; Welch's interval is on the safe side with five samples
    assert covered / count >= 0.95 - 3 * math.sqrt(0.95 * 0.05 / count)


def _pair(a, b):
    result, record = compared(a, b)
    return result, *record["laws"]


RUNS = np.exp(0.1 * np.random.default_rng(4).normal(size=(5, 40)))


@pytest.mark.parametrize(
    ("factor", "samples", "word"),
    [
        (0.8, 5, Word.BETTER),
        (1.25, 5, Word.WORSE),
        (0.8, 2, Word.UNDECIDED),  # with fewer than three samples, no law is called better
        (1.0, 5, Word.ALIKE),
        (0.8, 3, Word.BETTER),
    ],
)
def test_the_word_follows_from_the_interval(factor, samples, word):
    one = ratio(*_pair(factor * RUNS[:samples], RUNS[:samples]), METRIC)
    assert one.word is word
    assert one.value == pytest.approx(factor)
    assert one.samples == samples


def test_of_a_law_whose_search_is_not_finished_nothing_is_said_but_that():
    result, record = compared(0.8 * RUNS, RUNS)
    record |= {"samples": 5, "budget": 100}
    for gained, is_finished in ((0.004, True), (0.021, False), (None, False)):
        record["laws"][1]["searches"][3]["gained"] = gained
        [pair] = ratios(result, record, [METRIC])
        assert pair.verdict == ("worse" if is_finished else "search not finished")
        assert ("a is better than b" in sentences(result, [pair], 5)[0]) is is_finished
        assert bool(endings(record)) is not is_finished
    record["laws"][1]["searches"][3]["gained"] = 0.021
    assert endings(record) == [
        "Search not finished: b gained 2.1 % in its last exchange between samples; "
        "tune.budget: 140 would go on."
    ]
    # Two samples exchange nothing, and decide nothing; a law as it is has no search.
    assert endings(record | {"samples": 2}) == []
    record["laws"][1]["over"] = {}
    assert ratios(result, record, [METRIC])[0].verdict == "worse"


def test_a_tuned_law_that_is_worse_than_its_start_says_so():
    result, record = compared(RUNS, 1.2 * RUNS)
    a, b = record["laws"]
    for law, start in ((a, "b"), (b, "a, sample 2")):
        law["start"] = start
    [line] = worse_than_started(result, record)
    assert line.startswith("b is WORSE at its tuned gains than at its starting gains: +20")


def test_a_sentence_gives_the_better_law_and_by_how_much_it_is_better():
    for factor in (0.8, 1.25):
        result, record = compared(factor * RUNS, RUNS)
        said = sentences(result, ratios(result, record, [METRIC]), 5)
        better, worse = ("a", "b") if factor < 1 else ("b", "a")
        assert f"{better} is better than {worse} (−20" in said[0]


def test_samples_that_contradict_each_other_decide_nothing():
    swing = np.array([0.7, 1.3, 0.8, 1.2, 0.9])[:, None]
    assert ratio(*_pair(swing * RUNS, RUNS), METRIC).word is Word.UNDECIDED


def test_a_mean_and_a_median_run_that_disagree_are_both_said():
    """A law that is a tenth worse in most runs, and far better in the hardest ones."""
    hard = np.where(np.arange(40) % 4 == 0, 20.0, 1.0)
    a = np.where(hard > 1, 0.5, 1.1) * hard * np.ones((5, 1))
    result, record = compared(a, hard * np.ones((5, 1)))
    [pair] = ratios(result, record, [METRIC])
    assert (pair.first, pair.second) == ("b", "a")  # the later law against the earlier one
    assert pair.disagrees
    assert pair.median == pytest.approx(1 / 1.1)
    assert pair.value == pytest.approx(230 / (33 + 100))
    result.quantity = lambda name: QUANTITIES[name]
    text = " ".join(sentences(result, [pair], 5))
    assert "disagree" in text and "which was tuned" in text and "−9.1 %" in text


def test_runs_without_a_number_leave_the_pair():
    a, b = RUNS.copy(), RUNS.copy()
    a[2, 7] = np.nan
    one = ratio(*_pair(a, b), METRIC)
    assert one.runs == 39
    assert ratio(*_pair(a * np.nan, b), METRIC).word is Word.UNDECIDED


def test_a_sample_that_found_no_gains_leaves_the_pair():
    result, record = compared(0.8 * RUNS, RUNS)
    record["laws"][0]["searches"][1]["label"] = None
    one = ratio(result, *record["laws"], METRIC)
    assert (one.samples, one.word) == (4, Word.BETTER)


def test_a_law_that_spends_less_is_named():
    law = tuned("gt", 3)
    record = {"laws": [law], "constraints": [{"metric": "effort", "bound": 50.0, "equal": True}]}
    assert unequal(record) == []
    law["searches"][1]["measured"] = [40.0]
    [line] = unequal(record)
    assert line.startswith("GT spends 0.80 to 1.00 of effort 50: its error is no lower with more")
    law["searches"][0]["values"] = {"gains.kp": 9.99}
    assert "its ranges hold no gains that spend more (kp at the upper end)" in unequal(record)[0]
    law["searches"][1]["gained"] = 0.02
    assert "its search is not finished" in unequal(record)[0]
    law["searches"][1]["measured"] = [52.0]
    [line] = unequal(record)
    assert line.startswith("GT spends 1.00 to 1.04 of effort 50: no gains in its ranges spend less")
