"""A flight of PX4 as a table of text; it knows no group.

The formats of messages and their frames are those of PX4's documentation,
https://docs.px4.io/main/en/msg_docs/: attitudes are quaternions (w, x, y, z) from the body FRD to
NED, positions and velocities are in NED, rates are of the body FRD, and setpoints of torque and
thrust have no unit.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, InputError
from eqt_cli.core.files import text_of
from eqt_cli.core.regular_files import TooLargeError, content_of
from eqt_cli.notation.poses import QUATERNION_TOLERANCE

SUFFIX = ".ulg"
"""How files of this format end."""

MOST_BYTES = 400_000_000
"""Of a file; the table that is made of it has a bound of its own."""

SMALLER = "log fewer topics, or a part of the flight"
"""What to do about a larger one."""

DAMAGED = "# parts of the file are damaged and were skipped"
"""The first line of a table that is made of such a file."""

MOST_FIELDS = 2000
"""Of a message, whose format in the file may ask for any number of them."""

GAP = 5.0
"""Times the median step of a topic: what is longer is a gap, across which nothing is interpolated.
"""

CHUNK = 20_000
"""Rows that are written at once; as numbers of Python, they take 10 times their memory."""

_START = b"ULog\x01\x12\x35"


class _Source(NamedTuple):
    """Where a quantity is found: a topic, its fields, and those that say whether they are known.

    The frame of their numbers is in another field, for those of odometry.
    """

    topic: str
    fields: tuple[str, ...]
    flags: tuple[str, ...] = ()
    frame: str = ""


def _array(name: str, size: int = 3) -> tuple[str, ...]:
    return tuple(f"{name}[{index}]" for index in range(size))


_LOCAL, _ODOMETRY = "vehicle_local_position", "vehicle_odometry"

_FRAMES = (1, 2)
"""Axes of odometry: NED, and FRD of any heading that stands still."""

_SOURCES: dict[str, tuple[tuple[str, ...], str, tuple[_Source, ...]]] = {
    "position": (
        ("x", "y", "z"),
        "m",
        (
            _Source(_LOCAL, ("x", "y", "z"), ("xy_valid", "z_valid")),
            _Source(_ODOMETRY, _array("position"), frame="pose_frame"),
        ),
    ),
    "attitude": (
        ("qw", "qx", "qy", "qz"),
        "",
        (
            _Source("vehicle_attitude", _array("q", 4)),
            _Source(_ODOMETRY, _array("q", 4), frame="pose_frame"),
        ),
    ),
    "velocity": (
        ("vx", "vy", "vz"),
        "m/s",
        (
            _Source(_LOCAL, ("vx", "vy", "vz"), ("v_xy_valid", "v_z_valid")),
            _Source(_ODOMETRY, _array("velocity"), frame="velocity_frame"),
        ),
    ),
    "rates": (
        ("wx", "wy", "wz"),
        "rad/s",
        (
            _Source("vehicle_angular_velocity", _array("xyz")),
            _Source(_ODOMETRY, _array("angular_velocity")),
        ),
    ),
}
"""eqt's columns of each quantity, its unit, and where it is found: the first that a file has."""

_COMMANDS = tuple(
    _Source(f"vehicle_{kind}_setpoint", _array("xyz")) for kind in ("torque", "thrust")
)
"""What holds until the next; it is normalised to −1 … 1, so eqt takes it for no torque or force."""

_TIMES = ("timestamp_sample", "timestamp")
"""Of the measurement where that is known, and else of the message; µs since the start."""

NAMES = {
    f"{source.topic}.{field}": name
    for names, _, sources in _SOURCES.values()
    for source in sources
    for field, name in zip(source.fields, names, strict=True)
} | {
    f"{source.topic}.{time}": "t"
    for *_, sources in _SOURCES.values()
    for source in sources
    for time in _TIMES
}
"""eqt's name of a column by its heading in such a table."""


class _Series(NamedTuple):
    """Numbers of a topic: their times, µs, and the heading of these."""

    source: _Source
    clock: str
    times: Array
    numbers: Array


def recording_text(path: Path, missing: str, kind: type[EqtError], most: int, smaller: str) -> str:
    """The text of a recording that a user names; that of a PX4 flight is its table.

    Raises
    ------
    EqtError
        Of this kind, as `eqt_cli.core.files.text_of`; of an `InputError` for a flight that cannot
        be read.
    """
    if path.suffix.lower() != SUFFIX:
        return text_of(path, missing, kind, most=most, smaller=smaller)

    def read(path: Path, most_of_file: int) -> str:
        table = table_of(content_of(path, most_of_file), str(path))
        if len(table) > most:
            raise TooLargeError(most, len(table))
        return table

    return text_of(path, missing, kind, most=MOST_BYTES, smaller=SMALLER, read=read)


@np.errstate(all="ignore")  # of numbers that are none, which are found afterwards
def table_of(content: bytes, name: str) -> str:
    """The table of a flight, with PX4's names as headings.

    A row stands at each time of the position, or else of the attitude. Attitudes are interpolated
    along the shortest rotation, positions, velocities and rates linearly, and setpoints hold. Where
    another topic has a gap, there is no row.

    Raises
    ------
    InputError
        If the file cannot be read, or holds neither attitudes nor positions.
    """
    topics, damaged = _topics(content, name)
    found = {
        quantity: series
        for quantity, (*_, sources) in _SOURCES.items()
        for series in [next(_found(sources, topics, name), None)]
        if series is not None
    }
    if "position" not in found:
        found.pop("velocity", None)
    lead = found.get("position", found.get("attitude"))
    if lead is None:
        raise InputError(
            f"{name}: holds no poses; expected the topics vehicle_attitude and "
            f"vehicle_local_position, or {_ODOMETRY}"
        )
    covered = np.all([_covers(series, lead.times) for series in found.values()], axis=0)
    times = lead.times[covered]
    if not len(times):
        raise InputError(f"{name}: {', '.join(found)} were recorded at no common time")
    headings, columns = [f"{lead.clock} [us]"], [times]
    for quantity, series in found.items():
        headings += _headings(series, _SOURCES[quantity][1])
        try:
            columns += list(_at(times, series, quantity == "attitude").T)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
    for series in filter(None, (next(_found((each,), topics, name), None) for each in _COMMANDS)):
        headings += _headings(series, "normalised")
        columns += list(_held(times, series).T)
    parts = [f"{DAMAGED}\n"] * damaged + [",".join(headings), "\n"]
    form = ",".join(["%d", *["%.9g"] * (len(columns) - 1)]) + "\n"  # whole µs, single precision
    for first in range(0, len(times), CHUNK):
        some = np.stack([column[first : first + CHUNK] for column in columns], axis=-1)
        parts.append("".join(form % tuple(row) for row in some.tolist()))
    return "".join(parts)


def _headings(series: _Series, unit: str) -> list[str]:
    said = f" ({unit})" if unit else ""
    return [f"{series.source.topic}.{field}{said}" for field in series.source.fields]


def _topics(content: bytes, name: str) -> tuple[dict[str, Mapping[str, Array]], bool]:
    """The fields of each topic that is wanted, and whether parts of the file were skipped."""
    if find_spec("pyulog") is None:
        raise EqtError(f"{name}: a PX4 ULog needs pyulog; install it with: pip install pyulog")
    from pyulog import ULog

    if not content.startswith(_START):
        raise InputError(f"{name}: is no PX4 ULog; such a file begins with 'ULog'")
    sources = [source for *_, each in _SOURCES.values() for source in each]
    wanted = sorted({source.topic for source in (*sources, *_COMMANDS)})
    try:
        with redirect_stdout(io.StringIO()):  # it prints its warnings
            formats = ULog(_Bounded(content), parse_header_only=True).message_formats
            _require_small(formats, name)
            log = ULog(_Bounded(content), wanted)
    except _ExhaustedError:
        raise InputError(f"{name}: is too damaged to be read") from None
    except InputError:
        raise
    except Exception as error:  # whatever a file from outside makes of the library
        raise InputError(f"{name}: cannot be read as a PX4 ULog: {error}") from error
    topics = {each.name: each.data for each in log.data_list if each.multi_id == 0}
    return topics, bool(log.file_corruption)


class _ExhaustedError(Exception):
    """More was read than a file holds."""


class _Bounded(io.BytesIO):
    """Bytes that are read a few times; in some damaged files, pyulog reads on without an end."""

    def __init__(self, content: bytes) -> None:
        super().__init__(content)
        self._reads, self._bytes = 3 * len(content) + 1000, 2 * len(content) + 10**9

    def read(self, size: int | None = -1, /) -> bytes:
        found = super().read(size)
        self._reads -= 1
        self._bytes -= len(found)
        if min(self._reads, self._bytes) < 0:
            raise _ExhaustedError
        return found


def _require_small(formats: Mapping[str, Any], name: str) -> None:
    """Raise an `InputError` for a message of too many fields, before they are made."""
    known: dict[str, int] = {}

    def fields_of(message: str) -> int:
        if message not in known:
            known[message] = MOST_FIELDS + 1  # of one that holds itself
            known[message] = min(
                sum(
                    max(1, size) * (fields_of(kind) if kind in formats else 1)
                    for kind, size, _ in formats[message].fields
                ),
                MOST_FIELDS + 1,
            )
        return known[message]

    for message in formats:
        if fields_of(message) > MOST_FIELDS:
            raise InputError(
                f"{name}: expected at most {MOST_FIELDS} fields of a message, got more of "
                f"{message[:40]!r}"
            )


def _found(
    sources: Sequence[_Source], topics: Mapping[str, Mapping[str, Array]], name: str
) -> Iterator[_Series]:
    """What a file has of a quantity: rows without a number are left out."""
    for source in sources:
        data = topics.get(source.topic, {})
        clock = next((key for key in _TIMES if key in data and np.all(data[key] > 0)), None)
        if clock is None or not set(source.fields) <= set(data):
            continue
        kept = _valid(source, data)
        numbers = np.stack([data[field] for field in source.fields], axis=-1).astype(float)
        kept &= np.isfinite(numbers).all(axis=-1)
        times, numbers = data[clock].astype(float)[kept], numbers[kept]
        if np.any(back := np.diff(times) < 0):
            where = times[1:][back][0] / 1e6
            raise InputError(f"{name}: the time of {source.topic} goes back to {where:.6f} s")
        first = np.concatenate([[True], np.diff(times) > 0]) if len(times) else np.empty(0, bool)
        if first.sum() > 1:
            yield _Series(source, f"{source.topic}.{clock}", times[first], numbers[first])


def _valid(source: _Source, data: Mapping[str, Array]) -> Array:
    """Rows of which PX4 says that they are known, in axes of the world that point down."""
    rows = np.ones(len(data[source.fields[0]]), bool)
    for flag in source.flags:
        rows &= data.get(flag, rows).astype(bool)
    if source.frame:
        frame = data.get(source.frame, np.zeros(len(rows)))  # older versions have other numbers
        rows &= np.isin(frame, _FRAMES) & (data.get("pose_frame", frame) == frame)
    return rows


def _covers(series: _Series, times: Array) -> Array:
    """At which times there are numbers, or such closely before and after."""
    own = series.times
    inside = (own[0] <= times) & (times <= own[-1])
    after = np.clip(np.searchsorted(own, times), 1, len(own) - 1)
    step = own[after] - own[after - 1]
    close = (step <= GAP * np.median(np.diff(own))) | (own[after] == times)
    return inside & (close | (own[after - 1] == times))


def _at(times: Array, series: _Series, turns: bool) -> Array:
    """Numbers between those of a topic."""
    if not turns:
        columns = [np.interp(times, series.times, column) for column in series.numbers.T]
        return np.stack(columns, axis=-1)
    from scipy.spatial.transform import Rotation, Slerp  # slow to import

    norms = np.linalg.norm(series.numbers, axis=-1)
    if np.any(wrong := abs(norms - 1) > QUATERNION_TOLERANCE):
        raise InputError(
            f"{series.source.topic}: expected quaternions of norm 1, got norm "
            f"{norms[wrong][0]:.6g} at {series.times[wrong][0] / 1e6:.6f} s"
        )
    rotations = Rotation.from_quat(np.roll(series.numbers, -1, axis=-1))
    return np.roll(Slerp(series.times, rotations)(times).as_quat(), 1, axis=-1)


def _held(times: Array, series: _Series) -> Array:
    """The latest numbers of a topic; none before the first."""
    row = np.searchsorted(series.times, times, side="right") - 1
    return np.where(row[:, None] >= 0, series.numbers[row], np.nan)
