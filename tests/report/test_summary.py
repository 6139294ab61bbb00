"""What the page says of accuracy, and of whom."""

import numpy as np
import pytest

from eqt_cli.report.summary import accuracy


@pytest.fixture
def energy_sentence(make_result):
    """The sentence on energy, of results with these residuals and runs that failed."""

    def of(residuals, status=None):
        labels = [f"law{k}" for k in range(len(residuals))]
        result = make_result(labels, metrics={"energy_residual": residuals}, status=status)
        return [sentence for sentence in accuracy(result) if sentence.startswith("Energy")]

    return of


BALANCE = "Energy balance: |L(t) + ∫dissipation − L(0)| stays below 4e-09 of L(0) in every run"


def test_laws_that_all_claim_a_balance_need_no_names(energy_sentence):
    assert energy_sentence([[1e-9, 2e-9], [4e-9, 3e-9]]) == [f"{BALANCE}."]


def test_laws_that_claim_no_balance_are_named(energy_sentence):
    nothing = [np.nan, np.nan]
    assert energy_sentence([[1e-9, 4e-9], nothing, nothing]) == [
        f"{BALANCE} of law0; none is claimed of law1 and law2."
    ]


def test_a_run_that_failed_does_not_take_the_claim_away(energy_sentence):
    assert energy_sentence([[4e-9, np.nan]], status=[[0, 1]]) == [f"{BALANCE}."]


def test_without_a_balance_nothing_is_said(energy_sentence):
    assert energy_sentence([[np.nan, np.nan]]) == []
