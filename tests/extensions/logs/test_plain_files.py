"""Plain tables, which eqt reads without the extension: the same bits as by the extension."""

import numpy as np
import pytest

from eqt_cli.components.pose_tables import (
    LogMapping,
    plain_poses,
    pose_columns,
    read_starts,
    velocity_columns,
)
from eqt_cli.extend import Problems, WaypointsReference, group_named
from eqt_cli.extensions.logs import recording, recording_check

GROUPS = ("SO2", "SO3", "SE2", "SE3", "SE23", "R3", "SE3*SO2")


def entries(G):
    return [f"Q{row}{column}" for row in range(1, G.size + 1) for column in range(1, G.size + 1)]


def rows_of(names, G, random):
    """Random rows of a pose in these columns, with zeros of both signs."""
    if names == entries(G):
        return G.exp(random.normal(size=(4, G.dimension))).reshape(4, -1)
    rows = random.normal(size=(4, len(names))).round(1)
    rows[0] = -0.0
    for k in (k for k, name in enumerate(names) if name.startswith("qx")):
        rows[0, k + 3] = 1.0
        rows[:, k : k + 4] /= np.linalg.norm(rows[:, k : k + 4], axis=1, keepdims=True)
    return rows


def table(names, rows):
    return "\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())])


def forms(G):
    """The columns of a pose in each form, and those of a velocity."""
    euler = [name for name in ("yaw", "pitch", "roll") if G.name in ("SO3", "SE3", "SE23")]
    places = [name for name in pose_columns(G) if name[0] != "q"]
    poses = [pose_columns(G), entries(G), *([[*euler, *places]] if euler else [])]
    return [(pose, velocity) for pose in poses for velocity in ([], *velocity_columns(G))]


@pytest.mark.parametrize("name", GROUPS)
def test_starts(name):
    G, random = group_named(name), np.random.default_rng(3)
    for pose, velocity in forms(G):
        if {*pose} & {*velocity}:
            continue
        rows = np.c_[rows_of(pose, G, random), random.normal(size=(4, len(velocity)))]
        text = table([*pose, *velocity], rows)
        assert plain_poses(text, "s.csv", G, LogMapping(), [velocity])
        plain = read_starts(text, "s.csv", G, LogMapping())
        full = recording.read_starts(text, "s.csv", G, LogMapping())
        assert plain[0].tobytes() == full[0].tobytes()
        assert (plain[1] is None) == (full[1] is None) == (not velocity)
        if velocity:
            assert plain[1].tobytes() == full[1].tobytes()
        assert plain[2] == full[2] == ()


@pytest.mark.parametrize("name", GROUPS)
def test_waypoints(name):
    G, random = group_named(name), np.random.default_rng(4)
    for pose in dict.fromkeys(tuple(pose) for pose, _ in forms(G)):
        rows = np.c_[[-0.0, 0.5, 2.0, 2.25], rows_of([*pose], G, random)]
        text = table(["t", *pose], rows)
        reference = WaypointsReference(file="w.csv").with_files({"w.csv": text})
        assert plain_poses(text, "w.csv", G, LogMapping(), [["t"]])
        times, poses = reference.rows(G)
        log = recording_check.log_of(reference, G)
        assert times.tobytes() == log.times.tobytes()
        assert poses.tobytes() == log.moved_poses.tobytes()


PLAIN = "qx,qy,qz,qw,V1,V2,V3\n0,0,0,1,1,2,3\n"


@pytest.mark.parametrize(
    "text",
    [
        "",
        PLAIN.replace("V1", "V1 [rad/s]"),
        PLAIN.replace("V1", "v_1"),
        PLAIN.replace("V1", "V2"),
        PLAIN.replace("V1,V2", "V2,V1"),
        PLAIN.replace("1,1,2", "0.9,1,2"),
        PLAIN.replace("1,2,3", "1,2,"),
        PLAIN.replace("1,2,3", "1,2,nan"),
        PLAIN.replace("1,2,3", "1,2"),
        PLAIN.replace("1,2,3", "1,2,x"),
        PLAIN.replace("1,2,3", '1,2,"3"'),
        PLAIN.replace("1,2,3", "1,2,1_0"),
        PLAIN.replace("3\n", "3\n\n"),
        PLAIN.replace("3", "3" + 100_000 * " "),
        "wx,wy,wz,V1,V2,V3\n0,0,0,1,2,3\n",
        PLAIN.partition("\n")[0],
    ],
)
def test_what_leaves_something_open_is_not_plain(text):
    others = velocity_columns(G := group_named("SO3"))
    assert plain_poses(PLAIN, "s.csv", G, LogMapping(), others)
    assert plain_poses(text, "s.csv", G, LogMapping(), others) is None


def test_a_mapping_is_read_by_the_extension():
    G = group_named("SO3")
    assert plain_poses(PLAIN, "s.csv", G, LogMapping(body="FRD to FLU"), [["V1"]]) is None
    _, V, _ = read_starts(PLAIN, "s.csv", G, LogMapping(body="FRD to FLU"))
    np.testing.assert_array_equal(V, [[1, -2, -3]])


@pytest.mark.parametrize("times", [(0, 0), (1, 0)])
def test_times_that_do_not_rise_are_refused(times):
    G = group_named("R3")
    text = "t,x,y,z\n" + "".join(f"{t},0,0,0\n" for t in times)
    problems = Problems()
    reference = WaypointsReference(file="w.csv").with_files({"w.csv": text})
    reference.check(G, problems)
    assert [problem.path for problem in problems] == ["file"]
