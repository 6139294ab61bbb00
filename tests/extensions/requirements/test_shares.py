"""Words on shares, against SciPy's binomial distribution and counts of all outcomes."""

import numpy as np
import pytest
from scipy.stats import binom

from eqt_cli.extensions.requirements.shares import boundary, share_of_runs, share_of_time


def runs(count, failures=()):
    keeps = np.ones(count, dtype=bool)
    keeps[list(failures)] = False
    return keeps


@pytest.mark.parametrize("bad", [0.1, 0.01, 0.003])
@pytest.mark.parametrize("n", [30, 500, 3000])
def test_one_look_is_the_exact_test(bad, n):
    few, many = boundary([n], bad, 0.05), boundary([n], bad, 0.05, above=True)
    assert binom.cdf(few, n, bad) <= 0.05 < binom.cdf(few + 1, n, bad)
    assert binom.sf(many - 1, n, bad) <= 0.05 < binom.sf(many - 2, n, bad)


def test_998_runs_without_a_failure_show_a_share_of_997_in_1000():
    assert share_of_runs(runs(997), runs(997), 0.997, 0.05).word == "not shown"
    statement = share_of_runs(runs(998), runs(998), 0.997, 0.05)
    assert statement.word == "meets"
    assert statement.low == pytest.approx(0.05 ** (1 / 998), abs=1e-12)
    assert share_of_runs(runs(200), runs(200), 0.997, 0.05).needed == 998


def test_a_first_look_that_can_show_nothing_costs_nothing():
    keeps = runs(998)
    assert share_of_runs(keeps, keeps, 0.997, 0.05, earlier=[100, 300]).word == "meets"
    assert share_of_runs(keeps, keeps, 0.997, 0.05, earlier=[100], planned=5).word == "not shown"


@pytest.mark.parametrize(("planned", "looks"), [(2, (20, 45)), (1, (20, 45)), (3, (10, 25, 40))])
def test_looks_together_err_in_at_most_5_percent(planned, looks):
    """By all outcomes: at the required share, just one word in twenty may be wrong."""
    share, sizes = 0.9, np.diff((0, *looks))
    wrong = {"meets": 0.0, "fails": 0.0}

    def follow(counts, probability, number):
        if number == len(looks):
            return
        for failed in range(sizes[number] + 1):
            likely = probability * binom.pmf(failed, sizes[number], 1 - share)
            if likely < 1e-9:
                continue
            order = [
                k < lost
                for lost, size in zip((*counts, failed), sizes, strict=False)
                for k in range(size)
            ]
            keeps = ~np.array(order)
            word = share_of_runs(keeps, keeps, share, 0.05, looks[:number], planned).word
            if word == "not shown":
                follow((*counts, failed), likely, number + 1)
            else:
                wrong[word] += likely

    follow((), 1.0, 0)
    assert 0.005 < wrong["meets"] <= 0.05
    assert 0.005 < wrong["fails"] <= 0.05


def test_what_may_be_kept_is_no_failure_and_no_proof():
    sure, possible = runs(998, [0, 1, 2, 3, 4, 5, 6, 7, 8]), runs(998)
    assert share_of_runs(sure, possible, 0.997, 0.05).word == "not shown"
    assert share_of_runs(sure, sure, 0.997, 0.05).word == "fails"


@pytest.mark.parametrize("share", [0.9, 0.99])
def test_means_of_shares_of_time_err_in_at_most_5_percent(share):
    random, words = np.random.default_rng(4), []
    for _ in range(400):  # a mean of exactly the required share, at looks of half and of all runs
        x = random.beta(2 * share, 2 * (1 - share), 200)
        both = [share_of_time(x[:n], x[:n], share, 0.05).word for n in (100, 200)]
        words.append(next((word for word in both if word != "not shown"), "not shown"))
    assert words.count("meets") <= 0.08 * 400  # 5 % and three deviations
    assert words.count("fails") <= 0.08 * 400
    sure = random.beta(40, 0.1, 1500)
    assert share_of_time(sure, sure, share, 0.05).word == "meets"
    assert share_of_time(1 - sure, 1 - sure, share, 0.05).word == "fails"
