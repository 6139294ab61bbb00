"""What is said of a recording: each mistake of a mapping with what was seen and what to do."""

import json

import numpy as np
import pytest
from case_tables import from_yaml, refusal
from said import says
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.base.errors import ConfigError, EqtError, EqtWarning, InputError
from eqt_cli.components.pose_tables import LogMapping, MappingError, TimeMapping
from eqt_cli.extend import group_named
from eqt_cli.extensions.logs.log_check import check_text
from eqt_cli.extensions.logs.recording import read_log
from eqt_cli.extensions.logs.recording_check import recording_of

HEAD = "t,qx,qy,qz,qw,x,y,z,wx,wy,wz,vx,vy,vz"
NUMBERED = HEAD.replace("qx,qy,qz,qw", "q0,q1,q2,q3")
T = np.arange(0.0, 10.0, 0.05)
STEP = 1e-5


def turned(t):
    return Rotation.from_euler("ZYX", np.c_[0.8 * t, 0.4 * np.cos(1.3 * t), 0.6 * np.sin(t)])


def made(t):
    """Times, quaternions, positions, body rates and velocities of a motion."""
    return {
        "t": t,
        "q": turned(t).as_quat(),
        "p": np.c_[np.cos(t), np.sin(2 * t), 0.3 * t],
        "w": (turned(t - STEP).inv() * turned(t + STEP)).as_rotvec() / (2 * STEP),
        "v": np.c_[-np.sin(t), 2 * np.cos(2 * t), 0.3 + 0 * t],
    }


R, MADE = turned(T), made(T)


def recording(head=HEAD, **others):
    rows = np.column_stack([others.get(name, each) for name, each in MADE.items()])
    lines = (",".join(map(repr, row)) for row in rows.tolist())
    return head + "\n" + "\n".join(lines) + "\n"


def check(text, kind="csv", **mapping):
    return check_text(text, "log.csv", kind, LogMapping(**mapping))


def test_a_recording_that_fits_together_has_no_notes():
    found = check(recording())
    assert (found.group, found.rows, found.notes, found.problems) == ("SE3", len(T), [], [])
    assert found.gaps == []
    assert found.rate == pytest.approx(20.0)
    assert found.norms == pytest.approx((1.0, 1.0))


DEG = dict.fromkeys(("wx", "wy", "wz"), "deg/s")
MISTAKES = {
    "frame of rates": ({"w": R.apply(MADE["w"])}, {}, {"rates": "spatial"}),
    "frame of the velocity": ({"v": R.inv().apply(MADE["v"])}, {}, {"velocity": "body"}),
    "attitude": ({"q": R.inv().as_quat()}, {}, {"attitude": "world_to_body"}),
    "order": ({"head": NUMBERED}, {"quaternion": "wxyz"}, {"quaternion": "xyzw"}),
    "transformation of frames": (
        {"q": R.inv().as_quat(), "w": R.apply(MADE["w"])},
        {},
        {"attitude": "world_to_body", "rates": "spatial"},
    ),
    "sign of a rate": ({"w": MADE["w"] * [1, -1, 1]}, {}, {"scale": {"wy": -1}}),
    "unit of rates": ({"w": np.rad2deg(MADE["w"])}, {}, {"units": DEG}),
    "unit of positions": ({"p": 1e3 * MADE["p"]}, {}, None),
    "time base": ({"t": 1e3 * T}, {}, {"units": {"t": "ms"}}),
    "slow clock": ({"t": T / 2}, {}, {"time": TimeMapping(scale=2.0)}),
    "clock that is a little fast": ({"t": 1.2 * T}, {}, None),
    "a part of a rotation": ({"head": HEAD.replace("qw", "foo")}, {}, None),
    "none that is known": ({"w": MADE["w"][::-1]}, {}, None),
    "attitude and frame of rates": (
        {"q": R.inv().as_quat(), "w": R.apply(MADE["w"])},
        {},
        {"attitude": "world_to_body", "rates": "spatial"},
    ),
    "order and frame of rates": (
        {"head": NUMBERED, "w": R.apply(MADE["w"])},
        {"quaternion": "wxyz"},
        {"quaternion": "xyzw", "rates": "spatial"},
    ),
}
"""What is recorded, how it is read, and the mapping by which all of it fits, if there is one."""


@from_yaml
def test_velocities_tell_a_mistake_and_its_remedy_makes_them_fit(mistake, notes):
    recorded, mapping, remedy = MISTAKES[mistake]
    assert says(" | ".join(check(recording(**recorded), **mapping).notes), notes)
    assert remedy is None or check(recording(**recorded), **remedy).notes == []


def test_the_sign_of_an_angle_is_named_and_given_by_a_scale():
    """The pitch of a Crazyflie has the sign of its legacy axes."""
    yaw, pitch, roll = R.as_euler("ZYX").T
    rows = np.c_[T, yaw, -pitch, roll, MADE["w"]]
    text = "t,yaw,pitch,roll,wx,wy,wz\n" + "\n".join(",".join(map(repr, r)) for r in rows.tolist())
    (note,) = check(text).notes
    assert note.endswith(", and with `scale: {pitch: -1}` by 0 %; correct the mapping")
    assert check(text, scale={"pitch": -1}).notes == []
    said = refusal(MappingError, check, text, scale={"pich": -1})
    assert said == "log.csv has no column pich; did you mean 'pitch'?"


def test_the_other_order_of_a_quaternion_fits():
    recorded = recording(NUMBERED, q=np.roll(MADE["q"], 1, axis=1))
    assert check(recorded, quaternion="wxyz").notes == []


def test_velocities_are_not_compared_where_rows_are_missing():
    t = np.concatenate([5.0 * k + np.arange(0.0, 0.5, 1 / 16) for k in range(8)])
    (gaps,) = check(recording(**made(t))).notes
    assert (
        gaps == "7 gaps, the longest of 4.562 s after t = 0.4375 s, where rows are 0.0625 s apart"
    )


@pytest.mark.parametrize(
    ("step", "unit"), [(6.0, "ms"), (900.0, "ms"), (1500.0, "us"), (3e7, "ns")]
)
def test_the_unit_of_time_is_the_largest_that_gives_usual_steps(step, unit):
    text = "".join(f"{step * k!r} 0 0 0 0 0 0 1\n" for k in range(4))
    (note,) = check(text, "tum").notes
    assert note.endswith(f"add `units: {{t: {unit}}}` to the mapping if t is in {unit}")


def test_noise_is_no_mistake():
    noise = 0.02 * np.random.default_rng(0).normal(size=MADE["p"].shape)
    assert check(recording(p=MADE["p"] + noise)).notes == []


def test_a_level_start_tells_the_order_and_the_axes():
    q = Rotation.from_euler("z", np.c_[[0.1, 0.2, 0.3]]).as_quat()
    rows = np.c_[[0, 1, 2], np.zeros((3, 3)), q]
    text = "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist())
    (order,) = check(text, "tum", quaternion="wxyz").notes
    assert order == (
        "the first pose is rotated by 180 deg, and with `quaternion: xyzw` by 6 deg; correct the "
        "mapping if the body was level then"
    )
    (axes,) = check(text, "tum", world="NED to ENU").notes
    assert axes == (
        "the first pose is tilted by 180 deg, and with `body: FRD to FLU` by 0 deg; correct the "
        "mapping if the body was level then"
    )
    assert check(text, "tum", world="NED to ENU", body="FRD to FLU").notes == []


def test_logarithms_of_poses_are_no_positions():
    with pytest.warns(EqtWarning, match=r"log\.csv: x, y, z are read as positions, and wx, wy, wz"):
        check("t,x,y,z,wx,wy,wz\n0,1,0,0,0,0,1\n1,1,0,0,0,0,1\n")


def test_gaps_columns_that_are_not_used_and_turns_without_a_unit_are_named():
    t = np.array([0.0, 0.1, 0.2, 0.3, 1.3, 1.4, 1.5, 2.5, 2.6])
    rows = "".join(f"{each!r},{90 * each!r},0,0,on,12\n" for each in t.tolist())
    text = f"t,yaw,pitch,roll,mode,battery (V)\n{rows}"
    found = check(text)
    assert found.gaps == [(0.3, 1.0), (1.5, 1.0)]
    assert found.notes == [
        "column yaw: 234 is more than a full turn and has no unit, so it is taken as rad; add "
        "`units: {yaw: deg}` to the mapping, or rad if it is meant",
        "2 gaps, the longest of 1 s after t = 0.3 s, where rows are 0.1 s apart",
        "columns mode, battery are not used",
    ]
    assert not any("yaw" in note for note in check(text.replace("yaw", "yaw (deg)", 1)).notes)
    uses = [(one.name, one.use, one.unit, one.assumed) for one in found.columns]
    assert uses[:2] == [("t", "time", "s", True), ("yaw", "pose", "rad", True)]
    assert uses[-1] == ("", "not used", "V", False)


def test_what_makes_it_no_motion_is_a_problem_and_not_raised():
    text = "t,qx,qy,qz,qw\n0,0,0,0,1\n2,0,0,0,1\n1,0,0,0,1\n3,0,0,0,1\n2.5,0,0,0,1\n"
    (problem,) = check(text).problems
    assert says(problem, "log.csv:4: expected a time after 2 s…got 1 s (2 times in…")


def test_poses_of_no_group():
    assert refusal(EqtError, check, "t,a,b\n0,1,2\n") == (
        "log.csv: no columns of a pose were found, such as qx, qy, qz, qw or yaw, pitch, roll for "
        "a rotation and x, y, z for a position; name them in a mapping, `columns: {qx: …}`, or "
        "give the group, as SO3 for entries Q11 … Q33 of a matrix"
    )


def test_from_python_and_as_a_command(tmp_path, monkeypatch, invoke):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text(recording(HEAD.replace("t,", "stamp [ms],"), t=1e3 * T))
    mapping = {"columns": {"t": "stamp"}, "time": {"begin": 1, "end": 3, "offset": "first"}}
    found = eqt_cli.check_log("log.csv", mapping)
    assert (found.rows, found.begin, found.notes) == (41, 0.0, [])
    assert found.end == pytest.approx(2.0)
    (tmp_path / "log.yaml").write_text(json.dumps(mapping))
    done = invoke("log", "check", "log.csv", "--mapping", "log.yaml", "--json")
    assert json.loads(done.stdout)["rows"] == 41
    done = invoke("log", "check", "log.csv", "--mapping", "log.yaml")
    assert "stamp   t     time      ms\n" in done.stdout
    assert "rows      41, from 0 to 2 s\nrate      20 Hz\ngaps      none\n" in done.stdout
    (tmp_path / "log.yaml").write_text("columns: {t: stmp}\n")
    done = invoke("log", "check", "log.csv", "--mapping", "log.yaml", code=2)
    assert done.stderr == (
        "1 error in log.yaml\n"
        "log.yaml:1:11: columns.t: log.csv:1: no column 'stmp'; did you mean 'stamp'?\n"
    )
    (tmp_path / "back.csv").write_text("t,yaw,pitch,roll\n1,0,0,0\n0,0,0,0\n")
    done = invoke("log", "check", "back.csv", code=2)
    assert says(done.stderr, "eqt: error: back.csv:3: expected a time after 1 s, got 0 s…\n")
    with pytest.raises(ConfigError) as caught:
        eqt_cli.check_log("log.csv", {"quaternion": "zyxw", "time": {"offset": "frist"}})
    assert "quaternion: expected 'xyzw' or 'wxyz', got 'zyxw'" in str(caught.value)
    offset = "time.offset: expected a number of seconds, or first, got 'frist'"
    assert offset in str(caught.value)


def body_of(text, **mapping):
    return recording_of(read_log(text, "l.csv", "csv", group_named("SE3"), LogMapping(**mapping)))


def test_a_marker_tells_the_motion_of_the_body():
    """A marker off the body's origin, seen in a frame beside the world, both by hand."""
    turn, at = Rotation.from_rotvec([0.3, -0.2, 0.5]), np.array([0.1, -0.05, 0.2])
    frame, origin = Rotation.from_rotvec([0, 0, 0.7]), np.array([3.0, 2.0, 1.0])
    seen = frame.inv().apply(MADE["p"] + R.apply(at) - origin)
    speed = frame.inv().apply(MADE["v"] + R.apply(np.cross(MADE["w"], at)))
    q, w = (frame.inv() * R * turn).as_quat(), turn.inv().apply(MADE["w"])
    said = {
        "origin": {"rotvec": [0, 0, 0.7], "position": origin.tolist()},
        "sensor": {"rotvec": [0.3, -0.2, 0.5], "position": at.tolist()},
    }
    found = body_of(recording(q=q, p=seen, w=w, v=speed), **said)
    np.testing.assert_allclose(found.poses[:, :3, :3], R.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(found.poses[:, :3, 3], MADE["p"], atol=1e-12)
    V = np.c_[MADE["w"], R.inv().apply(MADE["v"])]
    np.testing.assert_allclose(found.velocities, V, atol=1e-12)
    assert found.notes == ()  # the marker moves as its poses do
    # Without rates, nobody knows the velocity of the body's origin from that of a marker beside it.
    only = body_of(recording(HEAD.replace("wx,wy,wz", "a,b,c"), q=q, p=seen, v=speed), **said)
    assert np.isnan(only.velocities).all()


def test_a_marker_is_a_pose_of_the_group():
    said = refusal(MappingError, body_of, recording(), sensor={"at": [0, 0, 0.1]})
    assert said == "unknown key; a pose of SE3 takes rotvec, quaternion, euler, matrix, position"


def test_rows_are_thinned_and_commands_keep_their_mean():
    rows = [f"{0.01 * k!r},{0.02 * k!r},{1.0 if k % 10 < 3 else 0.0}" for k in range(100)]
    del rows[42:45]
    text, G = "\n".join(["t,angle,tz", *rows]), group_named("SO2")
    thin = recording_of(read_log(text, "l.csv", "csv", G, LogMapping(time=TimeMapping(rate=10.0))))
    np.testing.assert_allclose(thin.times, 0.1 * np.arange(10), atol=1e-12)
    # The command of 1 N m before the missing rows holds until the next: 0.05 s of 0.1 s.
    np.testing.assert_allclose(thin.wrenches[:, 0], [0.3] * 4 + [0.5] + [0.3] * 5)
    assert thin.gaps.tolist() == []  # 0.04 s is no gap of rows 0.01 s apart
    said = LogMapping(time=TimeMapping(rate=10.0, gap=0.03))
    assert recording_of(read_log(text, "l.csv", "csv", G, said)).gaps.tolist() == [4]


ANGLES = np.column_stack([T, R.as_euler("ZYX"), MADE["w"]])


@pytest.mark.parametrize("sequence", ["XYZ", "zyx", "ZXY"])
def test_rates_tell_the_order_of_angles(sequence):
    lines = (",".join(map(repr, row)) for row in ANGLES.tolist())
    found = check("t,yaw,pitch,roll,wx,wy,wz\n" + "\n".join(lines), euler=sequence)
    [note] = found.notes
    assert note.endswith("and with `euler: ZYX` by 0 %; correct the mapping")


POSES = "t,qx,qy,qz,qw\n0,0,0,0,1\n1,0,0,0,1\n"
FILES = {
    "semicolons": ("t;angle\n0;1\n1;2\n", {}, "log.csv:1: the columns are separated by semicolons; "
        "expected commas, and decimals with a point"),
    "tabs": ("t\tangle\n0\t1\n", {}, "log.csv:1: the columns are separated by tabs; expected "
        "commas, and decimals with a point"),
    "another format": ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", {}, "log.csv:1: has 8 numbers "
        "separated by spaces; use the format tum"),
    "an angle is missing": ("t,yaw,pitch,rolll\n0,0,0,0\n1,0,0,0\n", {}, "log.csv:1: column roll "
        "is missing, so yaw, pitch cannot be used"),
    "names of columns exchanged": (POSES.replace("t,", "stamp,", 1), {"columns": {"stamp": "t"}},
        "log.csv:1: no column 't'; eqt's name is first: write `{t: stamp}`"),
    "a name that eqt does not know": (POSES, {"columns": {"time": "t"}}, "eqt has no column of "
        "this name; it knows t, qx, qy, qz, qw, yaw, pitch, roll, x, y, z, wx, vx and others"),
    "a unit of none": (POSES, {"units": {"qx": "deg"}}, "column qx: expected no unit, got 'deg'"),
    "an order of angles that it has not": (POSES, {"euler": "xyz"}, "the poses of log.csv have no "
        "yaw, pitch and roll; remove this key"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", FILES)
def test_a_file_that_is_otherwise_than_said(mistake):
    text, mapping, expected = FILES[mistake]
    assert refusal(InputError, check, text, **mapping) == expected


def test_velocities_beside_an_incomplete_pose_are_no_pose():
    head = HEAD.replace("qw", "foo")
    assert says(
        refusal(
            InputError,
            read_log,
            recording(head=head),
            "l.csv",
            "csv",
            group_named("SE3"),
            LogMapping(),
        ),
        "l.csv:1: missing column qw…",
    )
