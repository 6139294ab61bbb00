"""Who measures and who commands: publishers, frames, versions of messages, and cores."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal
from flights import dataflash, pose_stamped, write_bag
from said import says
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.base.errors import EqtError, InputError
from eqt_cli.extensions.logs.logs import flight_of

T = 100.0 + np.arange(200) / 20  # s
US = 1e6
POSE, TWIST = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TwistStamped"


def place(t):
    return np.c_[2 * np.sin(t), 3 * np.cos(0.7 * t), 0.1 * (t - T[0])]


def turned(t):
    return Rotation.from_euler("ZYX", np.c_[0.6 * (t - T[0]), 0.2 * np.sin(t), 0 * t])


def rms(found, quantity="position"):
    return next(one.rms for one in found.sizes if one.quantity == quantity)


def table(name, t, p):
    np.savetxt(name, np.c_[t, p], delimiter=",", header="t,x,y,z", comments="")


@pytest.mark.ci("writes and reads bags")
def test_a_topic_of_two_publishers_is_all_its_messages():
    parts = [(T[:50], 0.0), (T[50:], 0.4)]
    topics = [
        ("/mocap", POSE, t, pose_stamped(place(t) + off, turned(t).as_quat())) for t, off in parts
    ]
    path = write_bag(Path("f.bag"), topics)
    table("truth.csv", T, place(T))
    assert eqt_cli.check_log(path).rows == 200
    assert rms(eqt_cli.log_errors(path, "truth.csv")) == pytest.approx(0.4 * np.sqrt(3 * 0.75))


@pytest.mark.ci("writes and reads bags")
def test_a_topic_named_as_a_target_may_be_measured_and_is_not_its_own_setpoint():
    pose = pose_stamped(place(T), turned(T).as_quat())
    path = write_bag(Path("f.bag"), [("/vrpn/target_drone/pose", POSE, T, pose)])
    checked = eqt_cli.check_log(path)
    assert (checked.group, checked.rows, checked.problems) == ("SE3", 200, [])
    said = refusal(InputError, eqt_cli.log_errors, path, topic="/vrpn/target_drone/pose")
    assert said.startswith("f.bag: measured: position, attitude; wanted: none; name the topic")
    table("truth.csv", T, place(T) + 0.1)
    found = eqt_cli.log_errors(path, "truth.csv", topic="/vrpn/target_drone/pose")
    assert rms(found) == pytest.approx(0.1 * np.sqrt(3))


def twist(velocities, rates):
    def made(k, header, make):
        linear, angular = (make["Vector3"](*x[k].tolist()) for x in (velocities, rates))
        return make["TwistStamped"](header, make["Twist"](linear, angular))

    return made


@pytest.mark.ci("writes and reads bags")
@pytest.mark.parametrize("name", ["velocity_body", "velocity_local", "twist"])
def test_the_poses_tell_the_frame_of_a_twist(name):
    """MAVROS stamps a twist of the body and one of space with the same frame."""
    R, step = turned(T), 1e-6
    v = (place(T + step) - place(T - step)) / (2 * step)
    w = (turned(T - step).inv() * turned(T + step)).as_rotvec() / (2 * step)
    is_body = name != "velocity_local"
    numbers = (R.inv().apply(v), w) if is_body else (v, R.apply(w))
    topics = [
        ("/pose", POSE, T, pose_stamped(place(T), R.as_quat())),
        (f"/{name}", TWIST, T, twist(*numbers)),
        ("/cmd_vel", TWIST, T, twist(v + 0.1, w)),
    ]
    path = write_bag(Path("f.bag"), topics)
    found = eqt_cli.log_errors(path)
    assert rms(found, "velocity") == pytest.approx(0.1 * np.sqrt(3), abs=1e-6)
    assert rms(found, "rates") < 1e-6
    told = f"/{name}{' (turned from the body)' * is_body} − /cmd_vel"
    assert found.topics["velocity"] == told
    assert not [note for note in eqt_cli.check_log(path).notes if "differ" in note]


SETPOINT = "uint64 timestamp\nfloat32[3] position\nfloat32[3] velocity\nfloat32[3] acceleration\n"
SETPOINT += "float32[3] jerk\nfloat32 yaw\nfloat32 yawspeed\n"


def setpoints(off=0.0):
    """A topic of PX4: setpoints in NED and FRD at the place of the poses, in ENU."""

    def made(k, header, make):
        x, y, z = place(T)[k]
        unset = np.full(3, np.nan, np.float32)
        at = np.array([y + off, x, -z], np.float32)
        return make["TrajectorySetpoint"](int(US * T[k]), at, unset, unset, unset, 0.0, 0.0)

    return "/fmu/in/trajectory_setpoint", "px4_msgs/msg/TrajectorySetpoint", T, made


@pytest.mark.ci("writes and reads bags")
def test_axes_of_ros_are_not_subtracted_from_those_of_px4():
    topics = [("/mocap", POSE, T, pose_stamped(place(T), turned(T).as_quat())), setpoints(0.05)]
    definitions = {"px4_msgs/msg/TrajectorySetpoint": SETPOINT}
    path = write_bag(Path("f.db3"), topics, definitions=definitions)
    assert says(
        refusal(InputError, eqt_cli.log_errors, path), "f.db3: the axes of /mocap (ENU) and…"
    )
    axes = {"world": "ENU to NED", "body": "FLU to FRD"}
    assert rms(eqt_cli.log_errors(path, mapping=axes)) == pytest.approx(0.05, abs=1e-5)
    # One mapping of a log and a table is the table's; of each, there may be one
    x, y, z = place(T).T
    table("ned.csv", T, np.c_[y, x, -z])
    assert rms(eqt_cli.log_errors(path, "ned.csv", {"world": "NED to ENU"})) < 1e-9
    assert rms(eqt_cli.log_errors(path, "ned.csv", axes, second_mapping={})) < 1e-9


# VehicleAttitudeSetpoint of release/1.14 and of main of px4_msgs, and VehicleStatus of 1.14, cut
OF_114 = "uint64 timestamp\nfloat32 roll_body\nfloat32 pitch_body\nfloat32 yaw_body\n"
VERSIONS = {
    "1.14": OF_114 + "float32 yaw_sp_move_rate\nfloat32[4] q_d\nfloat32[3] thrust_body\n"
    "bool reset_integral\nbool fw_control_yaw_wheel\n",
    "main": "uint64 timestamp\nfloat32 yaw_sp_move_rate\nfloat32[4] q_d\nfloat32[3] thrust_body\n",
}


@pytest.mark.ci("writes and reads bags")
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_the_messages_of_a_version_of_px4_are_those_of_the_file(version, suffix):
    q = turned(T).as_quat(scalar_first=True).astype(np.float32)
    kind, text = "px4_msgs/msg/VehicleAttitudeSetpoint", VERSIONS[version]
    zeros = dict.fromkeys(("roll_body", "pitch_body", "yaw_body", "yaw_sp_move_rate"), 0.0)
    zeros |= {"reset_integral": False, "fw_control_yaw_wheel": False}
    zeros = {name: value for name, value in zeros.items() if name in text}

    def made(k, header, make):
        thrust = np.zeros(3, np.float32)
        stamp = int(US * T[k])
        one = make["VehicleAttitudeSetpoint"]
        return one(timestamp=stamp, q_d=q[k], thrust_body=thrust, **zeros)

    path = write_bag(Path(f"f{suffix}"), [("/sp", kind, T, made)], definitions={kind: text})
    if suffix == ".db3":  # older recorders store no definition; then a message tells
        with closing(sqlite3.connect(path)) as database, database:
            database.execute("DELETE FROM message_definitions")
    (series,) = flight_of(path).series("attitude setpoint")
    assert series.numbers == pytest.approx(q, abs=1e-7)


@pytest.mark.ci("writes and reads bags")
def test_what_sqlite_holds_beside_a_bag_belongs_to_it():
    """The recorder lost its power: a part of the bag is in its write-ahead log."""
    pose = pose_stamped(place(T), turned(T).as_quat())
    path = write_bag(Path("f.db3"), [("/pose", POSE, T, pose)])
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA wal_autocheckpoint=0")
        database.execute(f"DELETE FROM messages WHERE timestamp > {1e9 * T[99]:.0f}")
        database.commit()
        content = path.read_bytes(), Path("f.db3-wal").read_bytes()
        for name, part in zip(("g.db3", "g.db3-wal"), content, strict=True):
            Path(name).write_bytes(part)
    database.close()
    assert eqt_cli.check_log("g.db3").rows == 100
    assert Path("g.db3").read_bytes() == content[0]


def psc(axis, t, x):
    rows = [(US * s + 20 * "NED".index(axis), 0, 0, p) for s, p in zip(t, x, strict=True)]
    return (f"PSC{axis}", "Qfff", f"TimeUS,DP{axis},TP{axis},P{axis}", rows)


def test_axes_of_ardupilot_are_joined_by_time():
    """The horizontal controller starts later, and a row is lost."""
    north, east, down = place(T).T
    some = np.delete(np.arange(80, 200), 50)
    content = dataflash(
        psc("N", T[80:], north[80:]),
        psc("E", T[some], east[some]),
        psc("D", T, down),
        ("ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw", [(US * s, 0, 0, 0) for s in T]),
    )
    Path("f.bin").write_bytes(content)
    table("truth.csv", T, place(T))
    found = eqt_cli.log_errors("f.bin", "truth.csv")
    assert (len(found.curves["position"][0]), rms(found) < 1e-3) == (119, True)


def test_the_primary_core_of_an_estimator_is_read():
    """ArduPilot 4.1 and newer log each core, and XKF4.PI names the primary one."""
    names, unit = "TimeUS,C,PN,PE,PD", b"#"
    cores = [(US * s, core, 10 * core + s, 0, 0) for s in T for core in (0, 1)]
    primary = [(US * s + 1, core, int(s >= T[100])) for s in T for core in (0, 1)]
    content = dataflash(
        ("XKF4", "QBB", "TimeUS,C,PI", primary),
        ("XKF1", "QBfff", names, cores),
        ("ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw", [(US * s, 0, 0, 0) for s in T]),
        units={"XKF1": b"s" + unit + b"mmm", "XKF4": b"s" + unit + b"-"},
    )
    Path("f.bin").write_bytes(content)
    (series,) = flight_of(Path("f.bin")).series("position")
    right = T + 10.0 * (series.times > T[100] + 1e-9)
    assert series.numbers[:, 0] == pytest.approx(right, abs=1e-4)


def tree(t):
    """A tree of SLAM: corrections at 5 Hz, odometry at 20 Hz, and a sensor that stands still."""
    slow = np.arange(len(t)) % 4 == 0
    correction = Rotation.from_rotvec((0.7 + 0.02 * (t - t[0]))[:, None] * [0, 0, 1])
    shift = np.c_[3 + 0.1 * (t - t[0]), 1 + 0 * t, 0 * t]
    parts = {
        "map odom": (shift, correction, slow),
        "odom base": (place(t), turned(t), slow | True),
        "base imu": (
            np.tile([0.1, 0, 0.2], (len(t), 1)),
            Rotation.from_rotvec((1.2 + 0 * t)[:, None] * [0, 0, 1]),
            t == t[0],
        ),
    }

    def made(k, header, make):
        transforms = []
        for pair, (p, R, at) in parts.items():
            if at[k]:
                parent, child = pair.split()
                one = make["Header"](stamp=header.stamp, frame_id=parent)
                x, q = make["Vector3"](*p[k].tolist()), make["Quaternion"](*R[k].as_quat().tolist())
                moved = make["Transform"](translation=x, rotation=q)
                transforms.append(make["TransformStamped"](one, child, moved))
        return make["TFMessage"](transforms=transforms)

    p, R = np.zeros((len(t), 3)), Rotation.identity(len(t))
    for name in ("base imu", "odom base", "map odom"):
        x, turn, _ = parts[name]
        p, R = x + turn.apply(p), turn * R
    return ("/tf", "tf2_msgs/msg/TFMessage", t, made), p, R


@pytest.mark.ci("writes and reads bags")
def test_transforms_are_composed_to_the_pair_that_is_asked_for():
    topic, p, R = tree(T)
    path = write_bag(Path("f.mcap"), [topic])
    np.savetxt("truth.tum", np.c_[T, p, R.as_quat()], fmt="%.17g")
    found = eqt_cli.log_errors(path, "truth.tum", topic="/tf map.imu")
    assert len(found.curves["position"][0]) == 197  # until the last correction
    assert (rms(found) < 1e-6, rms(found, "attitude") < 1e-4) == (True, True)
    # The body is the frame that odometry moves, and not the odometry's own frame
    assert eqt_cli.check_log(path).rows == 200
    with pytest.raises(EqtError, match=r"has no topic '/tf map\.wheel'"):
        eqt_cli.log_errors(path, "truth.tum", topic="/tf map.wheel")


@pytest.mark.ci("writes and reads bags")
@pytest.mark.parametrize("compression", [None, "FILE", "MESSAGE"])
def test_a_folder_of_a_bag_is_read_as_one(compression):
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, pose = get_typestore(Stores.ROS2_HUMBLE), pose_stamped(place(T), turned(T).as_quat())
    make = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    writer = Writer(Path("f"), version=9, storage_plugin=StoragePlugin.SQLITE3)
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/pose", POSE, typestore=store)
        for k, t in enumerate(T):
            stamp = store.types["builtin_interfaces/msg/Time"](int(t), round(1e9 * (t % 1)))
            message = pose(k, make["Header"](stamp, "map"), make)
            writer.write(connection, round(1e9 * t), store.serialize_cdr(message, POSE))
    checked = eqt_cli.check_log("f")
    assert (checked.rows, checked.format, checked.problems) == (200, "bag", [])
    if compression == "MESSAGE":
        (file,) = Path("f").glob("*.db3")
        said = refusal(InputError, eqt_cli.check_log, file)
        assert said.endswith("; if its messages are compressed, give the folder of the bag")


def test_a_bag_that_was_cut_names_what_mends_it():
    pose = pose_stamped(place(T), turned(T).as_quat())
    path = write_bag(Path("f.mcap"), [("/pose", POSE, T, pose)])
    path.write_bytes(path.read_bytes()[:-400])
    said = refusal(InputError, eqt_cli.check_log, path)
    assert "; if its recorder was stopped, mcap recover (.mcap), rosbag reindex (.bag)" in said
