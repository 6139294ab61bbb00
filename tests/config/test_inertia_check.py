"""A time-varying inertia is refused where it is singular, and only there."""

import numpy as np
import pytest

from eqt_cli.base.errors import ConfigError

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


BODY = [[0.8, -0.12, 0.05], [-0.12, 1.1, 0.02], [0.05, 0.02, 1.5]]
SIX = "urdf: [0.8, -0.12, 0.05, 1.1, 0.02, 1.5]"


def test_six_numbers_of_a_urdf_are_the_tensor(experiment):
    """The upper triangle by rows, ixx, ixy, ixz, iyy, iyz, izz, and on SE3 the mass."""
    assert experiment(inertia=f"{{{SIX}}}").loop.inertia.matrix.tolist() == BODY
    space = {"group": "SE3", "inertia": f"{{{SIX}, mass: 200 g}}"}
    matrix = experiment("reference={torque: [0, 0, 0, 0, 0, 0]}", **space).loop.inertia.matrix
    assert matrix[:3, :3].tolist() == BODY
    assert matrix[3:, 3:].tolist() == (0.2 * np.eye(3)).tolist()
    assert not matrix[:3, 3:].any()


@pytest.mark.parametrize(
    ("group", "inertia", "said"),
    [
        (
            "SO3",
            "[0.8, -0.12, 0.05, 1.1, 0.02, 1.5]",
            "for SO3, got 6; write six numbers of a URDF or",
        ),
        ("SE3", "[0.8, -0.12, 0.05, 1.1, 0.02, 1.5]", "1.5; write six numbers of a URDF or SDF as"),
        ("SO3", "{urdf: [1, 1, 1]}", "expected ixx, ixy, ixz, iyy, iyz, izz, got [1.0, 1.0, 1.0]"),
        ("SO3", f"{{{SIX}, mass: 1}}", "expected `mass` on SE3, and none on SO3"),
        ("SE3", f"{{{SIX}}}", "expected `mass` on SE3, and none on SO3"),
        ("SE23", f"{{{SIX}, mass: 1}}", "`urdf` is the inertia of a body on SO3 or SE3, not on"),
        ("SO3*SO3", f"{{{SIX}, mass: 1}}", "a body on SO3 or SE3, not on SO3*SO3"),
    ],
)
def test_six_numbers_elsewhere_are_refused_with_what_to_write(experiment, group, inertia, said):
    numbers = {"SO3": 3, "SE3": 6, "SE23": 9, "SO3*SO3": 6}[group] * [0]
    with pytest.raises(ConfigError) as refused:
        experiment(f"reference.torque={numbers}", "initial={}", group=group, inertia=inertia)
    assert said in str(refused.value)
