"""The figure of attitude errors on the sphere, and the projection it is drawn in."""

import numpy as np
import pytest
from said import error_of

from eqt_cli.components.groups import group_named
from eqt_cli.figures.run_figures import Sphere, path, project, radius_of

pytestmark = pytest.mark.usefixtures("unarranged")

ROUNDING = {"atol": 1e-15}  # of a few operations on numbers up to 1


def around(angle, towards):
    """The unit vector at an angle from e_z, towards a direction in the plane."""
    return np.array(
        [np.sin(angle) * np.cos(towards), np.sin(angle) * np.sin(towards), np.cos(angle)]
    )


@pytest.mark.parametrize("angle", [0, 1e-9, 0.7, np.pi / 2, 2.5, np.pi - 1e-6])
@pytest.mark.parametrize("towards", [0.0, 1.0, -2.5])
def test_points_keep_their_direction_and_lie_at_sin_of_half_the_angle(angle, towards):
    x, y = project(around(angle, towards), 2)
    expected = np.sin(angle / 2) * np.array([np.cos(towards), np.sin(towards)])
    np.testing.assert_allclose([x, y], expected, **ROUNDING)
    assert radius_of(angle) == np.sin(angle / 2)


def test_the_point_opposite_the_centre_is_on_the_rim():
    np.testing.assert_array_equal(project(np.array([0.0, 0.0, -1.0]), 2), [1, 0])


@pytest.mark.parametrize(("centre", "right", "up"), [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_axes_are_seen_from_outside(centre, right, up):
    unit = np.eye(3)
    edge = np.sin(np.pi / 4)
    np.testing.assert_allclose(project(unit[centre], centre), [0, 0], **ROUNDING)
    np.testing.assert_allclose(project(unit[right], centre), [edge, 0], **ROUNDING)
    np.testing.assert_allclose(project(unit[up], centre), [0, edge], **ROUNDING)


def test_areas_are_equal():
    angle, towards, step = 2.0, 0.3, 1e-4
    corners = [(angle, towards), (angle + step, towards), (angle, towards + step)]
    (x0, y0), (x1, y1), (x2, y2) = (project(around(*corner), 2) for corner in corners)
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    # The unit disc has π, the sphere 4π; the parallelogram is the piece to first order in the step.
    assert 4 * area == pytest.approx(np.sin(angle) * step**2, rel=10 * step)


def test_a_path_past_the_opposite_point_has_a_gap_and_no_line_across():
    angles = np.linspace(np.pi - 0.5, np.pi + 0.5, 8)
    x, y = path(np.stack([around(angle, 0.2) for angle in angles]), 2)
    assert np.isnan(x).sum() == 1
    assert np.nanmax(np.hypot(np.diff(x), np.diff(y))) < 0.1
    assert np.nanmin(np.hypot(x, y)) > 0.96  # 0.25 rad from the rim at most


def test_a_path_along_the_rim_is_finer_and_in_one_piece():
    turns = np.linspace(0, 2 * np.pi, 9)
    x, y = path(np.stack([around(3.0, turn) for turn in turns]), 2)
    assert not np.isnan(x).any()
    assert np.hypot(np.diff(x), np.diff(y)).max() < 0.1


def test_a_path_near_the_centre_is_left_as_it_is():
    turns = np.linspace(0, 2 * np.pi, 5)
    points = np.stack([around(1.0, turn) for turn in turns])
    np.testing.assert_array_equal(path(points, 2), project(points, 2))


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_paths_are_those_of_the_error_in_the_spatial_frame(axis, so3, opened):
    results, centre = opened(so3), "xyz".index(axis)
    drawing = Sphere(axis=axis).draw([results])
    line = drawing.axes[1].lines[4]
    assert line.get_label() == "run 4"
    error = results["pose"][1, 4] @ results["desired_pose"].swapaxes(-1, -2)
    x, y = path(error[..., centre], centre)
    np.testing.assert_allclose(line.get_xdata(), x, **ROUNDING)
    np.testing.assert_allclose(line.get_ydata(), y, **ROUNDING)


def test_of_a_rigid_motion_the_rotation_is_shown(se3, opened):
    results, G = opened(se3), group_named("SE3")
    drawing = Sphere().draw([results])
    assert [axes.get_title() for axes in drawing.axes] == ["EqT", "GT", "nog", "asym"]
    error = results["pose"][0, 0] @ G.inverse(results["desired_pose"])
    x, _ = path(error[:, :3, 2], 2)
    np.testing.assert_allclose(drawing.axes[0].lines[0].get_xdata(), x, **ROUNDING)


def test_two_rotations_have_two_columns(simulate, opened, picture):
    result = simulate(
        group="SO3*SO3",
        inertia=1.0,
        gains={"kp": [1.0, 2.0], "kd": 0.5},
        reference={"torque": ["cos(t)", "0", "0", "0", "sin(t)", "0"]},
        initial={
            "pose": [{"kind": "haar"}, {"kind": "haar"}],
            "velocity": {"kind": "normal", "std": 1.0},
        },
        controllers=["eqt"],
        ensemble={"runs": 2, "seed": 1},
    )
    drawing = picture(Sphere(), opened(result))
    assert [axes.get_title() for axes in drawing.axes] == ["EqT, rotation 1", "EqT, rotation 2"]


def test_the_graticule_is_numbered(so3, opened, picture):
    texts = [text.get_text() for text in picture(Sphere(axis="x"), opened(so3)).axes[0].texts]
    assert [text for text in texts if text] == ["45°", "90°", "135°", "180°", "$e_y$", "$e_z$"]


@pytest.mark.parametrize(
    ("group", "torque", "has"),
    [("SE2", ["0", "1", "0"], "turns in a plane only"), ("R3", ["0", "1", "0"], "has none")],
)
def test_groups_without_rotations_in_space_are_refused(group, torque, has, simulate, opened):
    result = simulate(
        group=group,
        inertia=1.0,
        reference={"torque": torque},
        controllers=["eqt"],
        ensemble={"runs": 2, "seed": 1},
    )
    assert error_of(Sphere().draw, [opened(result)]) == (
        f"{result}: figure 'sphere' shows rotations in space, and {group} {has}; figure 'runs' "
        "shows its errors over time"
    )
