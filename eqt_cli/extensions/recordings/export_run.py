"""Writes a run for programs that show flights: CSV, TUM, MATLAB, and MCAP of ROS 2."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.files import write_all
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.results.dataset import derived
from eqt_cli.results.result import Result

REFERENCE = "reference"
"""Names the reference in place of a law."""


@dataclass(frozen=True)
class Flight:
    """A rigid motion over time; what a group does not have is 0, or the identity.

    Attributes
    ----------
    times : (n,)
        Times, s.
    position, velocity : (n, 3)
        m and m/s, in space.
    quaternion : (n, 4)
        w, x, y, z; body to space.
    angular_velocity : (n, 3)
        rad/s, in the body.
    torque, force : (n, 3)
        What acts on the body, N m and N, in the body.
    """

    times: Array
    position: Array
    quaternion: Array
    velocity: Array
    angular_velocity: Array
    torque: Array
    force: Array


def flight(result: Result, law: str, run: int) -> Flight:
    """Read a run of a law, or the reference of that run."""
    result = result.single("a file holds a run of one experiment")
    reference = law == REFERENCE and law not in result.labels
    G, prefix = result.group, "desired_" * reference
    if G is None:
        raise result.error(f"is on group '{result.group_name}' of a plugin, which is not known")
    rows = max(len(range(G.size)[part.entries[0]]) for part in G.parts)
    if "*" in G.name or rows > 3:
        raise result.error(f"is on {G.name}; a file holds the motion of one body in space")
    if not reference and result.status[result.position_of(law), run : run + 1].any():
        raise result.error(f"run {run} of '{law}' failed, so that a file would lack its end")
    names = (f"{prefix}{name}" for name in ("pose", "velocity", "torque"))
    pose, velocity, wrench = (_of_run(result, name, law, run) for name in names)
    signals = {each.name: each.values(pose, velocity) for each in derived(G)}
    if {"quaternion", "heading", "position"}.isdisjoint(signals):
        raise result.error(f"is on {G.name}, which is not the motion of one body")
    return Flight(result.times, *_padded(G, signals, wrench))


def _of_run(result: Result, name: str, law: str, run: int) -> Array:
    result.check_stored(name, who="a run in a file needs")
    dims, place = result.dims(name), result.stored_place(run)
    chosen: dict[str, Any] = {dim: place for dim in dims if dim.endswith("run")}
    if "controller" in dims:
        known = law != REFERENCE or law in result.labels
        chosen["controller"] = result.position_of(law) if known else 0
    return result.read(name, **chosen)


def _padded(G: MatrixLieGroup, signals: dict[str, Array], wrench: Array) -> Iterator[Array]:
    """Yield position, quaternion, velocity, angular velocity, torque and force, in three axes."""
    count = len(wrench)

    def in_space(values: Array | None, *, last: bool = False) -> Array:
        vectors = np.zeros((count, 3))
        if values is not None:
            values = values.reshape(count, -1)
            vectors[:, slice(-values.shape[1], None) if last else slice(values.shape[1])] = values
        return vectors

    half = signals.get("heading", np.zeros(count)) / 2
    planar = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=-1)
    yield in_space(signals.get("position"))
    yield signals.get("quaternion", planar)
    yield in_space(signals.get("linear_velocity"))
    yield in_space(signals.get("angular_velocity"), last=True)
    for unit in ("N m", "N"):
        axes = [part.axes for part in G.parts if part.force_unit == unit]
        yield in_space(wrench[:, axes[0]] if axes else None, last=unit == "N m")


# The files ----------------------------------------------------------------------------------------


def export_run(result: Result, path: Path, laws: list[str], run: int) -> None:
    """Write a run as the format of the file's name asks.

    Parameters
    ----------
    laws
        Labels of laws, or ``reference``. CSV, TUM and MATLAB hold one; MCAP the reference, too.

    Raises
    ------
    EqtError
        If the format, the law or the run is not known, or the file cannot be written.
    """
    if path.exists():
        raise EqtError(f"--export: {path} exists; remove it, or give another name")
    known = [*FORMATS, MCAP]
    if path.suffix not in known:
        hint = suggestion(path.suffix, known) or f"; known: {', '.join(known)}"
        raise EqtError(f"--export: unknown format '{path.suffix}'{hint}")
    if path.suffix == MCAP:
        flown = {law: flight(result, law, run) for law in [*(laws or result.labels), REFERENCE]}
        content = _mcap(flown)
    elif len(laws) > 1:
        raise EqtError(f"--export: a {path.suffix} file holds one law; choose one by --controller")
    else:
        content = FORMATS[path.suffix](flight(result, (laws or result.labels)[0], run))
    write_all({path: content}, path.parent)


def _table(of: Flight, names: str, *columns: Array, sep: str = ",", head: str = "") -> bytes:
    stream = BytesIO()
    rows = np.column_stack([of.times, *columns])
    np.savetxt(stream, rows, fmt="%.17g", delimiter=sep, header=head + names, comments="")
    return stream.getvalue()


def _csv(of: Flight) -> bytes:
    """Columns as `eqt log` reads them."""
    names = "t,x,y,z,qw,qx,qy,qz,vx,vy,vz,wx,wy,wz,tx,ty,tz,fx,fy,fz"
    moves = of.position, of.quaternion, of.velocity, of.angular_velocity
    return _table(of, names, *moves, of.torque, of.force)


def _tum(of: Flight) -> bytes:
    """Time, position, and quaternion with w last; positions are compared by evo."""
    names = "timestamp x y z qx qy qz qw"
    return _table(of, names, of.position, np.roll(of.quaternion, -1, 1), sep=" ", head="# ")


def _mat(of: Flight) -> bytes:
    from scipy.io import savemat

    stream = BytesIO()
    savemat(stream, vars(of), oned_as="column")
    return stream.getvalue()


FORMATS: dict[str, Callable[[Flight], bytes]] = {".csv": _csv, ".tum": _tum, ".mat": _mat}
MCAP = ".mcap"


def _mcap(flown: Mapping[str, Flight]) -> bytes:
    """Topics of each law and of the reference: ``/eqt/odometry`` and ``/eqt/wrench``."""
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise EqtError("MCAP needs rosbags (extra bags): pip install rosbags") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    make = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    with TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            names = [re.sub(r"\W", "_", law) for law in flown]
            for number, (name, of) in enumerate(zip(names, flown.values(), strict=True)):
                topic = name + f"_{number}" * (name in names[:number])
                for kind, messages in {_ODOMETRY: _odometry, _WRENCH: _wrenches}.items():
                    what = "odometry" if kind == _ODOMETRY else "wrench"
                    connection = writer.add_connection(f"/{topic}/{what}", kind, typestore=store)
                    for time, message in zip(of.times, messages(of, make), strict=True):
                        data = store.serialize_cdr(message, kind)
                        writer.write(connection, round(1e9 * time), data)
        (file,) = bag.glob("*.mcap")
        return file.read_bytes()


_ODOMETRY, _WRENCH = "nav_msgs/msg/Odometry", "geometry_msgs/msg/WrenchStamped"


def _header(time: float, frame: str, make: Mapping[str, Any]) -> Any:
    seconds, rest = divmod(round(1e9 * time), 10**9)
    return make["Header"](stamp=make["Time"](sec=seconds, nanosec=rest), frame_id=frame)


def _odometry(of: Flight, make: Mapping[str, Any]) -> Iterator[Any]:
    """The pose in space, and the twist in the body, as ROS has it."""
    from scipy.spatial.transform import Rotation

    unknown = np.zeros(36)
    turn = Rotation.from_quat(np.roll(of.quaternion, -1, axis=-1))
    velocity = turn.apply(of.velocity, inverse=True)
    rows = (of.times, of.position, of.quaternion, velocity, of.angular_velocity)
    for time, p, (w, x, y, z), v, omega in zip(*rows, strict=True):
        pose = make["Pose"](
            position=make["Point"](*p), orientation=make["Quaternion"](x=x, y=y, z=z, w=w)
        )
        twist = make["Twist"](linear=make["Vector3"](*v), angular=make["Vector3"](*omega))
        yield make["Odometry"](
            header=_header(time, "world", make),
            child_frame_id="body",
            pose=make["PoseWithCovariance"](pose=pose, covariance=unknown),
            twist=make["TwistWithCovariance"](twist=twist, covariance=unknown),
        )


def _wrenches(of: Flight, make: Mapping[str, Any]) -> Iterator[Any]:
    """Force and torque in the body."""
    for time, force, torque in zip(of.times, of.force, of.torque, strict=True):
        wrench = make["Wrench"](force=make["Vector3"](*force), torque=make["Vector3"](*torque))
        yield make["WrenchStamped"](header=_header(time, "body", make), wrench=wrench)
