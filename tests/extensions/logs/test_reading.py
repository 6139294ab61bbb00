"""Poses, velocities and wrenches in files: what is read, and what is said of a bad file."""

from time import process_time

import numpy as np
import pytest
from case_tables import from_yaml, refusal
from said import says
from scipy.spatial.transform import Rotation

from eqt_cli.base.errors import InputError, Problems
from eqt_cli.components.pose_tables import (
    LogMapping,
    MappingError,
    TimeMapping,
    coordinate_names,
    pose_columns,
    read_starts,
)
from eqt_cli.extend import group_named
from eqt_cli.extensions.logs.log_check import check_text
from eqt_cli.extensions.logs.recording import read_log, recorded_columns
from eqt_cli.extensions.logs.recording_check import recording_of

TURNS = Rotation.from_rotvec([[0, 0, 0], [0.1, 0.2, 0.3], [0.3, 0.1, -0.2]])
PLACES = np.array([[1.0, 2.0, 3.0], [1.5, 2.5, 3.0], [2.0, 3.0, 3.0]])
EXACT = 1e-14
HEAD = "t,qx,qy,qz,qw\n"
DROP = "; add `drop: [%s]` to the mapping to leave such rows out"


def lines(rows, parted=","):
    return "".join(parted.join(repr(float(x)) for x in row) + "\n" for row in rows)


def trajectory(text, name, kind, G, **mapping):
    log = read_log(text, name, kind, G, LogMapping(**mapping))
    log.require_usable()
    return log.times, log.poses


def expected(G):
    return G.assemble(TURNS.as_matrix(), PLACES[..., None] if G.columns else np.zeros((3, 3, 0)))


def test_columns_are_found_by_their_names():
    G, q = group_named("SE3"), TURNS.as_quat()
    rows = [
        [p[2], t, *p[:2], w, *xyz] for t, p, (*xyz, w) in zip([0, 1, 2.5], PLACES, q, strict=True)
    ]
    text = "z,t,x,y,qw,qx,qy,qz\n" + lines(rows)
    times, poses = trajectory(text, "a.csv", "csv", G)
    np.testing.assert_array_equal(times, [0, 1, 2.5])
    np.testing.assert_allclose(poses, expected(G), rtol=0, atol=EXACT)


@pytest.mark.parametrize("name", ["SO2", "SO3", "SE2", "SE3", "SE23", "R3", "SE3*SO2"])
def test_coordinates_of_any_group(name):
    G = group_named(name)
    V = np.random.default_rng(0).uniform(-1, 1, (3, G.dimension))
    units = [part.error_unit for part in G.parts for _ in range(G.dimension)[part.axes]]
    heads = [f"{axis} [{unit}]" for axis, unit in zip(coordinate_names(G), units, strict=True)]
    text = ",".join(["t", *heads]) + "\n" + lines(np.c_[[0, 1, 2], V])
    _, poses = trajectory(text, "a.csv", "csv", G)
    np.testing.assert_allclose(poses, G.exp(V), rtol=0, atol=EXACT)


def test_tum():
    G = group_named("SE3")
    rows = np.c_[[100.0, 100.5, 102.0], PLACES, TURNS.as_quat()]
    times, poses = trajectory("# a comment\n" + lines(rows, " "), "a.txt", "tum", G)
    np.testing.assert_array_equal(times, [0, 0.5, 2])
    np.testing.assert_allclose(poses, expected(G), rtol=0, atol=EXACT)


def test_euroc_subtracts_nanoseconds_as_integers():
    G, q = group_named("SO3"), np.roll(TURNS.as_quat(), 1, axis=1)
    stamps = [1403636580838555648 + k for k in (0, 5_000_001, 10_000_003)]
    given = zip(stamps, PLACES, q, strict=True)
    rows = [f"{t},{lines([[*p, *w]]).strip()},7" for t, p, w in given]
    text = "#timestamp,p_RS_R_x [m]\n" + "\n".join(rows) + "\n"
    times, poses = trajectory(text, "data.csv", "euroc", G)
    np.testing.assert_allclose(times, [0, 0.005000001, 0.010000003], rtol=1e-15)
    np.testing.assert_allclose(poses, TURNS.as_matrix(), rtol=0, atol=EXACT)


@from_yaml
def test_what_is_wrong_is_said_with_its_line(text, message):
    said = refusal(InputError, trajectory, text, "a.csv", "csv", group_named("SO3"))
    assert says(said, message)


@from_yaml
def test_what_is_wrong_in_other_formats(kind, text, message):
    said = refusal(InputError, trajectory, text, "a", kind, group_named("SE3"))
    assert says(said, message)


def test_starts_with_velocities_and_without():
    G, q = group_named("SO3"), TURNS.as_quat()
    V = np.arange(9.0).reshape(3, 3)
    poses, none, _ = read_starts("qx,qy,qz,qw\n" + lines(q), "s.csv", G, LogMapping())
    assert none is None
    np.testing.assert_allclose(poses, TURNS.as_matrix(), rtol=0, atol=EXACT)
    text = "qx,qy,qz,qw,wx,wy,wz\n" + lines(np.c_[q, V])
    _, found, _ = read_starts(text, "s.csv", G, LogMapping())
    np.testing.assert_array_equal(found, V)
    with pytest.raises(InputError, match=r"^s\.csv:1: missing column wz; a velocity on SO3 has"):
        read_starts("qx,qy,qz,qw,wx,wy\n" + lines(np.c_[q, V[:, :2]]), "s.csv", G, LogMapping())


# Units, Euler's angles and mappings ---------------------------------------------------------------

ANGLES = np.array([[0.0, 0.0, 0.0], [40.0, -20.0, 10.0], [170.0, 30.0, -60.0]])
"""yaw, pitch and roll, deg."""


@pytest.mark.parametrize(
    ("head", "mapping"),
    [
        ("t (ms),yaw [deg],pitch (deg),roll [deg],x (cm),y (cm),z (cm)", {}),
        (
            "stamp,psi,pitch,roll,east,y,z",
            {
                "columns": {"t": "stamp", "yaw": "psi", "x": "east"},
                "units": {"t": "ms", "x": "cm", "y": "cm", "z": "cm"}
                | dict.fromkeys(("yaw", "pitch", "roll"), "deg"),
            },
        ),
    ],
)
def test_units_and_euler_angles(head, mapping):
    G, rows = group_named("SE3"), np.c_[[0.0, 1000.0, 2500.0], ANGLES, 100 * PLACES]
    times, poses = trajectory(head + "\n" + lines(rows), "a.csv", "csv", G, **mapping)
    np.testing.assert_allclose(times, [0, 1, 2.5], rtol=1e-15)
    turns = Rotation.from_euler("ZYX", ANGLES, degrees=True).as_matrix()
    np.testing.assert_allclose(G.rotation(poses), turns, rtol=0, atol=EXACT)
    np.testing.assert_allclose(G.translations(poses)[..., 0], PLACES, rtol=EXACT)


def test_another_sequence_of_euler_angles():
    G, rows = group_named("SO3"), np.c_[[0.0, 1.0, 2.0], np.deg2rad(ANGLES)]
    text = "t,yaw,pitch,roll\n" + lines(rows)
    _, poses = trajectory(text, "a.csv", "csv", G, euler="xyz")
    expected = Rotation.from_euler("xyz", ANGLES[:, ::-1], degrees=True).as_matrix()
    np.testing.assert_allclose(poses, expected, rtol=0, atol=EXACT)


NORTH = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.mark.parametrize(
    ("mapping", "turn", "move"),
    [
        ({"attitude": "world_to_body"}, lambda R: R.swapaxes(-1, -2), np.eye(3)),
        ({"world": "NED to ENU"}, lambda R: NORTH @ R, NORTH),
        ({"body": "FLU to FRD"}, lambda R: R @ DOWN, np.eye(3)),
    ],
)
def test_frames(mapping, turn, move):
    G, rows = group_named("SE3"), np.c_[[0.0, 1.0, 2.0], PLACES, TURNS.as_quat()]
    _, poses = trajectory(lines(rows, " "), "a.txt", "tum", G, **mapping)
    np.testing.assert_allclose(G.rotation(poses), turn(TURNS.as_matrix()), rtol=0, atol=EXACT)
    np.testing.assert_array_equal(G.translations(poses)[..., 0], PLACES @ move.T)


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_numbered_quaternions_take_the_order_that_is_said(order):
    q = TURNS.as_quat() if order == "xyzw" else np.roll(TURNS.as_quat(), 1, axis=1)
    text = "t,q[0],q[1],q[2],q[3]\n" + lines(np.c_[[0, 1, 2], q])
    _, poses = trajectory(text, "a.csv", "csv", group_named("SO3"), quaternion=order)
    np.testing.assert_allclose(poses, TURNS.as_matrix(), rtol=0, atol=EXACT)


@pytest.mark.parametrize(
    ("time", "expected"),
    [
        (TimeMapping(scale=0.5), [50.0, 50.5, 51.0, 51.5]),
        (TimeMapping(offset=-100.0), [0.0, 1.0, 2.0, 3.0]),
        (TimeMapping(begin=101.0, end=102.0), [101.0, 102.0]),
        (TimeMapping(begin=101.0, offset="first"), [0.0, 1.0, 2.0]),
    ],
)
def test_times(time, expected):
    text = "t,yaw,pitch,roll\n" + "".join(f"{t},0,0,0\n" for t in (100, 101, 102, 103))
    times, poses = trajectory(text, "a.csv", "csv", group_named("SO3"), time=time)
    np.testing.assert_array_equal(times, expected)
    assert len(poses) == len(expected)


def test_nanoseconds_of_a_clock_are_exact():
    first = 1403636580838555648
    text = "t [ns],yaw,pitch,roll\n" + "".join(f"{first + k},0,0,0\n" for k in (0, 7, 15))
    time = TimeMapping(offset="first")
    times, _ = trajectory(text, "a.csv", "csv", group_named("SO3"), time=time)
    np.testing.assert_array_equal(times, [0.0, 7e-9, 15e-9])


def test_columns_that_are_not_used_may_hold_anything():
    text = 't,mode,yaw,pitch,roll\n0,"a, b",0,0,0\n1,,0,0,0\n'
    times, _ = trajectory(text, "a.csv", "csv", group_named("SO3"))
    np.testing.assert_array_equal(times, [0, 1])


FLAT = "t,yaw,pitch,roll\n0,0,0,0\n1,0,0,0\n"


@pytest.mark.parametrize(
    ("text", "mapping", "path", "message"),
    [
        (FLAT.replace("yaw,pitch,roll", "q0,q1,q2") .replace("\n", ",0\n")
         .replace("q2,0", "q2,q3"), {}, ("quaternion",), "a.csv:1: columns q0, q1, q2, q3 do not "
         "show which is the scalar part w; add `quaternion: wxyz` if it is q0, `quaternion: xyzw` "
         "if it is q3"),
        (FLAT, {"quaternion": "xyzw"}, ("quaternion",), "the columns of a.csv have names that show "
         "their order, such as qx, qy, qz, qw; remove this key"),
        (FLAT, {"columns": {"t": "stamp"}}, ("columns", "t"), "a.csv:1: no column 'stamp'; write a "
         "heading of the file, without a unit"),
        (FLAT, {"units": {"yaw": "grad"}}, ("units", "yaw"), "column yaw: expected an angle in "
         "rad, mrad, deg, arcmin or arcsec, got 'grad'"),
        (FLAT.replace("yaw", "yaw (deg)"), {"units": {"yaw": "rad"}}, ("units", "yaw"),
         "the header of a.csv says deg for yaw, got rad; remove one"),
        (FLAT, {"units": {"yow": "deg"}}, ("units", "yow"), "a.csv has no column yow; did you mean "
         "'yaw'?"),
        (FLAT, {"time": TimeMapping(begin=2.0)}, ("time", "begin"), "no row of a.csv is left: its "
         "times are from 0 to 1 s"),
    ],
)  # fmt: skip
def test_a_mapping_that_does_not_fit_its_file(text, mapping, path, message):
    with pytest.raises(MappingError) as caught:
        trajectory(text, "a.csv", "csv", group_named("SO3"), **mapping)
    assert (caught.value.path, str(caught.value)) == (path, message)


@from_yaml
def test_a_mapping_that_its_group_or_format_cannot_have(name, kind, mapping, message):
    text = "t,angle,x,y\n0,0,0,0\n1,0,0,0\n" if kind == "csv" else "0 0 0 0 0 0 0 1\n"
    said = refusal(MappingError, trajectory, text, "a.csv", kind, group_named(name), **mapping)
    assert says(said, message)


def test_what_is_wrong_with_a_mapping_whatever_the_file_is():
    problems = Problems()
    said = LogMapping(
        columns={"x": "a", "y": "a"}, euler="ZYZ", time=TimeMapping(begin=2.0, end=1.0)
    )
    said.check(problems)
    assert [(one.path, one.message) for one in problems] == [
        (
            "euler",
            "expected each of the three axes once, such as ZYX (yaw, pitch, roll about the rotated "
            "axes) or zyx (about the fixed ones), got 'ZYZ'",
        ),
        ("time.end", "expected a time after 2 s, got 1 s"),
        ("columns.x", "'a' is given for two columns"),
        ("columns.y", "'a' is given for two columns"),
    ]


@from_yaml
def test_a_header_that_is_nearly_right(head, message):
    text = head + "\n0,0,0,0\n1,0,0,0\n"
    said = refusal(InputError, trajectory, text, "a.csv", "csv", group_named("SO3"))
    assert says(said, message)


@pytest.mark.ci("reads a million rows")
def test_a_million_rows_take_seconds():
    tail = lines(np.r_[TURNS[1].as_quat(), PLACES[1]][None])
    text = "t,qx,qy,qz,qw,x,y,z\n" + "".join(f"{k / 1000},{tail}" for k in range(1_000_000))
    began = process_time()
    times, _ = trajectory(text, "a.csv", "csv", group_named("SE3"))
    assert len(times) == 1_000_000
    assert process_time() - began < 10


@pytest.mark.parametrize(("entry", "norm"), [("0", "0"), ("1e308", "inf")])
def test_a_quaternion_of_any_size_is_told(entry, norm):
    with pytest.raises(InputError) as caught:
        trajectory(HEAD + f"0,0,0,0,1\n1,0,0,0,{entry}\n", "a.csv", "csv", group_named("SO3"))
    assert (
        str(caught.value)
        == f"a.csv:3: expected a quaternion of norm 1, got norm {norm}" + DROP % "invalid"
    )


# Velocities and wrenches --------------------------------------------------------------------------


NEARLY_EXACT = 1e-12
GROUPS = {
    "SO2": "wz tz",
    "SO3": "wx wy wz tx ty tz",
    "SE2": "wz vx vy tz fx fy",
    "SE3": "wx wy wz vx vy vz tx ty tz fx fy fz",
    "R2": "vx vy fx fy",
    "SO3*R1": "wx1 wy1 wz1 tx1 ty1 tz1 vx2 fx2",
}


def text_of(header, rows):
    return header + "\n" + lines(rows)


@pytest.mark.parametrize("name", GROUPS)
def test_columns_of_each_group(name):
    G, numbers = group_named(name), np.random.default_rng(1)
    beside = list(recorded_columns(G))
    names = [each for one in beside for each in one.names]
    assert " ".join(names) == GROUPS[name]
    own = pose_columns(G)
    poses = np.tile([float(each.startswith("qw")) for each in own], (3, 1))  # the identity
    given = numbers.normal(size=(3, len(names)))
    rows = np.c_[[0.0, 1.0, 2.0], poses, given]
    text = text_of(",".join(["t", *own, *names]), rows)
    found = recording_of(read_log(text, "a.csv", "csv", G, LogMapping()))
    both = np.c_[found.velocities, found.require_wrenches()]
    half = {"rates": 0, "velocity": 0, "torque": G.dimension, "force": G.dimension}
    for one in beside:
        columns = [names.index(each) for each in one.names]
        axes = slice(one.axes.start + half[one.kind], one.axes.stop + half[one.kind])
        np.testing.assert_array_equal(both[:, axes], given[:, columns])


@pytest.mark.parametrize("frame", ["body", "spatial"])
def test_power_is_the_same_in_every_frame_and_axes(frame):
    """⟨wrench, V⟩ does not depend on the coordinates: τ·ω + f·v as they stand in the file."""
    G, numbers = group_named("SE3"), np.random.default_rng(3)
    poses = G.exp(numbers.normal(size=(4, 6)))
    given = numbers.normal(size=(4, 12))  # ω, v, τ, f, all of the same frame
    header = "t,qx,qy,qz,qw,x,y,z," + GROUPS["SE3"].replace(" ", ",")
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    text = text_of(header, np.c_[np.arange(4.0), turns, poses[:, :3, 3], given])
    frames = dict.fromkeys(("rates", "velocity", "torque", "force"), frame)
    said = LogMapping(world="NED to ENU", body="FRD to FLU", **frames)
    found = recording_of(read_log(text, "a.csv", "csv", G, said))
    power = np.sum(found.require_wrenches() * found.velocities, axis=1)
    expected = np.sum(given[:, :6] * given[:, 6:], axis=1)
    np.testing.assert_allclose(power, expected, atol=NEARLY_EXACT)
    axes = said.axes("body") if frame == "body" else found.poses[:, :3, :3].mT @ said.axes("world")
    torque = (axes @ given[:, 6:9, None])[..., 0]
    np.testing.assert_allclose(found.wrenches[:, :3], torque, atol=NEARLY_EXACT)


def test_what_was_not_measured_is_said():
    G = group_named("SE3")
    rows = np.array([[t, *[0, 0, 0, 1], *[0, 0, 0], 1, 2, 3] for t in (0.0, 1.0)])
    text = text_of("t,qx,qy,qz,qw,x,y,z,tx,ty,tz", rows)
    found = recording_of(read_log(text, "a.csv", "csv", G, LogMapping()))
    np.testing.assert_array_equal(found.wrenches[0], [1, 2, 3, np.nan, np.nan, np.nan])
    assert refusal(InputError, found.require_wrenches) == (
        "a.csv:1: missing column fx, fy, fz; a wrench on SE3 has tx, ty, tz, fx, fy, fz"
    )


def test_a_group_without_names_of_them():
    G = group_named("SE23")
    rows = np.array([[t, *[0, 0, 0, 1], *[0.0] * 6] for t in (0.0, 1.0)])
    text = text_of(",".join(["t", *pose_columns(G)]), rows)
    found = recording_of(read_log(text, "a.csv", "csv", G, LogMapping()))
    said = refusal(InputError, found.require_wrenches)
    assert said == "a.csv:1: no columns of a wrench on SE23 are known"


def test_units_of_wrenches():
    header = "t,qx,qy,qz,qw,x,y,z,tx [mN·m],ty (N m),tz,fx (kN),fy (mN),fz"
    rows = np.array([[t, *[0, 0, 0, 1], *[0.0] * 3, *[1.0] * 6] for t in (0.0, 1.0)])
    text, G = text_of(header, rows), group_named("SE3")
    found = recording_of(read_log(text, "a.csv", "csv", G, LogMapping(units={"tz": "Nm"})))
    np.testing.assert_allclose(found.wrenches[0], [1e-3, 1, 1, 1e3, 1e-3, 1], rtol=1e-15)
    said = check_text(text, "a.csv", "csv", LogMapping())
    assert [(one.use, one.unit, one.assumed) for one in said.columns[-6:]] == [
        ("torque", "mN·m", False),
        ("torque", "N m", False),
        ("torque", "N m", True),
        ("force", "kN", False),
        ("force", "mN", False),
        ("force", "N", True),
    ]
    pounds = LogMapping(units={"fz": "lbf"})
    said = refusal(InputError, read_log, text, "a.csv", "csv", G, pounds)
    assert said == "column fz: expected a force in N, mN or kN, got 'lbf'"
