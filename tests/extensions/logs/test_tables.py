"""Texts and bags that other programs write, against the motion that they were written from."""

import re
import time
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal

import eqt_cli
from eqt_cli.base.errors import EqtError, EqtWarning, InputError
from eqt_cli.extend import group_named
from eqt_cli.extensions.logs.api import read_measured

T = 0.1 * np.arange(30)
AXIS, ANGLE = np.array([1.0, -2.0, 2.0]) / 3, 0.3 * np.sin(T)
PLACES = np.c_[np.cos(T), np.sin(2 * T), 1 + 0.1 * T]


def rotations(axis, angle):
    """By Rodrigues' formula."""
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * K + (1 - c) * K @ K


R = rotations(AXIS, ANGLE)
Q = np.c_[np.outer(np.sin(ANGLE / 2), AXIS), np.cos(ANGLE / 2)]
ISO = [f"2024-02-29T23:59:{s:06.3f}" for s in 50 + T]


def rows(*columns, separator=","):
    numbers = np.column_stack(columns)
    return "".join(separator.join(f"{x:.12f}" for x in row) + "\n" for row in numbers.tolist())


def motive(unit="Meters", lost=()):
    facts = f"Format Version,1.23,Take Name,a,Rotation Type,Quaternion,Length Units,{unit}"
    scale = {"Meters": 1.0, "Millimeters": 1e3}[unit]
    cells = np.c_[Q, scale * PLACES, 0 * T, Q[::-1], scale * PLACES]
    body = ["Drone"] * 8 + ["Wand"] * 7
    turn = ["Rotation"] * 4 + ["Position"] * 3
    heads = [
        facts,
        "",
        ",Type" + ",Rigid Body" * 15,
        ",Name," + ",".join(body),
        ",ID" + ',"ab"' * 15,
        ",," + ",".join([*turn, "Mean Marker Error", *turn]),
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z,W,X,Y,Z",
    ]
    lines = [f"{k},{T[k]:.6f}," + ",".join(map(repr, row)) for k, row in enumerate(cells.tolist())]
    for k in lost:
        lines[k] = f"{k},{T[k]:.6f}" + "," * 15
    return "\n".join([*heads, *lines, ""])


def vicon():
    """Angles about the rotated axes x, y, z, of matrices that are multiplied."""
    angles = np.c_[0.2 * np.sin(T), 0.3 * np.cos(T), 0.4 * T]
    x, y, z = (rotations(np.eye(3)[k], angles[:, k]) for k in range(3))
    head = "Objects\n10\n,,Global Angle (deg),,,Global Position (mm),,\n,,drone:drone,,,,,\n"
    head += "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ\n,,deg,deg,deg,mm,mm,mm\n"
    return head + rows(10 * T, 0 * T, np.rad2deg(angles), 1e3 * PLACES), x @ y @ z


AEM = """CCSDS_AEM_VERS = 1.0
META_START
REF_FRAME_A = EME2000
REF_FRAME_B = SC_BODY_1
ATTITUDE_DIR = {}
ATTITUDE_TYPE = QUATERNION
{}
META_STOP

DATA_START
COMMENT 12 rows
{}DATA_STOP
"""
STK = (
    "stk.v.12.0\n\nBEGIN Attitude\nNumberOfAttitudePoints 30\nAttitudeTime{}\n\n{}\nEND Attitude\n"
)
HEAD = "t,x,y,z,qx,qy,qz,qw\n"


def stamped(numbers, separator=" ", zone=""):
    lines = rows(numbers, separator=separator).splitlines()
    return "".join(f"{t}{zone}{separator}{line}\n" for t, line in zip(ISO, lines, strict=True))


first, since = np.roll(Q, 1, axis=1), 1709251190.0  # of 2024-02-29T23:59:50Z
BLACKBOX = "loopIteration, time (us), setpoint[0], setpoint[1], setpoint[2], gyroADC[0] (deg/s), "
BLACKBOX += "gyroADC[1] (deg/s), gyroADC[2] (deg/s), flags (flags), roll, pitch, heading\n"

SPINS = "".join(
    f"{k}, {1e5 * k:.0f}, 0, 0, 0, 0, 0, 57.29578, X|Y, 0.0, 0.0, {np.rad2deg(t):.9f}\n"
    for k, t in enumerate(T)
)
NANOSECONDS = "".join(
    f"{1403715000000000000 + round(1e9 * t)}.000000,{line}\n"
    for t, line in zip(T, rows(PLACES, Q).splitlines(), strict=True)
)
MATRIX = "t,r00,r01,r02,r10,r11,r12,r20,r21,r22\n" + rows(T, R.reshape(-1, 9))
COSINES = "time,C11,C12,C13,C21,C22,C23,C31,C32,C33\n" + rows(T, R.swapaxes(1, 2).reshape(-1, 9))
MRP = "t,sigma_BN_1,sigma_BN_2,sigma_BN_3\n" + rows(T, np.outer(np.tan(ANGLE / 4), AXIS))
ABOUT_Z, QUATERNIONS = rotations(np.eye(3)[2], T), "t,qw,qx,qy,qz\n"

KITTI = rows(np.dstack([R, PLACES]).reshape(-1, 12), separator=" ")
AEM_2 = AEM.format("A2B", "", stamped(Q))

# A text, the times, the rotations and the places in it
TEXTS = {
    "motive": (motive(), T, R, PLACES),
    "markers of motive": (re.sub(r"Rotation(?! Type)", "Colour", motive()), T, None, PLACES),
    "motive in mm": (motive("Millimeters"), T, R, PLACES),
    "vicon": (vicon()[0], T, vicon()[1], PLACES),
    "kitti": (KITTI, T, R, PLACES),
    "kitti with spaces": (KITTI.replace("\n", " \n "), T, R, PLACES),
    "aem": (AEM.format("A2B", "QUATERNION_TYPE = FIRST", stamped(first)), since + T, R, None),
    "aem, scalar last": (AEM_2, since + T, R, None),
    "aem, to A": (AEM.format("B2A", "", stamped(Q * [-1, -1, -1, 1])), since + T, R, None),
    "stk": (STK.format("Quaternions", rows(T, Q, separator=" ")), T, R, None),
    "stk with rates": (STK.format("QuatAngVels", rows(T, Q, Q, separator=" ")), T, R, None),
    "stk, scalar first": (STK.format("QuatScalarFirst", rows(T, first, separator=" ")), T, R, None),
    "iso": (QUATERNIONS + stamped(first, ","), since + T, R, None),
    "iso, zone": (QUATERNIONS + stamped(first, ",", "-01:00"), 3600 + since + T, R, None),
    "day of the year": (AEM_2.replace("2024-02-29", "2024-060"), since + T, R, None),
    "mrp": (MRP, T, R, None),
    "mrp in brackets": (MRP.replace("BN_1", "BN[0]").replace("BN_2", "BN[1]"), T, R, None),
    "cosines": (COSINES.replace("time", "t"), T, R, None),
    "matrix": (MATRIX, T, R, None),
    "matrix in brackets": (re.sub(r"r(\d)(\d)", r"R[\1][\2]", MATRIX), T, R, None),
    "blackbox": (BLACKBOX + SPINS, T, ABOUT_Z, None),
    "nanoseconds": ("t (ns)," + HEAD[2:] + NANOSECONDS, 1403715000 + T, R, PLACES),
}


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.filterwarnings("ignore::eqt_cli.base.errors.EqtWarning")
def test_a_text_of_another_program_is_the_motion_in_it(name):
    text, times, turned, places = TEXTS[name]
    Path("a.txt").write_text(text)
    group = "SO3" if places is None else "R3" if turned is None else "SE3"
    poses = read_measured("a.txt", group_named(group))
    np.testing.assert_allclose(poses.times, times, rtol=0, atol=1e-7)
    if turned is not None:
        np.testing.assert_allclose(poses.poses[:, :3, :3], turned, atol=1e-8)
    if places is not None:
        np.testing.assert_allclose(poses.poses[:, :3, 3], places, atol=1e-9)


REFUSED = [
    (motive().replace("Quaternion", "XYZ"), "holds Euler angles; export it with Rotation Type: Q"),
    (
        motive(lost=[3, 4, 5, 6]),
        ":11: expected a finite number in column x, got nan or an empty cell; add `dr",
    ),
    (vicon()[0].replace("\n11.0", "\nsecret", 1), "begins as objects of Vicon, but goes on otherw"),
    ("1 0 0 0 0 2 0 0 0 0 1 0\n", "begins as poses of KITTI, but goes on otherwise with no r"),
    ("1 0 0 0 0 1 0 0 0 0 1 0\n1 0\n", "begins as poses of KITTI, but goes on otherwise"),
    (AEM.format("A2B", "", "").replace("QUATERNION", "SPIN"), "expected one segment, of ATTITUDE"),
    (STK.format("YPRAngles", "0 1 2 3"), "expected AttitudeTimeQuaternions; export it with quat"),
    ("t,x\n2024-02-29T00:00:00,1\nsecret,2\n", ":3: expected a time as 2024-03-05T10:11:12.5Z"),
]


@pytest.mark.parametrize(("text", "words"), REFUSED)
@pytest.mark.filterwarnings("ignore::eqt_cli.base.errors.EqtWarning")
def test_a_text_that_cannot_be_read_is_named_with_what_to_do(text, words):
    Path("a.txt").write_text(text)
    said = refusal(InputError, eqt_cli.check_log, "a.txt", group="R3")
    assert said.removeprefix("a.txt").removeprefix(": ").startswith(words)
    assert "secret" not in said


def test_deviations_and_parts_of_matrices_are_no_rotations():
    for head in ("t,x,y,z,sigma_x,sigma_y,sigma_z", "t,x,y,z,c11,c12,c13", "t,x,y,z,r11,a,b"):
        Path("a.csv").write_text(f"{head}\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n")
        assert eqt_cli.check_log("a.csv").group == "R3"


def test_what_a_file_leaves_open_is_told():
    Path("a.csv").write_text(motive(lost=[3]))
    with pytest.warns(EqtWarning, match=r"a\.csv: a take of Motive of Drone, Wand; body Drone is"):
        found = eqt_cli.check_log("a.csv", {"drop": ["invalid"]})
    assert found.notes[:2] == ["1 invalid row left out, the first in line 11", found.notes[1]]
    chosen = {f"q{axis}": f"Wand Rotation {axis.upper()}" for axis in "xyzw"}
    with pytest.warns(EqtWarning):
        wand = read_measured("a.csv", group_named("SO3"), {"columns": chosen, "drop": ["invalid"]})
    np.testing.assert_allclose(wand.poses, np.delete(R[::-1], 3, axis=0), atol=1e-9)
    Path("a.txt").write_text(KITTI)
    with pytest.warns(EqtWarning, match=r"rows are 0.1 s apart, as no times.txt of 30 rows is"):
        assert "its content gives the format" in refusal(
            InputError, eqt_cli.check_log, "a.txt", format="tum"
        )
    Path("times.txt").write_text(rows(2 * T))
    assert eqt_cli.check_log("a.txt").rate == pytest.approx(5.0)


def test_a_quaternion_before_the_position_is_told_by_its_norm():
    Path("a.txt").write_text(rows(T, Q, PLACES, separator=" "))
    with pytest.warns(EqtWarning, match="the order of Sophus: columns 2 to 5 have norm 1"):
        found = read_measured("a.txt", group_named("SE3"), format="tum")
    np.testing.assert_allclose(found.poses[:, :3, 3], PLACES, atol=1e-9)
    np.testing.assert_allclose(found.poses[:, :3, :3], R, atol=1e-8)


def test_polynomials_are_sampled():
    """Pieces of x = t³ and yaw = t²/2, each about its own start, which binomials give."""
    starts, pieces = [0.0, 0.5, 1.2], []
    for s, e in zip(starts, [0.5, 1.2, 1.5], strict=True):
        x = [s**3, 3 * s**2, 3 * s, 1.0, 0, 0, 0, 0]
        yaw = [s**2 / 2, s, 0.5, 0, 0, 0, 0, 0]
        pieces.append([e - s, *x, *[0.0] * 8, *[2.0, *[0.0] * 7], *yaw])
    head = ",".join(["duration", *(f"{a}^{k}" for a in ("x", "y", "z", "yaw") for k in range(8))])
    Path("a.csv").write_text(head + "\n" + rows(pieces))
    found = read_measured("a.csv", group_named("SE3"))
    t = found.times
    assert (t[0], t[-1], np.diff(t).max() < 0.021) == (0.0, pytest.approx(1.5), True)
    np.testing.assert_allclose(found.poses[:, 0, 3], t**3, atol=1e-9)
    np.testing.assert_allclose(found.poses[:, :3, :3], rotations(np.eye(3)[2], t**2 / 2), atol=1e-9)
    inside = np.einsum("nij,nj->ni", found.poses[:, :3, :3], found.velocities[:, 3:])
    np.testing.assert_allclose(inside[:, 0], 3 * t**2, atol=1e-6)


def test_setpoints_of_betaflight_are_rates():
    """Measured rates are 3 and 4 deg/s from their setpoints; no attitude is needed."""
    setpoints = np.rint(np.rad2deg(np.c_[np.sin(T), np.cos(T), 0.2 * T]))
    numbers = np.c_[1e5 * T / 0.1, setpoints, np.array([3, -4, 0]) + setpoints].tolist()
    lines = [f"{k}, " + ", ".join(map("{:.0f}".format, row)) for k, row in enumerate(numbers)]
    Path("a.csv").write_text("\n".join([BLACKBOX.rpartition(", flags")[0], *lines, ""]))
    sizes = {one.axis: one.rms for one in eqt_cli.log_errors("a.csv").sizes}
    assert sizes == pytest.approx({"all": 5.0, "x": 3.0, "y": 4.0, "z": 0.0}, abs=1e-6)


# Time and memory, of texts that are made to take much of them ------------------------------------

WHOLE_AEM = """CCSDS_AEM_VERS = 1.0
META_START
REF_FRAME_A = EME2000
REF_FRAME_B = SC_BODY_1
ATTITUDE_DIR = A2B
ATTITUDE_TYPE = QUATERNION
META_STOP
{}DATA_START
2024-02-29T23:59:50 0 0 0 1
2024-02-29T23:59:51 0 0 0 1
DATA_STOP
"""
STK_HEAD = "stk.v.12.0\n\nBEGIN Attitude\n"
POWERS = "duration," + ",".join(f"{a}^{k}" for a in ("x", "y", "z", "yaw") for k in range(8))
PIECE = "\n{}" + ",0.1" * 32
HOSTILE = {
    "aem, blank lines": lambda n: WHOLE_AEM.format("\n" * n),
    "aem, spaces in a value": lambda n: WHOLE_AEM.format(f"X = y{' ' * n}z\n"),
    "aem, one word": lambda n: WHOLE_AEM.format("X" * n + "\n"),
    "stk, heads": lambda n: STK_HEAD + "AttitudeTimeX " * (n // 14),
    "stk, heads together": lambda n: STK_HEAD + "AttitudeTimeX" * (n // 13),
    "stk, blocks": lambda n: "stk.v.12.0\n" + "BEGIN " * (n // 6),
    "polynomials": lambda n: POWERS + PIECE.format(0.1) * (n // 130),
    "csv, blank lines": lambda n: "t,x,y,z\n0,1,2,3\n" + "\n" * n + "1,1,2,3\n",
    "csv, spaces in a heading": lambda n: f"t,x,y{' ' * n}(m),z\n0,1,2,3\n",
    "csv, brackets in a heading": lambda n: f"t,x,y,z{'[(' * (n // 2)}\n0,1,2,3\n",
    "csv, columns": lambda n: ",".join(f"n{k}" for k in range(n // 5)) + "\n0\n",
    "csv, quotes": lambda n: "t,x,y,z\n" + '0,"1",2,3\n' * (n // 10),
    "csv, empty cells": lambda n: "t,x,y,z\n" + "0,,,\n" * (n // 5),
    "iso, commas": lambda n: "t,x\n" + "," * n + "2024-03-05T10:11\n",
    "vicon, columns": lambda n: f"Objects\n9\n,a\nFrame,Sub Frame,{'TX,' * (n // 3)}\n,\n1,2\n",
    "kitti, spaces": lambda n: "1 " * 11 + "1" + " " * n + "\n",
    "blackbox, columns": lambda n: f"time (us),gyroADC[0],{'roll  ,' * (n // 7)}\n1,2\n",
    "comments": lambda n: "# x\n" * (n // 4) + "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n",
    "an open quote": lambda n: f't,x\n0,"{"a" * n}\n',
    "one line": lambda n: "a" * n,
}
SIZE = 10_000
"""Characters; a quadratic reader of the worst of these takes seconds for twice as many."""

NOTHING = 0.05
"""CPU time that is no matter, s; the noise of shorter ones is as large as they are."""


def longer(text, size):
    """Repeat the last line of numbers of a text."""
    *before, last = (line for line in text.splitlines() if line)
    while not any(letter.isdigit() for letter in last):
        last = before.pop()
    return "\n".join([*before, *[last] * (size // len(last))]) + "\n"


MAKERS = HOSTILE | {
    name: lambda n, text=text: longer(text, 10 * n) for name, (text, *_) in TEXTS.items()
}


def seconds(text):
    """The least CPU time of three readings, s."""
    Path("a.txt").write_text(text, encoding="utf-8")
    spent = []
    for _ in range(3):
        begun = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with suppress(EqtError):
                eqt_cli.check_log("a.txt")
        spent.append(time.process_time() - begun)
    return min(spent)


@pytest.mark.ci("reads each format six times")
@pytest.mark.parametrize("name", MAKERS)
def test_time_is_linear_in_the_size(name):
    one, two = seconds(MAKERS[name](SIZE)), seconds(MAKERS[name](2 * SIZE))
    assert two < max(NOTHING, 3 * one)


@pytest.mark.parametrize(
    ("durations", "said"),
    [
        ((1.0, 0.0), "piece 2: expected a duration above 0 s, got 0"),
        (("inf", 1.0), "piece 1: expected a duration above 0 s, got inf"),
        ((1.0, 1e12), "expected pieces of 4,000 s in all, or less, got 1e+12 s"),
    ],
)
def test_polynomials_that_would_fill_the_memory(durations, said):
    """One row of 0.5 kB would give 5e13 rows."""
    Path("p.csv").write_text(POWERS + "".join(map(PIECE.format, durations)), encoding="utf-8")
    assert said in refusal(EqtError, eqt_cli.check_log, "p.csv")
