"""A time-varying inertia is refused where it is singular, and only there."""

import pytest

TURNING = "['cos(500*t)', '-sin(500*t)', 0], ['sin(500*t)', 'cos(500*t)', 0], [0, 0, 1]"


@pytest.mark.parametrize(
    "inertia",
    [
        "{initial: 1, factor: [['1 - 0.999*sin(5*t)', 0, 0], [0, 1, 0], [0, 0, 1]]}",
        "{initial: 1, factor: [['exp(-9*t)', 0, 0], [0, 'exp(-9*t)', 0], [0, 0, 'exp(-9*t)']]}",
        f"{{initial: [1, 100, 100], factor: [{TURNING}]}}",
    ],
)
def test_nearly_singular_is_not_singular(experiment, inertia):
    assert experiment(inertia=inertia).name == "c"


HEAVY = "[1, 1, 3]"
"""The moments of no rigid body."""


def test_an_inertia_that_no_rigid_body_has_is_remarked(experiment):
    [(path, remark)] = experiment(inertia=HEAVY).remarks()
    assert path == ("inertia",)
    assert remark == (
        "not the inertia of a rigid body: its principal moments "
        "1, 1 and 3 kg m² violate the triangle inequality: 1 + 1 < 3; correct it, or "
        "add `rigid: false` if the system is not one rigid body"
    )


def test_it_is_not_remarked_of_what_is_said_not_to_be_rigid(experiment):
    assert list(experiment("rigid=false", inertia=HEAVY).remarks()) == []
    assert list(experiment().remarks()) == []


def test_the_remark_is_no_number_of_the_experiment(experiment):
    assert experiment("rigid=false").digest == experiment().digest
