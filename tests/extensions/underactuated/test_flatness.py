"""The attitude that a force asks for, and its rates along a motion."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eqt_cli.components.motions import check_rigid_body, only_direction, unit_vector
from eqt_cli.extend import Inertia, Jet, Problems, cos, group_named, sin, stack
from eqt_cli.extensions.underactuated.attitude import attitude, check_along, third_axis

AXES = [
    *((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, 0.0, -0.8), (0.0, 1.0)),
    (0.6, 0.8),
]
STEP = 1e-3


def force(t, space):
    return stack([sin(t) + 0.3, cos(2.0 * t) - 0.2, 2.0 + sin(3.0 * t)][-space:])


def commanded(along, t, R=None, free=False):
    """Of runs, with a leading axis; t is a number or a series."""
    space = len(along)
    t = t if isinstance(t, Jet) else Jet([np.array([t])])
    heading = None if free or space == 2 else 0.7 * t + t * t
    return attitude(force(t, space), along, heading, R)


@pytest.mark.parametrize("along", AXES)
def test_the_axis_points_along_the_force_and_the_rates_are_those_of_the_attitude(along):
    G = group_named(f"SO{len(along)}")
    found = commanded(along, Jet.time(np.array([0.4]), 2))
    R = found.R[0]
    np.testing.assert_allclose(R.T @ R, np.eye(len(along)), atol=1e-15)
    F = force(Jet([np.array([0.4])]), len(along)).value[0]
    np.testing.assert_allclose(R @ along, F / np.linalg.norm(F), atol=1e-15)

    def velocity(t):
        before, after = (commanded(along, t + k * STEP).R for k in (-1, 1))
        return G.log(np.swapaxes(before, -1, -2) @ after) / (2 * STEP)

    # Central differences of second order, of a motion at some rad/s.
    np.testing.assert_allclose(found.velocity, velocity(0.4), atol=1e-4)
    rate = (velocity(0.4 + 10 * STEP) - velocity(0.4 - 10 * STEP)) / (20 * STEP)
    np.testing.assert_allclose(found.acceleration, rate, atol=2e-2)


@pytest.mark.parametrize("along", AXES[:2])
def test_the_heading_is_the_course_of_the_first_axis(along):
    """As in Lee (2010) with thrust along −b₃, and in Mellinger and Kumar (2011) along b₃."""
    R = commanded(along, 0.4).R[0]
    b3 = np.sign(along[2]) * R @ along
    ahead = np.array([np.cos(0.44), np.sin(0.44), 0.0])  # ψ = 0.7·0.4 + 0.4²
    second = np.cross(b3, ahead) / np.linalg.norm(np.cross(b3, ahead))
    np.testing.assert_allclose(R, np.stack([np.cross(second, b3), second, b3], 1), atol=1e-15)
    np.testing.assert_array_equal(third_axis(along), [0, 0, 1])


def test_without_a_heading_it_is_the_next_attitude_and_does_not_turn_about_the_push():
    along = AXES[3]
    R = Rotation.from_rotvec([[0.4, -0.3, 0.8]]).as_matrix()
    found = commanded(along, Jet.time(np.array([0.4]), 2), R, free=True)
    F = force(Jet([np.array([0.4])]), 3).value[0]
    v, n = R[0] @ along, F / np.linalg.norm(F)
    axis = np.cross(v, n) / np.linalg.norm(np.cross(v, n))
    between = Rotation.from_rotvec(np.arccos(v @ n) * axis).as_matrix()
    np.testing.assert_allclose(found.R[0], between @ R[0], atol=1e-15)
    assert found.velocity[0] @ along == pytest.approx(0.0, abs=1e-15)
    assert found.acceleration[0] @ along == pytest.approx(0.0, abs=1e-14)
    # R_c Ω_c = n × ṅ, whatever R is.
    other = commanded(along, Jet.time(np.array([0.4]), 2), np.eye(3)[None], free=True)
    for one, two in zip(found[1:], other[1:], strict=True):
        np.testing.assert_allclose(found.R @ one[0], other.R @ two[0], atol=1e-14)


def test_rates_above_the_order_of_the_force_are_0():
    first = commanded(AXES[0], Jet.time(np.array([0.4]), 1))
    both = commanded(AXES[0], Jet.time(np.array([0.4]), 2))
    np.testing.assert_array_equal(first.velocity, both.velocity)
    assert not first.acceleration.any()


@pytest.mark.parametrize(
    ("across", "found"), [(0.0, [0.0, 0.0, -1.0]), (1e-10, [0.0, 0.0, -1.0]), (1e-8, None)]
)
def test_pushes_along_one_line_have_a_direction(across, found):
    """That of the largest."""
    pushes = np.array([[0.0, across, 0.0], [0.0, 0.0, 0.0], [1.0, 2.0, -4.0]])
    direction = only_direction(pushes)
    assert found is None or direction.tolist() == pytest.approx(found, abs=1e-9)
    assert (direction is None) == (found is None)


@pytest.mark.parametrize(
    ("along", "fits"), [([0, 0, 2], True), ([0, 0, 0], False), ([0, 1], False), (None, True)]
)
def test_a_body_axis_is_a_direction_in_space(along, fits):
    problems = Problems()
    check_along(along, 3, problems)
    assert (not list(problems)) == fits
    assert not fits or along is None or unit_vector(along) == (0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("entry", "size", "said"),
    [
        ((3, 3), 1e-14, None),
        ((0, 3), 1e-14, None),
        ((0, 3), 1e-9, "couples rotation and translation"),
        ((4, 4), 1e-9, "masses that differ by direction"),
        ((3, 3), 1e-9, "masses that differ by direction"),
        ((3, 4), 1e-9, "masses that differ by direction"),
    ],
)
def test_the_inertia_of_a_rigid_body_about_its_centre_of_mass(entry, size, said):
    M = np.diag([1.0, 2.0, 3.0, 2.0, 2.0, 2.0])
    M[entry] += size
    problems = Problems()
    check_rigid_body(group_named("SE3"), Inertia(M, np.linalg.inv(M)), problems)
    messages = [each.message for each in problems]
    assert [said in each for each in messages] == [True] * (said is not None)
