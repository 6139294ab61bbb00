"""Reads and checks recordings, and measures the tracking errors in them."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from eqt_cli.api.loading import path_from
from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtError, InputError, Problems
from eqt_cli.base.files import refusals, text_of
from eqt_cli.base.option_types import validated
from eqt_cli.base.units import factor
from eqt_cli.components import pose_tables
from eqt_cli.components.groups import MatrixLieGroup, group_named
from eqt_cli.components.pose_tables import LogMapping, MappingError, TrajectoryFormat
from eqt_cli.extensions.logs import frames, logs
from eqt_cli.extensions.logs.command_series import series_of_commands
from eqt_cli.extensions.logs.first_bytes import format_of
from eqt_cli.extensions.logs.log_check import LogCheck, check_text, largest_group, topics_of
from eqt_cli.extensions.logs.log_table import CONVERTED, open_sheet
from eqt_cli.extensions.logs.logs import Flight, Series, TrackingErrors, flight_of
from eqt_cli.extensions.logs.recording import read_log, recorded_names
from eqt_cli.extensions.logs.recording_check import Recording, recording_of
from eqt_cli.extensions.logs.setpoints import setpoints_of
from eqt_cli.extensions.logs.tables import text_of_recording, with_columns
from eqt_cli.extensions.logs.two_clocks import clocks_of
from eqt_cli.extensions.logs.unflown import flown_rows

MappingSource: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | None


def literal(kind: Any, option: str, text: str) -> Any:
    """Return a text that is one of a `Literal`'s, or raise an `InputError`."""
    if text not in get_args(kind):
        raise InputError(f"{option}: expected one of {', '.join(get_args(kind))}, got {text!r}")
    return text


def check_log(
    path: str | os.PathLike[str],
    mapping: MappingSource = None,
    *,
    format: str = "csv",
    group: str | None = None,
) -> LogCheck:
    r"""Read a recording and report its columns, units, times and irregularities.

    Parameters
    ----------
    path
        The recording; a file name that ends in ``.ulg`` is a PX4 flight log.
    mapping
        Information that the file does not contain (columns, units, frames, times), as a YAML file
        or a mapping with the keys of ``reference.mapping``.
    format
        ``csv`` with a header that names the columns, ``tum`` or ``euroc``.
    group
        Group of the poses. Default: the group that fits the columns.

    Returns
    -------
    LogCheck
        The report. Its ``problems`` are empty if the recording can be used as waypoints.

    Raises
    ------
    EqtError
        If the file does not exist or holds no poses.
    ConfigError
        If the mapping is wrong or does not fit the file, with the place of each problem.

    Examples
    --------
    >>> from pathlib import Path
    >>> rows = "stamp,yaw (deg),pitch,roll\n0,0,0,0\n10,1,0,0\n20,2,0,0\n"
    >>> _ = Path("flight.csv").write_text(rows)
    >>> check = eqt_cli.check_log("flight.csv", {"columns": {"t": "stamp"}, "units": {"t": "ms"}})
    >>> check.group, check.rate, check.notes
    ('SO3', 100.0, [])
    """
    G, flight = None if group is None else group_named(group), _flight(path)
    with _read(path, mapping, format, flight) as read:
        check = check_text(*read[:4], G)
        check.notes.extend([*read.remarks, *read.clocks()])
    more: Any = {"topics": [*topics_of(flight)], "format": flight.format} if flight else {}
    return replace(check, **more)


def read_measured(
    path: str | os.PathLike[str],
    G: MatrixLieGroup,
    mapping: MappingSource = None,
    format: str = "csv",
) -> Recording:
    """Read a recording as a motion on a group; arguments and errors as for `check_log`."""
    with _read(path, mapping, format) as read:
        return read.recording(G)


def driving(
    path: str | os.PathLike[str], G: MatrixLieGroup, mapping: MappingSource, format: str
) -> Recording:
    """Read a recording of a wrench; rates are enough for a rotation, and its poses then NaN."""
    rates, names = recorded_names(G, ["rates"]), pose_tables.pose_columns(G)
    with _read(path, mapping, format) as read:
        sheet = open_sheet(*read[:4])
        used, units = pose_tables.used_columns(sheet.names, G), sheet.units | read.mapping.units
        is_pose = used and (used.layout != "coordinates" or factor(units.get(rates[0], ""), "rad"))
        if is_pose or len(rates) < G.dimension or not {*rates} <= {*sheet.names}:
            return read.recording(G)
        rest = [0.0] * (len(names) - 1) + [float(len(names) > 1)]
        text = with_columns(read.text, ",".join(names), np.tile(rest, (len(sheet.lines), 1)))
        recording = read._replace(text=text).recording(G)
        return replace(recording, poses=np.full_like(recording.poses, np.nan))


def _flight(path: str | os.PathLike[str], mapping: MappingSource = None) -> Flight | None:
    """Return the topics of a file of another program; None for a table.

    Of a mapping, they obey `drop`, `time`, and `t` of `columns` if that is the recorder's time.
    """
    file = path_from("path", path)
    if not format_of(file):
        return None
    before, how = _before.get(), _mapping_from(mapping)[0]
    if before is not None and str(file) in before:
        return before[str(file)]._replace(mapping=how)
    with refusals(file, "read"):
        flight = flight_of(file)._replace(mapping=how)
    if before is not None:
        before[str(file)] = flight
    return flight


def _mapping_from(mapping: MappingSource) -> tuple[LogMapping, Problems]:
    """Return a mapping, and the problems that note their place in it."""
    if mapping is None:
        return LogMapping(), Problems()
    if isinstance(mapping, Mapping):
        source = yaml_source.load(yaml_source.flow(mapping), "mapping")
    else:
        place = path_from("mapping", mapping, "a path or a mapping")
        source = yaml_source.load(text_of(place, "check the path"), str(place))
    problems = Problems(source.key_place)
    columns = validated(LogMapping, source.data, problems) or LogMapping()
    columns.check(problems)
    problems.raise_if_any()
    return columns, problems


class Read(NamedTuple):
    """A recording as the text of a table, without rows that were not flown.

    Attributes
    ----------
    text, name, format, mapping
        The table, its file, its format, and how it is read.
    remarks
        The rows that were not flown, in words.
    """

    text: str
    name: str
    format: TrajectoryFormat
    mapping: LogMapping
    remarks: Sequence[str] = ()

    def recording(self, G: MatrixLieGroup) -> Recording:
        """Return the motion in the table."""
        one = recording_of(read_log(*self[:3], G, self.mapping))
        return replace(one, notes=(*self.remarks, *one.notes))

    def clocks(self) -> list[str]:
        """Say how far the clocks of two sources in the table differ."""
        if self.format != "csv" or self.text.startswith(CONVERTED):
            return []
        clocks = clocks_of(*self[:2], self.mapping)
        return [f"{clocks}"] if clocks else []

    def motions(self) -> dict[str, Series]:
        """Return the series of positions and rotations in the table."""
        return logs.motions_of(
            read_log(*self[:3], largest_group(*self[:4]), self.mapping, of_commands=False)
        )


_before: ContextVar[dict[Any, Any] | None] = ContextVar("_before", default=None)


@contextmanager
def reading_once() -> Iterator[None]:
    """Read no recording twice until the block ends."""
    if _before.get() is not None:
        yield
        return
    token = _before.set({})
    try:
        yield
    finally:
        _before.reset(token)


@contextmanager
def _read(
    path: str | os.PathLike[str], mapping: MappingSource, format: str, flight: Flight | None = None
) -> Iterator[Read]:
    """Yield a recording as a table; note a problem of the mapping at its place."""
    kind, file = literal(TrajectoryFormat, "format", format), path_from("path", path)
    columns, problems = _mapping_from(mapping)
    smaller = "cut it into parts, leave out columns, or keep every tenth row"
    before = _before.get()
    which = str(file), kind, repr(columns)
    try:
        if before is not None and which in before:
            yield before[which]
            return
        text = flight and logs.table_of(flight)
        text = text or text_of_recording(file, "check the path", EqtError, logs.MAX_BYTES, smaller)
        kind, remarks = _kind_of(text) if kind == "csv" else kind, list[str]()
        if kind == "csv" and not format_of(file):
            text, remarks = flown_rows(text, str(file), columns)
        read = Read(text, str(file), kind, columns, remarks)
        if before is not None:
            before[which] = read
        yield read
    except MappingError as error:
        problems.at(*error.path).add(str(error))
        problems.raise_if_any()
        raise


def _kind_of(text: str) -> TrajectoryFormat:
    """Return the format of a table by its first row of numbers."""
    row = next((line for line in text[:10_000].splitlines() if line[:1] != "#"), "")
    if re.fullmatch(r"\s*([-+.\deE]+\s+){7}[-+.\deE]+\s*", row):
        return "tum"
    return "euroc" if re.match(r"\d{16,}(\.0*)?(,\s*[-+.\deE]+){7}", row) else "csv"


@reading_once()
def log_errors(
    path: str | os.PathLike[str],
    second: str | os.PathLike[str] | None = None,
    mapping: MappingSource = None,
    *,
    format: str = "csv",
    second_mapping: MappingSource = None,
    second_format: str | None = None,
    topic: str | None = None,
    setpoint: str | None = None,
    association: str = "linear",
    align: str | None = None,
    relative: int | str | None = None,
    begin: float | str = -np.inf,
    end: float | str = np.inf,
    disarmed: bool = False,
    delays: bool = True,
    out: str | os.PathLike[str] | None = None,
) -> TrackingErrors:
    """Measure how far a recorded vehicle was from its setpoints, or from a second recording.

    Of measurement and setpoint, the smoother one is interpolated to the instants of the other:
    positions, velocities and rates linearly, attitudes along the shortest rotation. Only
    instants while armed count, and nothing is interpolated over a gap, a change of the mode, or a
    reset of the estimator. The times of two files are those of one clock, of which none is moved.

    Parameters
    ----------
    path, mapping, format
        As for `check_log`; without others, also those of the second file.
    second_mapping, second_format
        Those of the second file.
    second
        The recording of what was wanted. Default: the setpoints in the file.
    topic, setpoint
        Topics of the measurement and of the setpoints. Default: the first that the file has.
        The setpoint ``desired`` are the desired values of ArduPilot in place of its targets.
    association
        ``linear``; ``nearest``: for each row of the shorter one, the other at the nearest time, at
        most 0.01 s away; ``held``: the last measurement.
    align
        Moves the measured positions to the wanted ones first: ``rigid`` or ``similarity`` (with a
        scale) by least squares (Umeyama), ``yaw`` likewise but about z only, as for estimates that
        know gravity, ``origin`` by the first pose.
    relative
        Compare the motions over so many instants in place of the poses or, as in ``5m``, over
        metres of the desired path.
    begin, end
        The first and the last time to compare, s, by the clock of the files; a text such as ``+5``
        counts from the first row of `path`.
    disarmed
        Whether times while disarmed count, too.
    delays
        Whether delays are estimated, which takes most of the time.
    out
        Output folder for the figure ``errors``, and a CSV of each quantity. Default: no files.

    Returns
    -------
    TrackingErrors
        Root mean square, median and largest error by quantity and axis, a significant delay with
        its standard error, and the errors over time.

    Raises
    ------
    EqtError
        If a file cannot be read, or has nothing to compare.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0, 6, 61)
    >>> wanted = np.c_[t, np.sin(t), np.cos(t), 0 * t]
    >>> late = np.c_[t + 0.1, wanted[:, 1:]]
    >>> for name, rows in (("wanted.csv", wanted), ("flown.csv", late)):
    ...     np.savetxt(name, rows, delimiter=",", header="t,x,y,z", comments="")
    >>> size = eqt_cli.log_errors("flown.csv", "wanted.csv").sizes[0]
    >>> round(size.rms, 3), round(size.delay, 3), round(size.remains, 3)
    (0.1, 0.1, 0.0)
    """
    literal(Literal["linear", "nearest", "held"], "association", association)
    literal(Literal["rigid", "similarity", "yaw", "origin"], "align", align or "rigid")
    over = re.fullmatch(r"(\d+|\d*\.?\d+ ?(m))", f"{relative or 1}")
    if not over or relative == 0 or not (size := float(over[1].rstrip("m "))) > 0:
        expected = "expected instants, as 50, or metres of the path, as 5m"
        raise EqtError(f"relative: {expected}, got {relative!r}")
    parts = None if relative is None else (size, over[2] or "")
    flight, spans, of = _flight(path, mapping), logs.NO_SPANS, " setpoint"
    remarks = list[str]()
    if flight is None and second is None and format == "csv":
        with _read(path, mapping, format) as read:
            flight = logs.flight_of_table(read.text, read.name)
        mapping = mapping if flight is None else None
    of_second = mapping if second_mapping is None else second_mapping
    other = None if second is None else _flight(second, of_second)
    if second is not None and second_mapping is None and (flight is None) != (other is None):
        # One mapping of a log and a table is that of the table, but for the rows to leave out
        drop = LogMapping(drop=_mapping_from(mapping)[0].drop)
        flight, other = (x and x._replace(mapping=drop) for x in (flight, other))
    for source in filter(None, (flight, other)):
        rest = replace(source.mapping, columns={}, drop=[], world=None, body=None)
        if replace(rest, time=replace(rest.time, begin=None, end=None)) != LogMapping():
            keys = "`drop`, `world`, `body`, begin and end of `time`, and the recorder's `columns`"
            raise EqtError(f"mapping: of a log, errors take only {keys}")
    measured = _series(path, flight, mapping, format, topic, remarks=remarks)
    if second is not None:
        about = None if flight else _point(path, mapping, format)
        how: Any = {"about": about, "remarks": remarks}
        goals = _series(second, other, of_second, second_format or format, setpoint, **how)
    elif flight is None:
        goals = _setpoints(path, mapping, format)
    else:
        setpoint, of = (None, " desired") if setpoint == "desired" else (setpoint, of)
        goals = _series(path, flight, mapping, format, setpoint, of)
        spans = logs.spans_of(flight, disarmed)
    actual, wanted = _chosen(measured, goals, second is None and setpoint is None)
    shared = dict(_shared(actual, wanted))
    if {*shared} == {*wanted}:
        remarks += [f"measured and wanted are the same columns, {x}" for x in shared.values()][:1]
    else:
        wanted = {q: series for q, series in wanted.items() if q not in shared}
        remarks += [f"{q}: left out, as both are {columns}" for q, columns in shared.items()]
    begins = [t for series in actual.values() for t in series.times[:1]]
    span = [_instant(*bound, begins) for bound in (("begin", begin), ("end", end))]
    compared: Any = spans, association, align, parts, span, delays
    errors = logs.tracking_errors(f"{path}", actual, wanted, *compared)
    errors = errors._replace(flight=flight, remarks=(*errors.remarks, *remarks))
    if out is not None:
        from eqt_cli.extensions.logs.figures import save_errors  # slow to import

        save_errors(errors, f"{path}", Path(out))
    return errors


def _setpoints(path: Any, mapping: Any, format: str) -> dict[str, list[Series]]:
    """Return the series of the setpoints in the table of the measurement."""
    with _read(path, mapping, format) as read:
        text, name, kind, columns, _ = read
        both = setpoints_of(text, name, columns) if kind == "csv" else None
        if both is None or not {"position", "attitude"} & {*both.quantities}:
            advice = "name their columns in a mapping, `setpoint: {x: …, y: …, z: …}`, or give a "
            raise EqtError(f"{path}: has no columns of setpoints, as x_ref; {advice}second file")
        return {
            q: [one._replace(topic=both.quantities[q], fields=())]
            for q, one in Read(both.text, name, kind, both.mapping).motions().items()
            if q in both.quantities
        }


def measured_series(
    path: str | os.PathLike[str], mapping: MappingSource = None, format: str = "csv"
) -> dict[str, Series]:
    """Return the series of each quantity that was measured; arguments as for `check_log`."""
    every = _series(path, _flight(path, mapping), mapping, format, None)
    return {quantity: some[0] for quantity, some in every.items()}


def command_series(
    path: str | os.PathLike[str], mapping: MappingSource = None, format: str = "csv"
) -> dict[str, Series]:
    """Return the series of each commanded quantity; arguments as for `check_log`.

    Besides torque and force, a table may have thrust, acceleration, attitude and rates. Commands
    along the body have eqt's axes; a unit of shares is *normalised*.
    """
    if (flight := _flight(path, mapping)) is not None:
        every = {q: next(iter(flight.series(q)), None) for q in ("torque", "force")}
        return {q: frames.in_axes("rates", one, flight.mapping) for q, one in every.items() if one}
    with _read(path, mapping, format) as read:
        return dict(series_of_commands(open_sheet(*read[:4]), read.mapping))


def _shared(actual: dict[str, Series], wanted: dict[str, Series]) -> Iterator[tuple[str, str]]:
    """Yield the quantities whose measurement and setpoint are the same columns of one file."""
    for q in [q for q in actual if q in wanted]:
        one, other = actual[q], wanted[q]
        if one.topic == other.topic and one.fields and [*one.fields] == [*other.fields]:
            yield q, f"{', '.join(one.fields)} of {one.topic}"


def _instant(name: str, value: float | str, begins: Sequence[float]) -> float:
    """Return a time, s; a text with a sign counts from the first of some times."""
    try:
        return float(value) + f"{value}".startswith("+") * min(begins, default=0.0)
    except ValueError:
        expected = "expected seconds, as 12.5 by the clock of the file or +5 from its first row"
        raise EqtError(f"{name}: {expected}, got {value!r}") from None


def _point(path: Any, mapping: Any, format: str) -> Any:
    """Return the point about which latitudes of a table are positions; None without any."""
    with _read(path, mapping, format) as read:
        positions = open_sheet(*read[:4]).geodetic
        return positions and positions.about._asdict()


def _series(
    path: Any,
    flight: Flight | None,
    mapping: Any,
    format: str,
    topic: str | None,
    of: str = "",
    about: Any = None,
    remarks: list[str] | None = None,
) -> dict[str, list[Series]]:
    """Return the series of each quantity, the first of the table first; of a topic, if named.

    Latitudes are about a point, if the mapping states none. `remarks` gets the rows that were not
    flown.
    """
    if flight is None:
        with _read(path, mapping, format) as read:
            placed = replace(read.mapping, geodetic=read.mapping.geodetic or about)
            if remarks is not None:
                remarks += [*read.remarks, *read.clocks()]
            return {q: [series] for q, series in read._replace(mapping=placed).motions().items()}
    kinds, topics = [of], flight.topics
    if topic is not None:
        kinds, topics = (
            [of, "", " setpoint"],
            [candidate for candidate in topics if candidate.name == topic],
        )
        topics = topics or list(filter(None, [frames.composed(flight.topics, topic)]))
        if not topics:
            raise EqtError(f"{path}: has no topic '{topic}'; eqt log check lists them")
    flight = flight._replace(topics=topics)
    every = {q: [s for k in kinds for s in flight.series(q + k, not of)] for q in logs.QUANTITIES}
    turned = {q: [frames.in_axes(q, s, flight.mapping) for s in some] for q, some in every.items()}
    return {quantity: some for quantity, some in turned.items() if some}


def _chosen(
    measured: dict[str, list[Series]], goals: dict[str, list[Series]], differ: bool
) -> tuple[dict[str, Series], dict[str, Series]]:
    """Return the first pair of each quantity: usable, of the same axes, and of different fields."""
    actual = {q: some[0] for q, some in measured.items()}
    wanted: dict[str, Any] = {q: some[0] for q, some in goals.items()}
    for q in [q for q in actual if q in goals]:  # the position first, whose topic leads
        lead = actual.get("position", actual[q]).topic
        pairs: list[Any] = [(k, w) for w in goals[q] for k in measured[q]]
        pairs = [(k, w) for k, w in pairs if not differ or k.fields != w.fields]
        odd = [(k.is_odd or w.is_odd, k.axes != w.axes, k.topic != lead) for k, w in pairs]
        best = odd.index(min(odd)) if odd else 0
        actual[q], wanted[q] = (pairs or [(actual[q], None)])[best]
    return actual, {q: series for q, series in wanted.items() if series is not None}
