"""Shares of runs against published examples, and where they stand in comparisons."""

import numpy as np
import pytest
from scipy.stats import binomtest

from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.comparison_tables import records, text_tables
from eqt_cli.analysis.intervals import difference_of_shares, share, shares
from eqt_cli.results.quantity import Plain

# Complete response before and after consolidation therapy (Cavo et al. 2012), and airway
# hyper-responsiveness before and after stem cell transplantation (Bentur et al. 2009), as in
# Fagerland, Lydersen, Laake, Statistical Analysis of Contingency Tables (2017), chapter 8.
CAVO, BENTUR = (59, 6, 16, 80), (1, 1, 7, 12)


def difference(counts, confidence=0.95):
    """Of runs with the event under both, only the first, only the second, and neither."""
    first, second = np.repeat([[1.0, 1.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0]], counts, axis=1)
    return difference_of_shares(first, second, confidence)


def test_a_difference_has_the_published_interval_of_newcombe():
    found, _ = difference(CAVO)
    assert tuple(found) == pytest.approx((-0.0621, -0.1186, -0.0046), abs=5e-5)


def test_a_negative_correlation_is_not_corrected():
    # ad - bc = -30; Newcombe's formula, written out.
    found, _ = difference((0, 6, 5, 4))
    one, other = share(6, 15, 0.95), share(5, 15, 0.95)
    correlation = -30 / np.sqrt(6 * 9 * 5 * 10)
    down, up = one.value - one.low, other.high - other.value
    assert found.low == pytest.approx(
        1 / 15 - np.sqrt(down**2 + up**2 - 2 * correlation * down * up), rel=1e-12
    )


def test_mcnemars_test_has_the_published_p_value():
    assert difference(BENTUR)[1] == pytest.approx(0.0703, abs=5e-5)


def test_laws_that_never_differ_are_equal_with_a_doubt():
    found, p_value = difference((20, 0, 0, 0))
    assert p_value == 1.0
    low = share(20, 20, 0.95).low
    assert tuple(found) == pytest.approx((0, low - 1, 1 - low), rel=1e-12)


def test_exchanged_laws_have_the_opposite_difference():
    (a, _), (b, _) = difference(CAVO, 0.9), difference((59, 16, 6, 80), 0.9)
    assert tuple(a) == pytest.approx((-b.value, -b.high, -b.low), rel=1e-12)


def test_runs_without_a_number_do_not_count():
    found = shares(np.array([[1, 0, np.nan, 1], [np.nan] * 4]), 0.95)
    assert tuple(found[0]) == tuple(share(2, 3, 0.95))
    assert np.isnan(found[1]).all()


TIMES = [[3.0, np.nan, 4.0, 5.0, np.nan, 6.0, 1.0], [np.nan, np.nan, 4.0, np.nan, np.nan, 6.0, 2.0]]
SETTLED = np.isfinite(TIMES).astype(float)


@pytest.fixture(params=["stored", "told"])
def settling(request, make_result):
    """Runs of which 5 and 3 of 7 settle; `settled` is stored, or follows from the settling time."""
    metrics = {"settling_time": TIMES} | ({"settled": SETTLED} if request.param == "stored" else {})
    return make_result(["a", "b"], metrics=metrics)


def test_settled_runs_are_compared_as_shares(settling):
    comparison = compare(settling, metrics=["settled"])
    assert [(x.mean, x.low, x.high) for x in comparison.levels] == [
        share(5, 7, 0.95),
        share(3, 7, 0.95),
    ]
    (pair,) = comparison.pairs
    expected, p_value = difference((3, 0, 2, 2))  # of b against a
    assert (pair.difference, pair.low, pair.high) == expected
    assert pair.p_value == p_value == 0.5


def test_a_failed_run_is_of_no_share(make_result):
    status = [[0] * 7, [1, *[0] * 6]]
    results = make_result(["a", "b"], metrics={"settling_time": TIMES}, status=status)
    comparison = compare(results, metrics=["settled"])
    assert [(x.mean, x.runs) for x in comparison.levels] == [(5 / 7, 7), (3 / 6, 6)]
    assert comparison.pairs[0].difference == pytest.approx((3 - 4) / 6)


def test_tables_say_which_intervals_shares_have(settling):
    made = text_tables(compare(settling, metrics=["settled"]), Plain())
    (row,) = made["controllers"].blocks[0].rows
    assert row[-2:] == ["71 [36, 92]", "43 [16, 75]"]
    assert made["controllers"].notes == ["Shares of runs: with 95 % Wilson intervals."]
    [row] = made["pairs"].rows
    assert row[:3] == ["settled", "-0.29 [-0.58, 0.14]", "−29 points [−58, +14]"]


def test_records_hold_the_p_value_of_the_row_alone(settling):
    """McNemar's of shares; of times the sign test, here of no majority of seven runs."""
    found = records(compare(settling, metrics=["settled", "settling_time"]))["pairs"]
    assert [record["p_value"] for record in found] == [0.5, 1.0]


@pytest.mark.parametrize("runs", [1, 7, 40, pytest.param(200, marks=pytest.mark.ci("many"))])
def test_intervals_and_p_values_are_those_of_scipy(runs):
    """To what bisection for the exact ends, and summing for the p-values, leave of the digits."""
    for count in range(runs + 1):
        told = binomtest(count, runs)
        for method, exact in (("wilson", False), ("exact", True)):
            found, expected = share(count, runs, 0.9, exact=exact), told.proportion_ci(0.9, method)
            assert (found.low, found.high) == pytest.approx(expected, abs=1e-11)
        _, p_value = difference((0, count, runs - count, 0))
        assert p_value == pytest.approx(told.pvalue, rel=1e-10)
