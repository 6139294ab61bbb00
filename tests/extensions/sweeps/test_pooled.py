"""One answer over all points of a sweep, against sums by hand and synthetic experiments."""

import json
import math

import numpy as np
import pytest
from said import says

from eqt_cli.analysis.intervals import Interval, Resampling, Word
from eqt_cli.extensions.sweeps.pooled import beside_1, interval, is_drawn, logs_of, word_of
from eqt_cli.results.metrics import quantity_of
from eqt_cli.results.result import open_result

HOW = Resampling(0.95, 999, 0)


@pytest.mark.ci("imports scipy.stats")
def test_the_interval_of_drawn_points_is_students_with_both_variances():
    logs = np.random.default_rng(0).normal(size=(6, 9))
    from scipy.stats import t

    points, runs = logs.mean(axis=1), logs.mean(axis=0)
    parts = points.var(ddof=1) / 6, runs.var(ddof=1) / 9
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / 5 + parts[1] ** 2 / 8)
    half = t.ppf(0.975, freedom) * math.sqrt(sum(parts))
    expected = logs.mean(), logs.mean() - half, logs.mean() + half
    np.testing.assert_allclose(interval(logs, HOW, drawn=True), expected, rtol=1e-12)


def test_runs_with_all_their_points_are_what_a_grid_draws():
    runs = np.random.default_rng(0).normal(size=9)
    one = interval(runs[None], HOW, drawn=False)
    # Equal points add nothing; points that differ by a constant neither.
    many = interval(runs + np.arange(5.0)[:, None] - 2, HOW, drawn=False)
    np.testing.assert_allclose(many, one, rtol=1e-12)
    assert not any(map(math.isfinite, interval(runs[None, :4], HOW, drawn=False)[1:]))
    lost = np.where(np.arange(9) == 3, np.nan, runs)[None]
    np.testing.assert_allclose(interval(lost, HOW, drawn=False).value, np.nanmean(lost))


@pytest.mark.parametrize(
    ("ends", "word"),
    [((0.8, 0.9), "better"), ((1.1, 1.2), "worse"), ((0.995, 1.005), "no difference")],
)
def test_words_go_by_the_interval(ends, word):
    assert word_of(Interval(1.0, *ends), quantity_of("effort")) == word
    assert word_of(Interval(1.0, 0.9, 1.1), quantity_of("effort")) is Word.UNDECIDED
    assert word_of(Interval(1.0, math.nan, 1.1), quantity_of("effort")) is Word.UNDECIDED


@pytest.mark.ci("1,000 experiments each")
@pytest.mark.parametrize("drawn", [False, True])
@pytest.mark.parametrize("theta", [0.0, -0.1])
def test_intervals_cover_and_words_are_seldom_false(drawn, theta):
    random, covered, false = np.random.default_rng(1), 0, 0
    effort = quantity_of("effort")

    def skewed(*shape):
        return (random.gamma(2, 1, shape) - 2) / math.sqrt(2)

    effects = np.linspace(-0.2, 0.2, 6)
    for _ in range(1000):
        points = random.normal(0, 0.1, 6) if drawn else effects
        pairs = np.linspace(0.5, 2, 6)[:, None] * 0.15 * skewed(6, 20)
        found = interval(theta + points[:, None] + 0.1 * skewed(20) + pairs, HOW, drawn=drawn)
        covered += found.low <= theta <= found.high
        word = word_of(Interval(*map(math.exp, found)), effort)
        right = {Word.UNDECIDED, Word.BETTER if theta else Word.ALIKE}
        false += word not in right
    assert covered >= 930 and false <= 60


@pytest.mark.ci("draws and computes a sweep")
def test_the_answer_of_a_sweep(tmp_path, invoke, swept_result):
    document = json.loads(
        invoke("compare", swept_result, "--pooled", "-m", "effort", "--json").stdout
    )
    with open_result(swept_result) as result:
        effort, laws = result["effort"], result.labels
        assert not is_drawn(result)
        logs = np.log(effort[:, 1] / effort[:, 0])
        np.testing.assert_allclose(logs_of(result, "effort", 1, 0), logs, rtol=1e-12)
    row = document["pooled"][0]
    assert (row["law"], row["first"], row["pairs"]) == (laws[1], laws[0], logs.size)
    assert row["ratio"] == pytest.approx(math.exp(logs.mean()), rel=1e-12)
    assert sum(row["points"].values()) == len(logs)
    first = invoke(
        "compare", swept_result, "--pooled", "--controller", laws[1], "--controller", laws[0]
    )
    assert f"ratio to {laws[1].upper()}" in first.stdout
    out = tmp_path / "figures"
    chosen = f"controllers=[{laws[0]}, {laws[1]}]"
    invoke("plot", swept_result, "--figure", "pooled", "--option", chosen, "--out", out)
    assert [*out.glob("*.pdf"), *out.glob("*.svg"), *out.glob("*.png")]


@pytest.mark.ci("computes a sweep")
@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--metric", "settled"], "…--pooled needs a positive number…settled is a share of runs…"),
        (["--point", "0"], "…--pooled is one answer about all points of one sweep…"),
        (["--against", "gt"], "…--pooled is one answer about all points of one sweep…"),
        (["--controller", "eqt"], "…--pooled compares laws, and here is one"),
        (["--metric", "efort"], "…efort…effort…"),
    ],
)
def test_what_is_wrong_is_said(invoke, swept_result, more, said):
    assert says(invoke("compare", swept_result, "--pooled", *more, code=2).stderr.strip(), said)


def test_the_end_of_an_interval_shows_on_which_side_of_1_it_is():
    assert [beside_1(x) for x in (0.99991, 1.00002, 0.601, 1.0)] == [
        "0.9999", "1.00002", "0.601", "1.000",
    ]  # fmt: skip
