"""Checks a recording for `eqt log check`: its columns, their use and units, gaps and errors."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import PurePath

import numpy as np

from eqt_cli.base.errors import InputError
from eqt_cli.components.groups import MatrixLieGroup, groups
from eqt_cli.components.log_table import (
    QUATERNION,
    LogMapping,
    MappingError,
    TrajectoryFormat,
    open_sheet,
    units_of,
)
from eqt_cli.components.matrix_groups import EuclideanGroup
from eqt_cli.components.recording import (
    VELOCITY,
    Log,
    pose_columns,
    quaternion_norms,
    read_log,
    used_columns,
)
from eqt_cli.components.recording_check import gaps_of, incomplete_columns, notes
from eqt_cli.extensions.recordings import RECORDINGS


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
        ``time``, ``pose``, ``rates``, ``velocity``, ``torque``, ``force`` or ``not used``.
    unit
        The unit of its numbers; empty where they have none.
    assumed
        Whether neither the file nor a mapping gives this unit.
    """

    heading: str
    name: str
    use: str
    unit: str
    assumed: bool


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
    G = G or _largest_group(text, name, form, mapping)
    log = read_log(text, name, form, G, mapping)
    times, norms = log.times, quaternion_norms(log.table, log.columns)
    steps = np.diff(times)
    median = float(np.median(steps)) if len(steps) else np.nan
    problems = []
    try:
        log.require_usable()
    except MappingError:
        raise
    except InputError as error:
        problems.append(str(error))
    all_norms = np.concatenate(list(norms.values())) if norms else np.empty(0)
    return LogCheck(
        name,
        RECORDINGS.get(PurePath(name.lower()).suffix, form),
        G.name,
        list(_uses(log)),
        len(times),
        float(times[0]),
        float(times[-1]),
        1 / median if median > 0 else np.nan,
        gaps_of(times, log.gaps),
        (float(all_norms.min()), float(all_norms.max())) if len(all_norms) else None,
        problems,
        [] if problems else list(notes(log)),
    )


def _largest_group(
    text: str, name: str, form: TrajectoryFormat, mapping: LogMapping
) -> MatrixLieGroup:
    """Return the largest group whose poses the columns of a file can hold."""
    sheet = open_sheet(text, name, form, mapping)
    names = set(sheet.names)
    fitting = [
        group
        for group in _groups_of_poses()
        if (layout := used_columns(names, group)) is not None and layout.layout == "parts"
    ]
    if not fitting:
        if len(sheet.names) == 1 and (other := next((c for c in ";\t" if c in sheet.names[0]), "")):
            shown = {";": "semicolons", "\t": "tabs"}[other]
            raise InputError(
                f"{sheet.header_place}: the columns are separated by {shown}; expected commas, and "
                "decimals with a point"
            )
        if incomplete := next(incomplete_columns(names), None):
            raise InputError(f"{sheet.header_place}: {incomplete}")
        known = ", ".join(QUATERNION)
        raise InputError(
            f"{name}: no columns of a pose were found, such as {known} or yaw, pitch, roll for a "
            "rotation and x, y, z for a position; name them in a mapping, "
            "`columns: {qx: …}`, or give the group"
        )
    return max(fitting, key=lambda group: len(pose_columns(group)))


def _groups_of_poses() -> Iterator[EuclideanGroup]:
    """Yield the groups whose elements are rotations and positions, without velocities."""
    examples = (kind.named(each) for kind in groups.all() for each in kind.examples())
    for group in examples:
        if isinstance(group, EuclideanGroup) and set(group.column_units) <= {"m"}:
            yield group


def _uses(log: Log) -> Iterator[ColumnUse]:
    for name, heading in zip(log.sheet.names, log.sheet.headings, strict=True):
        if name not in log.table.columns:
            yield ColumnUse(heading, "", "not used", log.sheet.units.get(name, ""), False)
            continue
        kinds = [recorded.kind for recorded in log.recorded if name in recorded.names]
        use = "time" if name == "t" else kinds[0] if kinds else "pose"
        unit = log.sheet.units.get(name, "")
        default = next(iter(units_of(name)), "")
        if use in VELOCITY and "/" not in default:
            default += "/s"
        yield ColumnUse(heading, name, use, unit or default, bool(default) and not unit)
