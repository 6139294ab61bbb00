"""Converts a PX4 flight log (ULog) to a table of text.

Message formats and frames are those of PX4's documentation,
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

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, InputError
from eqt_cli.base.files import TooLargeError, content_of, text_of
from eqt_cli.components.log_table import DAMAGED
from eqt_cli.components.pose_notation import QUATERNION_TOLERANCE

TITLE = "a PX4 flight"
"""Name of such a recording in messages."""

MAX_BYTES = 400_000_000
"""Largest size of a file; its table has a bound of its own."""

SMALLER = "log fewer topics, or a part of the flight"
"""Advice for a larger file."""

MAX_FIELDS = 2000
"""Largest number of fields of a message; a format in a file could ask for any number."""

GAP = 5.0
"""Multiple of a topic's median step beyond which a step is a gap; gaps are not interpolated."""

CHUNK = 20_000
"""Number of rows to write at once, because rows as Python numbers take 10 times the memory."""

_START = b"ULog\x01\x12\x35"


class _TopicFields(NamedTuple):
    """The place of a quantity in a log: a topic, its fields, and the flags of their validity.

    In odometry, the field `frame` holds the frame of the numbers.
    """

    topic: str
    fields: tuple[str, ...]
    flags: tuple[str, ...] = ()
    frame: str = ""


def _array(name: str, size: int = 3) -> tuple[str, ...]:
    return tuple(f"{name}[{index}]" for index in range(size))


_LOCAL, _ODOMETRY = "vehicle_local_position", "vehicle_odometry"

_FRAMES = (1, 2)
"""Accepted frames of odometry: NED, and a fixed FRD of arbitrary heading."""

_SOURCES: dict[str, tuple[tuple[str, ...], str, tuple[_TopicFields, ...]]] = {
    "position": (
        ("x", "y", "z"),
        "m",
        (
            _TopicFields(_LOCAL, ("x", "y", "z"), ("xy_valid", "z_valid")),
            _TopicFields(_ODOMETRY, _array("position"), frame="pose_frame"),
        ),
    ),
    "attitude": (
        ("qw", "qx", "qy", "qz"),
        "",
        (
            _TopicFields("vehicle_attitude", _array("q", 4)),
            _TopicFields(_ODOMETRY, _array("q", 4), frame="pose_frame"),
        ),
    ),
    "velocity": (
        ("vx", "vy", "vz"),
        "m/s",
        (
            _TopicFields(_LOCAL, ("vx", "vy", "vz"), ("v_xy_valid", "v_z_valid")),
            _TopicFields(_ODOMETRY, _array("velocity"), frame="velocity_frame"),
        ),
    ),
    "rates": (
        ("wx", "wy", "wz"),
        "rad/s",
        (
            _TopicFields("vehicle_angular_velocity", _array("xyz")),
            _TopicFields(_ODOMETRY, _array("angular_velocity")),
        ),
    ),
}
"""For each quantity eqt's columns, the unit, and its sources; the first one in a file is used."""

_COMMANDS = tuple(
    _TopicFields(f"vehicle_{kind}_setpoint", _array("xyz")) for kind in ("torque", "thrust")
)
"""Setpoints, each held until the next.

They are normalised to −1 … 1, so eqt does not use them as torque or force.
"""

_TIMES = ("timestamp_sample", "timestamp")
"""Fields of the time, µs since the start: of the measurement if given, otherwise of the message."""

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
"""eqt's name of a column by its heading in the table of a flight."""


class _Series(NamedTuple):
    """Numbers of a topic, with their times, µs, and the heading of the times."""

    source: _TopicFields
    clock: str
    times: Array
    numbers: Array


def text_of_recording(path: Path, missing: str, kind: type[EqtError], limit: int) -> str:
    """Return a PX4 flight as the text of a table.

    Raises
    ------
    EqtError
        Of this kind, as by `eqt_cli.base.files.text_of`; an `InputError` for a flight that cannot
        be read.
    """

    def read(path: Path, most_bytes: int) -> str:
        table = table_of(content_of(path, most_bytes), str(path))
        if len(table) > limit:
            raise TooLargeError(limit, len(table))
        return table

    return text_of(path, missing, kind, limit=MAX_BYTES, smaller=SMALLER, read=read)


@np.errstate(all="ignore")  # numbers that are not finite are handled later
def table_of(content: bytes, name: str) -> str:
    """Return the table of a flight, with PX4's names as headings.

    There is a row at each time of the position, or of the attitude in a log without positions.
    Attitudes are interpolated along the shortest rotation, positions, velocities and rates
    linearly; setpoints are held. Where another topic has a gap, there is no row.

    Raises
    ------
    InputError
        If the file cannot be read, or holds neither attitudes nor positions.
    """
    topics, damaged = _topics(content, name)
    recorded = {
        quantity: series
        for quantity, (*_, sources) in _SOURCES.items()
        for series in [next(_series(sources, topics, name), None)]
        if series is not None
    }
    if "position" not in recorded:
        recorded.pop("velocity", None)
    lead = recorded.get("position", recorded.get("attitude"))
    if lead is None:
        raise InputError(
            f"{name}: holds no poses; expected the topics vehicle_attitude and "
            f"vehicle_local_position, or {_ODOMETRY}"
        )
    covered = np.all([_covers(series, lead.times) for series in recorded.values()], axis=0)
    times = lead.times[covered]
    if not len(times):
        raise InputError(f"{name}: {', '.join(recorded)} were recorded at no common time")
    headings, columns = [f"{lead.clock} [us]"], [times]
    for quantity, series in recorded.items():
        headings += _headings(series, _SOURCES[quantity][1])
        try:
            columns += list(_interpolated(times, series, quantity == "attitude").T)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
    for series in filter(None, (next(_series((each,), topics, name), None) for each in _COMMANDS)):
        headings += _headings(series, "normalised")
        columns += list(_held(times, series).T)
    parts = [f"{DAMAGED}\n"] * damaged + [",".join(headings), "\n"]
    row_format = ",".join(["%d", *["%.9g"] * (len(columns) - 1)]) + "\n"  # µs, single precision
    for first in range(0, len(times), CHUNK):
        some = np.stack([column[first : first + CHUNK] for column in columns], axis=-1)
        parts.append("".join(row_format % tuple(row) for row in some.tolist()))
    return "".join(parts)


def _headings(series: _Series, unit: str) -> list[str]:
    in_unit = f" ({unit})" if unit else ""
    return [f"{series.source.topic}.{field}{in_unit}" for field in series.source.fields]


def _topics(content: bytes, name: str) -> tuple[dict[str, Mapping[str, Array]], bool]:
    """Return the fields of each topic in use, and whether parts of the file were skipped."""
    if find_spec("pyulog") is None:
        raise EqtError(
            f"{name}: a PX4 ULog needs pyulog (extra logs); install it with: pip install pyulog"
        )
    from pyulog import ULog

    if not content.startswith(_START):
        raise InputError(f"{name}: not a PX4 ULog; such a file begins with 'ULog'")
    sources = [source for *_, each in _SOURCES.values() for source in each]
    wanted = sorted({source.topic for source in (*sources, *_COMMANDS)})
    try:
        with redirect_stdout(io.StringIO()):  # pyulog prints its warnings
            formats = ULog(_BoundedBytes(content), parse_header_only=True).message_formats
            _require_small(formats, name)
            log = ULog(_BoundedBytes(content), wanted)
    except _ExhaustedError:
        raise InputError(f"{name}: too damaged to be read") from None
    except InputError:
        raise
    except Exception as error:  # a foreign file may make pyulog raise anything
        raise InputError(f"{name}: cannot be read as a PX4 ULog: {error}") from error
    topics = {each.name: each.data for each in log.data_list if each.multi_id == 0}
    return topics, bool(log.file_corruption)


class _ExhaustedError(Exception):
    """Raised where pyulog reads far more than the file holds."""


class _BoundedBytes(io.BytesIO):
    """Bytes with a bound on reading, because pyulog reads some damaged files without end."""

    def __init__(self, content: bytes) -> None:
        super().__init__(content)
        self._reads, self._bytes = 3 * len(content) + 1000, 2 * len(content) + 10**9

    def read(self, size: int | None = -1, /) -> bytes:
        content = super().read(size)
        self._reads -= 1
        self._bytes -= len(content)
        if min(self._reads, self._bytes) < 0:
            raise _ExhaustedError
        return content


def _require_small(formats: Mapping[str, Any], name: str) -> None:
    """Raise an `InputError` for a message of too many fields, before pyulog creates them."""
    counts: dict[str, int] = {}

    def fields_of(message: str) -> int:
        if message not in counts:
            counts[message] = MAX_FIELDS + 1  # for a message that contains itself
            counts[message] = min(
                sum(
                    max(1, size) * (fields_of(kind) if kind in formats else 1)
                    for kind, size, _ in formats[message].fields
                ),
                MAX_FIELDS + 1,
            )
        return counts[message]

    for message in formats:
        if fields_of(message) > MAX_FIELDS:
            raise InputError(
                f"{name}: expected at most {MAX_FIELDS} fields in a message, got more in "
                f"{message[:40]!r}"
            )


def _series(
    sources: Sequence[_TopicFields], topics: Mapping[str, Mapping[str, Array]], name: str
) -> Iterator[_Series]:
    """Yield the numbers of a quantity from each of its sources, without rows that are not known."""
    for source in sources:
        data = topics.get(source.topic, {})
        clock = next((key for key in _TIMES if key in data and np.all(data[key] > 0)), None)
        if clock is None or not set(source.fields) <= set(data):
            continue
        valid = _valid(source, data)
        numbers = np.stack([data[field] for field in source.fields], axis=-1).astype(float)
        valid &= np.isfinite(numbers).all(axis=-1)
        times, numbers = data[clock].astype(float)[valid], numbers[valid]
        if np.any(back := np.diff(times) < 0):
            where = times[1:][back][0] / 1e6
            raise InputError(f"{name}: the time of {source.topic} goes back to {where:.6f} s")
        first = np.concatenate([[True], np.diff(times) > 0]) if len(times) else np.empty(0, bool)
        if first.sum() > 1:
            yield _Series(source, f"{source.topic}.{clock}", times[first], numbers[first])


def _valid(source: _TopicFields, data: Mapping[str, Array]) -> Array:
    """Mark the rows that PX4 flags as valid, in an accepted frame."""
    rows = np.ones(len(data[source.fields[0]]), bool)
    for flag in source.flags:
        rows &= data.get(flag, rows).astype(bool)
    if source.frame:
        frame = data.get(source.frame, np.zeros(len(rows)))  # older versions have other numbers
        rows &= np.isin(frame, _FRAMES) & (data.get("pose_frame", frame) == frame)
    return rows


def _covers(series: _Series, times: Array) -> Array:
    """Mark the times inside the series and outside its gaps."""
    known = series.times
    inside = (known[0] <= times) & (times <= known[-1])
    after = np.clip(np.searchsorted(known, times), 1, len(known) - 1)
    step = known[after] - known[after - 1]
    close = (step <= GAP * np.median(np.diff(known))) | (known[after] == times)
    return inside & (close | (known[after - 1] == times))


def _interpolated(times: Array, series: _Series, is_attitude: bool) -> Array:
    """Return the numbers of a topic at some times."""
    if not is_attitude:
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
    """Return the latest numbers of a topic at some times; NaN before the first."""
    row = np.searchsorted(series.times, times, side="right") - 1
    return np.where(row[:, None] >= 0, series.numbers[row], np.nan)
