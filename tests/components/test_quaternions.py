"""The matrices of rotations are SciPy's: of quaternions and Euler angles to the bit."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eqt_cli.components.matrix_groups import rotation_of_euler, rotation_of_quaternion
from eqt_cli.extend import group_named

RUNS = 20_000


def test_of_a_quaternion():
    q = Rotation.random(RUNS, random_state=1).as_quat()
    expected = Rotation.from_quat(q, scalar_first=False).as_matrix()
    unit = q / np.sqrt((q * q).sum(axis=-1, keepdims=True))
    np.testing.assert_array_equal(rotation_of_quaternion(unit), expected)


@pytest.mark.parametrize("size", [0, 1e-300, 1e-9, 0.99, 1.01, 3.1, 100])
def test_of_a_rotation_vector(size):
    turn = size * Rotation.random(RUNS, random_state=2).as_matrix()[..., 0]
    expected = Rotation.from_rotvec(turn).as_matrix()
    found = group_named("SO3").exp(turn)
    # Rounding of some ten operations, and of an angle before its sine is taken.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15 + 2e-16 * size)


@pytest.mark.parametrize("sequence", ["Z", "zy", "ZYX", "zyx", "XYZ", "ZXZ", "xyx"])
def test_of_euler_angles(sequence):
    angles = np.random.default_rng(3).uniform(-7, 7, (RUNS, len(sequence)))
    expected = Rotation.from_euler(sequence, angles).as_matrix()
    np.testing.assert_array_equal(rotation_of_euler(sequence, angles), expected)
