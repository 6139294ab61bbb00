"""Gates: rules as users write them, and their outcomes by one-sided bounds."""

import math

import pytest

from eqt_cli.analysis.gate import Finding, Rule, lines, passes, rules_of
from eqt_cli.analysis.intervals import Interval
from eqt_cli.extend import EqtError


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("effort worse by 5 %", Rule("effort", 5.0, "%")),
        ("  effort worse  by 5% ", Rule("effort", 5.0, "%")),
        ("mean attitude error worse by 0.1 deg", Rule("mean_attitude_error", 0.1, "deg")),
        ("settled worse by 2 points", Rule("settled", 2.0, "points")),
        ("effort worse by 1e-3 (N m)^2 s", Rule("effort", 1e-3, "(N m)^2 s")),
        ("mean_pose_error worse by .01", Rule("mean_pose_error", 0.01, "")),
        ("worse", Rule("worse")),
    ],
)
def test_a_rule_is_read_as_written(text, rule):
    assert rules_of([text]) == [rule]
    assert rules_of([str(rule)]) == [rule]


@pytest.mark.parametrize(
    "text", ["effort", "effort worse", "effort better by 5 %", "effort worse by 0,5 %", ""]
)
def test_other_texts_are_refused_with_the_form(text):
    with pytest.raises(EqtError, match="METRIC worse by MARGIN, as 'effort worse by 5 %'"):
        rules_of([text])


@pytest.mark.parametrize("number", ["0", "-5", "1e999"])
def test_a_margin_is_above_0(number):
    with pytest.raises(EqtError, match="expected a margin above 0; `eqt diff` tests"):
        rules_of([f"effort worse by {number} %"])


@pytest.mark.parametrize(
    ("unit", "is_share", "margin", "factor"),
    [
        ("rad", False, "deg", 180 / math.pi),
        ("m", False, "%", 100.0),
        ("1", False, "", 1.0),
        ("1", True, "points", 100.0),
        ("1", True, "%", "points of 100, as 2 points"),
        ("m", False, "points", "%, or a length in m, cm, mm or km"),
        ("m", False, "", "%, or a length in m, cm, mm or km"),
        ("", False, "deg", "%, or a number without a unit"),
    ],
)
def test_a_margin_has_the_unit_of_its_number(unit, is_share, margin, factor):
    rule = Rule("x", 2.0, margin)
    if isinstance(factor, float):
        assert rule.factor(unit, is_share=is_share) == pytest.approx(factor)
        return
    with pytest.raises(EqtError) as refusal:
        rule.factor(unit, is_share=is_share)
    assert str(refusal.value) == f"'{rule}': expected a margin in {factor}"


@pytest.mark.parametrize(
    ("ends", "is_gain", "outcome"),
    [
        ((-1.0, 5.0), False, "holds"),
        ((-1.0, 5.1), False, "not shown"),
        ((5.1, 9.0), False, "worse"),
        ((5.0, 9.0), False, "not shown"),
        ((-5.0, 9.0), True, "holds"),
        ((-9.0, 0.0), True, "not shown"),
        ((-9.0, -5.1), True, "worse"),
        ((math.nan, math.nan), False, "not shown"),
        ((-math.inf, math.inf), True, "not shown"),
    ],
)
def test_outcomes_follow_from_the_bounds(ends, is_gain, outcome):
    finding = Finding(Rule("x", 5.0, "%"), "x", Interval(1.0, *ends), 9, is_gain=is_gain)
    assert finding.outcome == outcome
    assert passes([finding]) == (outcome == "holds")
    assert passes([finding], undecided=True) == (outcome != "worse")


def test_lines_say_the_answer_first_and_the_worst_first():
    rule = Rule("effort", 5.0, "%")
    changes = [(0.24, -1.0, 1.31), (9.0, 6.07, 12.0), (1.0, -6.0, 8.0)]
    findings = [Finding(rule, "EqT: effort", Interval(*x), 20, 34) for x in changes]
    points, drop = Rule("settled", 2.0, "points"), Interval(-9.0, -15.0, -3.03)
    findings += [Finding(points, "EqT: settled", drop, 60, is_gain=True)]
    assert lines(findings) == [
        "gate fails: 2 worse, 1 not shown, 1 holds",
        "worse: EqT: effort worse by more than 5 %: +9.0 %, at least +6.1 % (95 %)",
        "worse: EqT: settled worse by more than 2 points: −9.0 points, at most −3.0 points (95 %)",
        "not shown: EqT: effort not worse by 5 %: +1.0 %, at most +8.0 % (95 %); 34 runs would "
        "show it if nothing changed",
        "holds: EqT: effort not worse by 5 %: +0.2 %, at most +1.3 % (95 %)",
    ]
    holds, _, unknown, _ = findings
    assert lines([holds, holds])[0] == "gate passes: 2 hold"
    assert lines([holds, unknown])[0] == "gate fails: 1 not shown, 1 holds"
    allowed = lines([holds, unknown], undecided=True)
    assert allowed[0] == "gate passes although not shown: 1 not shown, 1 holds"
    assert lines([]) == ["gate passes: nothing failed"]
