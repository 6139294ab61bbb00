"""Flights of PX4: files are made here, byte by byte, as the format asks for."""

from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal
from flights import ULOG, message, ulog
from said import says
from scipy.spatial.transform import Rotation
from tiers import processor_time

import eqt_cli
from eqt_cli.base.errors import EqtError, InputError
from eqt_cli.components.pose_tables import LogMapping
from eqt_cli.extend import group_named
from eqt_cli.extensions.logs import logs
from eqt_cli.extensions.logs.log_check import check_text
from eqt_cli.extensions.logs.logs import flight_of
from eqt_cli.extensions.logs.recording import read_log
from eqt_cli.extensions.logs.tables import text_of_recording

STEP = 1e-5


def attitude(t):
    return Rotation.from_euler("ZYX", np.c_[0.8 * t, 0.4 * np.cos(1.3 * t), 0.6 * np.sin(t)])


def place(t):
    return np.c_[np.cos(t), np.sin(2 * t), -0.3 * t]


def topics(attitudes=None, valid=1):
    """A motion whose topics have different rates, and times that do not coincide."""
    a = np.arange(0.003, 10, 0.02) if attitudes is None else attitudes
    p, w, c = np.arange(0.05, 10, 0.05), np.arange(0.001, 10, 0.008), np.arange(1.0, 10, 0.1)
    us = 1e6
    v = (place(p + STEP) - place(p - STEP)) / (2 * STEP)
    rates = (attitude(w - STEP).inv() * attitude(w + STEP)).as_rotvec() / (2 * STEP)
    quaternion = np.roll(attitude(a).as_quat(), 1, axis=1)
    times = "uint64_t timestamp;uint64_t timestamp_sample;"
    local = "float x;float y;float z;float vx;float vy;float vz;bool xy_valid;bool z_valid;"
    known = np.tile([1, valid], (len(p), 1))
    return [
        # Published 2 ms after the measurement, whose time counts.
        ("vehicle_attitude", times + "float[4] q;", np.c_[us * a + 2000, us * a, quaternion]),
        ("vehicle_local_position", times + local, np.c_[us * p + 2000, us * p, place(p), v, known]),
        ("vehicle_angular_velocity", times + "float[3] xyz;", np.c_[us * w + 9, us * w, rates]),
        ("vehicle_torque_setpoint", times + "float[3] xyz;", np.c_[us * c + 9, us * c, c, c, c]),
    ]


def table_of(content, name="f.ulg"):
    """The table of a flight in the current folder."""
    Path(name).write_bytes(content)
    return logs.table_of(flight_of(Path(name)))


@pytest.fixture(scope="module")
def content():
    return ulog(*topics())


def test_topics_meet_at_the_times_of_the_position(content):
    log = read_log(table_of(content, "f.ulg"), "f.ulg", "csv", group_named("SE3"), LogMapping())
    t = np.arange(0.05, 9.96, 0.05)  # the first attitude is later than the first position
    assert log.times == pytest.approx(t, abs=1.1e-6)  # times are whole microseconds
    R = log.poses[:, :3, :3]
    # A chord of the rotation over 20 ms: |ω̇| h²/8, and what single precision leaves.
    assert np.abs(R - attitude(t).as_matrix()).max() < 3 * 0.02**2 / 8
    assert log.poses[:, :3, 3] == pytest.approx(place(t), abs=1e-6)
    named = zip(log.sheet.headings, log.sheet.names, log.sheet.units.values(), strict=True)
    assert list(named)[:2] == [("t", "t", "s"), ("x", "x", "m")]


def test_setpoints_hold_and_are_no_torques(content):
    _, header, *rows = table_of(content, "f.ulg").splitlines()
    column = header.split(",").index("vehicle_torque_setpoint.xyz[0] (normalised)")
    held = np.array([float(row.split(",")[column]) for row in rows])
    t = np.array([float(row.split(",")[0]) for row in rows])
    assert np.isnan(held[t < 1]).all()
    assert held[t >= 1] == pytest.approx(np.floor(10 * t[t >= 1] + 1e-6) / 10, abs=1e-6)


def test_velocities_of_a_flight_fit_its_poses(tmp_path, content):
    Path(tmp_path / "f.ulg").write_bytes(content)
    found = eqt_cli.check_log(tmp_path / "f.ulg")
    assert (found.format, found.group, found.gaps, found.problems) == ("ulog", "SE3", [], [])
    axes = ", ".join(f"vehicle_torque_setpoint.xyz[{axis}]" for axis in range(3))
    assert found.notes == [f"columns {axes} are not used"]


def test_nothing_is_interpolated_across_a_gap():
    a = np.arange(0.0, 10, 0.02)
    text = table_of(ulog(*topics(a[(a < 4) | (a > 4.5)])), "f.ulg")
    [(begin, length)] = check_text(text, "f.ulg", "csv", LogMapping()).gaps
    assert (begin, length) == pytest.approx((3.95, 0.6))


def test_positions_that_px4_does_not_know_are_left_out():
    found = check_text(table_of(ulog(*topics(valid=0)), "f.ulg"), "f.ulg", "csv", LogMapping())
    assert (found.group, found.rows) == ("SO3", 500)
    assert found.rate == pytest.approx(50.0)


@pytest.mark.parametrize(("frame", "kept"), [(1, True), (3, False)], ids=["NED", "body"])
def test_odometry_takes_the_place_of_what_is_missing(frame, kept):
    form = (
        "uint64_t timestamp;uint8_t pose_frame;float[3] position;float[4] q;"
        "uint8_t velocity_frame;float[3] velocity;"
    )
    t = np.arange(1.0, 4.0, 0.02)
    rows = [[1e6 * s, 1, s, 0, 0, 1, 0, 0, 0, frame, 1, 0, 0] for s in t]
    text = table_of(ulog(("vehicle_odometry", form, rows)))
    found = check_text(text, "f.ulg", "csv", LogMapping())
    uses = {each.use for each in found.columns}
    assert found.group == "SE3" and ("velocity" in uses) == kept


def test_without_pyulog_the_message_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(logs, "find_spec", lambda name: None)
    assert refusal(EqtError, table_of, ULOG) == (
        "f.ulg: a PX4 flight needs pyulog (extra logs); install it with: pip install pyulog"
    )


QUATERNIONS = "uint64_t timestamp;float[4] q;"
FILES = {
    "of something else": (b"t,x\n", "f.ulg: cannot be read as a PX4 flight: Invalid file format "
        "(Header too short)"),
    "empty": (b"", "f.ulg: cannot be read as a PX4 flight: Invalid file format (Header too short)"),
    "without topics": (ULOG, "f.ulg: holds no poses; expected vehicle_local_position or "
        "vehicle_odometry or vehicle_attitude"),
    "of a later format": (ulog(flags=b"\0" * 8 + b"\2"), "f.ulg: cannot be read as a PX4 flight: "
        "Unknown incompatible flag set: cannot parse the log"),
    "of parts at different times":
        (ulog(("vehicle_attitude", QUATERNIONS, [[k, 1, 0, 0, 0] for k in (10, 20, 30)]),
        ("vehicle_local_position", "uint64_t timestamp;float x;float y;float z;",
        [[k, 0, 0, 0] for k in (50, 60, 70)])), "f.ulg: position, attitude were recorded at no "
        "common time"),
}  # fmt: skip


@pytest.mark.parametrize("kind", FILES)
def test_a_file_that_is_no_flight(kind):
    given, expected = FILES[kind]
    assert refusal(InputError, table_of, given) == expected


ODD = {
    "f.ulg:5: expected a time after 2e-05 s, got 1.5e-05 s; add `drop: [unordered]` to the mapping "
    "to leave such rows out": [[k, 1, 0, 0, 0] for k in (10, 20, 15)],
    "f.ulg:3: expected a quaternion of norm 1, got norm 0.5": [
        [k, 0.5, 0, 0, 0] for k in (10, 20, 30)
    ],
}


@pytest.mark.parametrize("problem", ODD)
def test_rows_that_are_no_motion_are_for_the_mapping(problem):
    text = table_of(ulog(("vehicle_attitude", QUATERNIONS, ODD[problem])))
    assert check_text(text, "f.ulg", "csv", LogMapping()).problems == [problem]


HOSTILE = {
    "that asks for much": ULOG
    + message("F", b"a:float[65535] x;")
    + message("F", b"b:a[65535] y;")
    + message("A", b"\0\0\0b"),
    "of which little can be read": ULOG + b"\xff" * 200_000,
}


@pytest.mark.ci("runs into the limit of time")
@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_is_refused_within_ten_seconds(kind):
    begin = processor_time()
    refusal(InputError, table_of, HOSTILE[kind])
    assert processor_time() - begin < 10  # s, whatever else the machine does


def test_damage_is_told(content):
    broken = bytearray(content)
    middle = len(content) // 2
    broken[middle : middle + 400] = b"\0" * 400
    found = check_text(table_of(bytes(broken), "f.ulg"), "f.ulg", "csv", LogMapping())
    assert found.notes[0] == "parts of the file are damaged and were skipped"
    assert "" not in {topic for topic, *_ in eqt_cli.check_log("f.ulg").topics}


@pytest.mark.ci("starts a process for each of 24 files")
def test_any_change_of_bytes_gives_a_table_or_a_message(content):
    """The flight is accepted before, and a table is read on: as numbers, or to a message."""
    mapping, rng = LogMapping(), np.random.default_rng(0)
    assert not check_text(table_of(content, "f.ulg"), "f.ulg", "csv", mapping).problems
    outcomes = set()
    for k in range(24):
        broken = bytearray(content)
        # The definitions of the topics are at the beginning; all that follows is their data.
        for place_of in rng.integers(16, 1500 if k % 2 else len(content), size=8):
            broken[place_of] = rng.integers(256)
        try:
            table = table_of(bytes(broken), "f.ulg")
            found = check_text(table, "f.ulg", "csv", mapping)
            outcomes.add("problems" if found.problems else "accepted")
        except EqtError as error:
            outcomes.add("refused" if str(error).startswith("f.ulg: ") else str(error))
    assert {"accepted", "refused"} <= outcomes <= {"accepted", "refused", "problems"}


def test_a_configuration_takes_a_flight_and_keeps_its_table(tmp_path, content):
    (tmp_path / "f.ulg").write_bytes(content)
    (tmp_path / "c.yaml").write_text(
        "{group: SE3, inertia: [1, 1, 1, 1, 1, 1], gains: {kp: 1, kd: 1}, controllers: [eqt],"
        " time: {duration: 2}, reference: {kind: waypoints, file: f.ulg,"
        " mapping: {world: NED to ENU, body: FRD to FLU, time: {offset: first}}}}"
    )
    experiment = eqt_cli.load_experiment(tmp_path / "c.yaml")
    head = "# converted by eqt\nt (s),x (m),y (m),z (m),qw,"
    assert experiment.document.home.files["f.ulg"].startswith(head)


def test_the_table_of_a_flight_is_no_larger_than_other_files_may_be(tmp_path, content):
    (tmp_path / "f.ulg").write_bytes(content)
    size = len(table_of(content, "f.ulg"))
    assert len(text_of_recording(tmp_path / "f.ulg", "", EqtError, size, "cut it")) == size
    assert says(
        refusal(EqtError, text_of_recording, tmp_path / "f.ulg", "", EqtError, size - 1, "cut it"),
        f"{tmp_path / 'f.ulg'}: cannot be read: expected at most {size - 1:,} bytes…got {size:,}…",
    )
