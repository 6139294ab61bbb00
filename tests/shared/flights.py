"""Logs of other programs, made byte by byte or by rosbags, as their formats ask for."""

import struct

import numpy as np

ULOG = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)


def message(kind, content):
    return struct.pack("<HB", len(content), ord(kind)) + content


def parameter(name, value):
    """A message of a float."""
    key = f"float {name}".encode()
    return message("P", bytes([len(key)]) + key + struct.pack("<f", value))


def ulog(*topics, flags=b"", parameters=None, changes=(), hardware=b""):
    """A file with topics: a name, a format of fields, and rows of numbers.

    Parameters are floats by name; changes of them are a time in us, a name and a value.
    """
    definitions = [message("B", flags.ljust(40, b"\0"))]
    definitions += [parameter(*one) for one in (parameters or {}).items()]
    if hardware:
        key = f"char[{len(hardware)}] ver_hw".encode()
        definitions.append(message("I", bytes([len(key)]) + key + hardware))
    definitions += [message("F", f"{name}:{form}".encode()) for name, form, _ in topics]
    data = []
    for index, (name, form, rows) in enumerate(topics):
        data.append(message("A", struct.pack("<BH", 0, index) + name.encode()))
        codes = "".join(
            {"uint64_t": "Q", "float": "f", "bool": "?", "uint8_t": "B"}[kind.partition("[")[0]]
            * int(kind.partition("[")[2].rstrip("]") or 1)
            for kind in (field.split()[0] for field in form.split(";") if field)
        )
        for row in rows:
            whole = [int(x) if code in "QB?" else x for x, code in zip(row, codes, strict=True)]
            data.append(message("D", struct.pack(f"<H{codes}", index, *whole)))
    if changes:  # which have the time of the data before them
        times = [int.from_bytes(x[5:13], "little") if x[2:3] == b"D" else -1 for x in data]
        rows = [*zip(times, data, strict=True), *((t, parameter(*x)) for t, *x in changes)]
        data = [content for _, content in sorted(rows, key=lambda row: row[0])]
    return ULOG + b"".join(definitions + data)


def dataflash(*topics, units=None):
    """A log of ArduPilot: a name, codes of the columns, their names, and rows of numbers.

    `units` are those of the columns by the name; that of the number of an instance is #.

    As ArduPilot does, it describes each message first: type, length, name, codes, names.
    """
    sizes = [3 + struct.calcsize("<" + codes.replace("M", "B")) for _, codes, _, _ in topics]
    described = [(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")]
    for k, (name, codes, names, _) in enumerate(topics):
        described.append((129 + k, sizes[k], name.encode(), codes.encode(), names.encode()))
    described.append((128 - 1, 44, b"FMTU", b"QBNN", b"TimeUS,FmtType,UnitIds,MultIds"))
    content = b"".join(b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *form) for form in described)
    for k, (name, *_) in enumerate(topics):
        if name in (units or {}):
            content += b"\xa3\x95\x7f" + struct.pack("<QB16s16s", 0, 129 + k, units[name], b"")
    rows = [(row[0], k, row) for k, (*_, rows) in enumerate(topics) for row in rows]
    for _, k, row in sorted(rows, key=lambda each: each[:2]):
        codes = topics[k][1].replace("M", "B")
        numbers = [int(x) if code in "QB" else x for x, code in zip(row, codes, strict=True)]
        content += b"\xa3\x95" + bytes([129 + k]) + struct.pack("<" + codes, *numbers)
    return content


def write_bag(path, topics, *, definitions=None):
    """Write a bag by rosbags: a topic's name, type, times in s, and a function that makes messages.

    The suffix says whether it is of ROS 1 (.bag), MCAP (.mcap) or SQLite (.db3).
    """
    import rosbags.rosbag1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    old = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_HUMBLE)
    for kind, text in (definitions or {}).items():
        store.register(get_types_from_msg(text, kind))
    make = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    make["Time"] = store.types["builtin_interfaces/msg/Time"]
    folder = path.with_name(f"{path.name}-bag")
    if old:
        writer = rosbags.rosbag1.Writer(path)
    else:
        plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
        writer = Writer(folder, version=9, storage_plugin=plugin)
    serialize = store.serialize_ros1 if old else store.serialize_cdr
    with writer:
        for node, (name, kind, times, made) in enumerate(topics):
            caller = {"callerid": f"/{node}"} if old else {}
            connection = writer.add_connection(name, kind, typestore=store, **caller)
            for k, t in enumerate(np.round(1e9 * times).astype(int).tolist()):
                stamp = make["Time"](sec=t // 10**9, nanosec=t % 10**9)
                more = {"seq": k} if old else {}
                header = make["Header"](stamp=stamp, frame_id="map", **more)
                writer.write(connection, t, serialize(made(k, header, make), kind))
    if not old:
        (file,) = folder.glob(f"*{path.suffix}")
        file.rename(path)
    return path


def pose_stamped(positions, quaternions):
    """A function that makes messages of poses; quaternions are x, y, z, w."""

    def made(k, header, make):
        q = dict(zip("xyzw", quaternions[k].tolist(), strict=True))
        pose = make["Pose"](
            position=make["Point"](*positions[k].tolist()), orientation=make["Quaternion"](**q)
        )
        return make["PoseStamped"](header=header, pose=pose)

    return made


def odometry(positions, quaternions, velocities, rates):
    """A function that makes messages of odometry; velocities and rates are in the body."""
    pose_of = pose_stamped(positions, quaternions)

    def made(k, header, make):
        twist = make["Twist"](
            linear=make["Vector3"](*velocities[k].tolist()),
            angular=make["Vector3"](*rates[k].tolist()),
        )
        unknown = np.zeros(36)
        return make["Odometry"](
            header=header,
            child_frame_id="body",
            pose=make["PoseWithCovariance"](pose=pose_of(k, header, make).pose, covariance=unknown),
            twist=make["TwistWithCovariance"](twist=twist, covariance=unknown),
        )

    return made
