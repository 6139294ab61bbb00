"""`--set KEY=VALUE`: what it changes, and what is said of one that is wrong, word by word."""

import pytest
from case_tables import from_yaml
from said import says


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


def test_a_key_may_be_repeated_with_its_value_only(experiment, message):
    assert experiment("gains.kp=2", "gains.kp=2").resolved["gains"]["kp"] == 2.0
    said = "overrides[2]: gains.kp: is given twice, as 'gains.kp=2' and 'gains.kp=3'…"
    assert says(message("gains.kp=2", "gains.kd=2", "gains.kp=3"), said)


@from_yaml
def test_a_wrong_override(message, override, said):
    assert says(message(override), f"overrides[0]: {said}")


def test_all_that_cannot_be_applied_are_reported_together(message):
    assert message("gains.kp", "gains.kd=2", "inertia[3]=1", "gains.kp=017").splitlines() == [
        "overrides[0]: expected KEY=VALUE, got 'gains.kp'",
        "overrides[2]: inertia[3]: no entry 3; inertia has 3 entries, counted from 0",
        "overrides[3]: gains.kp: 017 is ambiguous: write 17 or 0o17",
    ]


def test_overrides_and_the_file_are_reported_together(message):
    assert says(
        message("gains.kd=-1", "gains.kp=-1", inertia="[1, 2]"),
        "c.yaml:2:1: inertia: expected 3 diagonal entries for SO3, got 2\n"
        "overrides[0]: gains.kd: expected a positive definite matrix, got eigenvalues -1, -1, -1\n"
        "overrides[1]: gains.kp: must be positive…stiffness -2, -2, -2…",
    )


def test_what_a_later_override_replaces_is_not_the_place(message):
    assert message("gains.kd=1", "gains={kp: 1, kd: -1}") == (
        "overrides[1]: gains.kd: expected a positive definite matrix, got eigenvalues -1, -1, -1"
    )


def test_a_new_section_of_an_override_is_its_place(message):
    assert message("gian.kp=1") == "overrides[0]: gian: unknown key; did you mean 'gains'?"
