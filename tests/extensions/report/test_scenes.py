"""Runs as moving pictures: what moves, and what the files hold."""

from dataclasses import replace
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from said import error_of, says
from small_experiment import mapping

import eqt_cli
from eqt_cli.api.loading import open_at
from eqt_cli.extend import EqtError
from eqt_cli.extensions.report.scenes import (
    MOST_CONTROLLERS,
    TRAIL,
    _Stage,
    box,
    flat,
    gif,
    motion,
    multirotor,
    scene_of,
    tips,
)
from eqt_cli.figures.shapes import CORNERS, FACES, camera, discs


@pytest.fixture(scope="module")
def results(paper_result):
    with open_at(paper_result) as opened:
        yield opened


def test_motion_is_that_of_the_result(results):
    shown = motion(results, 7, ["gt", "eqt"])
    assert [ensemble.label for ensemble in shown.ensembles] == ["eqt", "gt"]
    assert np.array_equal(shown.body.rotation[1], results.read("pose", controller=1, run=7))
    assert np.array_equal(
        shown.norms["torque_norm"][0], results.read("torque_norm", controller=0, run=7)
    )
    assert not shown.has_translation
    assert scene_of(shown).length == 1.0


def test_all_controllers_unless_told_otherwise(results):
    assert len(motion(results, 0).ensembles) == min(4, MOST_CONTROLLERS)


@pytest.fixture(scope="module")
def rotors(tmp_path_factory):
    """Three thrusters on a body in the plane, which starts beside its reference."""
    places = [{"at": [x, 0.0], "along": [0, 2]} for x in (0.1, -0.2)]
    places.append({"at": [0.0, 0.1], "along": [1, 0]})
    config = {
        "name": "rotors",
        "group": "SE2",
        "inertia": [0.01, 0.5, 0.5],
        "gains": {"kp": 1, "kd": 1},
        "reference": {"kind": "constant"},
        "controllers": ["eqt"],
        "actuators": [{"kind": "thrusters", "thrusters": places}],
        "initial": {"pose": {"kind": "fixed", "coordinates": [0.2, 0.0, -0.3]}},
        "ensemble": {"runs": 1},
        "time": {"duration": 0.5, "samples": 6},
        "solver": {"rtol": 1e-6, "cross_check": 0, "error_estimate": False},
    }
    folder = tmp_path_factory.mktemp("rotors") / "out"
    eqt_cli.run(config, folder)
    with open_at(folder) as opened:
        yield opened


def test_thrusts_begin_at_their_thrusters_and_are_in_proportion(rotors):
    lines = motion(rotors, 0).thrusts
    assert lines.shape == (1, 6, 3, 2, 3)
    foot, tip = lines[0, ..., 0, :], lines[0, ..., 1, :]
    assert (foot == [[0.5, 0, 0], [-1.0, 0, 0], [0, 0.5, 0]]).all()
    thrust = rotors.read("thrust", controller=0, run=0)
    along = np.array([[0, 1, 0], [0, 1, 0], [1, 0, 0]])
    expected = (thrust / np.abs(thrust).max())[..., None] * along
    np.testing.assert_allclose(tip - foot, expected, atol=1e-14)
    stage = _Stage(scene_of(motion(rotors, 0)), 1.0)
    for sample in (0, 5):
        stage.picture(sample)


def test_a_vehicle_without_thrusters_shows_none(results):
    assert motion(results, 0).thrusts.size == 0


def test_run_that_is_not_stored(results):
    assert error_of(motion, results, 60) == (
        f"{results.path}: the trajectory of run 60 is not stored; stored are runs 0 to 59"
    )


def test_group_without_a_body_to_show(results, monkeypatch):
    none = SimpleNamespace(parts=())
    monkeypatch.setattr("eqt_cli.extensions.report.scenes.group_named", lambda name: none)
    assert says(error_of(motion, results, 0), f"{results.path}: a pose of SO3 is neither a…")


def test_unknown_controller(results):
    with pytest.raises(EqtError, match=r"finds no controller 'eq'; did you mean 'eqt'\?$"):
        motion(results, 0, ["eq"])


def test_camera_is_a_rotation():
    assert camera() @ camera().T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.linalg.det(camera()) == pytest.approx(1)


def test_faces_are_flat_and_counted_around():
    for face in FACES:
        a, b, c, d = CORNERS[list(face)]
        assert a + c == pytest.approx(b + d)  # a parallelogram, whose diagonals halve each other


def test_at_most_three_faces_of_a_block_are_seen():
    generator = np.random.default_rng(1)
    for _ in range(20):
        rotation = np.linalg.qr(generator.normal(size=(3, 3)))[0]
        faces = box(rotation, np.zeros(3), 1.0)
        assert len(faces) == 3  # almost surely: one of each pair
        assert all(0 <= light <= 1 for _, light in faces)


def test_axes_of_a_frame_are_its_columns():
    rotation = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    place = np.array([1.0, 2, 3])
    expected = flat(np.array([place + 2 * rotation[:, k] for k in range(3)]))
    assert tips(rotation, place, 2.0) == pytest.approx(expected)


def test_gif_has_its_pictures_and_repeats(results, told):
    picture = Image.open(BytesIO(gif(results, 3, ["eqt"], seconds=0.5, rate=10)))
    shown = motion(results, 3, ["eqt"])
    assert shown.worst == np.nanargmax(results.read("pose_error", controller=0, run=3)) > 0
    # One more, of the largest error, comes first.
    assert (picture.n_frames, picture.info["duration"], picture.info["loop"]) == (6, 100, 0)
    assert told.steps == [("pictures drawn", 6)]
    assert told.total("pictures drawn") == 6


@pytest.mark.ci("draws every picture twice")
def test_gif_moves_and_is_the_same_again(results):
    first, second = (gif(results, 3, ["eqt"], seconds=0.3, rate=10) for _ in range(2))
    assert first == second
    picture = Image.open(BytesIO(first))
    start = np.asarray(picture.convert("RGB"))
    picture.seek(2)
    assert (start != np.asarray(picture.convert("RGB"))).any()
    assert (start[0, 0] == 255).all()  # the paper is white


def test_a_body_that_fails_is_said_to(results):
    shown = motion(results, 0)
    rotation = shown.body.rotation.copy()
    rotation[0, 5:] = np.nan
    stage = _Stage(scene_of(replace(shown, body=shown.body._replace(rotation=rotation))), 1.0)
    for sample, failed in ((0, False), (9, True)):
        stage.picture(sample)
        assert [body.gone.get_visible() for body in stage.bodies] == [failed, False, False, False]


def on_se3(folder, **changes):
    """The result of runs on SE3, open."""
    config = mapping(group="SE3", inertia=1.0, solver={"rtol": 1e-3, "cross_check": 0}, **changes)
    eqt_cli.run(config, folder)
    return open_at(folder)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A run on SE3 as a scene."""
    changes = {
        "controllers": ["eqt", "gt", "nog", "asym"],
        "reference": {"torque": ["cos(t)", "sin(t)", "0", "1", "cos(t)", "0"]},
        "initial": {"pose": "exp_normal", "velocity": "normal"},
        "time": {"duration": 4.0, "samples": 41},
    }
    with on_se3(tmp_path_factory.mktemp("flight") / "out", **changes) as opened:
        yield scene_of(motion(opened, 2))


@pytest.mark.parametrize("up", [1, -1])
def test_a_last_axis_that_points_down_is_turned_upwards(tmp_path, up):
    changes = {
        "name": "turned",
        "plant": {"forces": [{"kind": "restoring", "weight": 9.80665, "up": [0, 0, up]}]},
        "reference": {"torque": ["0.1", "0", "0", "0", "0.2", "0"]},
        "controllers": ["eqt"],
        "time": {"duration": 0.5, "samples": 3},
    }
    with on_se3(tmp_path / "out", **changes) as result:
        shown, height = motion(result, 0), result["pose"][0, 0, :, 2, 3] * up
    np.testing.assert_allclose(shown.body.position[0, :, 2], height)
    np.testing.assert_allclose(shown.frame @ [0, 0, up], [0, 0, 1])


def test_rotation_and_translation_have_curves_of_their_own(flight):
    assert list(flight.motion.norms) == [
        "attitude_angle",
        "position_error",
        "torque_norm_rotation",
        "torque_norm_translation",
    ]


def test_the_camera_sees_the_whole_paths(flight):
    shown = flight.motion
    for places in (shown.body.position, shown.reference.position):
        assert (np.abs(flat(places - flight.centre)) < flight.reach).all()


def test_a_body_that_leaves_the_others_does_not_move_the_camera(flight):
    shown = flight.motion
    position = shown.body.position.copy()
    position[1] *= 1 + 100 * np.linspace(0, 1, len(shown.times))[:, None]
    gone = scene_of(replace(shown, body=shown.body._replace(position=position)))
    assert np.linalg.norm(gone.centre - flight.centre) < flight.reach
    assert gone.reach < 3 * flight.reach
    assert gone.ground[0, 0, 2] > flight.ground[0, 0, 2] - 3 * flight.reach


def test_a_rotor_is_an_arm_and_a_disc():
    disc = list(discs(np.array([[[0.5, 0.5, 0], [0, 0, 1]]])))
    assert [len(polygon) for polygon in disc] == [2, 24]
    drawn = multirotor(disc, np.eye(3), np.zeros(3), 2.0)
    assert sorted(len(outline) for outline, _ in drawn) == [2, 24]


def test_the_ground_is_level_and_below_all_bodies(flight):
    heights = np.unique(flight.ground[..., 2])
    assert heights.size == 1
    assert heights[0] < flight.motion.body.position[..., 2].min() - flight.length


def test_a_trail_shows_the_last_seconds(flight):
    times = flight.motion.times
    late = len(times) - 1
    shown = flight.trail(1, late)
    assert len(shown) == np.count_nonzero(times >= times[late] - TRAIL)
    assert np.array_equal(shown[-1], flight.motion.body.position[1, late])


def test_bodies_that_only_turn_leave_the_trail_of_their_x_axis(results):
    scene = scene_of(motion(results, 1, ["eqt"]))
    np.testing.assert_allclose(np.linalg.norm(scene.trails[0], axis=-1), 1, rtol=1e-6)


def test_three_bodies_leave_no_place_empty(results):
    stage = _Stage(scene_of(motion(results, 0, ["eqt", "gt", "nog"])), 1.0)
    boxes = [body.axes.get_window_extent() for body in stage.bodies]
    assert boxes[2].width > 1.9 * boxes[0].width
    stage.picture(0)
    for body in stage.bodies:  # with equal scales
        across, up = np.ptp(body.axes.get_xlim()), np.ptp(body.axes.get_ylim())
        panel = body.axes.get_window_extent()
        assert across / up == pytest.approx(panel.width / panel.height)
        assert body.name.get_text() == body.motion.ensembles[body.index].title


def test_the_gif_says_how_fast_it_is_played_and_names_of_curves_stand_right_of_bodies(flight):
    stage = _Stage(flight, 2.5)
    stage.picture(0)
    assert stage.clock.get_text() == "run 2,  $t$ = 0.0 s,  2.5 times as fast.  Grey: reference"
    bodies = [each.axes.get_window_extent() for each in stage.bodies]
    names = [each.now.axes.yaxis.label.get_window_extent() for each in stage.curves]
    assert max(box.x1 for box in bodies) < min(box.x0 for box in names)
