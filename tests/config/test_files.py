"""Experiments that take waypoints and starts from files, which their results keep."""

import numpy as np
import pytest
from case_tables import from_yaml
from said import mentions, says
from scipy.spatial.transform import Rotation

from eqt_cli.base.errors import ConfigError
from eqt_cli.base.store_reader import open_results
from eqt_cli.base.yaml_source import dump
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.config.remarks import remarks
from eqt_cli.config.study import study
from eqt_cli.runs.run_study import execute

pytestmark = pytest.mark.needs("logs")  # columns with units

CONFIG = """task: track
group: SO3
inertia: 1.0
gains: {kp: 1.0, kd: 1.0}
reference: {kind: waypoints, file: data/plan.csv}
controllers: [eqt]
initial: {file: starts.csv}
time: {duration: 2, samples: 11}
solver: {cross_check: 0}
"""
PLAN = "t,wx [rad],wy [rad],wz [rad]\n0,0,0,0\n1,0.1,0.2,0\n2.5,0.3,0.2,0.1\n"
STARTS = "wx [rad],wy [rad],wz [rad]\n0.1,0,0\n0,0.2,0\n0,0,0.3\n"


@pytest.fixture
def config(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data/plan.csv").write_text(PLAN)
    (tmp_path / "starts.csv").write_text(STARTS)
    path = tmp_path / "c.yaml"
    path.write_text(CONFIG)
    return path


def messages(path, *overrides):
    with pytest.raises(ConfigError) as caught:
        build(read_config(path, overrides))
    return [problem.message for problem in caught.value.problems]


def test_runs_are_the_rows_of_the_file(config):
    assert build(read_config(config)).config.ensemble.runs == 3
    assert build(read_config(config, ["ensemble.runs=2"])).config.ensemble.runs == 2
    expected = "expected at most 3, the number of rows of starts.csv, got 4"
    assert messages(config, "ensemble.runs=4") == [expected]


def test_content_is_part_of_the_identity_and_the_name_is_not(config):
    one = build(read_config(config)).digest
    (config.parent / "other.csv").write_text(PLAN)
    assert build(read_config(config, ["reference.file=other.csv"])).digest == one
    (config.parent / "data/plan.csv").write_text(PLAN.replace("0.3", "0.4"))
    assert build(read_config(config)).digest != one


@pytest.mark.ci("computes an experiment several times")
def test_a_result_runs_again_without_its_files(config, tmp_path):
    one = execute(study(read_config(config)), tmp_path / "one").folder
    (config.parent / "data/plan.csv").unlink()
    (config.parent / "starts.csv").unlink()
    for k, again in enumerate((one.results, one.path / "config.yaml")):
        other = execute(study(read_config(again)), tmp_path / f"again{k}").folder
        with open_results(one.path) as left, open_results(other.path) as right:
            np.testing.assert_array_equal(left["pose"], right["pose"])


def test_starts_of_a_table_take_a_mapping(config):
    """Angles in deg and axes FRD, of a file that names its columns otherwise."""
    rows = "psi,pitch,roll,wx,wy,wz\n30,20,10,1,2,3\n"
    (config.parent / "flown.csv").write_text(rows)
    mapping = "{columns: {yaw: psi}, units: {yaw: deg, pitch: deg, roll: deg}, body: FRD to FLU}"
    asked = ["initial.file=flown.csv", "initial.relative=true", f"initial.mapping={mapping}"]
    found = build(read_config(config, asked))
    FRD = np.diag([1.0, -1.0, -1.0])
    R = Rotation.from_euler("ZYX", [30, 20, 10], degrees=True).as_matrix() @ FRD
    np.testing.assert_allclose(found.start.poses.errors, [R], atol=1e-15)
    np.testing.assert_array_equal(found.start.velocities.errors, [[1, -2, -3]])
    assert found.resolved["initial"]["mapping"]["body"] == "FRD to FLU"


@from_yaml
def test_a_mapping_of_starts_that_will_not_do(config, asked, said):
    [message] = messages(config, *asked)
    assert says(message, said)


def test_runs_start_where_those_of_a_result_did(config, tmp_path):
    one = execute(study(read_config(config)), tmp_path / "one").folder
    found = build(read_config(config, ["initial.file=one/results.h5"]))
    with open_results(one.path) as results:
        expected = results["initial_pose"]
    rounding = 1e-14  # of five products of matrices
    starts = found.desired.pose @ found.start.poses.errors
    np.testing.assert_allclose(starts, expected, rtol=0, atol=rounding)


@from_yaml
def test_what_is_wrong(config, override, message):
    assert any(mentions(said, message) for said in messages(config, override))


def test_a_file_that_is_too_large_is_not_read(config):
    with (config.parent / "huge.csv").open("wb") as file:
        file.truncate(2 * 2**30)  # a sparse file, which takes no space
    (found,) = messages(config, "reference.file=huge.csv")
    path = config.parent / "huge.csv"
    assert says(found, f"{path}: cannot be read: expected at most 64,000,000…got 2,147,483,648…")


def test_a_file_of_poses_may_be_mapped_and_says_what_is_odd(config):
    text = PLAN.replace("t,", "stamp,").replace("\n", ",ok\n")
    (config.parent / "data/plan.csv").write_text(text)
    mapping = "{columns: {t: stamp}, time: {offset: first}}"
    found = build(read_config(config, [f"reference.mapping={mapping}"]))
    (remark,) = [str(one) for one in remarks(found) if "plan.csv" in str(one)]
    assert remark == f"{config}:5:1: reference: data/plan.csv: column ok is not used"
    resolved = config.parent / "resolved.yaml"
    resolved.write_text(dump(found.resolved))
    assert build(read_config(resolved)).digest == found.digest


@pytest.mark.parametrize(
    "reference",
    ["{kind: constant, velocity: 0.1}", "{kind: slew, to: {rotvec: 1}, duration: 9, start: -1}"],
)
def test_a_reference_without_instants_within_the_horizon(config, reference):
    found = build(read_config(config, [f"reference={reference}"])).reference_over_horizon()
    assert found.finite.all()
    assert found.jumps == []


def test_angles_of_many_turns_that_are_written_as_numbers_are_told(config):
    asked = [
        "reference={kind: constant, pose: {rotvec: [45, 15*pi, 720 deg]}}",
        "initial={pose: {kind: euler, low: -30, high: 6}}",
    ]
    found = [str(remark) for remark in remarks(build(read_config(config, asked)))]
    assert [said.partition(": ")[2] for said in found if "rotation of" in said] == [
        "reference.pose.rotvec[0]: rotation of 45 rad is 7.2 turns; write '45 deg' if degrees were "
        "meant",
        "initial.pose.low: rotation of -30 rad is 4.8 turns; write '-30 deg' if degrees were meant",
    ]
