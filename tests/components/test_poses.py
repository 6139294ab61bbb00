"""Poses as they are written in a configuration."""

import numpy as np
import pytest
import yaml
from case_tables import from_yaml
from said import says
from scipy.spatial.transform import Rotation

from eqt_cli.components.pose_notation import pose_from
from eqt_cli.extend import Problems, group_named

QUARTER = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()


@pytest.mark.parametrize(
    "value",
    [
        {"rotvec": [0, 0, "90 deg"]},
        {"rotvec": [0, 0, "pi/2"]},
        {"quaternion": {"xyzw": [0, 0, "sqrt(1/2)", "sqrt(1/2)"]}},
        {"quaternion": {"wxyz": ["sqrt(1/2)", 0, 0, "sqrt(1/2)"]}},
        {"euler": {"sequence": "ZYX", "angles": ["90 deg", 0, 0]}},
        {"euler": {"sequence": "xyz", "angles": [0, 0, "pi/2"]}},
        {"matrix": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]},
    ],
)
@pytest.mark.parametrize("name", ["SO3", "SE3"])
def test_ways_to_write_a_quarter_turn(value, name):
    G, problems = group_named(name), Problems()
    found = pose_from(value, G, problems)
    assert not list(problems)
    np.testing.assert_allclose(G.rotation(found), QUARTER, rtol=0, atol=1e-15)


@from_yaml
def test_what_is_wrong_with_a_pose(value, message):
    problems = Problems()
    assert pose_from(yaml.safe_load(value), group_named("SO3"), problems) is None
    assert any(says(problem.message, message) for problem in problems)


@pytest.mark.parametrize("pose", [{"position": [0, -1e308]}, [[1, 0, 0], [0, 1, 1e308], [0, 0, 1]]])
def test_places_that_no_body_reaches(pose):
    problems = Problems()
    assert pose_from(pose, group_named("SE2"), problems) is None
    [problem] = problems
    assert problem.message == "expected numbers of at most 1e+15, got 1e+308"
