"""Writes a run for programs that show flights: CSV, TUM, MATLAB, and MCAP of ROS 2."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.files import write_all
from eqt_cli.components.derived import derived
from eqt_cli.components.groups import known_group
from eqt_cli.results.result import Result, check_stored, stored_place

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
    G, prefix = known_group(result.group_name), ("desired_" if reference else "")
    if G is None:
        raise result.error(f"is on group '{result.group_name}' of a plugin, which is not known")
    rows = max(len(range(G.size)[part.entries[0]]) for part in G.parts)
    if "*" in G.name or rows > 3:
        raise result.error(f"is on {G.name}; a file holds the motion of one body in space")
    if not reference and result.status[result.position_of(law), run : run + 1].any():
        raise result.error(f"run {run} of '{law}' failed, so that a file would lack its end")
    names = (f"{prefix}{name}" for name in ("pose", "velocity", "torque"))
    pose, velocity, wrench = (_of_run(result, name, law, run) for name in names)
    signals = {signal.name: signal.values(pose, velocity) for signal in derived(G)}
    if {"quaternion", "heading", "position"}.isdisjoint(signals):
        raise result.error(f"is on {G.name}, which is not the motion of one body")
    count = len(wrench)

    def in_space(values: Array | None, *, last: bool = False) -> Array:
        vectors = np.zeros((count, 3))
        if values is not None:
            values = values.reshape(count, -1)
            vectors[:, slice(-values.shape[1], None) if last else slice(values.shape[1])] = values
        return vectors

    half = signals.get("heading", np.zeros(count)) / 2
    planar = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=-1)
    acting = {part.force_unit: wrench[:, part.axes] for part in reversed(G.parts)}
    return Flight(
        times=result.times,
        position=in_space(signals.get("position")),
        quaternion=signals.get("quaternion", planar),
        velocity=in_space(signals.get("linear_velocity")),
        angular_velocity=in_space(signals.get("angular_velocity"), last=True),
        torque=in_space(acting.get("N m"), last=True),
        force=in_space(acting.get("N")),
    )


def _of_run(result: Result, name: str, law: str, run: int) -> Array:
    check_stored(result, name, who="a run in a file needs")
    dims, place = result.dims(name), stored_place(result, run)
    chosen: dict[str, Any] = {dim: place for dim in dims if dim.endswith("run")}
    if "controller" in dims:
        is_law = law != REFERENCE or law in result.labels
        chosen["controller"] = result.position_of(law) if is_law else 0
    return result.read(name, **chosen)


# The files ----------------------------------------------------------------------------------------


@purposes.show_export
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
    form, formats = path.suffix, [".csv", ".tum", ".mat", ".mcap"]
    if form not in formats:
        hint = suggestion(form, formats) or f"; known: {', '.join(formats)}"
        raise EqtError(f"--export: unknown format '{form}'{hint}")
    flown = [*laws] or result.labels
    if form == ".mcap":
        content = _mcap({law: flight(result, law, run) for law in [*flown, REFERENCE]})
    elif len(laws) > 1:
        raise EqtError(f"--export: a {form} file holds one law; choose one by --controller")
    else:
        content = _single(flight(result, flown[0], run), form)
    write_all({path: content}, path.parent)


def _single(flown: Flight, form: str) -> bytes:
    """Return a motion as CSV with the columns that `eqt log` reads, as TUM, or for MATLAB."""
    stream = BytesIO()
    if form == ".mat":
        from scipy.io import savemat

        savemat(stream, vars(flown), oned_as="column")
        return stream.getvalue()
    if form == ".csv":
        names, delimiter = "t,x,y,z,qw,qx,qy,qz,vx,vy,vz,wx,wy,wz,tx,ty,tz,fx,fy,fz", ","
        columns = [*vars(flown).values()]
    else:  # evo compares such positions; w is the last of the quaternion
        names, delimiter = "# timestamp x y z qx qy qz qw", " "
        columns = [flown.times, flown.position, np.roll(flown.quaternion, -1, 1)]
    rows = np.column_stack(columns)
    np.savetxt(stream, rows, fmt="%.17g", delimiter=delimiter, header=names, comments="")
    return stream.getvalue()


def _mcap(flown: Mapping[str, Flight]) -> bytes:
    """Topics of each law and of the reference: ``/eqt/odometry`` and ``/eqt/wrench``."""
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise EqtError("MCAP needs rosbags (extra bags): pip install rosbags") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    make = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    topics = (
        ("odometry", "nav_msgs/msg/Odometry", _odometry),
        ("wrench", "geometry_msgs/msg/WrenchStamped", _wrenches),
    )
    with TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            names = [re.sub(r"\W", "_", law) for law in flown]
            for number, (name, motion) in enumerate(zip(names, flown.values(), strict=True)):
                if name in names[:number]:
                    name = f"{name}_{number}"
                for topic, kind, messages in topics:
                    connection = writer.add_connection(f"/{name}/{topic}", kind, typestore=store)
                    for time, message in zip(motion.times, messages(motion, make), strict=True):
                        data = store.serialize_cdr(message, kind)
                        writer.write(connection, round(1e9 * time), data)
        (file,) = bag.glob("*.mcap")
        return file.read_bytes()


def _header(time: float, frame: str, make: Mapping[str, Any]) -> Any:
    seconds, rest = divmod(round(1e9 * time), 10**9)
    return make["Header"](stamp=make["Time"](sec=seconds, nanosec=rest), frame_id=frame)


def _odometry(flown: Flight, make: Mapping[str, Any]) -> Iterator[Any]:
    """The pose in space, and the twist in the body, as ROS has it."""
    from scipy.spatial.transform import Rotation

    unknown = np.zeros(36)
    turn = Rotation.from_quat(np.roll(flown.quaternion, -1, axis=-1))
    velocity = turn.apply(flown.velocity, inverse=True)
    rows = (flown.times, flown.position, flown.quaternion, velocity, flown.angular_velocity)
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


def _wrenches(flown: Flight, make: Mapping[str, Any]) -> Iterator[Any]:
    """Force and torque in the body."""
    for time, force, torque in zip(flown.times, flown.force, flown.torque, strict=True):
        wrench = make["Wrench"](force=make["Vector3"](*force), torque=make["Vector3"](*torque))
        yield make["WrenchStamped"](header=_header(time, "body", make), wrench=wrench)
