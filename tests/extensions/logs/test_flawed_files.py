"""Files of poses with flaws, of other programs, and with headers that may mean two things."""

import gzip
import sqlite3
import zipfile
from contextlib import closing

import h5py
import numpy as np
import pytest
from case_tables import refusal
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from eqt_cli.base.errors import InputError
from eqt_cli.components.pose_tables import LogMapping, TimeMapping, read_starts
from eqt_cli.extend import group_named
from eqt_cli.extensions.logs.log_check import check_text
from eqt_cli.extensions.logs.recording import read_log
from eqt_cli.extensions.logs.recording_check import notes
from eqt_cli.extensions.logs.tables import text_of_recording

VARIATIONS = range(25)
EXACT = 1e-14
HEAD = ["t", "qx", "qy", "qz", "qw", "x", "y", "z"]
FLAWS = ("repeated", "invalid", "unordered")


def motion(random, count=12):
    """Random rows of a time, a unit quaternion and a position."""
    times = np.cumsum(random.uniform(0.1, 1.0, count)).round(6)
    turns = Rotation.random(count, rng=random).as_quat()
    return np.c_[times, turns, random.normal(size=(count, 3))]


def flawed(kind, random, row, rows):
    """A row with a flaw that may follow the given one, as text."""
    cells = [repr(x) for x in [*row[:1], *rows[random.integers(len(rows))][1:].tolist()]]
    if kind == "unordered":
        cells[0] = repr(float(row[0]) - 1e-3 * random.uniform(0.1, 0.9))
    if kind == "invalid":
        cells[0] = repr(float(row[0]) + 1e-3)
        if random.random() < 0.3:
            cells[1:5] = random.choice(["0", "0.0", "-0"], 4).tolist()
        else:
            cells[random.integers(8)] = str(random.choice(["", "nan", "NaN", "inf", "-inf", " "]))
    return ",".join(cells)


def planted(kinds, random):
    """A clean file, the same with flaws, and the lines of the flaws by their kind."""
    rows = motion(random)
    clean, lines, where = [",".join(HEAD)], [",".join(HEAD)], {kind: [] for kind in kinds}
    for row in rows.tolist():
        clean.append(",".join(map(repr, row)))
        lines.append(clean[-1])
        for kind in random.permutation(kinds)[: random.integers(len(kinds) + 1)]:
            lines.append(flawed(kind, random, row, rows))
            where[kind].append(len(lines))
    for kind in kinds:  # at least one of each
        if not where[kind]:
            lines.append(flawed(kind, random, rows[-1].tolist(), rows))
            where[kind].append(len(lines))
    return "\n".join(clean) + "\n", "\n".join(lines) + "\n", where


def read(text, kind="csv", group="SE3", **mapping):
    log = read_log(text, "a.csv", kind, group_named(group), LogMapping(**mapping))
    log.require_usable()
    return log


@pytest.mark.parametrize("kinds", [[kind] for kind in FLAWS] + [list(FLAWS)], ids="+".join)
@pytest.mark.parametrize("seed", VARIATIONS)
def test_flawed_rows_are_left_out_and_counted(kinds, seed):
    clean, text, where = planted(kinds, np.random.default_rng(seed))
    with pytest.raises(InputError, match=r"a\.csv:\d+: expected .*; add `drop: \[") as caught:
        read(text)
    assert any(f"drop: [{kind}]" in str(caught.value) for kind in kinds)
    found, right = read(text, drop=kinds), read(clean)
    np.testing.assert_array_equal(found.times, right.times)
    np.testing.assert_array_equal(found.poses, right.poses)
    said = [
        f"{len(lines)} {kind} row{'s' * (len(lines) > 1)} left out, the first in line {lines[0]}"
        for kind, lines in where.items()
    ]
    assert set(said) <= set(notes(found))
    assert set(said) <= set(check_text(text, "a.csv", "csv", LogMapping(drop=kinds)).notes)


def test_one_kind_alone():
    """Times that were seen before are repeated; those not after the largest are unordered."""
    text = "t,angle\n" + "".join(f"{t},{k}\n" for k, t in enumerate([0, 1, 2, 1, 1.5, 3, 3]))
    with pytest.raises(InputError, match=r"a\.csv:6: .*1\.5 s; add `drop: \[unordered\]`"):
        read(text, group="SO2", drop=["repeated"])
    found = read(text, group="SO2", drop=["unordered"])
    np.testing.assert_array_equal(found.times, [0, 1, 2, 3])
    assert "3 unordered rows left out, the first in line 5" in list(notes(found))


def test_flaws_in_nanoseconds_and_without_header():
    first = 1403636580838555648
    stamps = [first, first + 7, "", first + 7, first + 3, first + 15]
    text = "t [ns],yaw,pitch,roll\n" + "".join(f"{t},0,0,0\n" for t in stamps)
    found = read(text, group="SO3", drop=list(FLAWS), time=TimeMapping(offset="first"))
    np.testing.assert_array_equal(found.times, [0, 7e-9, 15e-9])
    tum = "0 0 0 0 0 0 0 1\n1 nan 0 0 0 0 0 1\n0 5 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n"
    found = read(tum, "tum", drop=list(FLAWS))
    np.testing.assert_array_equal(found.times, [0, 2])
    said = refusal(InputError, read, "t,angle\nnan,0\n", group="SO2", drop=["invalid"])
    assert "holds no rows of numbers but those that `drop` leaves out" in said
    with pytest.raises(InputError, match=r"a\.csv:3: expected a finite number in column x, got t"):
        read("t,x\n0,0\n1,a\n", group="R1", drop=list(FLAWS))


# Files of other programs --------------------------------------------------------------------------


def database(path):
    with closing(sqlite3.connect(path)) as opened:
        opened.execute("create table topics (id integer)")
        opened.commit()


def hierarchical(path):
    with h5py.File(path, "w") as file:
        file["x"] = [1.0, 2.0]


def zipped(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("poses.csv", "t,x\n0,0\n")


def arrays(path):
    with path.open("wb") as file:
        np.savez(file, positions=np.eye(3))


def array(path):
    with path.open("wb") as file:
        np.save(file, np.eye(3))


def begins(start):
    return lambda path: path.write_bytes(start + np.random.default_rng(len(start)).bytes(99))


FOREIGN = {
    "SQLite, as bags of ROS 2 are": database,
    "a NumPy file": array,
    "a NumPy file,": arrays,
    "a zip archive or a workbook": zipped,
    "a gzip archive": lambda path: path.write_bytes(gzip.compress(b"t,x\n0,0\n")),
    "a MAT-file of MATLAB 5": lambda path: savemat(path, {"x": [1.0]}, appendmat=False),
    "a MAT-file of MATLAB 7.3": begins(b"MATLAB 7.3 MAT-file, Platform: GLNXA64"),
    "an HDF5 file": hierarchical,
    "compressed by zstd": begins(b"\x28\xb5\x2f\xfd"),
    "telemetry of MAVLink (tlog)": begins((1_700_000_000_000_000).to_bytes(8, "big") + b"\xfd\x1c"),
    "a log of Betaflight": begins(b"H Product:Blackbox flight data recorder"),
    "a kernel of SPICE": begins(b"DAF/CK  "),
    "XML": begins(b'<?xml version="1.0"?>'),
}


@pytest.mark.parametrize("title", FOREIGN)
@pytest.mark.parametrize("name", ["a.csv", "b.txt", "c"])
def test_a_file_of_another_program_is_named_by_its_first_bytes(tmp_path, title, name):
    path = tmp_path / name
    FOREIGN[title](path)
    expected = (
        f"{path}: is {title.rstrip(',')}, not a table that eqt reads; convert it to a table with "
    )
    assert refusal(InputError, text_of_recording, path, "", InputError, 10**6, "").startswith(
        expected
    )


# Headers ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", VARIATIONS)
def test_capitals_of_headers_do_not_matter(seed):
    random = np.random.default_rng(seed)
    rows = motion(random)
    text = "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist())
    head = [name.upper() if random.random() < 0.5 else name.capitalize() for name in HEAD]
    found, right = (read(",".join(names) + "\n" + text) for names in (head, HEAD))
    np.testing.assert_array_equal(found.poses, right.poses)
    assert list(notes(found)) == list(notes(right))


def test_capitals_that_make_columns_equal_are_refused():
    text = "t,T,angle\n0,20,0\n1,21,0\n"
    said = refusal(InputError, read, text, group="SO2")
    assert said == "a.csv:1: two columns are named t: t and T; rename one"
    np.testing.assert_array_equal(read(text, group="SO2", columns={"t": "t"}).times, [0, 1])
    np.testing.assert_array_equal(read(text, group="SO2", columns={"t": "T"}).times, [20, 21])


@pytest.mark.parametrize("seed", VARIATIONS)
def test_poses_of_the_plane_by_quaternions_and_angles(seed):
    random = np.random.default_rng(seed)
    t, angle = np.arange(6.0), random.uniform(-np.pi, np.pi, 6)
    places = random.normal(size=(6, 2))
    turns = Rotation.from_euler("z", angle[:, None])
    q = turns.as_quat() * random.choice([-1, 1], (6, 1))
    zero = np.zeros((6, 2))
    c, s = np.cos(angle), np.sin(angle)
    expected = np.zeros((6, 3, 3))
    expected[:, :2, :2] = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
    expected[:, :2, 2], expected[:, 2, 2] = places, 1.0
    for names, columns in (("qx,qy,qz,qw", q), ("yaw,pitch,roll", np.c_[angle, zero])):
        rows = np.c_[t, columns, places].tolist()
        text = f"t,{names},x,y\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)
        np.testing.assert_allclose(read(text, group="SE2").poses, expected, rtol=0, atol=EXACT)
    tilt = np.deg2rad(random.uniform(1.1, 170))
    axis = [*Rotation.from_euler("z", float(angle[0])).apply([1, 0, 0])]
    q[3] = (turns[3] * Rotation.from_rotvec(tilt * np.array(axis))).as_quat()
    text = "t,qx,qy,qz,qw,x,y\n" + "".join(
        ",".join(map(repr, row)) + "\n" for row in np.c_[t, q, places].tolist()
    )
    assert refusal(InputError, read, text, group="SE2").startswith(
        "a.csv:5: expected a rotation about z for SE2, got one that tilts it by "
        f"{np.rad2deg(tilt):.3g} deg; "
    )


@pytest.mark.parametrize(
    ("head", "group"),
    [
        ("wx,wy,wz", "SO3"),
        ("r11,wx,wy,wz", "SO3"),
        ("wx [rad/s],wy [rad/s],wz [rad/s]", "SO3"),
        ("wx,wy,wz,V1,V2,V3", "SO3"),
        ("v1,v2,v3", "R3"),
        ("w,vx,vy", "SE2"),
    ],
)
def test_coordinates_that_may_be_a_velocity_are_refused(head, group):
    G, rows = group_named(group), ",".join("0" for _ in head.split(",")) + "\n"
    with pytest.raises(InputError, match=r":1: .* may be the pose or a velocity; add `units: \{"):
        read_starts(head + "\n" + rows, "s.csv", G, LogMapping())
    with pytest.raises(InputError, match=r":1: .* may be the pose or a velocity; add `units: \{"):
        read(f"t,{head}\n0,{rows}1,{rows}", group=group)


def test_initial_states_say_what_is_not_used():
    G = group_named("SO3")
    text = "qx,qy,qz,qw,r11,wx,wy,wz,mass\n0,0,0,1,1,1,2,3,4\n0,0,0,0,1,1,2,3,4\n"
    poses, velocities, said = read_starts(text, "s.csv", G, LogMapping(drop=["invalid"]))
    np.testing.assert_array_equal(poses, [np.eye(3)])
    np.testing.assert_array_equal(velocities, [[1, 2, 3]])
    assert said == (
        "s.csv: 1 invalid row left out, the first in line 3",
        "s.csv: columns r11, mass are not used",
    )
