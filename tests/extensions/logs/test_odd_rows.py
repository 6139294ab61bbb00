"""Rows that are no measurement: few are left out and counted, many are refused, and keys decide."""

from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal
from flights import odometry, pose_stamped, write_bag
from said import says
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.base.errors import EqtError, InputError

T = 1e3 + np.arange(200) / 20  # s
POSE, ODOMETRY = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry"


def place(t):
    return np.c_[np.sin(t), np.cos(0.7 * t), 0.1 * (t - T[0])]


def turned(t):
    return Rotation.from_euler("ZYX", np.c_[0.3 * (t - T[0]), 0.1 * np.sin(t), 0 * t]).as_quat()


def poses(name, off=0.0, quaternions=None, times=T, stamps=None, places=None):
    """A topic of poses, recorded at some times and stamped at others."""
    p = place(times) + off if places is None else places
    made = pose_stamped(p, turned(times) if quaternions is None else quaternions)
    stamps = times if stamps is None else stamps

    def stamped(k, header, make):
        header.stamp = make["Time"](sec=int(stamps[k]), nanosec=round(1e9 * (stamps[k] % 1)))
        return made(k, header, make)

    return name, POSE, times, stamped


def size(found, quantity="position"):
    return next(one for one in found.sizes if one.quantity == quantity)


def odd(kind, count):
    """Poses of which some rows are odd in one way, as columns."""
    t, p, q = T.copy(), place(T), turned(T)
    rows = 7 + 9 * np.arange(count)
    if kind == "zero quaternion":
        q[rows] = 0
    elif kind == "half a quaternion":
        q[rows] /= 2
    elif kind == "nan":
        p[rows] = np.nan
    elif kind == "repeated":
        t[rows] = t[rows - 1]
    else:
        t[rows] = t[rows - 4] + 0.01
    return t, p, q


KINDS = {
    "zero quaternion": "invalid",
    "half a quaternion": "invalid",
    "nan": "invalid",
    "repeated": "repeated",
    "backward": "unordered",
}


@pytest.mark.parametrize(
    "form", ["csv", pytest.param("mcap", marks=pytest.mark.ci("reads six bags"))]
)
@pytest.mark.parametrize("kind", KINDS)
def test_few_odd_rows_are_left_out_and_counted_and_many_are_refused(kind, form):
    drop = KINDS[kind]
    for count in (4, 15):
        t, p, q = odd(kind, count)
        path, wanted = Path(f"f{count}.{form}"), Path("wanted.csv")
        rows, head = np.c_[T, place(T) + 0.1, turned(T)], "t,x,y,z,qx,qy,qz,qw"
        np.savetxt(wanted, rows, delimiter=",", header=head, comments="")
        if form == "csv":
            np.savetxt(path, np.c_[t, p, q], delimiter=",", header=head, comments="")
        else:
            # The recorder is an hour late, so that it cannot stand in for the stamps.
            write_bag(path, [poses("/mocap", quaternions=q, times=T + 3600, stamps=t, places=p)])
        said = f"{count} of 200 rows are left out ({count} {drop})"
        if count == 15:
            complaint = refusal(InputError, eqt_cli.log_errors, path, wanted)
            assert "drop: [" in complaint
            assert eqt_cli.check_log(path, {"drop": [drop]}).left_out == said
        options = {"drop": [drop]} if count == 15 else None
        found = eqt_cli.log_errors(path, wanted, options)
        assert size(found).rms == pytest.approx(0.1 * np.sqrt(3), abs=2e-3)
        assert found.headline.endswith(f": {said}")
        assert eqt_cli.check_log(path, options).left_out == said


def test_a_setpoint_without_an_attitude_has_none():
    """ROS leaves an orientation that nobody sets at 0, 0, 0, 0."""
    unset = np.zeros((len(T), 4))
    path = write_bag(Path("f.bag"), [poses("/pose"), poses("/setpoint", 0.1, unset)])
    found = eqt_cli.log_errors(path)
    assert size(found).rms == pytest.approx(0.1 * np.sqrt(3), abs=1e-9)
    assert {one.quantity for one in found.sizes} == {"position"}


@pytest.mark.ci("writes and reads bags")
def test_a_bad_topic_that_nobody_asks_for_is_no_reason():
    unset, back = np.zeros((len(T), 4)), np.r_[T[:100], T[:100]]
    topics = [
        poses("/matcher", 5.0, stamps=back),
        ("/gps", ODOMETRY, T, odometry(place(T), unset, 0 * place(T), 0 * place(T))),
        poses("/mocap"),
    ]
    checked = eqt_cli.check_log(write_bag(Path("f.mcap"), topics))
    assert (checked.rows, checked.problems, checked.left_out) == (200, [], "")
    table = np.c_[T, place(T) - [0.2, 0, 0]]
    np.savetxt("wanted.csv", table, delimiter=",", header="t,x,y,z", comments="")
    for topic, rms in (("/mocap", 0.2), ("/gps", 0.2)):
        found = eqt_cli.log_errors("f.mcap", "wanted.csv", topic=topic)
        assert size(found).rms == pytest.approx(rms, abs=1e-9)
    assert says(
        refusal(InputError, eqt_cli.log_errors, "f.mcap", "wanted.csv", topic="/matcher"),
        "f.mcap: /matcher: 100 of 200 rows are odd (100 repeated)…",
    )


@pytest.mark.ci("writes and reads bags")
def test_a_pose_is_of_one_topic():
    """The first topic has attitudes, but no positions."""
    nowhere = np.full((len(T), 3), np.nan)
    still = np.tile([0.0, 0, 0, 1], (len(T), 1))
    path = write_bag(Path("f.mcap"), [poses("/a", quaternions=still, places=nowhere), poses("/b")])
    columns = {one.heading for one in eqt_cli.check_log(path).columns if not one.name}
    assert {f"/a.pose.orientation.{axis}" for axis in "wxyz"} <= columns
    np.savetxt("truth.tum", np.c_[T, place(T), turned(T)], fmt="%.17g")
    found = eqt_cli.log_errors(path, "truth.tum")
    assert {one.partition(" − ")[0] for one in found.topics.values()} == {"/b"}


@pytest.mark.ci("writes and reads bags")
def test_stamps_that_stand_still_leave_the_times_to_the_recorder():
    path = write_bag(Path("f.bag"), [poses("/pose"), poses("/setpoint", 0.1, stamps=0 * T + T[0])])
    rates = {name: rate for name, _, _, rate, _ in eqt_cli.check_log(path).topics}
    assert rates == pytest.approx({"/pose": 20.0, "/setpoint": 20.0})
    assert size(eqt_cli.log_errors(path)).rms == pytest.approx(0.1 * np.sqrt(3), abs=1e-9)


@pytest.mark.ci("writes and reads bags")
@pytest.mark.parametrize(
    ("mapping", "rows", "length"),
    [
        ({"columns": {"t": "/pose recorded"}}, 200, 9.95),
        ({"time": {"end": 4.5}}, 91, 4.5),
        ({"drop": ["unordered"]}, 100, 4.95),
    ],
)
def test_a_clock_that_starts_again_is_for_a_mapping(mapping, rows, length):
    path = write_bag(Path("f.mcap"), [poses("/pose", stamps=(T - T[0]) % 5)])
    assert eqt_cli.check_log(path).problems
    checked = eqt_cli.check_log(path, mapping)
    assert (checked.rows, checked.problems) == (rows, [])
    assert checked.end - checked.begin == pytest.approx(length, abs=1e-6)
    found = eqt_cli.log_errors(path, path, mapping)
    assert len(found.curves["position"][0]) == rows
    said = refusal(EqtError, eqt_cli.log_errors, path, path, mapping | {"euler": "zyx"})
    assert said.endswith("begin and end of `time`, and the recorder's `columns`")
