"""The verdict on each claim, as its table says it."""

import pytest

from eqt_cli.analysis.claims import by_claim
from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.comparison_tables import text_tables
from eqt_cli.results.quantity import Plain

TITLES = {"eqt": "EqT", "gt": "GT", "nog": "nog", "asym": "asym"}


@pytest.fixture
def compared(make_result):
    """A comparison of runs with constant torque and pose error."""

    def of(labels, torque, pose):
        constant = make_result.constant
        signals = {
            "torque_norm": constant(*torque),
            "pose_error": constant(*pose),
            "velocity_error": constant(*pose),
            "lyapunov": constant(*pose),
        }
        metrics = {"mean_pose_error": pose, "early_torque": torque}
        units = {"torque_norm": "N m", "early_torque": "N m"}
        result = make_result(labels, signals, metrics, units=units)
        result.title_of = TITLES
        return compare(result)

    return of


def verdicts(comparison):
    return {rows[0].says[:12]: verdict for verdict, rows in by_claim(comparison)}


LOW, HIGH = [1.0, 1.1, 1.2, 1.3, 1.4, 1.5], [2.0, 2.2, 2.4, 2.6, 2.8, 3.0]


def test_a_claim_that_holds_has_its_number_and_interval(compared):
    comparison = compared(["eqt", "gt"], [LOW, HIGH], [HIGH, LOW])
    assert verdicts(comparison)["the EqT cont"] == "supported"
    [_, block, *_] = text_tables(comparison, Plain())["claims"].blocks
    assert block.title.endswith(": supported")
    [[measured, window, found, verdict, _]] = block.rows
    assert (measured, window, verdict) == ("mean ‖τ‖: EqT − GT", "0–5 s", "supported")
    assert found.startswith("-1.25 [-1.") and found.endswith("] N m (−50.0 %)")


def test_a_claim_about_every_run_counts_them_and_names_absent_laws(compared):
    """All of 6 runs: 0.05^(1/6) = 60.7 % of all initial states at least."""
    comparison = compared(["eqt", "gt"], [LOW, HIGH], [HIGH, LOW])
    [block, *_] = text_tables(comparison, Plain())["claims"].blocks
    assert block.title.endswith(" (here without nog, asym): undecided")
    assert block.rows[0][2] == "in 6 of 6 runs (of all, 60.7 % or more)"


@pytest.mark.parametrize(
    ("torque", "pose", "verdict"),
    [
        ([LOW, HIGH, HIGH], [HIGH, LOW, [3.5] * 6], "partly supported"),
        ([HIGH, LOW, LOW], [HIGH, HIGH, HIGH], "not supported"),
        ([LOW, HIGH, HIGH], [LOW, HIGH, HIGH], "supported"),
    ],
)
def test_a_claim_of_several_rows_has_one_verdict(compared, torque, pose, verdict):
    """Nothing that supports a claim is no partial support, although a row is undecided."""
    assert verdicts(compared(["eqt", "nog", "asym"], torque, pose))["The EqT and "] == verdict


@pytest.mark.parametrize(
    ("torque", "verdict"), [([HIGH, LOW], "not supported"), ([LOW, LOW[::-1]], "undecided")]
)
def test_a_claim_that_runs_refute_or_leave_open(compared, torque, verdict):
    assert verdicts(compared(["eqt", "gt"], torque, [HIGH, LOW]))["the EqT cont"] == verdict
