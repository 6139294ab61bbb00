"""The table of metrics and the variables of a dataset, against other ways to compute them."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from said import error_of

import eqt_cli

is_lacking = not all(map(find_spec, ("xarray", "h5netcdf")))  # they are slow to import
pytestmark = pytest.mark.skipif(is_lacking, reason="needs the extra xarray")

CONFIGS = Path(__file__).parents[2] / "configs"
FEW = {"ensemble.runs": 2, "solver.cross_check": 0}


@pytest.fixture(scope="module")
def flown(made_once):
    """A quadrotor over 1 s, sampled every 2 ms."""

    def fly(folder):
        settings = FEW | {"time.duration": 1.0, "time.samples": 501}
        eqt_cli.run(eqt_cli.load_experiment(CONFIGS / "se3.yaml", settings), folder / "out")

    return eqt_cli.open_result(made_once("flown for datasets", fly) / "out")


@pytest.fixture(scope="module")
def data(flown):
    with flown.to_xarray("ZYX") as opened:
        yield opened


def slope(values, times):
    """Central differences at inner samples, of second order in 2 ms."""
    return (values[..., 2:, :] - values[..., :-2, :]) / (times[2:] - times[:-2])[:, None]


def test_positions_and_their_rates(data):
    position = data.position.transpose("controller", "run", "time", "axis_xyz").values
    np.testing.assert_array_equal(position, data.pose.values[..., :3, 3])
    rate = slope(position, data.time.values)
    scale = np.abs(rate).max()
    np.testing.assert_allclose(data.linear_velocity[..., 1:-1, :], rate, atol=1e-3 * scale)
    assert data.position.attrs == {"units": "m", "long_name": "position", "frame": "space"}


def test_quaternions_are_the_attitude_without_jumps(data):
    w, x, y, z = np.moveaxis(data.quaternion.values, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    R = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    np.testing.assert_allclose(R, data.pose.values[..., :3, :3], atol=1e-8)  # of the solver's drift
    steps = np.linalg.norm(np.diff(data.quaternion.values, axis=-2), axis=-1)
    assert steps.max() < 0.1  # a change of sign is a step of 2


def test_angular_velocities_turn_the_attitude(data):
    R, times = data.pose.values[..., :3, :3], data.time.values
    rate = (R[..., 2:, :, :] - R[..., :-2, :, :]) / (times[2:] - times[:-2])[:, None, None]
    inner = R[..., 1:-1, :, :]
    for name, hat in (
        ("angular_velocity", np.swapaxes(inner, -1, -2) @ rate),
        ("angular_velocity_in_space", rate @ np.swapaxes(inner, -1, -2)),
    ):
        omega = np.stack([hat[..., 2, 1], hat[..., 0, 2], hat[..., 1, 0]], axis=-1)
        scale = np.abs(omega).max()
        np.testing.assert_allclose(data[name][..., 1:-1, :], omega, atol=2e-3 * scale)


def test_euler_angles_give_the_attitude_back(data):
    yaw, pitch, roll = np.moveaxis(data.euler_angles.values, -1, 0)
    zero, one = np.zeros_like(yaw), np.ones_like(yaw)

    def about(axis, angle):
        c, s = np.cos(angle), np.sin(angle)
        turns = {
            "z": [[c, -s, zero], [s, c, zero], [zero, zero, one]],
            "y": [[c, zero, s], [zero, one, zero], [-s, zero, c]],
            "x": [[one, zero, zero], [zero, c, -s], [zero, s, c]],
        }
        return np.moveaxis(np.array(turns[axis]), (0, 1), (-2, -1))

    R = about("z", yaw) @ about("y", pitch) @ about("x", roll)
    np.testing.assert_allclose(R, data.pose.values[..., :3, :3], atol=1e-8)


def test_what_is_read_in_part_is_a_part_of_the_whole(data):
    whole = data.quaternion.values
    for chosen in ({"controller": 1, "time": -1}, {"run": [1], "time": slice(3, 90, 7)}):
        part = data.quaternion.isel(**chosen)
        np.testing.assert_array_equal(part, data.quaternion.copy(data=whole).isel(**chosen))
    assert data.desired_position.dims[-2:] == ("time", "axis_xyz")


def test_a_vehicle_in_the_plane_has_a_heading(tmp_path):
    settings = FEW | {"time.duration": 1.0, "time.samples": 51}
    run = eqt_cli.run(eqt_cli.load_experiment(CONFIGS / "se2_vehicle.yaml", settings), tmp_path)
    with run.to_xarray() as data:
        c, s = data.pose.values[..., 0, 0], data.pose.values[..., 1, 0]
        np.testing.assert_allclose(np.cos(data.heading), c, atol=1e-8)
        np.testing.assert_allclose(np.sin(data.heading), s, atol=1e-8)
        assert np.abs(np.diff(data.heading)).max() < np.pi
        assert data.angular_velocity.dims == data.heading.dims


def test_every_metric_that_compare_lists_has_a_column_and_an_array(flown):
    table, known = flown.metrics(), flown.opened.comparable
    assert {*known} <= {*table.columns}
    for name in known:
        values = flown.metric(name)
        np.testing.assert_array_equal(table[name], values.ravel())
        assert values.shape == (len(flown.labels), 2)
    assert list(table.columns[:3]) == ["controller", "run", "status"]
    assert table.attrs["units"]["mean_position_error"] == "m"


def test_a_computed_metric_is_as_compared(flown):
    """Of those that are not stored, one by its formula: ∫‖I − Q_E‖² dt by the trapezoidal rule."""
    squares = flown.read("pose_error") ** 2
    by_hand = ((squares[..., 1:] + squares[..., :-1]) / 2 * np.diff(flown.times)).sum(axis=-1)
    assert "squared_pose_error" not in flown.names
    np.testing.assert_allclose(flown.metric("squared_pose_error"), by_hand, rtol=1e-12)


def test_chosen_metrics_alone(flown):
    assert list(flown.metrics(["effort"]).columns[3:]) == ["effort"]
    assert "unknown metric 'efort'; did you mean 'effort'?" in error_of(flown.metrics, ["efort"])


def test_points_of_a_sweep_have_their_keys_and_computed_metrics(tmp_path):
    settings = FEW | {"time.duration": 0.5, "time.samples": 11, "store.trajectories": "all"}
    settings["sweep"] = [{"grid": {"gains.kp": [1.0, 2.0]}}]
    config = eqt_cli.load_experiment(CONFIGS / "paper.yaml", settings)
    swept = eqt_cli.run(config, tmp_path / "swept")
    table = swept.metrics()
    assert list(table.columns[:5]) == ["point", "gains.kp", "controller", "run", "status"]
    with eqt_cli.open_result(swept, 1) as second:
        squares = second.metric("squared_pose_error")
        expected = second.metrics(["effort"]).effort
    np.testing.assert_array_equal(swept.metric("squared_pose_error")[1], squares)
    np.testing.assert_array_equal(table[table.point == 1].effort, expected)


def test_a_dataset_without_trajectories_opens_and_closes(tmp_path):
    settings = FEW | {"time.duration": 0.5, "time.samples": 11, "store.trajectories": "none"}
    run = eqt_cli.run(eqt_cli.load_experiment(CONFIGS / "paper.yaml", settings), tmp_path / "out")
    with run.to_xarray() as data:
        assert "quaternion" not in data


def test_a_file_with_one_sample_has_its_stored_metrics(tmp_path):
    settings = FEW | {"time.duration": 0.5, "time.samples": 11, "store.decimate": 100}
    run = eqt_cli.run(eqt_cli.load_experiment(CONFIGS / "paper.yaml", settings), tmp_path / "out")
    table = run.metrics()
    assert len(run.times) == 1
    assert np.isfinite(table.effort).all()
    assert "squared_pose_error" not in table


@pytest.mark.parametrize("angles", ["foo", "ZZY", "zyX", "ZY", "XXZ"])
def test_axes_that_are_none(flown, angles):
    message = f"angles: expected three axes, such as ZYX or xyz, got '{angles}'"
    assert error_of(flown.to_xarray, angles) == message


def test_a_point_is_no_path(tmp_path):
    settings = FEW | {"time.duration": 0.5, "time.samples": 11, "store.trajectories": "all"}
    settings["sweep"] = [{"zip": {"gains.kp": [1.0, 2.0], "time.samples": [11, 21]}}]
    config = eqt_cli.load_experiment(CONFIGS / "paper.yaml", settings)
    swept = eqt_cli.run(config, tmp_path / "swept")
    assert swept.metric("squared_pose_error").shape == (2, 4, 2)  # of points of unequal shape
    assert set(swept) == set(swept.names)
    second = eqt_cli.open_result(swept, 1)
    with second.to_xarray() as data:
        assert data.quaternion.sizes["time"] == 21
    assert error_of(eqt_cli.compare, second) == (
        f"{swept.path}: a point of a sweep is not a path; give the path and point"
    )


def test_a_run_that_failed_has_no_numbers(tmp_path):
    settings = FEW | {"time.duration": 1.0, "time.samples": 11, "solver.max_steps": 2}
    run = eqt_cli.run(eqt_cli.load_experiment(CONFIGS / "paper.yaml", settings), tmp_path / "out")
    table = run.metrics()
    assert run.failed == 8
    assert (table.status != 0).all()
    assert table.effort.isna().all()
    with run.to_xarray() as data:
        assert np.isnan(data.quaternion.isel(time=-1)).all()
