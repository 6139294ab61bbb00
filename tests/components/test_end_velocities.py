"""Velocities at the ends of a motion through points, against clamped splines of SciPy."""

import re

import numpy as np
import pytest
import yaml
from case_tables import refusal
from said import mentions
from scipy.interpolate import CubicSpline, make_interp_spline
from small_experiment import mapping

from eqt_cli.api import load_experiment
from eqt_cli.base.errors import ConfigError
from eqt_cli.extend import group_named

TIMES, PLACES = [0.0, 1.0, 2.5, 4.0], [[0, 0, 1], [1, 0.5, 1.2], [2, -0.5, 1.5], [2.5, 0, 2]]
IN_SPACE = [{"matrix": group_named("R3").exp(np.array(place, float)).tolist()} for place in PLACES]
ENDS = [0.5, -0.2, 0.1], [1.0, 0.3, -0.4]


def points(name, poses, ends=ENDS):
    rows = [{"t": t, name: pose} for t, pose in zip(TIMES, poses, strict=True)]
    rows[0]["velocity"], rows[-1]["velocity"] = ends
    return rows


def text(group, reference):
    size = {"R3": 3, "SE3": 6}[group]
    return yaml.safe_dump(
        {
            "group": group,
            "inertia": [1.0] * size,
            "gains": {"kp": 1.0, "kd": 1.0},
            "reference": reference,
            "controllers": ["eqt"],
            "time": {"duration": 4.0},
            **(
                {"model": {"forces": [{"kind": "restoring", "weight": 9.80665}]}}
                if size == 6
                else {}
            ),
        }
    )


def motion(experiment_of, group, reference, t):
    experiment = experiment_of(text(group, reference))
    return experiment.loop.reference.motion(experiment.group, t)


def test_waypoints_in_a_vector_space_give_the_clamped_spline(experiment_of):
    t = np.linspace(0.0, 4.0, 33)
    reference = {"kind": "waypoints", "points": points("pose", IN_SPACE)}
    Q, V, V_dot = motion(experiment_of, "R3", reference, t)
    expected = CubicSpline(TIMES, PLACES, bc_type=((1, ENDS[0]), (1, ENDS[1])))
    for k, found in enumerate((Q[..., :3, 3], V, V_dot)):
        np.testing.assert_allclose(found, expected(t, k), rtol=0, atol=1e-11)


@pytest.mark.needs("underactuated")
@pytest.mark.ci("0.5 s")
def test_waypoints_on_a_group_begin_and_end_with_these_velocities(experiment_of):
    """V is that of the pose by finite differences, and V̇ has no jumps."""
    G, rng = group_named("SE3"), np.random.default_rng(4)
    poses = [{"matrix": G.exp(x).tolist()} for x in 0.4 * rng.standard_normal((4, 6))]
    ends = [x.tolist() for x in rng.standard_normal((2, 6))]
    reference = {"kind": "waypoints", "points": points("pose", poses, ends)}
    t, h = np.array([0.0, 1.0, 2.5, 4.0]), 1e-6
    at = {s: motion(experiment_of, "SE3", reference, t + s) for s in (-h, 0.0, h)}
    np.testing.assert_allclose(at[0.0][1][[0, -1]], ends, rtol=0, atol=1e-9)
    np.testing.assert_allclose(at[h][2][1:3], at[-h][2][1:3], rtol=0, atol=1e-4)


@pytest.mark.needs("underactuated")
def test_a_motion_of_least_snap_begins_and_ends_with_these_velocities(experiment_of):
    """SciPy's spline of degree 7 with velocity, and no acceleration and jerk, at the ends."""
    reference = {"kind": "flat", "minimum_snap": points("position", PLACES)}
    reference["along"] = [0, 0, 1]
    t = np.linspace(0.0, 4.0, 33)
    Q, _, _ = motion(experiment_of, "SE3", reference, t)
    rest = [(2, np.zeros(3)), (3, np.zeros(3))]
    sides = [[(1, np.array(end)), *rest] for end in ENDS]
    expected = make_interp_spline(TIMES, np.array(PLACES, float), 7, bc_type=tuple(sides))
    np.testing.assert_allclose(Q[..., :3, 3], expected(t), rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("index", "velocity", "said"),
    [
        (0, [1, 2], "points[0].velocity: expected 3 numbers, got 2"),
        (1, [1, 2, 3], "points[1].velocity: belongs to the first and the last point alone…"),
        (3, "fast", "points[3].velocity: expected a list…'fast'"),
    ],
)
def test_what_is_no_velocity_at_an_end_is_refused(experiment_of, index, velocity, said):
    rows = points("pose", IN_SPACE)
    rows[index]["velocity"] = velocity
    reference = {"kind": "waypoints", "points": rows}
    assert mentions(refusal(ConfigError, experiment_of, text("R3", reference)), f"reference.{said}")


HOLDS = {
    "at the end": ([0, 10, 30], [0, 40, 40]),
    "between motions": ([0, 8, 10, 25, 40], [0, 20, 50, 50, -10]),
    "at the start": ([0, 5, 6, 12], [10, 10, 25, 60]),
}


@pytest.mark.parametrize("name", HOLDS)
def test_a_hold_that_swings_is_remarked_on_with_its_size_and_a_cure(name):
    times, degrees = HOLDS[name]
    points = [
        {"t": t, "pose": {"rotvec": [0, 0, f"{x} deg"]}}
        for t, x in zip(times, degrees, strict=True)
    ]
    reference = load_experiment(mapping(reference={"kind": "waypoints", "points": points})).base
    (said,) = reference.loop.reference.remarks(reference.group)
    since, until, swing, *more, left = map(
        float, re.findall(r"(\d+\.?\d*(?:e-\d+)?)(?=[ ,;]|$)", said)
    )
    row = times.index(since)
    inside = np.linspace(since, until, 2001)

    def away(times, degrees):  # about one axis, the spline is the natural one of the angle
        angle = CubicSpline(times, degrees, bc_type="natural")(inside)
        return np.abs(angle - dict(zip(times, degrees, strict=True))[since]).max()

    assert times[row + 1] == until
    assert swing == pytest.approx(away(times, degrees), rel=0.01)  # three digits are written
    times, degrees = [*times, *more], [*degrees, degrees[row], degrees[row]]
    order = np.argsort(times)
    stopped = away(list(np.array(times)[order]), list(np.array(degrees)[order]))
    assert left == pytest.approx(stopped, rel=0.06)  # two digits
    assert left < swing / 5


def test_waypoints_that_move_or_stay_are_not_remarked_on():
    for degrees in ([0, 40, 50], [30, 30, 30]):
        points = [
            {"t": 5 * k, "pose": {"rotvec": [0, 0, f"{x} deg"]}} for k, x in enumerate(degrees)
        ]
        base = load_experiment(mapping(reference={"kind": "waypoints", "points": points})).base
        assert not list(base.loop.reference.remarks(base.group))
