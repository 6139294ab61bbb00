"""Runs written for other programs, read back by readers of their own."""

from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml
from said import error_of, mentions
from scipy.io import loadmat

import eqt_cli
from eqt_cli.extensions.logs.export_run import _mcap, export_run, flight

CONFIGS = Path(__file__).parents[3] / "configs"
FEW = {"ensemble.runs": 2, "time.duration": 1.0, "time.samples": 51, "solver.cross_check": 0}


@pytest.fixture(scope="module")
def runs(made_once):
    """Results on SO(3), SE(3) and SE(2)."""

    def make(folder):
        for name in ("paper", "se3", "se2_vehicle"):
            settings = FEW | {"controllers": ["eqt", "gt"]}
            eqt_cli.run(eqt_cli.load_experiment(CONFIGS / f"{name}.yaml", settings), folder / name)

    folder = made_once("runs to be exported", make)
    return {name: eqt_cli.open_result(folder / name) for name in ("paper", "se3", "se2_vehicle")}


@pytest.mark.parametrize("name", ["paper", "se3", "se2_vehicle"])
def test_csv_is_a_recording_that_explains_the_whole_run(runs, name, tmp_path):
    export_run(runs[name].opened, tmp_path / "run.csv", ["gt"], 1)
    (found, *_) = eqt_cli.compare_measured(
        runs[name], tmp_path / "run.csv", run=1, controllers=["gt"]
    )
    assert found.rows == 51
    assert [share.explained for share in found.shares] == pytest.approx([1] * len(found.shares))


def test_tum_has_positions_and_attitudes_with_w_last(runs, tmp_path):
    export_run(runs["se3"].opened, tmp_path / "run.tum", ["reference"], 1)
    rows = np.loadtxt(tmp_path / "run.tum")
    desired = runs["se3"].read("desired_pose")
    np.testing.assert_array_equal(rows[:, 1:4], desired[:, :3, 3])
    x, y, z, w = rows[:, 4:].T
    np.testing.assert_allclose(1 - 2 * (y * y + z * z), desired[:, 0, 0], atol=1e-8)
    np.testing.assert_allclose(2 * (x * y + w * z), desired[:, 1, 0], atol=1e-8)


def test_a_heading_is_a_turn_about_z(runs, tmp_path):
    export_run(runs["se2_vehicle"].opened, tmp_path / "run.mat", ["eqt"], 0)
    found = loadmat(tmp_path / "run.mat")
    pose = runs["se2_vehicle"].read("pose", controller="eqt", run=0)
    velocity = runs["se2_vehicle"].read("velocity", controller="eqt", run=0)
    w, x, y, z = found["quaternion"].T
    np.testing.assert_allclose(w * w - z * z, pose[:, 0, 0], atol=1e-8)
    assert not x.any()
    assert not y.any()
    np.testing.assert_array_equal(found["position"][:, :2], pose[:, :2, 2])
    np.testing.assert_array_equal(found["angular_velocity"][:, 2], velocity[:, 0])
    in_space = np.einsum("nij,nj->ni", pose[:, :2, :2], velocity[:, 1:])
    np.testing.assert_allclose(found["velocity"][:, :2], in_space, atol=1e-8)
    np.testing.assert_array_equal(
        found["torque"][:, 2], runs["se2_vehicle"].read("torque", controller="eqt", run=0)[:, 0]
    )


def test_mcap_has_topics_of_all_laws_and_the_reference(runs, tmp_path):
    pytest.importorskip("rosbags", reason="needs the extra bags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    export_run(runs["se3"].opened, tmp_path / "run.mcap", [], 1)
    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([tmp_path / "run.mcap"], default_typestore=store) as bag:
        topics = {each.topic: each.msgcount for each in bag.connections}
        assert topics == {
            f"/{law}/{what}": 51
            for law in ("eqt", "gt", "reference")
            for what in ("odometry", "wrench")
        }
        of = [each for each in bag.connections if each.topic == "/gt/odometry"]
        read = [(t, bag.deserialize(raw, c.msgtype)) for c, t, raw in bag.messages(of)]
    np.testing.assert_array_equal([t for t, _ in read], np.round(1e9 * runs["se3"].times))
    places = [[m.pose.pose.position.x, m.pose.pose.position.z] for _, m in read]
    pose = runs["se3"].read("pose", controller="gt", run=1)
    np.testing.assert_array_equal(places, pose[:, [0, 2], 3])
    twists = [[m.twist.twist.angular.y, m.twist.twist.linear.x] for _, m in read]
    velocity = runs["se3"].read("velocity", controller="gt", run=1)
    np.testing.assert_allclose(twists, velocity[:, [1, 3]], atol=1e-8)  # of the solver's drift


def test_topics_are_unique(runs, tmp_path):
    pytest.importorskip("rosbags", reason="needs the extra bags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    flown = flight(runs["paper"].opened, "eqt", 0)
    (tmp_path / "run.mcap").write_bytes(_mcap({"a-b": flown, "a_b": flown}))
    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([tmp_path / "run.mcap"], default_typestore=store) as bag:
        topics = {each.topic for each in bag.connections}
    names = ("odometry", "wrench")
    assert topics == {f"/{law}/{name}" for law in ("a_b", "a_b_1") for name in names}


def test_a_force_is_in_newtons(tmp_path):
    """SE_2(3) has a velocity beside the position, whose dual is in N s."""
    settings = FEW | {"controllers": ["eqt"]}
    run = eqt_cli.run(eqt_cli.load_experiment(CONFIGS / "se23.yaml", settings), tmp_path / "out")
    wrench = run.read("torque", controller="eqt", run=0)
    np.testing.assert_array_equal(flight(run.opened, "eqt", 0).force, wrench[:, 6:9])


@from_yaml
def test_results_without_such_a_run(tmp_path, config, changes, message):
    loaded = eqt_cli.load_experiment(CONFIGS / f"{config}.yaml", FEW | changes)
    run = eqt_cli.run(loaded, tmp_path / "out")
    assert mentions(error_of(export_run, run.opened, tmp_path / "run.csv", [], 0), message)


def test_a_file_that_exists_stays(runs, tmp_path):
    (tmp_path / "run.csv").write_text("mine", encoding="utf-8")
    said = error_of(export_run, runs["se3"].opened, tmp_path / "run.csv", [], 0)
    assert said == f"--export: {tmp_path / 'run.csv'} exists; remove it, or give another name"


@from_yaml
def test_what_cannot_be_written(runs, tmp_path, name, laws, run, message):
    said = error_of(export_run, runs["se3"].opened, tmp_path / name, laws, run)
    assert mentions(said, message)
