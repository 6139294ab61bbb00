"""The figure of what is followed: of a configuration before it is run, and of its result."""

from pathlib import Path

import numpy as np
import pytest
from said import error_of, says
from scipy.spatial.transform import Rotation

from eqt_cli import api
from eqt_cli.api.drawing import desired_motion
from eqt_cli.api.loading import open_at
from eqt_cli.extend import SO3, ShownReference
from eqt_cli.figures.figure import figures
from eqt_cli.figures.labels import pose_coordinates, without_jumps
from eqt_cli.figures.render import curves

pytestmark = pytest.mark.usefixtures("unarranged")

CONFIG = {
    "group": "SE3",
    "inertia": [1, 2, 3, 4, 4, 4],
    "gains": {"kp": 1.0, "kd": 0.5},
    "reference": {"kind": "constant", "velocity": [0, 0, 2.0, 0.5, 0, 0]},
    "controllers": ["eqt"],
    "initial": {"pose": {"kind": "exp_normal", "std": 0.1}, "velocity": "fixed"},
    "ensemble": {"runs": 1, "seed": 1},
    "time": {"duration": 10.0, "samples": 11},
    "solver": {"rtol": 1e-4, "cross_check": 0},
}


def experiment(**changes):
    return desired_motion(api.load_experiment(CONFIG | changes).base)


def drawn(source, **options):
    """The numbers of each curve, by panel and coordinate."""
    drawing = figures.get("reference")(**options).draw([source])
    return {(curve.panel, curve.name): curve for curve in curves(drawing)}


def test_pose_velocity_and_torque_of_a_configuration():
    """A turn about z at 2 rad/s, beyond half-turns, on a circle of radius 0.25 m."""
    found = drawn(experiment())
    t = found["pose rotation", "ωz"].x
    np.testing.assert_allclose(found["pose rotation", "ωz"].y, 2 * t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["pose translation", "vx"].y, np.sin(2 * t) / 4, atol=1e-12)
    np.testing.assert_allclose(found["velocity translation", "vx"].y, 0.5, atol=1e-12)
    # m ω v towards the centre of the circle.
    np.testing.assert_allclose(found["torque translation", "vy"].y, 4 * 2 * 0.5, atol=1e-12)


def test_degrees_are_those_of_rotations():
    found, plain = drawn(experiment(), degrees=True), drawn(experiment())
    for key, factor in (
        (("pose rotation", "ωz"), 180 / np.pi),
        (("velocity translation", "vx"), 1),
    ):
        np.testing.assert_allclose(found[key].y, factor * plain[key].y, rtol=1e-12)
    assert "deg/s" in found["velocity rotation", "ωz"].up
    assert "N m" in found["torque rotation", "ωz"].up


def test_a_result_shows_the_same(tmp_path):
    result = api.run(api.load_experiment(CONFIG), tmp_path / "result")
    with open_at(result.path) as opened:
        stored = ShownReference(opened, "reference")
    unrun = ShownReference(experiment(), "reference")
    rows = np.searchsorted(unrun.times, stored.times - 1e-9)
    for name in ("pose", "velocity", "torque"):
        np.testing.assert_allclose(
            getattr(stored, name), getattr(unrun, name)[rows], rtol=0, atol=1e-9, err_msg=name
        )


def test_jumps_are_said_below():
    rates = ["0", "0", "step(t, 4)", "0", "0", "0"]
    shown = ShownReference(experiment(reference={"kind": "rates", "rates": rates}), "reference")
    assert shown.notes() == ["The reference: $V_{\\mathrm{d}}$ jumps by 1 at t = 4 s."]
    turns = {"kind": "rates", "rates": rates[:3]}
    of_turns = experiment(group="SO3", inertia=[1, 2, 3], reference=turns)
    shown = ShownReference(of_turns, "reference")
    assert shown.notes() == ["The reference: $V_{\\mathrm{d}}$ jumps by 1 rad/s at t = 4 s."]


def test_other_figures_need_a_run():
    assert says(
        error_of(figures.get("paper")().draw, [experiment()]),
        "config: figure 'paper' shows results, and this is…",
    )


def test_a_vector_goes_on_beyond_a_half_turn():
    angles = np.linspace(0, 30, 301)[:, None]
    axis = np.array([0.6, 0.0, 0.8])
    wrapped = ((angles + np.pi) % (2 * np.pi) - np.pi) * axis
    np.testing.assert_allclose(without_jumps(wrapped), angles * axis, rtol=0, atol=1e-12)
    for count, name in ((25, r"\log R"), (50, r"\log R,\ \mathrm{unwrapped}")):  # 2.5, 5 rad
        poses = Rotation.from_rotvec(angles[:count] * axis).as_matrix()
        assert pose_coordinates(SO3(), SO3().parts[0], poses)[1:] == (name, "rad")


def test_files_are_in_a_folder_of_the_same_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (file,) = api.plot(api.load_experiment(CONFIG, {"name": "ahead"}), formats=["json"])
    assert file == Path("figures/ahead/reference.json")
