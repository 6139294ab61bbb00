"""A recording as a motion on a group: its velocities and wrenches are those of the body."""

import numpy as np
import pytest

from eqt_cli.core.errors import InputError
from eqt_cli.groups import group_named
from eqt_cli.logs.check import check_text
from eqt_cli.logs.mapping import LogMapping
from eqt_cli.logs.reading import pose_columns, recorded_columns
from eqt_cli.logs.recording import read_recording

EXACT = 1e-12
GROUPS = {
    "SO2": "wz tz",
    "SO3": "wx wy wz tx ty tz",
    "SE2": "wz vx vy tz fx fy",
    "SE3": "wx wy wz vx vy vz tx ty tz fx fy fz",
    "R2": "vx vy fx fy",
    "SO3*R1": "wx1 wy1 wz1 tx1 ty1 tz1 vx2 fx2",
}


def text_of(header, rows):
    return header + "\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist())


@pytest.fixture
def numbers():
    return np.random.default_rng(3)


def entries(G, poses):
    """The numbers of `pose_columns`, of groups in space and products of them."""
    return np.c_[quaternions(poses), poses[:, :3, 3:].reshape(len(poses), -1)]


def quaternions(poses):
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(poses[:, :3, :3]).as_quat()


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
    found = read_recording(
        text_of(",".join(["t", *own, *names]), rows), "a.csv", "csv", G, LogMapping()
    )
    both = np.c_[found.velocities, found.require_wrenches()]
    half = {"rates": 0, "velocity": 0, "torque": G.dimension, "force": G.dimension}
    for one in beside:
        columns = [names.index(each) for each in one.names]
        axes = slice(one.axes.start + half[one.kind], one.axes.stop + half[one.kind])
        np.testing.assert_array_equal(both[:, axes], given[:, columns])


@pytest.mark.parametrize("frame", ["body", "spatial"])
def test_power_is_the_same_in_every_frame_and_axes(numbers, frame):
    """⟨wrench, V⟩ does not depend on the coordinates: τ·ω + f·v as they stand in the file."""
    G = group_named("SE3")
    poses = G.exp(numbers.normal(size=(4, 6)))
    given = numbers.normal(size=(4, 12))  # ω, v, τ, f, all of the same frame
    header = "t,qx,qy,qz,qw,x,y,z," + GROUPS["SE3"].replace(" ", ",")
    text = text_of(header, np.c_[np.arange(4.0), entries(G, poses), given])
    frames = dict.fromkeys(("rates", "velocity", "torque", "force"), frame)
    said = LogMapping(world="NED to ENU", body="FRD to FLU", **frames)
    found = read_recording(text, "a.csv", "csv", G, said)
    power = np.sum(found.require_wrenches() * found.velocities, axis=1)
    np.testing.assert_allclose(power, np.sum(given[:, :6] * given[:, 6:], axis=1), atol=EXACT)
    axes = said.axes("body") if frame == "body" else found.poses[:, :3, :3].mT @ said.axes("world")
    torque = (axes @ given[:, 6:9, None])[..., 0]
    np.testing.assert_allclose(found.wrenches[:, :3], torque, atol=EXACT)


def test_what_was_not_measured_is_said():
    G = group_named("SE3")
    rows = np.array(
        [[0.0, *[0, 0, 0, 1], *[0, 0, 0], 1, 2, 3], [1.0, *[0, 0, 0, 1], *[0, 0, 0], 1, 2, 3]]
    )
    text = text_of("t,qx,qy,qz,qw,x,y,z,tx,ty,tz", rows)
    found = read_recording(text, "a.csv", "csv", G, LogMapping())
    np.testing.assert_array_equal(found.wrenches[0], [1, 2, 3, np.nan, np.nan, np.nan])
    with pytest.raises(InputError) as error:
        found.require_wrenches()
    assert str(error.value) == (
        "a.csv:1: missing column fx, fy, fz; a wrench on SE3 has tx, ty, tz, fx, fy, fz"
    )


def test_a_group_without_names_of_them():
    G = group_named("SE23")
    rows = np.array([[t, *[0, 0, 0, 1], *[0.0] * 6] for t in (0.0, 1.0)])
    text = text_of(",".join(["t", *pose_columns(G)]), rows)
    with pytest.raises(InputError) as error:
        read_recording(text, "a.csv", "csv", G, LogMapping()).require_wrenches()
    assert str(error.value) == "a.csv:1: no columns of a wrench on SE23 are known"


def test_units_of_wrenches():
    header = "t,qx,qy,qz,qw,x,y,z,tx [mN·m],ty (N m),tz,fx (kN),fy (mN),fz"
    rows = np.array([[t, *[0, 0, 0, 1], *[0.0] * 3, *[1.0] * 6] for t in (0.0, 1.0)])
    text, G = text_of(header, rows), group_named("SE3")
    found = read_recording(text, "a.csv", "csv", G, LogMapping(units={"tz": "Nm"}))
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
    with pytest.raises(InputError) as error:
        read_recording(text, "a.csv", "csv", G, LogMapping(units={"fz": "lbf"}))
    assert str(error.value) == "column fz: expected a force in N, mN or kN, got 'lbf'"
