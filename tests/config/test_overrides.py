"""`--set KEY=VALUE`: what it changes, and what is said of one that is wrong, word by word."""

import pytest
from said import said_of


def value_at(resolved, path):
    for step in path.replace("]", "").replace("[", ".").split("."):
        resolved = resolved[int(step)] if step.isdigit() else resolved[step]
    return resolved


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("gains.kp=2", "gains.kp", 2.0),
        (" gains.kp = 2 ", "gains.kp", 2.0),
        ("gains.kd=pi/2", "gains.kd", 1.5707963267948966),
        ("inertia[1]=7", "inertia[1]", 7.0),
        ("controllers[1]=nog", "controllers[1].kind", "nog"),
        ("controllers=[{kind: family, gyroscopic: 0.5}]", "controllers[0].gyroscopic", 0.5),
        ("initial={pose: euler}", "initial.pose.kind", "euler"),
        ("store.decimate=2", "store.decimate", 2),
        ("reference.torque[2]=t**2 - 1", "reference.torque[2]", "t**2 - 1"),
        ("name=other", "name", "other"),
    ],
)
def test_an_override(experiment, override, path, value):
    assert value_at(experiment(override).resolved, path) == value


def test_the_last_override_counts(experiment):
    assert experiment("gains.kp=2", "gains.kp=3").resolved["gains"]["kp"] == 3.0


@pytest.mark.parametrize(
    ("override", "said"),
    said_of("""
gains.kp → expected KEY=VALUE, got 'gains.kp'
=2 → expected KEY=VALUE, got '=2'
gains.=2 → expected a key such as gains.kp or controllers[0].label, got 'gains.'
gains..kp=2 → expected a key such as gains.kp or controllers[0].label, got 'gains..kp'
controllers[x]=gt → expected a key such as gains.kp or controllers[0].label, got 'controllers[x]'
inertia[²]=1 → expected a key such as gains.kp or controllers[0].label, got 'inertia[²]'
gains.kp=[1, → gains.kp: a '[' or '{' is never closed
time.duration=017 → time.duration: 017 is ambiguous: write 17 or 0o17
gains={kp: 1, kp: 2} → gains.kp: duplicate key
gains.kpp=2 → gains.kpp: unknown key; did you mean 'kp'?
controllers[5]=gt → controllers[5]: no entry 5; controllers has 2 entries, counted from 0
controllers[0].label=x →
    controllers[0].label: controllers[0] is 'eqt', not a mapping; set all of controllers[0] instead
inertia[0][1]=5 → inertia[0][1]: inertia[0] is 2, not a list; set all of inertia[0] instead
controllers.1.label=x →
    controllers.1.label: controllers is a list; write controllers[1] for an entry of it
controllers.label=x →
    controllers.label: controllers is a list; write controllers[0] for an entry of it
ensemble[0]=1 → ensemble[0]: ensemble is a mapping, not a list; set all of ensemble instead
initial.pose.kind=euler →
    initial.pose.kind: initial.pose is 'haar', not a mapping; set all of initial.pose instead
gains.kp= →
    gains.kp: missing; this key is required: Navigation weight K of Υ(Q) = ½ tr((Q − I) K (Q − I)ᵀ):
        scalar, diagonal or d×d matrix; for a product of groups also a list with one of these per
        factor
time.samples=1 → time.samples: expected a whole number of at least 2, got 1
time={samples: 5} → time.duration: missing; this key is required: Length of the horizon, s
controllers=[eqt, eqt] →
    controllers[1]: an earlier controller has the label 'eqt'; give this one another `label`
gains.kp=1=2 → gains.kp: expected a number, got '1=2': unexpected character '=' at column 2
""").items(),
)
def test_a_wrong_override(message, override, said):
    assert message(override) == f"overrides[0]: {said}"


def test_all_that_cannot_be_applied_are_reported_together(message):
    assert message("gains.kp", "gains.kd=2", "inertia[3]=1", "gains.kp=017").splitlines() == [
        "overrides[0]: expected KEY=VALUE, got 'gains.kp'",
        "overrides[2]: inertia[3]: no entry 3; inertia has 3 entries, counted from 0",
        "overrides[3]: gains.kp: 017 is ambiguous: write 17 or 0o17",
    ]


def test_overrides_and_the_file_are_reported_together(message):
    said = message("gains.kd=-1", "time.samples=1", inertia="[1, 2]").splitlines()
    assert said == [
        "c.yaml:2:1: inertia: expected 3 diagonal entries for SO3, got 2",
        "overrides[0]: gains.kd: expected a positive definite matrix, got eigenvalues -1, -1, -1",
        "overrides[1]: time.samples: expected a whole number of at least 2, got 1",
    ]


def test_what_a_later_override_replaces_is_not_the_place(message):
    assert message("gains.kd=1", "gains={kp: 1, kd: -1}") == (
        "overrides[1]: gains.kd: expected a positive definite matrix, got eigenvalues -1, -1, -1"
    )


def test_a_new_section_of_an_override_is_its_place(message):
    assert message("gian.kp=1") == "overrides[0]: gian: unknown key; did you mean 'gains'?"
