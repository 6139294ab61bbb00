"""Intervals and numbers of runs, against scipy's and against what they promise."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from case_tables import in_ci
from scipy import stats
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import ttest_1samp

from eqt_cli.analysis import intervals as bootstrap
from eqt_cli.analysis.intervals import (
    POWER,
    Resampling,
    intervals_of_means,
    median_of_runs,
    relative_difference,
    runs_to_decide,
    runs_without_exception,
    sign_test,
    student,
)
from eqt_cli.extend import Array


def intervals(columns, confidence=0.95, resamples=9999, seed=0):
    how = Resampling(confidence, resamples, seed)
    return intervals_of_means(np.asarray(columns, float), how)


def skewed(runs, columns, seed=1):
    return np.random.default_rng(seed).exponential(size=(runs, columns))


@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.99])
def test_intervals_are_those_of_scipy_expanded(confidence):
    sample = skewed(40, 1)
    ours = intervals(sample, confidence, resamples=20_000)
    expanded = np.sqrt(40 / 39) * stats.t.ppf((1 + confidence) / 2, 39)
    theirs = stats.bootstrap(
        (sample[:, 0],),
        np.mean,
        confidence_level=2 * stats.norm.cdf(expanded) - 1,
        n_resamples=20_000,
        method="BCa",
        rng=np.random.default_rng(2),
    ).confidence_interval
    # A quantile q of B resamples has the standard error sqrt(q(1 - q)/B)/density: 0.06 standard
    # deviations of the mean at the 99.8 % that BCa makes of 99.5 % here. Two of them, three sigma.
    tolerance = 3 * np.sqrt(2) * 0.06 * sample.std() / np.sqrt(40)
    assert ours.low[0] == pytest.approx(theirs.low, abs=tolerance)
    assert ours.high[0] == pytest.approx(theirs.high, abs=tolerance)


def rare(random, size):
    large = np.where(random.random(size) < 0.1, 20.0, 1.0)
    return large * random.normal(1, 0.1, size)


def coverages(runs):
    """How often intervals hold the mean: of the columns of the table, heavy tails and ties last."""
    draws = {
        lambda random, size: random.normal(size=size): 0.0,
        lambda random, size: random.lognormal(size=size): np.exp(0.5),
        rare: 0.9 + 0.1 * 20,
        lambda random, size: random.standard_t(3, size): 0.0,
        lambda random, size: random.pareto(2.5, size) + 1: 2.5 / 1.5,
        lambda random, size: np.where(
            random.random(size) < 0.3, 0.0, random.normal(0, 1, size)
        ): 0.0,
    }
    for draw, mean in draws.items():
        found = intervals(draw(np.random.default_rng(runs), (runs, 600)), resamples=999)
        yield np.mean((found.low <= mean) & (mean <= found.high))


@pytest.mark.parametrize("runs", [10, *(in_ci("resamples often", n) for n in (20, 200))])
def test_the_documentation_says_how_often_intervals_hold(runs):
    page = Path(__file__).parents[2] / "docs/explanation/statistics.md"
    (row,) = [x for x in page.read_text("utf-8").splitlines() if x.startswith(f"| {runs} |")]
    assert row == f"| {runs} | " + " | ".join(f"{x:.2f}" for x in coverages(runs)) + " |"


def test_missing_values_drop_out_of_their_column_only():
    columns = skewed(50, 2)
    columns[:20, 1] = np.nan
    found, alone = intervals(columns), intervals(columns[:, :1])
    assert found.mean[1] == pytest.approx(columns[20:, 1].mean(), rel=1e-12)
    assert (found.low[0], found.high[0]) == pytest.approx((alone.low[0], alone.high[0]), rel=1e-12)


def test_columns_with_missing_values_have_the_interval_of_what_is_left():
    columns = skewed(400, 1)
    padded = np.concatenate([columns, np.full((100, 1), np.nan)])
    found, expected = intervals(padded), intervals(columns)
    # The number of values per resample varies too, which is of the order 1/n; and Monte Carlo.
    assert found.high - found.low == pytest.approx(expected.high - expected.low, rel=0.05)


def test_no_interval_from_too_few_values():
    """Of two columns with 4 and 5 of 8 values, the second one has an interval."""
    columns = skewed(8, 2)
    columns[:4, 0] = columns[5:, 1] = np.nan
    found = intervals(columns)
    assert np.isfinite(found.mean).all()
    assert np.isnan([found.low[0], found.high[0]]).all()
    assert found.low[1] < found.mean[1] < found.high[1]


def test_no_mean_without_values():
    assert np.isnan(intervals(np.full((9, 1), np.nan)).mean[0])


def test_constant_values_have_an_interval_of_no_width():
    found = intervals(np.full((12, 1), 0.1))
    assert found.low[0] == found.high[0] == found.mean[0]


def test_intervals_depend_on_nothing_but_data_and_seed():
    columns = skewed(30, 3)
    first, second = intervals(columns), intervals(columns)
    assert np.array_equal(first.low, second.low)
    assert not np.array_equal(first.low, intervals(columns, seed=1).low)


def test_many_runs_get_fewer_resamples(monkeypatch):
    monkeypatch.setattr(bootstrap, "MOST_DRAWS", 200_000)
    assert intervals(skewed(100, 1)).resamples == 2000
    assert intervals(skewed(1000, 1)).resamples == 999
    monkeypatch.setattr(bootstrap, "MOST_DRAWS", 2000)
    assert intervals(skewed(1, 1)).resamples == 2000


@pytest.mark.parametrize("effect", [0.3, -0.3, 0.6, 1.2])
def test_that_many_runs_decide_with_the_stated_power(effect):
    runs = runs_to_decide(effect, 0.95)
    sample = np.random.default_rng(3).normal(effect, 1, size=(4000, runs))
    p_values = stats.ttest_1samp(sample, 0, axis=1).pvalue
    # 4000 experiments: a standard error of 0.6 %; the formula is good to some 2 %.
    assert np.mean(p_values < 0.05) == pytest.approx(POWER, abs=0.03)


@pytest.mark.parametrize("effect", [0.21, 0.4, 0.9])
@pytest.mark.parametrize("confidence", [0.8, 0.99, 0.999])
def test_numbers_of_runs_are_those_of_guenther(effect, confidence):
    z, power = stats.norm.ppf([(1 + confidence) / 2, POWER])
    expected = np.ceil(((z + power) / effect) ** 2 + z * z / 2)
    assert runs_to_decide(effect, confidence) == runs_to_decide(-effect, confidence) == expected


@pytest.mark.parametrize("effect", [0.0, np.nan, 1e-200, 1e-5])  # 8e10 runs for the last
def test_no_number_of_runs_decides_about_next_to_nothing(effect):
    assert runs_to_decide(effect, 0.95) is None


def test_a_billion_runs_are_the_most_that_are_told():
    least = sum(stats.norm.ppf([0.975, POWER])) / np.sqrt(1e9)
    assert runs_to_decide(least * (1 - 1e-10), 0.95) is None
    assert runs_to_decide(least * (1 + 1e-10), 0.95) == pytest.approx(1e9, abs=3)


def test_runs_without_exception_for_95_percent():
    # 0.95^58 = 0.051, 0.95^59 = 0.0485
    assert runs_without_exception(0.95) == 59


@pytest.mark.parametrize(
    ("drawn", "below"),
    [
        # 20 of 100 resamples are below the mean, and half of 30 that are equal to it.
        (np.r_[np.linspace(-2, -0.1, 20), np.zeros(30), np.linspace(0.1, 5, 50)], 0.35),
        # None is below it, which counts as half a one, or all are, which counts as all but half.
        (np.linspace(1, 2, 5), 0.1),
        (np.linspace(-2, -1, 5), 0.9),
        # What holds no value at all is left out.
        (np.r_[-np.ones(10), np.full(20, np.nan), np.linspace(0, 9, 70)], 0.105),
    ],
)
@pytest.mark.parametrize("confidence", [0.3, 0.9])
def test_the_share_of_resamples_below_the_mean_shifts_an_interval(
    monkeypatch, drawn, below, confidence
):
    """Efron (1987) without acceleration: both ends are moved by 2z of the share, here of a mean
    of 0 of values that lie symmetrically.
    """
    monkeypatch.setattr(bootstrap, "_resampled_means", lambda *_: drawn[:, None])
    found = intervals(np.array([[-1.0], [1.0]] * 5), confidence)
    t = np.sqrt(10 / 9) * stats.t.ppf((1 + confidence) / 2, 9)
    levels = stats.norm.cdf(2 * stats.norm.ppf(below) + np.array([-t, t]))
    assert (found.low[0], found.high[0]) == pytest.approx(np.nanquantile(drawn, levels), rel=1e-9)


def test_progress_counts_every_resample(told):
    intervals(skewed(9, 1), resamples=1500)
    assert ("resamples", 1500) in told.steps
    assert told.total("resamples") == 1500


@pytest.mark.parametrize("seed", range(4))
def test_a_single_resample_is_the_whole_interval(seed):
    """Also where it is greater than the mean, or less, so that no half of them is on each side."""
    found = intervals(skewed(9, 1), resamples=1, seed=seed)
    assert found.low == found.high
    assert found.low != found.mean


def test_what_is_drawn_at_once_does_not_matter(monkeypatch):
    columns = skewed(30, 2)
    whole = intervals(columns, resamples=1000)
    for at_once in (30 * 64, 10):
        monkeypatch.setattr(bootstrap, "_CHUNK", at_once)
        parts = intervals(columns, resamples=1000)
        assert parts.low == pytest.approx(whole.low, rel=1e-12)
        assert parts.high == pytest.approx(whole.high, rel=1e-12)


@pytest.mark.parametrize(("runs", "ranks"), [(5, None), (6, (1, 6)), (10, (2, 9)), (20, (6, 15))])
def test_the_interval_of_a_median_has_the_ranks_of_the_tables(runs, ranks):
    """Those of the 95 % interval in Conover, Practical Nonparametric Statistics (1999), 3.2."""
    found = median_of_runs(np.random.default_rng(1).permutation(np.arange(1.0, runs + 1)), 0.95)
    assert found.value == (runs + 1) / 2
    assert ranks is None or (found.low, found.high) == ranks
    assert ranks is not None or np.isnan([found.low, found.high]).all()


# A mean difference as a share of a mean -----------------------------------------------------------


@pytest.fixture
def runs() -> tuple[Array, Array]:
    random = np.random.default_rng(3)
    start = random.lognormal(0, 0.5, 40)
    return start * random.normal(1.2, 0.2, 40), start


def test_the_ends_are_where_the_paired_test_begins_to_reject(runs: tuple[Array, Array]) -> None:
    first, second = runs
    found = relative_difference(first - second, second, 0.9)
    for end, bracket in ((found.low, (-1, found.value)), (found.high, (found.value, 2))):
        root = brentq(lambda x: ttest_1samp(first - second - x * second, 0).pvalue - 0.1, *bracket)
        assert end == pytest.approx(root, rel=1e-9)


def test_of_a_negative_mean_the_share_keeps_the_sign_of_the_difference(
    runs: tuple[Array, Array],
) -> None:
    first, second = runs
    plain = relative_difference(first - second, second, 0.95)
    assert relative_difference(first - second, -second, 0.95) == pytest.approx(plain)
    assert plain.low < plain.value < plain.high


def test_no_share_of_a_mean_that_may_be_0() -> None:
    random = np.random.default_rng(1)
    found = relative_difference(np.ones(30), random.normal(0.01, 1, 30), 0.95)
    assert (found.low, found.high) == (-math.inf, math.inf)


def test_equal_runs_have_a_share_of_0_without_width() -> None:
    assert relative_difference(np.zeros(9), np.arange(1.0, 10), 0.95) == pytest.approx((0, 0, 0))


def test_no_interval_from_too_few_runs() -> None:
    assert math.isnan(relative_difference(np.ones(4), np.ones(4), 0.95).low)


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.ci("many runs"))])
@pytest.mark.parametrize("kind", ["normal", "lognormal"])
def test_intervals_hold_the_true_share_as_often_as_they_say(kind: str, count: int) -> None:
    """Of runs whose spread is that of the mean itself; 2,000 samples tell 0.95 within 0.01.

    An interval of the difference that is divided by the mean holds in 0.80 to 1.00 of them.
    """
    random = np.random.default_rng(7)
    held = 0
    for _ in range(2000):
        if kind == "normal":
            second = random.normal(2, 0.8, count)
        else:
            second = random.lognormal(0, 0.5, count)
        first = second * random.normal(0.8, 0.1, count)
        found = relative_difference(first - second, second, 0.95)
        held += found.low <= -0.2 <= found.high
    assert 0.93 <= held / 2000 <= 0.97


# Runs that grow -----------------------------------------------------------------------------------


def test_the_sign_test_at_every_look_is_one_over_a_mean_likelihood_ratio():
    """Over all shares p alike: the mean of (2p)^k (2 − 2p)^(n − k), by quadrature."""
    for ahead, runs in ((15, 20), (30, 31), (10, 20)):
        ratio = quad(lambda p, k=ahead, n=runs: (2 * p) ** k * (2 - 2 * p) ** (n - k), 0, 1)[0]
        assert sign_test(ahead, runs, True) == pytest.approx(min(1.0, 1 / ratio))


def test_looks_at_runs_that_grow_find_few_false_differences():
    """2,000 campaigns of 400 runs of equal laws, with a look after every 20: 5 % at most."""
    ahead = np.random.default_rng(0).random((2_000, 400)) < 0.5
    looks = np.arange(20, 401, 20)
    counts = np.cumsum(ahead, axis=1)[:, looks - 1]
    most = np.maximum(counts, looks - counts)
    p = [sign_test(most, looks, at_every_look) for at_every_look in (False, True)]
    shares = [np.mean((values <= 0.05).any(axis=1)) for values in p]
    assert shares == pytest.approx([0.214, 0.011], abs=0.03)


def test_the_interval_of_a_median_at_every_look_inverts_its_test():
    found = median_of_runs(np.arange(1.0, 31.0), 0.95, True)
    rank = int(found.low)
    assert sign_test(31 - rank, 30, True) <= 0.05 < sign_test(30 - rank, 30, True)
    assert found.high == 31 - rank


def test_the_quantile_at_every_look_is_where_the_mean_likelihood_ratio_is_20():
    """Over normal effects of 10 runs, by quadrature: noncentral against central t."""
    t = student(9, 0.95, 10)

    def density(effect):
        return stats.nct.pdf(t, 9, effect * math.sqrt(10)) * stats.norm.pdf(effect)

    assert quad(density, -8, 8)[0] / stats.t.pdf(t, 9) == pytest.approx(20, rel=1e-6)
    assert student(9, 0.95) == pytest.approx(stats.t.ppf(0.975, 9))
    assert student(1, 0.95, 2) == math.inf
