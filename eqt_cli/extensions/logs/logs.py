"""Reads logs of other programs as series, and measures errors of tracking."""

import io
import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, get_args

import numpy as np

from eqt_cli.base import yaml_source
from eqt_cli.base.arrays import Array, apply_matrix, norm, transpose
from eqt_cli.base.errors import EqtError, InputError, printable
from eqt_cli.base.files import CONFIG_MARK, TooLargeError, content_of, open_regular, text_of
from eqt_cli.base.reporting import Block, TextTable, significant
from eqt_cli.components import matrix_groups, pose_tables
from eqt_cli.components.matrix_groups import EuclideanGroup
from eqt_cli.components.pose_tables import LogMapping
from eqt_cli.engines.compiler import Limits, run_contained
from eqt_cli.extensions.logs import frames, log_table, readers, recording_check
from eqt_cli.extensions.logs.delay import LEAST_ERROR, Delay, Pair, apart, delay_of
from eqt_cli.extensions.logs.first_bytes import format_of
from eqt_cli.extensions.logs.log_table import LogTable, open_sheet, with_units
from eqt_cli.extensions.logs.readers import Topic
from eqt_cli.extensions.logs.recording import GAP, WRENCH, Log, in_span

# Reads a file of another program, in a process with limits ----------------------------------------


MAX_BYTES = 400_000_000  # of a file; its table has a bound of its own
HEAD = 20_000  # characters of a table that have its header
SMALLER = "log fewer topics, or a part of the flight"  # advice for a larger file
# What a file may take of the processor, at first and with its size; bags take 0.2 s per MB.
SECONDS, BYTES_PER_SECOND = 6.0, 1e6
PATIENCE = 30  # times as long by the clock, on a busy machine
MEMORY, RATIO = 10**9, 8

_START = "import os, runpy, sys; os.environ['OPENBLAS_NUM_THREADS'] = '1'; del sys.argv[0]; "
_START += "runpy.run_path(sys.argv[0], run_name='__main__')"

# Names of topics of ROS that hold a setpoint
_SETPOINTS = re.compile(r"(?i)setpoint|reference|desired|command|target|\bcmd_")
_CORRECTION = re.compile(r" .*\.(odom|map)$")  # a pair of frames of which none is a body
_FRAMES = 1, 2  # accepted ones of PX4's odometry: NED, and a fixed FRD of arbitrary heading
_STATES, _POSES = ("armed", "mode", "reset"), ("position", "attitude")
SAME_CLOCK = 1.0  # largest distance of the first stamp from its record, if of one clock, s
NEAREST = 0.01  # largest distance in time of what is associated by the nearest time, s


class Source(NamedTuple):
    """A row of the table of a format in ``formats.yaml``."""

    quantity: str
    kind: str
    fields: str
    unit: str = ""
    valid: str = ""


class Series(NamedTuple):
    """Numbers of a topic over their own time.

    Attributes
    ----------
    topic
        The topic, or its file.
    times : (n,)
        Rising times, s.
    numbers : (n, k)
        In m, m/s, rad/s; an attitude is a quaternion w, x, y, z. Positions and velocities are in
        space, rates in the body. NaN in the axes that a setpoint does not control.
    fields, unit
        The names of the numbers in the file, and their unit.
    rows
        All rows of the topic in the order of the file, usable or not: times, numbers, and whether
        the file itself calls them valid.
    left_out, is_odd
        Rows that are not used, in words, and whether these are too many.
    axes
        NED of autopilots, ENU of ROS, or empty for a table.
    """

    topic: str
    times: Array
    numbers: Array
    fields: Sequence[str] = ()
    unit: str = ""
    rows: Sequence[Array] = ()
    left_out: str = ""
    is_odd: bool = False
    axes: str = ""

    def at(self, t: Array, how: str = "linear", edges: Array | tuple[()] = ()) -> Array:
        """Return the numbers at some times; NaN outside, in gaps, and across edges.

        Parameters
        ----------
        how
            ``linear``: attitudes along the shortest rotation; ``nearest``, at most `NEAREST` away;
            ``held``: the last ones.
        edges
            Times at which something changes, so that nothing is taken from the other side.
        """
        times, numbers = self.times, self.numbers
        after = np.clip(np.searchsorted(times, t), 1, max(len(times) - 1, 1))
        before = after - 1
        if how == "held":
            before = after = np.searchsorted(times, t, side="right") - 1
            values, valid = numbers[before], before >= 0
        elif how == "nearest":
            near = t - times[before] <= times[after] - t
            before = after = np.where(near, before, after)
            values, valid = numbers[before], abs(times[before] - t) <= NEAREST
        else:
            share, step = (t - times[before]) / (times[after] - times[before]), np.diff(times)
            valid = (share >= 0) & (share <= 1) & (step[before] <= GAP * np.median(step))
            values = numbers[before] + share[:, None] * (numbers[after] - numbers[before])
            if numbers.shape[1] == 4:
                from scipy.spatial.transform import Rotation, Slerp  # slow to import

                turn = Slerp(times, Rotation.from_quat(numbers, scalar_first=True))
                values = turn(np.clip(t, *times[[0, -1]])).as_quat(scalar_first=True)
        span = [np.searchsorted(edges, x, side="right") for x in (t, times[before], times[after])]
        valid &= (span[0] == span[1]) & (span[0] == span[2])
        return np.where(valid[:, None], values, np.nan)


def left_out(table: LogTable) -> str:
    """Say how many rows of a table are left out, and why."""
    kinds = ", ".join(f"{len(lines)} {kind}" for kind, lines in table.dropped.items())
    count = sum(map(len, table.dropped.values()))
    return f"{count} of {len(table) + count} rows are left out ({kinds})" if count else ""


class Flight(NamedTuple):
    """A file of another program.

    Attributes
    ----------
    name, format
        The file and its format.
    topics
        Its topics over their own times.
    mapping
        Its `time` and `drop` say which rows count.
    by_names
        Whether the name of a topic of ROS tells setpoints from measurements.
    """

    name: str
    format: str
    topics: list[Topic]
    mapping: LogMapping = LogMapping()
    by_names: bool = True

    def series(self, quantity: str, whole: bool = True) -> Iterator[Series]:
        """Yield what the file has of a quantity: first what its table names first.

        Parameters
        ----------
        whole
            Whether all numbers of a row must be known.
        """
        bodies = [candidate for candidate in self.topics if not _CORRECTION.search(candidate.name)]
        for source in sources_of(self.format):
            for topic in (
                candidate for candidate in bodies or self.topics if candidate.kind == source.kind
            ):
                named = self.by_names and "/" in topic.kind and _SETPOINTS.search(topic.name)
                fits = quantity == source.quantity + (" setpoint" if named else "")
                if fits and {*source.fields.split()} <= {*topic.fields}:
                    series = self._of(source, topic, whole)
                    if series is not None and source.valid == "unsure" and not named:
                        series = self._in_one_frame(quantity, series)
                    if series is not None:
                        yield series

    def _in_one_frame(self, quantity: str, twist: Series) -> Series | None:
        """Return a twist by the poses; without them, one of the body has no velocity in space."""
        poses = [next((x for x in self.series(q) if not x.is_odd), None) for q in _POSES]
        if None not in poses and not twist.is_odd:
            return frames.of_twist(quantity, twist, *poses)
        return None if quantity == "velocity" and "body" in twist.topic else twist

    @np.errstate(all="ignore")  # numbers that are not finite are left out
    def _of(self, source: Source, topic: Topic, whole: bool) -> Series | None:
        times, drop = times_of(topic, self.mapping.columns), self.mapping.drop
        names, unit = source.fields.split(), source.unit
        if not len(times):
            return None
        numbers = np.stack([topic.fields[name] for name in names], axis=-1)
        if unit.startswith("deg"):
            numbers, unit = np.deg2rad(numbers), unit.replace("deg", "rad")
        is_known = (np.all if whole else np.any)(np.isfinite(numbers), axis=1)
        # Autopilots write NaN for what they do not know, and a setpoint may leave axes free
        is_measured = "/" in topic.kind and whole
        valid = np.ones(len(times), bool) if is_measured else is_known
        flags = [topic.fields[name] for name in source.valid.split() if name in topic.fields]
        for flag in flags:
            is_frame = source.valid.endswith("_frame")
            valid &= np.isin(flag, _FRAMES) & (flag == flags[0]) if is_frame else flag.astype(bool)
        if source.valid == "body":
            rows = sources_of(self.format)
            turned = (s for s in rows if s.quantity == "attitude" and s.kind == source.kind)
            poses = self._of(next(turned), topic, True)
            R = np.full((3, 3), np.nan)
            if poses is not None and len(poses.times) > 1:
                R = matrices(poses.at(times))
            numbers = apply_matrix(R, numbers)
            valid &= np.isfinite(numbers).all(axis=1) | ~is_known
        if source.quantity.startswith("attitude") and unit:  # roll, pitch, yaw
            R, unit = matrix_groups.rotation_of_euler("ZYX", np.nan_to_num(numbers)[:, ::-1]), ""
            numbers = np.where(is_known[:, None], quaternions(R), np.nan)
        valid &= in_span(self.mapping.time, times)
        names_of = pose_tables.QUATERNION if is_measured or numbers.shape[1] == 4 else ()
        columns = {"t": times} | dict(zip(names_of, numbers.T, strict=False))
        table = LogTable(topic.name, columns, range(len(times))).part(valid).free_of(drop)
        sound = table.free_of(get_args(pose_tables.Dropped))
        is_unset = not len(sound) and not np.nan_to_num(numbers[valid]).any()
        if is_unset or len(table) <= (source.quantity not in _STATES):  # a motion needs two rows
            return None
        first = np.array(sound.lines, int)
        fields = [f"{topic.name}.{name}" for name in names]
        is_odd = len(table) - len(sound) > log_table.MOST_ODD * len(table)
        axes = "ENU" if "/" in topic.kind else "NED"
        facts = (times, numbers, valid), left_out(sound), is_odd, axes
        return Series(topic.name, times[first], numbers[first], fields, unit, *facts)


def times_of(topic: Topic, columns: Mapping[str, str] | None = None) -> Array:
    """Return the times of a topic, s: its stamps, or the recorder's.

    These are taken where a mapping says so, and where too few stamps move on.
    """
    times, recorded = topic.times / 1e9, topic.fields.get("recorded", np.empty(0))
    are_stale = np.mean(np.diff(times) <= 0) > log_table.MOST_ODD if len(times) > 1 else False
    is_near = len(recorded) and abs(recorded[0] - times[0]) < SAME_CLOCK
    is_chosen = columns and columns.get("t") == f"{topic.name} recorded"
    return recorded if len(recorded) and (is_chosen or (are_stale and is_near)) else times


@lru_cache(maxsize=1)
def formats() -> dict[str, Any]:
    """Return the tables of all formats."""
    path = Path(__file__).with_name("formats.yaml")
    return dict(yaml_source.load(path.read_text(encoding="utf-8"), path.name).data)


def sources_of(format: str) -> list[Source]:
    """Return the table of a format; bags have messages of PX4, too."""
    kinds = ["bag", "ulog"] if format == "bag" else [format]
    return [Source(*row) for kind in kinds for row in formats()[kind]["sources"]]


def matrices(numbers: Array) -> Array:
    """Return the rotations of quaternions w, x, y, z, ``(n, 4) -> (n, 3, 3)``."""
    q = np.roll(numbers, -1, axis=-1) / norm(numbers)[:, None]
    return matrix_groups.rotation_of_quaternion(q)


def quaternions(R: Array) -> Array:
    """Return the quaternions w, x, y, z of rotations, ``(n, 3, 3) -> (n, 4)``."""
    from scipy.spatial.transform import Rotation  # slow to import

    return Rotation.from_matrix(R).as_quat(scalar_first=True)


def flight_of(path: Path) -> Flight:
    """Read a file of another program, in a process with limits.

    Raises
    ------
    InputError
        If it cannot be read within these, or is no such file.
    EqtError
        If the package that reads it is not installed.
    """
    format = format_of(path)
    title, package, extra = (formats()[format][key] for key in ("title", "package", "extra"))
    if find_spec(package) is None:
        get = f"(extra {extra}); install it with: pip install {package}"
        raise EqtError(f"{path}: {title} needs {package} {get}")
    wanted: dict[str, list[str]] = {}
    for source in sources_of(format):
        wanted.setdefault(source.kind, []).extend(f"{source.fields} {source.valid}".split())
    size, beside = 0, [Path(f"{path}-wal")]  # which SQLite has after a power cut
    files = path.iterdir() if path.is_dir() else [path, *beside]
    for file in filter(Path.is_file, files):
        with open_regular(file) as stream:
            size += stream.seek(0, io.SEEK_END)
    if size > MAX_BYTES:
        raise TooLargeError(MAX_BYTES, size)
    seconds = SECONDS + size / BYTES_PER_SECOND
    limits = Limits(PATIENCE * seconds, MEMORY + RATIO * size, 2**28 + RATIO * size)
    words = [sys.executable, "-I", "-c", _START, readers.__file__, str(path.absolute()), format]
    request = json.dumps([wanted, formats()["px4_msgs"]]).encode()
    try:
        done = run_contained([*words, f"{seconds}"], request, limits)
    except subprocess.TimeoutExpired:
        slow = f"was not read within {limits.seconds:.0f} s, perhaps because the machine is busy"
        raise InputError(f"{path}: {slow}; try again") from None
    if -done.returncode == getattr(signal, "SIGXCPU", None):
        many = f"takes more than {seconds:.0f} s of the processor to be read, too many for its size"
        raise InputError(f"{path}: {many}; {SMALLER}")
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip()[-300:]
        why = f"{printable(said) or 'too large'}{formats()[format]['remedy']}"
        raise InputError(f"{path}: cannot be read as {title}: {why}")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as arrays:
        topics = []
        for k, (*facts, note, names, more) in enumerate(json.loads(arrays["head"].tobytes())):
            fields = {column: arrays[f"{k},{j}"] for j, column in enumerate(names)}
            rest: Any = arrays[f"{k}"], fields, note, more
            topics.append(Topic(*facts, *rest))
    return Flight(str(path), format, topics)


def flight_of_table(text: str, name: str) -> Flight | None:
    """Return the rates and their setpoints in a table of Betaflight; None for another table."""
    if "gyroADC" not in text[:HEAD]:
        return None
    sheet = open_sheet(text, name, "csv", LogMapping())
    used = [field for source in sources_of("blackbox") for field in source.fields.split()]
    if not {"t", *used} <= {*sheet.names}:
        return None
    table = with_units(sheet, LogMapping(drop=["invalid"]), ["t", *used]).table(["t", *used])
    times = np.round(1e9 * (table.columns["t"] + table.since)).astype(int)
    topics = [Topic(name, "blackbox", len(table), times, table.columns)]
    settings = [(0.0, key, value) for key, value in betaflight_settings(Path(name)).items()]
    topics += [Topic("", "", 0, np.empty(0, int), {}, "", settings)] if settings else []
    return Flight(name, "blackbox", topics)


RAW, LOG = (".bbl", ".bfl", ".txt"), b"H Product:Blackbox"
"""Suffixes of raw logs of Betaflight, and how a log in such a file begins."""

OTHER_LINES = re.compile(r"Field |Data version|Log start|[IP] interval|Device UID|Board info")
"""Lines of their heads that are no settings."""


def _numbered(table: Path) -> tuple[str, str]:
    """Return the stem of the raw log of a table, and its number there."""
    name = re.fullmatch(r"(.+?)(?:\.(\d\d))?", table.stem)
    return (name[1], name[2] or "1") if name else (table.stem, "1")


def raw_logs(table: Path) -> list[Path]:
    """Return the raw logs beside a table, of which blackbox_decode may have written it."""
    stem = _numbered(table)[0]
    beside = (table.with_name(stem + x) for suffix in RAW for x in (suffix.upper(), suffix))
    return [path for path in beside if path.is_file()]


def betaflight_settings(table: Path) -> dict[str, str]:
    """Return gains and other settings of the raw log from which blackbox_decode wrote a table.

    Of ``LOG00001.02.csv``, the raw log is the second one in ``LOG00001.BBL`` of the same folder.
    """
    number = int(_numbered(table)[1])
    for raw in raw_logs(table):
        logs = content_of(raw, MAX_BYTES).split(LOG)
        if 0 < number < len(logs):
            lines = re.match(rb"[^\n]*\n((?:H [^\n]*\n)*)", logs[number])
            head = lines[1].decode("latin-1").splitlines() if lines else []
            pairs = (line[2:].partition(":") for line in head)
            return {
                "release" if key == "Firmware revision" else key: value.strip()
                for key, _, value in pairs
                if not OTHER_LINES.match(key)
            }
    return {}


# The table of a flight, which results keep --------------------------------------------------------


CHUNK = 20_000  # rows to write at once, because rows as Python numbers take 10 times the memory

# eqt's columns of a quantity; a torque and a force hold until the next
COLUMNS = {"position": "x y z", "attitude": "qw qx qy qz", "velocity": "vx vy vz"}
COLUMNS |= {"rates": "wx wy wz", "torque": "tx ty tz", "force": "fx fy fz"}


def text_of_recording(path: Path, missing: str, kind: type[EqtError], limit: int) -> str:
    """Return a file of another program as the text of a table.

    Raises
    ------
    EqtError
        Of this kind, as by `eqt_cli.base.files.text_of`; an `InputError` for a file that cannot
        be read.
    """

    def read(path: Path, limit: int) -> str:
        table = table_of(flight_of(path))
        if len(table) > limit:
            raise TooLargeError(limit, len(table))
        return table

    return text_of(path, missing, kind, limit=limit, smaller=SMALLER, read=read)


def table_of(flight: Flight) -> str:
    """Return the table of a flight: eqt's columns, and what other topics have of the same.

    There is a row at each time of the position, or of the attitude in a file without positions.
    Attitudes are interpolated along the shortest rotation, positions, velocities and rates
    linearly; commands are held. Where another topic has a gap, there is no row.

    Raises
    ------
    InputError
        If it holds neither attitudes nor positions.
    """
    series_by_name = {name: list(flight.series(name)) for name in COLUMNS}
    lead = _lead(flight, [*series_by_name["position"], *series_by_name["attitude"]])
    if lead is None:
        return table_of(flight._replace(by_names=False))
    if not series_by_name["position"]:
        series_by_name["velocity"] = []
    # Odd rows of the topic that leads stay, so that a mapping or the user decides on them.
    rows: Array = lead.rows[2]
    times, is_complete = lead.rows[0][rows], rows[rows]
    headings, columns = ["t (s)"], [times]
    for name, every in series_by_name.items():
        used = [one for one in every if one.topic == lead.topic or not one.is_odd]
        # The same topic first, and PX4's axes, which are not those of ROS, last
        used.sort(key=lambda one: (one.axes != lead.axes, one.topic != lead.topic))
        for k, series in enumerate(used):
            is_first = not k and series.axes == lead.axes and series.unit != "normalised"
            names = COLUMNS[name].split() if is_first else series.fields
            headings += [f"{column} ({series.unit})" if series.unit else column for column in names]
            numbers, is_valid = _at_rows(series, lead, "held" if name in WRENCH else "linear")
            columns += [*numbers.T]
            if is_first and name not in WRENCH:
                is_complete = is_complete & is_valid
    for topic in (candidate for candidate in flight.topics if candidate.name == lead.topic):
        if len(recorded := topic.fields.get("recorded", ())) == len(rows):
            headings.append(f"{lead.topic} recorded (s)")  # where the header has another time
            columns.append(recorded[rows])
    table = np.stack(columns, axis=-1)[is_complete]
    if not len(table):
        names = [name for name, every in series_by_name.items() if every and name not in WRENCH]
        raise InputError(f"{flight.name}: {', '.join(names)} were recorded at no common time")
    damaged = any(candidate.kind == "damaged" for candidate in flight.topics)
    parts = [log_table.DAMAGED if damaged else log_table.CONVERTED, "\n", ",".join(headings), "\n"]
    row_format = ",".join("%.9f" if x.endswith("(s)") else "%r" for x in headings) + "\n"
    for first in range(0, len(table), CHUNK):
        rows = table[first : first + CHUNK].tolist()
        parts.append("".join(row_format % tuple(row) for row in rows))
    return "".join(parts)


def _at_rows(series: Series, lead: Series, how: str) -> tuple[Array, Array]:
    """Return the numbers of a series at the rows of another one, and where they are valid."""
    rows = lead.rows[2]
    if series.topic == lead.topic and len(series.rows[0]) == len(rows):
        return series.rows[1][rows], series.rows[2][rows]
    numbers = series.at(lead.rows[0][rows], how)
    return numbers, np.asarray(np.isfinite(numbers).all(axis=1))


def _lead(flight: Flight, poses: list[Series]) -> Series | None:
    """Return the first poses that are usable; None where only topics named as setpoints are left.

    Raises
    ------
    InputError
        If there are no poses at all.
    """
    if poses:
        return next((pose for pose in poses if not pose.is_odd), poses[0])
    if flight.by_names:
        return None
    kinds = dict.fromkeys(s.kind for s in sources_of(flight.format) if s.quantity in _POSES)
    why = "".join(f"; {topic.name}: {topic.note}" for topic in flight.topics if topic.note)
    raise InputError(f"{flight.name}: holds no poses; expected {' or '.join(kinds)}{why}")


# How far a vehicle was from its setpoints ---------------------------------------------------------


# Unit and rows of each quantity; tilt is the angle between the z axes of the bodies
QUANTITIES = {
    "position": ("m", ["all", "x", "y", "z"]),
    "velocity": ("m/s", ["all", "x", "y", "z"]),
    "attitude": ("deg", ["angle", "tilt", "heading"]),
    "rates": ("deg/s", ["all", "x", "y", "z"]),
}


class ErrorSize(NamedTuple):
    """The size of an error over the instants of the setpoint.

    Attributes
    ----------
    quantity, axis, unit
        ``position``, ``velocity``, ``attitude`` or ``rates``; ``all`` is the norm.
    rms, median, largest
        Of its absolute value.
    delay, delay_error, remains
        The time by which the measurement is later than the setpoint, its standard error, s, and the
        rms without it; NaN where it is not significant. Of all axes only.
    remark
        What else explains the errors: another frame, or a clock that is fast or slow.
    """

    quantity: str
    axis: str
    unit: str
    rms: float
    median: float
    largest: float
    delay: float
    delay_error: float
    remains: float
    remark: str = ""


class TrackingErrors(NamedTuple):
    """How far a vehicle was from its setpoints, while armed.

    Attributes
    ----------
    sizes
        The size of each error.
    curves
        Times ``(n,)`` and errors ``(n, k)`` of all axes by quantity, in its unit.
    topics
        The two sides of the comparison, by quantity.
    notes
        The times of both, and what else was noticed.
    remarks
        Odd rows that were not used, and the drift over metres of path.
    goals, actual
        The setpoints that count, and the measurements between begin and end, by the quantity.
    flight
        All topics of a log.
    """

    sizes: list[ErrorSize]
    curves: dict[str, tuple[Array, Array]]
    topics: dict[str, str]
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    goals: Mapping[str, Series] = MappingProxyType({})
    actual: Mapping[str, Series] = MappingProxyType({})
    flight: Flight | None = None

    @property
    def headline(self) -> str:
        """The answer in one line."""
        size = self.sizes[0]
        by, unit = (1e3, "mm") if size.unit == "m" and size.rms < 0.1 else (1.0, size.unit)
        rms, most, rest = (f"{by * x:.3g} {unit}" for x in (size.rms, size.largest, size.remains))
        headline = f"{size.quantity} error {rms} rms, at most {most}"
        if not np.isnan(size.delay):
            shift = f"{abs(size.delay):.3g} ± {size.delay_error:.1g} s"
            cause = "delay" if size.delay > 0 else "lead"
            headline += f", of which a {cause} of {shift} explains all but {rest}"
        headline += f" ({size.remark})" if size.remark else ""
        return "; ".join([headline, *self.remarks])


def motions_of(log: Log) -> dict[str, Series]:
    """Return the series of a recording of positions or rotations in space, by its own clock."""
    one = recording_check.recording_of(log)
    G, V, name = one.group, one.velocities, one.name
    if not isinstance(G, EuclideanGroup) or G.space != 3:
        raise EqtError(f"{name}: errors are of poses in space, not of {G.name}")
    R, numbers = G.rotation(one.poses), dict[str, Array]()
    if G.rotations:
        numbers = {"attitude": quaternions(R), "rates": V[:, :3]}
    if G.columns:
        numbers["position"] = G.translations(one.poses)[..., 0]
        numbers["velocity"] = apply_matrix(R, V[:, -3:])
    finite = {name: values for name, values in numbers.items() if np.isfinite(values).all()}
    times, odd = own_times(log), left_out(log.table)
    heading = dict(zip(log.sheet.names, log.sheet.headings, strict=True))
    named = {"attitude": log.columns.names[: -3 * bool(G.columns) or None]}
    named |= {q: COLUMNS[q].split() for q in ("position", "velocity", "rates")}
    return {
        q: Series(name, times, values, [heading[x] for x in named[q] if x in heading], left_out=odd)
        for q, values in finite.items()
    }


def own_times(log: Log) -> Array:
    """Return the times of a log by the clock of its file, s; some formats count from a row."""
    time, table = log.mapping.time, log.table
    if time.offset == "first":
        return log.times
    return (table.since + table.columns["t"]) * time.scale + (time.offset or 0.0)


def spans_of(flight: Flight, disarmed: bool = False) -> tuple[Array, Array]:
    """Return the times of changes of mode, arming and estimator, and whether each span counts.

    Raises
    ------
    InputError
        If the vehicle was never armed, and disarmed times do not count.
    """
    changes, armed = [np.empty(0)], list(flight.series("armed"))[:1]
    for one in (*flight.series("mode"), *flight.series("reset"), *armed):
        changed = np.any(np.diff(one.numbers, axis=0, prepend=np.nan) != 0, axis=1)
        changes.append(one.times[changed])
    edges = np.unique(np.concatenate(changes))
    starts = np.r_[-np.inf, edges]
    flying = [one.at(starts, "held")[:, 0] == float(one.unit) for one in armed[: not disarmed]]
    if flying and not flying[0].any():
        advice = "--disarmed compares disarmed times, too"
        raise InputError(f"{flight.name}: was never armed, by {armed[0].topic}; {advice}")
    return edges, flying[0] if flying else np.ones(len(starts), bool)


def difference(quantity: str, measured: Array, wanted: Array) -> Array:
    """Return errors in the rows and the unit of `QUANTITIES`; of attitudes, angles of R_dᵀR."""
    if quantity != "attitude":
        errors = np.rad2deg(measured - wanted) if quantity == "rates" else measured - wanted
        whole = np.where(np.isnan(errors).all(axis=1), np.nan, norm(np.nan_to_num(errors)))
        return np.column_stack([whole, errors])
    R, goal = matrices(measured), matrices(wanted)
    apart = quaternions(transpose(goal) @ R)
    tilt = 2 * np.arcsin(np.minimum(norm(R[:, :, 2] - goal[:, :, 2]) / 2, 1.0))
    heading = np.subtract(*(np.arctan2(Q[:, 1, 0], Q[:, 0, 0]) for Q in (R, goal)))
    angle = 2 * np.arctan2(norm(apart[:, 1:]), abs(apart[:, 0]))
    return np.rad2deg(np.stack([angle, tilt, (heading + np.pi) % (2 * np.pi) - np.pi], axis=-1))


def paired(
    actual: Series, wanted: Series, spans: tuple[Array, Array], how: str, window: Sequence[float]
) -> Pair:
    """Return both series: the one nearer to its chords is interpolated, the longer one searched."""

    def roughness(one: Series) -> float:
        """The median distance of every second row from the chord of its neighbours."""
        if len(one.times) < 4:
            return np.inf
        chord = one._replace(times=one.times[::2], numbers=one.numbers[::2]).at(one.times[1:-1:2])
        return float(np.median(norm(np.nan_to_num(apart(one.numbers[1:-1:2], chord)))))

    base, other, side = wanted, actual, 1
    is_shorter = len(actual.times) <= len(wanted.times)
    if (
        is_shorter
        if how == "nearest"
        else how == "linear" and roughness(actual) > roughness(wanted)
    ):
        base, other, side = actual, wanted, -1
    begin, end = window[0] - LEAST_ERROR, window[1] + LEAST_ERROR
    inside = (begin <= base.times) & (base.times <= end)
    base = base._replace(times=base.times[inside], numbers=base.numbers[inside])
    return Pair(base, other, side, *spans)


def _frame(
    position: list[Array], turned: list[Series], align: str, how: str
) -> tuple[float, Array, Array]:
    """Return c, R and p that move the measured positions to the wanted ones."""
    t, x, y = position
    if align != "origin":  # for which c R x + p is nearest to y (Umeyama 1991)
        x0, y0 = x.mean(axis=0), y.mean(axis=0)
        C = (y - y0).T @ (x - x0) / len(x)
        if align == "yaw":  # about z, which gravity gives
            angle = np.arctan2(C[1, 0] - C[0, 1], C[0, 0] + C[1, 1])
            R = matrix_groups.rotation_of_euler("ZYX", np.array([angle, 0.0, 0.0]))
            return 1.0, R, y0 - R @ x0
        U, d, Vt = np.linalg.svd(C)
        if not d[1] > 1e-12 * d[0]:
            raise EqtError("align: the positions are on a line; use origin, or leave it out")
        signs = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
        R, c = (U * signs) @ Vt, 1.0
        if align == "similarity":
            c = float(d @ signs / np.mean(np.sum((x - x0) ** 2, axis=1)))
        return c, R, y0 - c * R @ x0
    R = np.eye(3)
    if turned:
        here, there = (matrices(one.at(t[:1], how))[0] for one in turned)
        R = there @ here.T
    return 1.0, R, y[0] - R @ x[0]


def moved(quantity: str, one: Series, c: float, R: Array, p: Array) -> Series:
    """Return a series in the frame of c R x + p."""
    if quantity == "attitude":
        return one._replace(numbers=quaternions(R @ matrices(one.numbers)))
    there = c * one.numbers @ R.T + p * (quantity == "position")
    return one if quantity == "rates" else one._replace(numbers=there)


def _relative(
    name: str, position: list[Array], turned: list[Series], how: str, over: tuple[float, str]
) -> tuple[dict[str, tuple[Array, Array]], list[str]]:
    """Return the errors E = (Q_d⁻¹ Q_d')⁻¹ Q⁻¹Q' over instants or metres of path, and remarks."""
    t, *places = position
    steps = norm(np.diff(places[1], axis=0)) if over[1] else np.ones(len(t) - 1)
    passed, rows, lengths = 0.0, [0], list[float]()
    for row, step in enumerate(steps.tolist(), start=1):
        passed += step
        if passed >= over[0]:
            rows, lengths, passed = [*rows, row], [*lengths, passed], 0.0
    if not lengths:
        raise InputError(
            f"{name}: the desired path of {passed:.3g} m is shorter than {over[0]:g} m"
        )
    moves = []
    for k, place in enumerate(places):
        Q = np.tile(np.eye(4), (len(t), 1, 1))
        Q[:, :3, 3] = place
        if turned:
            Q[:, :3, :3] = matrices(turned[k].at(t, how))
        moves.append(np.linalg.solve(Q[rows[:-1]], Q[rows[1:]]))
    E, t = np.linalg.solve(moves[1], moves[0]), t[rows[1:]]
    none = np.tile([1.0, 0, 0, 0], (len(t), 1))
    errors = {"position": (t, difference("position", E[:, :3, 3], 0 * none[:, 1:]))}
    if turned:
        errors["attitude"] = t, difference("attitude", quaternions(E[:, :3, :3]), none)
    share = float(np.mean(norm(E[:, :3, 3]) / lengths))
    drift = f"on average {100 * share:.4g} % of the path, in {len(lengths)} parts"
    return errors, ([drift] if over[1] else [])


NO_SPANS = np.empty(0), np.ones(1, bool)


def tracking_errors(
    name: str,
    actual: dict[str, Series],
    wanted: dict[str, Series],
    spans: tuple[Array, Array] = NO_SPANS,
    association: str = "linear",
    align: str | None = None,
    relative: tuple[float, str] | None = None,
    window: Sequence[float] = (-np.inf, np.inf),
    delays: bool = True,
) -> TrackingErrors:
    """Compare known series with wanted ones, at the instants of the rougher ones in a window.

    Without `delays`, none is estimated, which takes most of the time.

    Raises
    ------
    InputError
        If they have no quantity in common, or no time.
    """

    def pair(q: str) -> Pair:
        return paired(actual[q], wanted[q], spans, association, window)

    def attitudes() -> list[Series]:
        return [actual["attitude"], wanted["attitude"]] if "attitude" in shared else []

    shared = [q for q in QUANTITIES if q in actual and q in wanted]
    pairs = [(actual[q], wanted[q]) for q in shared]
    times = _require_comparable(name, pairs)
    odd = {f"{x.topic}: {x.left_out}": 0 for pair in pairs for x in pair if x.left_out}
    if (align or relative) and "position" not in shared:
        raise EqtError(f"{name}: align and relative need positions, measured and wanted")
    if align:
        position = enough(name, pair("position").rows(0.0, association), 1)
        frame = _frame(position, attitudes(), align, association)
        actual = {q: moved(q, series, *frame) for q, series in actual.items()}
    drift = list[str]()
    if relative:
        least = 2 if relative[1] else 1 + int(relative[0])
        position = enough(name, pair("position").rows(0.0, association), least)
        curves, drift = _relative(name, position, attitudes(), association, relative)
    else:
        rows = {q: pair(q).rows(0.0, association) for q in shared}
        curves = {q: (t, difference(q, *two)) for q, (t, *two) in rows.items() if len(t)}
    if not curves:
        raise InputError(f"{name}: {_nothing_left(actual, wanted, times)}")
    sizes: list[ErrorSize] = []
    body = dict(zip(["position"], attitudes(), strict=False))
    for q, (_, errors) in curves.items():
        sizes += _sizes(q, errors, pair(q) if delays and not relative else None, body.get(q))
    if not sizes:
        raise InputError(f"{name}: an attitude is missing wherever there are positions")
    topics = {q: f"{actual[q].topic} − {wanted[q].topic}" for q in curves}
    goals = {q: _within(wanted[q], window, spans) for q in curves}
    within = {q: _within(one, window) for q, one in actual.items()}
    notes = (f"times: {times}, by one clock",)
    return TrackingErrors(sizes, curves, topics, notes, (*drift, *odd), goals, within)


def _within(one: Series, window: Sequence[float], spans: tuple[Array, Array] = NO_SPANS) -> Series:
    """Return a series between two times, and where spans count."""
    (edges, counts), t = spans, one.times
    inside = counts[np.searchsorted(edges, t, "right")] & (window[0] <= t) & (t <= window[1])
    return one._replace(times=t[inside], numbers=one.numbers[inside])


def _require_comparable(name: str, pairs: list[tuple[Series, Series]]) -> str:
    """Return the times of the first of some pairs, in words; refuse odd rows and other axes."""
    for one in (x for pair in pairs for x in pair if x.is_odd):
        said = one.left_out.replace("are left out", "are odd")
        advice = "leave them out by a mapping, `drop: [invalid, repeated, unordered]`"
        raise InputError(f"{name}: {one.topic}: {said}; {advice}, or name another topic")
    for pair in (pair for pair in pairs if {x.axes for x in pair} == {"NED", "ENU"}):
        axes = " and ".join(f"{x.topic} ({x.axes})" for x in pair)
        advice = "`{world: ENU to NED, body: FLU to FRD}` in a mapping turns what ROS has"
        raise InputError(f"{name}: the axes of {axes} differ; {advice}, or name other topics")
    begins, ends = ([[x.times[k] for x in pair] for pair in pairs] for k in (0, -1))
    ends_of = ((x.topic, *x.times[[0, -1]]) for pair in pairs[:1] for x in pair)
    times = " and ".join(f"{topic} from {a:.13g} to {b:.13g} s" for topic, a, b in ends_of)
    if pairs and all(max(b) > min(e) for b, e in zip(begins, ends, strict=True)):
        advice = "move the clock of one file by a mapping, `time: {offset: …}`"
        raise InputError(f"{name}: no common time: {times}; {advice}")
    return times


def _nothing_left(actual: dict[str, Series], wanted: dict[str, Series], times: str) -> str:
    if times:
        why = "setpoints that are not finite, and times outside begin and end (+5: from the start)"
        return f"no instant is left of {times}, without gaps, disarmed times, mode changes, {why}"
    measured, goal = (", ".join(names) or "none" for names in (actual, wanted))
    advice = "name the topic of the setpoints (--setpoint), or give a second file"
    return f"measured: {measured}; wanted: {goal}; {advice}"


def enough(name: str, position: list[Array], least: int) -> list[Array]:
    """Return times, measured and wanted positions; refuse fewer instants than are needed."""
    if (count := len(position[0])) < least:
        few = f"positions at {count} common instants; align and relative need {least}"
        raise InputError(f"{name}: {few}; eqt log check shows the times of a file")
    return position


def _sizes(
    quantity: str, errors: Array, pair: Pair | None, body: Series | None
) -> Iterator[ErrorSize]:
    """Yield the sizes of the errors of each axis that has any, the delay with the first."""
    unit, axes = QUANTITIES[quantity]
    late, remains = delay_of(pair, body) if pair else Delay(), np.nan
    if pair and np.isfinite(late.late[0]):
        left = difference(quantity, *pair.rows(late.shift)[1:])[:, 0]
        remains = float(np.sqrt(np.mean(left**2)))
    for axis, column in zip(axes, abs(errors).T, strict=True):
        if len(x := column[np.isfinite(column)]):
            rms, median, most = map(float, (np.sqrt(np.mean(x**2)), np.median(x), x.max()))
            numbers = rms, median, most, float(late.late[0]), float(late.errors[0]), remains
            yield ErrorSize(quantity, axis, unit, *numbers, late.remark)
        late, remains = Delay(), np.nan


def error_table(tracking: TrackingErrors) -> TextTable:
    """Return the table of the sizes of errors."""
    rows = []
    for one in tracking.sizes:
        *numbers, late, _, rest = (significant(x, 3) for x in one[3:-1])
        late += "" if np.isnan(one.delay) else f" ± {one.delay_error:.1g}"
        rows.append([*one[:3], *numbers, late, rest])
    header = ["error", "axis", "unit", "rms", "median", "largest", "delay, s", "remains"]
    notes = [f"{quantity}: {topics}." for quantity, topics in tracking.topics.items()]
    notes += [f"{note}." for note in tracking.notes]
    notes += [f"{one.quantity}: {one.remark}." for one in tracking.sizes[1:] if one.remark]
    return TextTable("errors", tracking.headline, header, [Block("", rows)], notes, keys=3)


def error_files(tracking: TrackingErrors, folder: Path) -> dict[Path, bytes]:
    """Return the errors over time, a CSV of each quantity by its path."""
    files = {}
    for quantity, (t, errors) in tracking.curves.items():
        unit, axes = QUANTITIES[quantity]
        names, stream = ["t (s)", *(f"{axis} ({unit})" for axis in axes)], io.BytesIO()
        head, rows = CONFIG_MARK.format("log") + ",".join(names), np.column_stack([t, errors])
        np.savetxt(stream, rows, fmt="%.17g", delimiter=",", header=head, comments="")
        files[folder / f"errors_{quantity}.csv"] = stream.getvalue()
    return files
