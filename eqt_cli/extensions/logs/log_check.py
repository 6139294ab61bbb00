"""Checks a recording: its topics and columns, their units and use, and what is odd."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtWarning, InputError
from eqt_cli.base.reporting import reporter
from eqt_cli.components import pose_tables
from eqt_cli.components.groups import MatrixLieGroup, groups
from eqt_cli.components.matrix_groups import EuclideanGroup
from eqt_cli.components.pose_tables import LogMapping, MappingError, TrajectoryFormat
from eqt_cli.extensions.logs import log_table, recording, recording_check
from eqt_cli.extensions.logs.first_bytes import format_of
from eqt_cli.extensions.logs.geodetic import AXES, NAMES
from eqt_cli.extensions.logs.logs import Flight, left_out, sources_of, times_of
from eqt_cli.extensions.logs.recording import GAP, Log, read_log


@dataclass(frozen=True)
class ColumnUse:
    """A column of a file and its use.

    Attributes
    ----------
    heading
        The heading in the file, without the unit.
    name
        eqt's name for the column; empty where it is not used.
    use
        ``time``, ``pose``, ``rates``, ``velocity``, ``torque``, ``force``, ``speed`` (of a rotor),
        ``command`` or ``not used``.
    unit
        The unit of its numbers; empty where they have none.
    assumed
        Whether the unit is assumed: neither the file nor a mapping gives it.
    """

    heading: str
    name: str
    use: str
    unit: str
    assumed: bool


def topics_of(flight: Flight) -> Iterator[tuple[str, str, int, float, int]]:
    """Yield name, use, rows, rate in Hz, and gaps of all topics; a rate of those that are read."""
    for topic in (topic for topic in flight.topics if topic.rows):
        steps, fields = np.diff(times_of(topic)), {*topic.fields}
        median = float(np.median(steps)) if len(steps) and np.median(steps) > 0 else np.nan
        sources = [s for s in sources_of(flight.format) if s.kind == topic.kind]
        names = dict.fromkeys(s.quantity for s in sources if {*s.fields.split()} <= fields)
        use = topic.note or ", ".join(names) or "not used"
        yield topic.name, use, topic.rows, 1 / median, int(np.sum(steps > GAP * median))


@dataclass(frozen=True)
class LogCheck:
    """The contents of a recording, its errors and its oddities.

    Attributes
    ----------
    file, format, group
        The file, its format, and the group of its poses.
    columns
        Every column, in the order of the file.
    rows
        The number of rows.
    begin, end
        The first and the last time, s.
    rate
        Sampling rate by the median step, Hz.
    gaps
        The begin and the length of each gap, s.
    norms
        The smallest and the largest norm of its quaternions; None without any.
    problems
        Reasons why it cannot be used.
    notes
        Oddities, each with what to do.
    topics
        The topics of a file of another program.
    left_out
        Rows that are not used, in words.
    """

    file: str
    format: str
    group: str
    columns: list[ColumnUse]
    rows: int
    begin: float
    end: float
    rate: float
    gaps: list[tuple[float, float]]
    norms: tuple[float, float] | None
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    topics: list[tuple[str, str, int, float, int]] = field(default_factory=list)
    left_out: str = ""

    @property
    def mapping(self) -> str:
        """The mapping by which the columns are read, as YAML in one line."""
        used = [x for x in self.columns if x.name]
        commands = {x.name: x.heading for x in used if x.use == "command"}
        columns = {x.name: x.heading for x in used if x.name not in (x.heading, *commands)}
        units = {one.name: one.unit for one in used if one.assumed}
        units |= {x.heading: x.unit for x in used if x.name in commands}
        return yaml_source.flow(
            {"columns": columns, "units": units} | ({"command": commands} if commands else {})
        )


def check_text(
    text: str,
    name: str,
    form: TrajectoryFormat,
    mapping: LogMapping,
    G: MatrixLieGroup | None = None,
) -> LogCheck:
    """Check the text of a recording; without a group, the largest that fits the columns is taken.

    Raises
    ------
    InputError
        If there are no columns of a pose, or entries that are no finite numbers.
    """
    G = G or largest_group(text, name, form, mapping)
    log = read_log(text, name, form, G, mapping)
    steps = np.diff(log.times)
    median = float(np.median(steps)) if len(steps) else np.nan
    norms = np.ravel(pose_tables.quaternion_norms(log.table, log.columns.names))
    problems = []
    try:
        log.require_usable()
    except MappingError:
        raise
    except InputError as error:
        problems.append(str(error))
    kind = format_of(Path(name)) or form
    begin, end = log.times[[0, -1]].tolist()
    rate, gaps = 1 / median if median > 0 else np.nan, recording_check.gaps_of(log.times, log.gaps)
    least = (float(norms.min()), float(norms.max())) if len(norms) else None
    facts = kind, G.name, list(_uses(log)), len(log.times), begin, end, rate
    remarks = [] if problems else list(recording_check.notes(log))
    return LogCheck(name, *facts, gaps, least, problems, remarks, left_out=left_out(log.table))


def largest_group(
    text: str, name: str, form: TrajectoryFormat, mapping: LogMapping
) -> MatrixLieGroup:
    """Return the largest group whose poses the columns of a file can hold."""
    sheet = log_table.open_sheet(text, name, form, mapping)
    names = set(sheet.names)
    fitting = []
    for group in (kind.named(name) for kind in groups.all() for name in kind.examples()):
        # of rotations and positions, without velocities
        if isinstance(group, EuclideanGroup) and set(group.column_units) <= {"m"}:
            columns = pose_tables.used_columns(names, group)
            if columns is not None and columns.layout == "parts":
                fitting.append(group)
    if not fitting:
        if len(sheet.names) == 1 and (other := next((c for c in ";\t" if c in sheet.names[0]), "")):
            shown = {";": "semicolons", "\t": "tabs"}[other]
            raise InputError(
                f"{sheet.header_place}: the columns are separated by {shown}; expected commas, and "
                "decimals with a point"
            )
        if incomplete := next(recording_check.incomplete_columns(names), None):
            raise InputError(f"{sheet.header_place}: {incomplete}")
        quaternion = ", ".join(pose_tables.QUATERNION)
        raise InputError(
            f"{name}: no columns of a pose were found, such as {quaternion} or yaw, pitch, roll "
            "for a rotation and x, y, z for a position; name them in a mapping, "
            "`columns: {qx: …}`, or give the group, as SO3 for entries Q11 … Q33 of a matrix"
        )
    largest = max(fitting, key=lambda group: len(pose_tables.pose_columns(group)))
    rates = {*"xyz", "wx", "wy", "wz"} <= names and not [*recording_check.incomplete_columns(names)]
    if rates and not largest.rotations and not text.startswith(log_table.CONVERTED):
        words = "x, y, z are read as positions, and wx, wy, wz have no rotation; if the rows are "
        words += "log(T) = (rho, theta) of poses T, rho is no position: write T = exp(rho, theta)"
        reporter().remark(EqtWarning(f"{name}: {words}"))
    return largest


def _uses(log: Log) -> Iterator[ColumnUse]:
    positions = log.sheet.geodetic
    for name, heading in zip(log.sheet.names, log.sheet.headings, strict=True):
        if positions is not None and name in (*NAMES, *AXES):
            if heading:  # not the positions that eqt makes of them
                written = log.sheet.units.get(name, "")
                yield ColumnUse(heading, name, "pose", positions.units[name], not written)
            continue
        if name in log.sheet.commands:
            yield ColumnUse(
                heading, log.sheet.commands[name][0], "command", log.sheet.commands[name][1], False
            )
            continue
        if not heading:
            continue
        if name not in log.table.columns:
            yield ColumnUse(heading, "", "not used", log.sheet.units.get(name, ""), False)
            continue
        kinds = [recorded.kind for recorded in log.recorded if name in recorded.names]
        kinds += (["time"] if name == "t" else []) + (["speed"] if name in log.speeds else [])
        use = next(iter(kinds), "pose")
        unit = log.sheet.units.get(name, "")
        default = next(iter(log_table.units_of(name)), "")
        if use in recording.VELOCITY and "/" not in default:
            default += "/s"
        yield ColumnUse(heading, name, use, unit or default, bool(default) and not unit)
