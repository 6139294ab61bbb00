"""How often a gate is right on simulated pairs of runs, as the documentation says."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from eqt_cli.analysis.comparison import Numbers
from eqt_cli.analysis.gate import TWO_SIDED, Rule
from eqt_cli.analysis.intervals import FEWEST, Resampling
from eqt_cli.extensions.gate import worsening
from eqt_cli.extensions.gate.worsening import judged
from eqt_cli.results.metrics import QUANTITIES
from eqt_cli.results.quantity import WHOLE
from eqt_cli.results.result import PerRun

LAWS = ["old/eqt", "new/eqt"]
RESULTS = SimpleNamespace(identical=False, unresolved=lambda pair: False)


def findings(rule, before, now, unit="(N m)^2 s"):
    """The findings on pairs of runs, a row of `before` and `now` each."""
    none = np.zeros((2, before.shape[-1]), dtype=bool)
    both = [
        PerRun(QUANTITIES[rule.metric], WHOLE, unit, np.stack(rows), none, before.shape[-1])
        for rows in zip(before, now, strict=True)
    ]
    how = Resampling(TWO_SIDED, FEWEST)
    numbers = Numbers(LAWS, ~none[:, : before.shape[-1]], both, how)
    pairs = [numbers.pair(k, *LAWS[::-1]) for k in range(len(both))]
    return [judged(rule, pair, "EqT: effort", RESULTS, False) for pair in pairs]


def drawn(change, spread, runs, trials, seed=1):
    """Numbers before, with a mean square of 1.28 squared means, and now."""
    random = np.random.default_rng(seed)
    before = random.lognormal(0, np.sqrt(np.log(1.28)), (trials, runs))
    return before, before * (1 + change + spread * random.normal(size=before.shape))


@pytest.mark.ci("simulates a thousand comparisons per cell")
@pytest.mark.parametrize(
    ("spread", "runs", "change", "holds", "worse"),
    [
        (0.03, 5, 0.0, 82, 0),
        (0.03, 10, 0.05, 5.0, 5.0),
        (0.15, 20, 0.05, 4.7, 4.9),
        (0.15, 50, 0.1, 0, 67),
    ],
)
def test_the_documentation_says_how_often_rules_hold(spread, runs, change, holds, worse):
    """Within three standard errors of a thousand trials."""
    outcomes = [
        finding.outcome
        for finding in findings(Rule("effort", 5.0, "%"), *drawn(change, spread, runs, 1000))
    ]
    for share, outcome in ((holds, "holds"), (worse, "worse")):
        error = np.sqrt(max(share * (100 - share), 5) / 1000)
        assert 100 * np.mean([x == outcome for x in outcomes]) == pytest.approx(
            share, abs=3 * error
        )


def test_so_many_runs_show_it_as_the_power_says():
    """The t-test that the mean change is below the margin has the power 0.8 with so many runs."""
    before, now = drawn(0.0, 0.15, 50, 20)
    both = findings(Rule("effort", 5.0, "%"), before, now)
    spreads = np.std(now - before, axis=-1, ddof=1) / before.mean(axis=-1)
    needed = np.array([finding.to_show for finding in both])
    bounds = stats.t.ppf(0.95, needed - 1)
    power = stats.nct.sf(bounds, needed - 1, 0.05 / spreads * np.sqrt(needed))
    assert power == pytest.approx(0.8, abs=0.01)  # the number is whole, of 40 or more


@pytest.mark.parametrize("unit", ["(N m)^2 s", "(mN m)^2 s"])
def test_a_margin_in_a_unit_is_judged_by_the_paired_t_test(unit):
    [before], [now] = drawn(0.02, 0.1, 20, 1)
    [finding] = findings(Rule("effort", 0.1, unit), before[None], now[None])
    factor = 1 if unit == "(N m)^2 s" else 1e6
    interval = stats.ttest_rel(factor * now, factor * before).confidence_interval(0.90)
    assert finding.change.low == pytest.approx(interval.low)
    assert finding.change.high == pytest.approx(interval.high)


def test_where_less_is_worse_the_other_bound_counts():
    random = np.random.default_rng(2)
    before = (random.random((1, 60)) < 0.9).astype(float)
    [same] = findings(Rule("settled", 10.0, "points"), before, before, "1")
    now = np.where(np.arange(60) < 30, 0.0, before)
    [lost] = findings(Rule("settled", 10.0, "points"), before, now, "1")
    [back] = findings(Rule("settled", 10.0, "points"), now, before, "1")
    assert [same.outcome, lost.outcome, back.outcome] == ["holds", "worse", "holds"]
    assert lost.change.value == pytest.approx(-back.change.value)


@pytest.mark.parametrize(("runs", "outcome"), [(58, "not shown"), (59, "holds")])
def test_runs_that_do_not_differ_are_bounded_exactly(runs, outcome):
    """None of n runs lost: a loss of 5 % has the probability 0.95^n, below 0.05 from 59 runs on."""
    settled = np.tile([0.0, 1.0], (1, runs))[:, :runs]
    [finding] = findings(Rule("settled", 5.0, "points"), settled, settled, "1")
    assert finding.outcome == outcome
    assert finding.to_show == 59
    bound = stats.binomtest(0, runs).proportion_ci(0.90, method="exact").high
    assert finding.change.low == pytest.approx(-100 * bound)


@pytest.mark.ci("simulates a thousand comparisons per cell")
@pytest.mark.parametrize(("share", "runs"), [(0.5, 20), (0.5, 100), (0.9, 200)])
def test_a_loss_of_a_share_seldom_holds(share, runs):
    """Only losses, of the margin: Newcombe's bounds alone let 12 % pass of 20 runs, 11 % of 100."""
    random = np.random.default_rng(runs)
    margin = 0.1 if runs == 20 else 0.05
    drawn = random.random((1000, runs))
    before = (drawn < share).astype(float)
    now = np.where(drawn < margin, 0.0, before)
    both = findings(Rule("settled", 100 * margin, "points"), before, now, "1")
    held = np.mean([finding.outcome == "holds" for finding in both])
    assert held <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 1000)


def test_bounds_at_every_look_are_wider_and_hold_at_every_look():
    """Shares: the ends are where the mean of the binomial likelihoods is ten times as large."""
    low, high = worsening._share(3, 40, True)[1:]
    for end in (low, high):
        assert stats.binom.pmf(3, 40, end) * 41 == pytest.approx(0.1)
    assert worsening._share(0, 40, True).low == 0.0
    lost = np.random.default_rng(0).random((1_000, 200)) < 0.1
    counts, looks = np.cumsum(lost, axis=1), np.arange(10, 201, 10)
    ends = {(k, n): worsening._share(k, n, True) for n in looks for k in {*counts[:, n - 1]}}
    held = {at: low <= 0.1 <= high for at, (_, low, high) in ends.items()}
    assert np.mean([all(held[c[n - 1], n] for n in looks) for c in counts]) >= 0.9
