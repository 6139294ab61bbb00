"""The sentences that a report opens with."""

import pytest

from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.verdict import findings

TITLES = {"eqt": "EqT", "gt": "GT", "nog": "nog", "asym": "asym", "a": "A", "b": "B"}


@pytest.fixture
def found(make_result):
    """The findings about runs with constant torque and pose error."""

    def of(labels, torque, pose, kinds=None, **more):
        constant = make_result.constant
        signals = {
            "torque_norm": constant(*torque),
            "pose_error": constant(*pose),
            "velocity_error": constant(*pose),
            "lyapunov": constant(*pose),
        }
        metrics = {"mean_pose_error": pose, "early_torque": torque, **more}
        units = {"torque_norm": "N m", "early_torque": "N m"}
        result = make_result(labels, signals, metrics, units=units, kinds=kinds)
        result.title_of = TITLES
        made = findings(compare(result))
        return {finding.claim[:12]: finding for finding in made}

    return of


LOW, HIGH = [1.0, 1.1, 1.2, 1.3, 1.4, 1.5], [2.0, 2.2, 2.4, 2.6, 2.8, 3.0]


def test_a_claim_that_holds_is_a_sentence_with_its_interval(found):
    first = found(["eqt", "gt"], [LOW, HIGH], [HIGH, LOW])["the EqT cont"]
    assert first.verdict == "supported" and first.claim.startswith("the EqT control requires")
    assert first.words.startswith("EqT has 50.0 % less mean ‖τ‖ over 0–5 s than GT (-1.25 [-1.")
    assert first.words.endswith("] N m).")


def test_laws_that_a_claim_is_about_and_that_are_not_there_are_named(found):
    claims = found(["eqt", "gt"], [LOW, HIGH], [HIGH, LOW])
    assert claims["All four of "].absent == "nog and asym"
    assert claims["the EqT cont"].absent == ""


def test_runs_in_which_a_claim_held_are_counted(found):
    first = found(["eqt", "gt"], [LOW, HIGH], [HIGH, LOW])["All four of "]
    assert first.words == (
        "L does not rise between samples: 6 of 6 runs under EqT and GT, so it holds for at least "
        "60.7 % of all initial states (95 % confidence), and 95 % is needed."
    )


def test_a_claim_of_which_some_rows_are_supported(found):
    torque, pose = [LOW, HIGH, HIGH], [HIGH, LOW, [3.5] * 6]
    claims = found(["eqt", "nog", "asym"], torque, pose)
    assert claims["The EqT and "].verdict == "partly supported"
    assert claims["The EqT and "].words.startswith(
        "3 of 4 comparisons agree with it; EqT has 100.0 % more mean ‖I − Q_E‖"
    )


def test_a_claim_that_the_runs_refute(found):
    first = found(["eqt", "gt"], [HIGH, LOW], [HIGH, LOW])["the EqT cont"]
    assert (first.verdict, first.words[:39]) == (
        "not supported",
        "EqT has 100.0 % more mean ‖τ‖ over 0–5 ",
    )


def test_a_difference_that_the_runs_do_not_tell(found):
    first = found(["eqt", "gt"], [LOW, LOW[::-1]], [HIGH, LOW])["the EqT cont"]
    assert first.verdict == "undecided"
    assert first.words.startswith("undecided between EqT and GT: mean ‖τ‖ over 0–5 s (")


def test_nothing_that_supports_a_claim_is_no_partial_support(found):
    last = found(["eqt", "nog"], [HIGH, LOW], [HIGH, HIGH])["The EqT and "]
    assert last.verdict == "not supported"
    assert last.words.startswith("0 of 2 comparisons agree with it, 1 is undecided; EqT has")
