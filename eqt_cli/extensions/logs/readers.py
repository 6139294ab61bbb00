"""Reads logs of other programs; a program of its own, which needs nothing of eqt.

Whoever reads a foreign file may run out of time or memory, so that `logs.flight_of` starts this
program with limits. Messages of ROS are decoded only with the types of rosbags' own stores and the
px4_msgs that eqt ships. The definitions in a file are compared with these, and never registered,
because rosbags would make code of them and run it.
"""

import io
import json
import math
import re
import shutil
import sqlite3
import struct
import sys
import zlib
from collections.abc import Iterable, Iterator
from contextlib import closing, redirect_stdout, suppress
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np

MANY, SINGLE = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/TransformStamped"
"""A message of many transforms, and one of a single one."""

PACKAGES = {"ulog": "pyulog", "dataflash": "pymavlink.DFReader"}
PACKAGES["bag"] = "rosbags.rosbag1 rosbags.rosbag2 rosbags.typesys"
"""What a reader imports, by its format."""


class Topic(NamedTuple):
    """What a file holds of a topic.

    Attributes
    ----------
    name, kind
        The topic, and its name in the table of its format.
    rows
        The number of its messages.
    times : (n,)
        Times of the fields, ns, as whole numbers; empty where the topic is not read.
    fields
        Numbers by the name of the field.
    note
        Why it is not read, although the table has it.
    settings
        Time, s, name and value of each parameter and of each change, of a topic without rows.
    """

    name: str
    kind: str
    rows: int
    times: Any
    fields: dict[str, Any]
    note: str = ""
    settings: list[tuple[float, str, Any]] = []  # noqa: RUF012  # never changed


def _since_boot(fields: dict[str, Any]) -> Any:
    """Return the times of the measurements if given, otherwise of the messages, ns; PX4 has µs."""
    stamps = (fields.get(name, np.zeros(1)) for name in ("timestamp_sample", "timestamp"))
    return 1000 * next((t for t in stamps if np.all(t > 0)), np.empty(0)).astype(int)


def ulog(path: str, wanted: dict[str, list[str]], types: dict[str, list[str]]) -> Iterator[Topic]:
    """Read a flight of PX4; `wanted` are the fields by the name of a topic."""
    from pyulog import ULog

    log = ULog(path)
    for dataset in log.data_list:
        name, kind = f"{dataset.name} {dataset.multi_id}", ""
        if dataset.multi_id == 0:
            name = kind = dataset.name
        numbers = {key: np.asarray(x, float) for key, x in dataset.data.items() if kind in wanted}
        yield Topic(name, kind, len(dataset.data["timestamp"]), _since_boot(numbers), numbers)
    facts = {"release": log.get_version_info_str(), "hardware": log.msg_info_dict.get("ver_hw")}
    facts = {name: fact for name, fact in facts.items() if fact is not None}
    settings = [(0.0, *fact) for fact in (facts | log.initial_parameters).items()]
    settings += [(t / 1e6, *change) for t, *change in log.changed_parameters]
    yield Topic("", "", 0, np.empty(0, int), {}, "", settings)
    if log.file_corruption:
        yield Topic("", "damaged", 0, np.empty(0, int), {})


def bag(path: str, wanted: dict[str, list[str]], types: dict[str, list[str]]) -> Iterator[Topic]:
    """Read a bag of ROS; `wanted` are the fields by the type of a message."""
    import rosbags.rosbag1
    import rosbags.rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    path = _with_its_log(path)
    old = Path(path).is_file() and np.fromfile(path, np.uint8, 7).tobytes() == b"#ROSBAG"
    store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_HUMBLE)
    decode = store.deserialize_ros1 if old else store.deserialize_cdr
    if MANY not in store.fielddefs:  # rosbags has none of ROS 1
        store.register(get_types_from_msg(f"{SINGLE.replace('/msg', '')}[] transforms", MANY))
    with (rosbags.rosbag1 if old else rosbags.rosbag2).Reader(Path(path)) as reader:
        publishers: dict[tuple[str, str], list[Any]] = {}
        for connection in reader.connections:
            publishers.setdefault((connection.topic, connection.msgtype), []).append(connection)
        for every in publishers.values():
            one = every[0]
            px4 = re.sub(r"\B([A-Z])", r"_\1", one.msgtype.rpartition("/")[2]).lower()
            kind = px4 if one.msgtype.startswith("px4_msgs") else one.msgtype
            count = sum(connection.msgcount for connection in every)
            topic = Topic(one.topic, kind, count, np.empty(0, int), {})
            note = ""
            try:
                name = one.msgtype.removeprefix("px4_msgs/msg/")
                if kind in wanted and (texts := types.get(name)):
                    store.register(_definition(one, texts, next(reader.messages(every), None)))
                is_known = kind in (*wanted, MANY) and one.msgtype in store.fielddefs
                if is_known:
                    note = next(filter(None, (_differs(x, store) for x in every)), "")
                if is_known and not note:
                    messages = ((t, decode(x, one.msgtype)) for _, t, x in reader.messages(every))
                    if kind == MANY:
                        for name, some in _parts(one.topic, messages).items():
                            part = Topic(name, SINGLE, 0, topic.times, {})
                            part = _decoded(part, some, SINGLE, wanted[SINGLE], store)
                            yield part._replace(rows=part.rows * (len(some) > 1))  # others: static
                            topic = topic._replace(rows=0)  # so that it is not listed
                    else:
                        topic = _decoded(topic, messages, one.msgtype, wanted[kind], store)
                        note = (
                            f"{topic.rows} of {count} read; try mcap recover"
                            if topic.rows < count
                            else ""
                        )
            except Exception as error:  # a foreign message may make rosbags raise anything
                note = f"{error}; if its messages are compressed, give the folder of the bag"
            yield topic._replace(note=note)


def _with_its_log(path: str) -> str:
    """Return a copy of a database with what SQLite still holds beside it, if it holds anything."""
    beside = Path(f"{path}-wal")
    if any(Path(path).glob("*.db3-wal")):
        raise ValueError("a part is in a write-ahead log; give the .db3 in place of the folder")
    if not beside.is_file() or not beside.stat().st_size:
        return path
    for name, source in (("copy.db3", path), ("copy.db3-wal", beside)):
        shutil.copyfile(source, name)  # in the empty folder of this process
    with closing(sqlite3.connect("copy.db3")) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    return "copy.db3"


def _parts(topic: str, messages: Iterator[Any]) -> dict[str, list[Any]]:
    """Return the transforms of each pair of frames, which one topic mixes."""
    pairs = dict[str, list[Any]]()
    for time, message in messages:
        for transform in message.transforms:
            frames = (
                x.removeprefix("/") for x in (transform.header.frame_id, transform.child_frame_id)
            )
            pairs.setdefault(f"{topic} {'.'.join(frames)}", []).append((time, transform))
    return pairs


def _decoded(topic: Topic, messages: Iterable[Any], kind: str, wanted: Any, store: Any) -> Topic:
    members = {name for name, _ in store.fielddefs[kind][1]}
    stamps = [name for name in ("timestamp", "timestamp_sample") if name in members]
    if "header" in members:
        stamps = ["header.stamp.sec", "header.stamp.nanosec"]
    names = {name.partition("[")[0] for name in wanted if re.split(r"[.[]", name)[0] in members}
    columns = [*stamps, *sorted(names)]
    get, times, rows, fields = attrgetter(*columns), [], [], dict[str, Any]()
    for time, message in messages:
        times.append(time)
        rows.append(get(message))
    for column, numbers in zip(columns, zip(*rows, strict=True), strict=False):
        array = np.asarray(numbers, float)
        split = range(array.shape[1] if array.ndim > 1 else 0)
        fields |= {f"{column}[{k}]": array[:, k] for k in split} or {column: array}
    recorded = np.array(times, int)
    if "header" in members and rows:
        sec, rest = (fields[name].astype(int) for name in stamps)
        if (sec + rest).any():  # a header may not be set
            fields["recorded"], recorded = recorded / 1e9, 10**9 * sec + rest
    elif "timestamp" in members:
        recorded = _since_boot(fields)
    return topic._replace(rows=len(rows), times=recorded, fields=fields)


def _definition(one: Any, texts: list[str], first: Any) -> Any:
    """Return the definition of PX4 that the file has or, without one, that fits a message."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    for text in texts:
        types = get_types_from_msg(text.replace(", ", "\n"), one.msgtype)
        store = get_typestore(Stores.EMPTY)
        store.register(types)
        with suppress(Exception):  # a foreign message may make rosbags raise anything
            if first:
                store.deserialize_cdr(first[2], one.msgtype)
            if not _differs(one, store):
                break
    return types


def _differs(one: Any, store: Any) -> str:
    """Say whether the definition in the file is another one than that of the store."""
    from rosbags.interfaces import MessageDefinitionFormat as Form
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    form, text = one.msgdef
    types = get_types_from_msg(text, one.msgtype) if form == Form.MSG else {}
    types |= get_types_from_idl(text) if form == Form.IDL else {}
    for name, (_, fields) in types.items():
        sides = (store.fielddefs.get(name, (0, ()))[1], fields)
        eqt_fields, here = ([(field.lower(), kind) for field, kind in side] for side in sides)
        if eqt_fields != here:
            return f"the file defines {name} otherwise than eqt knows it"
    return ""


def dataflash(
    path: str, wanted: dict[str, list[str]], types: dict[str, list[str]]
) -> Iterator[Topic]:
    """Read a log of ArduPilot; `wanted` are the fields by the name of a message."""
    from pymavlink.DFReader import DFReader_binary

    log, rows = DFReader_binary(path), dict[str, list[dict[str, Any]]]()
    counts = {form.name: log.counts[number] for number, form in log.formats.items()}
    axes, primary = [f"PSC{axis}" for axis in "NED"], 0
    kinds = [kind for kind in (*wanted, *axes, "PARM", "VER") if counts.get(kind)]
    while kinds and (message := log.recv_match(type=kinds)) is not None:
        instance = getattr(message, message.fmt.instance_field or "", 0)
        name, row = message.get_type(), message.to_dict()
        if name == "XKF4":  # of any core, it says which one flies
            primary = row.get("PI", 0)
        if instance == primary * name.startswith("XKF"):
            rows.setdefault(name, []).append(row)
    releases = (x for x in rows.pop("VER", ()) if "FWS" in x)
    settings = [(x["TimeUS"] / 1e6, "release", x["FWS"]) for x in releases]
    settings += [(x["TimeUS"] / 1e6, x["Name"], x["Value"]) for x in rows.pop("PARM", ())]
    yield Topic("", "", 0, np.empty(0, int), {}, "", settings)
    fields = {name: _columns(rows[name]) for name in rows}
    times = {name: columns.pop("TimeUS") for name, columns in fields.items()}
    if fields.keys() >= {*axes}:  # the three are written one by one, and not in all modes
        times["PSC"], fields["PSC"] = _joined([(times[name], fields[name]) for name in axes])
    for name, count in (counts | {"PSC": len(times.get("PSC", ()))}).items():
        of = fields.get(name, {})
        numbers = {key: of[key] for key in wanted.get(name, ()) if key in of}
        stamps = np.asarray(1000 * times.get(name, np.empty(0)), int)
        yield from ([Topic(name, name, count, stamps, numbers)] if count > 0 else [])


def _columns(rows: list[dict[str, Any]]) -> dict[str, Any]:
    names = [name for name, value in rows[0].items() if isinstance(value, (int, float))]
    return {name: np.array([row[name] for row in rows], float) for name in names}


def _joined(axes: list[tuple[Any, dict[str, Any]]]) -> tuple[Any, dict[str, Any]]:
    """Return the rows of the first axis beside those of the others at the same time."""
    (t, first), *others = axes
    near, joined = np.ones(len(t), bool), dict(first)
    for s, fields in others:
        after = np.clip(np.searchsorted(s, t), 1, len(s) - 1)
        distance = np.minimum(abs(t - s[after - 1]), abs(t - s[after]))
        near &= distance <= np.median(np.diff(s)) / 4
        joined |= {name: np.interp(t, s, numbers) for name, numbers in fields.items()}
    return t[near], {name: numbers[near] for name, numbers in joined.items()}


def crazyflie(
    path: str, wanted: dict[str, list[str]], types: dict[str, list[str]]
) -> Iterator[Topic]:
    """Read a log of the SD-card deck of a Crazyflie; each event has a topic with its own times.

    A head names the events and their variables, each with the letter of its type in `struct`; rows
    follow as they came, and a CRC-32 ends the file (`usddeck.c` of the firmware, versions 1 and 2).
    Without it, the log was cut or damaged, and rows are read as far as they are whole.
    """
    data = Path(path).read_bytes()
    version, names, layouts, at = _events(data)
    is_whole = len(data) >= at + 4 and zlib.crc32(data[:-4]) == int.from_bytes(data[-4:], "little")
    end, starts = len(data) - 4 * is_whole, dict[int, list[int]]()
    while at + 2 <= end and (number := data[at] + 256 * data[at + 1]) in layouts:
        if at + layouts[number].itemsize > end:
            break
        starts.setdefault(number, []).append(at)
        at += layouts[number].itemsize
    numbers = np.frombuffer(data, np.uint8)
    for number, places in starts.items():
        layout = layouts[number]
        rows = numbers[np.add.outer(places, np.arange(layout.itemsize))].view(layout)[:, 0]
        fields = {name: rows[name].astype(float) for name in layout.names[2:]}
        for name in [name for name in fields if re.match("(stateEstimate|ctrltarget)Z", name)]:
            fields[name] /= 1e3  # whole numbers of mm, mm/s and mrad/s, but for the quaternion
        if (name := "stateEstimateZ.quat") in fields:
            fields |= _unpacked(rows[name].astype(np.uint32))
        if "ctrlLee.thrustSi" in fields:
            fields |= {f"ctrlLee.thrust{axis}": np.zeros(len(rows)) for axis in "xy"}
        if "stateEstimate.pitch" in fields:  # the firmware's grows with the nose up
            fields["stateEstimate.pitch"] = -fields["stateEstimate.pitch"]
        times = rows["time"].astype(np.int64) * (1000 if version == 2 else 10**6)
        yield Topic(names[number], "crazyflie/event", len(rows), times, fields)
    if not is_whole:
        yield Topic("", "damaged", 0, np.empty(0, int), {})


def _events(data: bytes) -> tuple[int, dict[int, str], dict[int, Any], int]:
    """Return version, names and layouts of the events of a log, and where its rows begin."""
    version, count = struct.unpack_from("<HH", data, 1)
    if version not in (1, 2):
        raise ValueError(f"version {version} of the log is unknown; eqt reads 1 and 2")
    at, names, layouts = 5, dict[int, str](), dict[int, Any]()
    stamp = [("event", "<u2"), ("time", "<u8" if version == 2 else "<u4")]
    for _ in range(count):
        (number,), at = struct.unpack_from("<H", data, at), at + 2
        names[number], at = _terminated(data, at)
        (size,), at = struct.unpack_from("<H", data, at), at + 2
        variables = []
        for _ in range(size):
            words, at = _terminated(data, at)
            name, _, kind = words.rstrip(")").rpartition("(")
            if kind not in tuple("bBhHiIqQefd"):
                raise ValueError(f"type '{kind}' of {name} is unknown")
            variables.append((name, f"<{kind}".replace("<i", "<i4").replace("<I", "<u4")))
        layouts[number] = np.dtype(stamp + variables)
    return version, names, layouts, at


def _terminated(data: bytes, at: int) -> tuple[str, int]:
    """Return the text up to the next byte 0, and the place behind it."""
    end = data.index(0, at)
    return data[at:end].decode(), end + 1


def _unpacked(words: Any) -> dict[str, Any]:
    """Return quaternions that are packed into 32 bits (`quatcompress.h` of the firmware).

    Two bits number the largest part of x, y, z, w; the others have a sign and nine bits of √2 times
    their size, the last one lowest.
    """
    largest, parts = words >> 30, np.zeros((len(words), 4))
    for k in range(3, -1, -1):
        here = largest != k
        sizes = (words & 511) / (511 * np.sqrt(2))
        parts[here, k] = np.where(words & 512, -sizes, sizes)[here]
        words = np.where(here, words >> 10, words)
    rows = np.arange(len(words))
    parts[rows, largest] = np.sqrt(1 - (parts**2).sum(axis=1))
    return {f"stateEstimateZ.q{axis}": parts[:, k] for k, axis in enumerate("xyzw")}


def main(path: str, format: str, seconds: str) -> None:
    """Read a file, and write what is in it to stdout: a description in JSON, and arrays.

    Of the processor it may take so many seconds, without the imports.
    """
    reader = {"ulog": ulog, "bag": bag, "dataflash": dataflash, "crazyflie": crazyflie}[format]
    with redirect_stdout(io.StringIO()):  # readers print warnings
        for package in PACKAGES.get(format, "").split():
            import_module(package)
        with suppress(ImportError):  # Windows has no such limit
            import resource

            most = resource.getrlimit(resource.RLIMIT_CPU)[1]
            soft = math.ceil(process_time() + float(seconds))
            resource.setrlimit(resource.RLIMIT_CPU, (soft, most))
        topics = list(reader(path, *json.load(sys.stdin)))
    head = [[*record[:3], record.note, [*record.fields], record.settings] for record in topics]
    arrays = {f"{k}": topic.times for k, topic in enumerate(topics)}
    for k, topic in enumerate(topics):
        arrays |= {f"{k},{j}": x for j, x in enumerate(topic.fields.values())}
    np.savez(
        sys.stdout.buffer,
        head=np.frombuffer(json.dumps(head, default=str).encode(), np.uint8),
        **arrays,
    )


if __name__ == "__main__":
    try:
        main(*sys.argv[1:4])
    except Exception as error:  # a foreign file may make a reader raise anything
        sys.exit(f"{error}" or type(error).__name__)
