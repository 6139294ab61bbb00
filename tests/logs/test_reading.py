"""Poses in files: what is read, and what is said of a file that will not do."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eqt_cli.core.errors import InputError
from eqt_cli.groups import group_named
from eqt_cli.logs.mapping import LogMapping
from eqt_cli.logs.reading import read_log, read_starts

TURNS = Rotation.from_rotvec([[0, 0, 0], [0.1, 0.2, 0.3], [0.3, 0.1, -0.2]])
PLACES = np.array([[1.0, 2.0, 3.0], [1.5, 2.5, 3.0], [2.0, 3.0, 3.0]])
EXACT = 1e-14
HEAD = "t,qx,qy,qz,qw\n"


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
    from eqt_cli.logs.columns import coordinate_names

    G = group_named(name)
    V = np.random.default_rng(0).uniform(-1, 1, (3, G.dimension))
    text = ",".join(["t", *coordinate_names(G)]) + "\n" + lines(np.c_[[0, 1, 2], V])
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a.csv:1: expected a header that names the columns, such as t, qx, qy, qz, qw"),
        (
            "0,0,0,0,1\n",
            "a.csv:1: expected a header that names the columns, such as t, qx, qy, qz, qw",
        ),
        (HEAD, "a.csv: holds no rows of numbers"),
        (HEAD + "0,0,0,0,1\n", "a.csv:2: expected two rows or more, got 1"),
        (
            HEAD + "0,0,0,0,1\n1,0,0,0,1.1\n",
            "a.csv:3: expected a quaternion of norm 1, got norm 1.1",
        ),
        (HEAD + "0,0,0,0,1\n\n0,0,0,0,1\n", "a.csv:4: expected a time after 0 s, got 0 s"),
        (
            HEAD + "0,0,0,0,1\n1,0,nan,0,1\n",
            "a.csv:3: expected a finite number in column qy, got 'nan'",
        ),
        (
            HEAD + "0,0,0,0,1\n1,0,x,0,1\n",
            "a.csv:3: expected a finite number in column qy, got text",
        ),
        (HEAD + "0,0,0,0,1\n1,0,0,1\n", "a.csv:3: expected 5 entries, got 4"),
        ("t,qx,qy,qz,qw,qx\n", "a.csv:1: two columns are named qx"),
        (
            "t,qx,qy,qw\n0,0,0,1\n1,0,0,1\n",
            "a.csv:1: missing column qz; a pose of SO3 has qx, qy, qz, qw (or yaw, pitch, "
            "roll, or the coordinates wx, wy, wz)",
        ),
        ("qx,qy,qz,qw\n0,0,0,1\n", "a.csv:1: missing column t, the time in seconds"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(text, message):
    with pytest.raises(InputError) as caught:
        trajectory(text, "a.csv", "csv", group_named("SO3"))
    assert str(caught.value) == message


EUROC = "#timestamp, p_RS_R_x [m]\n10,0,0,0,1,0,0,0\n"


@pytest.mark.parametrize(
    ("kind", "text", "message"),
    [
        ("euroc", EUROC + "12.5,0,0,0,1,0,0,0\n", "a:3: expected whole nanoseconds, got '12.5'"),
        ("euroc", EUROC + "10,0,0,0,1,0,0,0\n", "a:3: expected a time after 0 s, got 0 s"),
        (
            "euroc",
            EUROC + "20,0,0,0,2,0,0,0\n",
            "a:3: expected a quaternion of norm 1, got norm 2",
        ),
        ("euroc", EUROC + "20,0,0,0,1,0,0\n", "a:3: expected 8 entries, got 7"),
        ("euroc", EUROC, "a:2: expected two rows or more, got 1"),
        ("tum", "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 1\n", "a:2: expected 8 entries, got 7"),
        (
            "tum",
            "0 0 0 0 0 0 0 1\n1 0 inf 0 0 0 0 1\n",
            "a:2: expected a finite number in column y, got 'inf'",
        ),
    ],
)
def test_what_is_wrong_in_other_formats(kind, text, message):
    with pytest.raises(InputError) as caught:
        trajectory(text, "a", kind, group_named("SE3"))
    assert str(caught.value) == message


def test_starts_with_velocities_and_without():
    G, q = group_named("SO3"), TURNS.as_quat()
    V = np.arange(9.0).reshape(3, 3)
    poses, none = read_starts("qx,qy,qz,qw\n" + lines(q), "s.csv", G)
    assert none is None
    np.testing.assert_allclose(poses, TURNS.as_matrix(), rtol=0, atol=EXACT)
    _, found = read_starts("qx,qy,qz,qw,wx,wy,wz\n" + lines(np.c_[q, V]), "s.csv", G)
    np.testing.assert_array_equal(found, V)
    with pytest.raises(InputError, match=r"^s\.csv:1: missing column wz; a velocity on SO3 has"):
        read_starts("qx,qy,qz,qw,wx,wy\n" + lines(np.c_[q, V[:, :2]]), "s.csv", G)
