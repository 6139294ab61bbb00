"""Recorded motions: from the columns of a table to poses, velocities and wrenches."""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, apply_matrix, transpose
from eqt_cli.base.errors import InputError, Problems, parse_key
from eqt_cli.base.units import factor
from eqt_cli.components import pose_tables
from eqt_cli.components.groups import MatrixLieGroup, ProductGroup
from eqt_cli.components.matrix_groups import EuclideanGroup
from eqt_cli.components.pose_notation import QUATERNION_TOLERANCE, pose_from
from eqt_cli.components.pose_tables import LogMapping, MappingError, Table, TrajectoryFormat
from eqt_cli.extensions.logs import log_table
from eqt_cli.extensions.logs.command_columns import with_commands
from eqt_cli.extensions.logs.log_table import DROPPING, LogTable, Sheet

VELOCITY = {"rates": "w", "velocity": "v"}
WRENCH = {"torque": "t", "force": "f"}
"""Quantities measured beside poses, each with the letter of its columns.

Each quantity is also the key of a mapping that gives its frame.
"""


class RecordedColumns(NamedTuple):
    """Columns of a velocity or a wrench that was recorded beside the poses.

    Attributes
    ----------
    kind
        The key in `VELOCITY` or `WRENCH`.
    names
        Names of the columns.
    axes
        Their coordinates in the Lie algebra, or in its dual.
    group, place
        The factor of the group that they belong to, and the rows of this factor in a pose.
    """

    kind: str
    names: tuple[str, ...]
    axes: slice
    group: EuclideanGroup
    place: slice


def recorded_columns(G: MatrixLieGroup, suffix: str = "") -> Iterator[RecordedColumns]:
    """Return the columns that velocities and wrenches of a group may have; none if not known."""
    if isinstance(G, ProductGroup):
        parts = zip(G.factors, G.coordinates, G.places, strict=True)
        for k, (factor, first, place) in enumerate(parts, start=1):
            for columns in recorded_columns(factor, str(k)):
                axes = slice(first.start + columns.axes.start, first.start + columns.axes.stop)
                yield columns._replace(axes=axes, place=place)
    if not isinstance(G, EuclideanGroup) or G.space > 3:
        return
    translations = [part.axes for part in G.parts if part.velocity_unit == "m/s"]
    for kinds in (VELOCITY, WRENCH):
        angular, linear = kinds
        if G.rotations:
            about = "xyz" if G.rotations == 3 else "z"
            names = tuple(kinds[angular] + axis + suffix for axis in about)
            yield RecordedColumns(angular, names, slice(0, G.rotations), G, slice(0, G.size))
        for axes in translations:
            names = tuple(kinds[linear] + axis + suffix for axis in "xyz"[: G.space])
            yield RecordedColumns(linear, names, axes, G, slice(0, G.size))


def recorded_names(G: MatrixLieGroup, kinds: Collection[str]) -> list[str]:
    """Return the names of all columns of some kinds."""
    return [name for column in recorded_columns(G) if column.kind in kinds for name in column.names]


def require_pose(
    sheet: Sheet, G: MatrixLieGroup, mapping: LogMapping, time: bool
) -> pose_tables.PoseColumns:
    """Return the columns of the poses, or raise an `InputError` if poses or times are missing.

    Coordinates may be a pose or its velocity, which their units tell.
    """
    if time and "t" not in sheet.names:
        alias = next(
            (header for header in sheet.names if header.lower() in log_table.LOOKS_LIKE["t"]), None
        )
        adds = f"`columns: {{t: {alias}}}`, and `units: {{t: ms}}` or its unit if that is not s,"
        hint = f"; add {adds} if {alias} is the time" if alias else ""
        raise InputError(f"{sheet.header_place}: missing column t, the time in seconds{hint}")
    forms, coordinates = pose_tables.forms_of_pose(G), pose_tables.coordinate_names(G)
    if used := pose_tables.used_columns(sheet.names, G):
        sheet.require_distinct()
        units = sheet.units | mapping.units
        bases = {name: part.error_unit for part in G.parts for name in coordinates[part.axes]}
        unclear = [name for name in coordinates if not factor(units.get(name, ""), bases[name])]
        if unclear and forms and used.layout == "coordinates":
            raise InputError(
                f"{sheet.header_place}: {', '.join(unclear)} may be the pose or a velocity; add "
                f"`units: {{{unclear[0]}: {bases[unclear[0]]}, …}}` to the mapping if they are the "
                f"pose, or columns such as {', '.join(forms[0])}"
            )
        return used
    layouts = forms or [coordinates]
    likely = max(layouts, key=lambda names: len({*names} & {*sheet.names}))
    missing = ", ".join(name for name in likely if name not in sheet.names)
    others = [*map(", ".join, forms[1:]), f"the coordinates {', '.join(coordinates)}"]
    also = f" (or {', or '.join(others)})" if forms else ""
    raise InputError(
        f"{sheet.header_place}: missing column {missing}; a pose of {G.name} has "
        f"{', '.join(layouts[0])}{also}"
    )


def require_norms(table: Table, columns: pose_tables.PoseColumns) -> None:
    """Raise an `InputError` for the first quaternion whose norm is not 1."""
    for norms in pose_tables.quaternion_norms(table, columns.names):
        wrong = np.flatnonzero(abs(norms - 1) > QUATERNION_TOLERANCE)
        for row in wrong[:1].tolist():
            message = f"expected a quaternion of norm 1, got norm {norms[row]:.6g}"
            raise table.error(row, message + DROPPING.format("invalid") * (len(wrong) < len(norms)))


ROUNDING = 1e-6
"""Share of an interval by which times of rows may be early."""

GAP = 5.0
"""Multiple of the median step beyond which a step is a gap."""


@dataclass(frozen=True)
class Log:
    """A recording as it is in its file, usable or not.

    Attributes
    ----------
    sheet
        The file, with the names of all its columns.
    table
        The numbers of the columns in use, with their lines.
    columns
        The columns of the poses.
    times : (n,)
        Times in the order of the file, s.
    recorded
        Columns of velocities and wrenches that are no part of the poses.
    group, mapping
        The group of the poses, and the mapping by which the file is read.
    missing
        Times after which rows are missing, s.
    speeds
        Columns of the speeds of rotors.
    """

    sheet: Sheet
    table: LogTable
    columns: pose_tables.PoseColumns
    times: Array
    recorded: list[RecordedColumns]
    group: MatrixLieGroup
    mapping: LogMapping
    missing: Array
    speeds: Sequence[str] = ()

    @cached_property
    def poses(self) -> Array:
        """Poses in the file ``(n, d, d)``; raises an `InputError` where it is not usable."""
        return pose_tables.table_poses(self.table, self.columns, self.group, self.mapping)

    @cached_property
    def moved_poses(self) -> Array:
        """Poses of the body in the world, by `origin` and `sensor` of the mapping."""
        origin, sensor = self.placed("origin"), self.placed("sensor")
        return origin @ self.poses @ self.group.inverse(sensor)

    def placed(self, key: str) -> Array:
        """Return the pose that the mapping gives, the identity without one, ``(d, d)``."""
        value, problems = getattr(self.mapping, key), Problems().at(key)
        pose = pose_from("identity" if value is None else value, self.group, problems)
        for problem in problems:
            raise MappingError(parse_key(problem.path), problem.message)
        assert pose is not None
        return pose

    @cached_property
    def gaps(self) -> Array:
        """The rows after which rows are missing."""
        rows = np.unique(np.searchsorted(self.times, self.missing, side="right") - 1)
        return rows[(rows >= 0) & (rows < len(self.times) - 1)]

    def in_body(self, recorded: RecordedColumns) -> Array:
        """Return recorded velocities or wrenches in the body frame, ``(n, k)``.

        A covector transforms as a vector does, because the origin stays that of the body.
        """
        numbers, mapping, frame = self.table.get(recorded.names), self.mapping, "body"
        if len(recorded.names) != recorded.group.space:
            return numbers  # a rotation in the plane, about the same axis in every frame
        if getattr(mapping, recorded.kind) == "spatial":
            frame = "world"
        if recorded.group.space == 3:
            numbers = numbers @ mapping.axes(frame).T
        if frame == "body":
            return numbers
        poses = self.poses[:, recorded.place, recorded.place]
        return apply_matrix(transpose(recorded.group.rotation(poses)), numbers)

    def with_mapping(self, **changes: Any) -> Self:
        """Return the log, read with other values of some keys of the mapping."""
        return replace(self, mapping=replace(self.mapping, **changes))

    def part(self, rows: slice) -> Self:
        """Return the log with some of its rows."""
        return replace(self, table=self.table.part(rows), times=self.times[rows])

    def require_usable(self) -> None:
        """Raise an `InputError` if its times, its poses or their axes make it no motion."""
        if len(self.table) < 2:
            raise self.table.error(-1, f"expected two rows or more, got {len(self.table)}")
        steps = np.flatnonzero(np.diff(self.times) <= 0)
        if len(steps):
            row = int(steps[0]) + 1
            before, here = self.times[row - 1], self.times[row]
            more = f" ({len(steps)} times in all)" if len(steps) > 1 else ""
            advice = DROPPING.format("repeated" if here in self.times[:row] else "unordered")
            message = f"expected a time after {before:.13g} s, got {here:.13g} s{more}"
            raise self.table.error(row, message + advice)
        require_norms(self.table, self.columns)
        _ = self.moved_poses


def read_log(
    text: str,
    name: str,
    form: TrajectoryFormat,
    G: MatrixLieGroup,
    mapping: LogMapping,
    *,
    of_commands: bool = True,
) -> Log:
    """Read a recording, whether it can be used or not.

    In the formats tum and euroc, times are counted from the first row. Commands in a table of
    another program are wrenches and speeds of rotors, unless they are of no use.

    Raises
    ------
    InputError
        With the line and the error; a `MappingError` where the mapping does not fit the file.
    """
    sheet = log_table.open_sheet(text, name, form, mapping)
    if form == "csv":
        sheet = with_commands(sheet, mapping, recorded_names(G, WRENCH), of_commands)
    columns = require_pose(sheet, G, mapping, True)
    others = set(sheet.names) - set(columns.names)
    recorded = [column for column in recorded_columns(G) if set(column.names) <= others]
    rotors = sorted(int(name[1:]) for name in others if re.fullmatch(r"n[1-9]\d*", name))
    speeds = [f"n{k}" for k in rotors]
    used = ["t", *columns.names, *(name for column in recorded for name in column.names), *speeds]
    sheet = log_table.with_units(sheet, mapping, used)
    table, times = _timed(sheet.table(used), form, mapping)
    sheet = replace(sheet, lines=[])  # frees memory of the size of the file
    steps, longest = np.diff(times), mapping.time.gap
    if longest is None:
        longest = GAP * np.median(steps) if len(steps) > 2 else np.inf
    missing = times[:-1][steps > longest]
    if mapping.time.rate is not None:
        held = {*speeds}.union(*(column.names for column in recorded if column.kind in WRENCH))
        table, times = _resampled(table, times, mapping.time.rate, held)
    return Log(sheet, table, columns, times, recorded, G, mapping, missing, speeds)


def _resampled(
    table: LogTable, times: Array, rate: float, held: Collection[str]
) -> tuple[LogTable, Array]:
    """Return the first row of each interval of 1/rate, with the means of what holds."""
    if len(times) < 2 or not np.all(steps := np.diff(times)) > 0:
        return table, times  # no motion, which is an error where it is used
    count = np.floor((times - times[0]) * rate + ROUNDING)
    rows = np.flatnonzero(np.diff(count, prepend=-1.0))
    length = np.append(steps, steps[-1])
    first_rows, columns = table.part(rows), dict[str, Array]()
    for name in held:
        sums = np.add.reduceat(table.columns[name] * length, rows)
        columns[name] = sums / np.add.reduceat(length, rows)
    return replace(first_rows, columns=first_rows.columns | columns), times[rows]


def _timed(table: LogTable, form: TrajectoryFormat, mapping: LogMapping) -> tuple[LogTable, Array]:
    """Return the rows that the mapping keeps, and their times."""
    time, since, first = mapping.time, table.since * mapping.time.scale, 0.0
    if form != "csv":
        since, first = 0.0, next(iter(table.columns["t"][np.isfinite(table.columns["t"])]), 0.0)
    times = (table.columns["t"] - first) * time.scale
    inside = in_span(time, times, since)
    if not inside.any() and len(times):
        low, high = float(times.min()) + since, float(times.max()) + since
        raise MappingError(
            ("time", "begin" if time.end is None or time.end >= low else "end"),
            f"no row of {table.name} is left: its times are from {low:.13g} to {high:.13g} s",
        )
    table = table if inside.all() else table.part(inside)
    table = table.without(mapping.drop)
    times = (table.columns["t"] - first) * time.scale
    if time.offset == "first":
        return table, times - times[0]
    late = since + (time.offset or 0.0)
    return table, times + late if late else times


def in_span(time: pose_tables.TimeMapping, times: Array, since: float = 0.0) -> Array:
    """Return which times a mapping keeps; one that is not a number is not outside."""
    inside = ~(times < -np.inf if time.begin is None else times < time.begin - since)
    beyond = times > (np.inf if time.end is None else time.end - since)
    for k in np.flatnonzero(beyond)[:1]:  # a clock that starts again comes to the end once more
        beyond[k:] |= times[k:] <= times[:k].max(initial=-np.inf, where=inside[:k])
    return inside & ~beyond


START_KEYS = set("columns units scale quaternion euler attitude world body geodetic drop".split())
"""The keys of a mapping that a table of initial states may have."""


@purposes.initial_file
def read_starts(
    text: str, name: str, G: MatrixLieGroup, mapping: LogMapping
) -> tuple[Array, Array | None, tuple[str, ...]]:
    """Read initial poses ``(n, d, d)`` and velocities ``(n, m)``, if any, one row per run.

    The third value are remarks on the file.

    Raises
    ------
    InputError
        With the line and the error; a `MappingError` where the mapping does not fit the file.
    """
    for key, default in vars(LogMapping()).items():
        if key not in START_KEYS and getattr(mapping, key) != default:
            raise MappingError(
                (key,),
                "rows of initial states have no times, and their velocities are in the body frame; "
                "remove this key",
            )
    sheet = log_table.open_sheet(text, name, "csv", mapping)
    columns = require_pose(sheet, G, mapping, False)
    velocity: list[str] = []
    for names in pose_tables.velocity_columns(G):
        missing = [column for column in names if column not in sheet.names]
        if len(missing) < len(names) and not set(names) & set(columns.names):
            if missing:
                raise InputError(
                    f"{sheet.header_place}: missing column {', '.join(missing)}; a velocity on "
                    f"{G.name} has {', '.join(names)}"
                )
            velocity = names
            break
    used = [*columns.names, *velocity]
    table = log_table.with_units(sheet, mapping, used).table(used).without(mapping.drop, most=0.0)
    require_norms(table, columns)
    poses = pose_tables.table_poses(table, columns, G, mapping)
    velocities = pose_tables.row_velocities(table, velocity, G, mapping) if velocity else None
    return poses, velocities, tuple(f"{name}: {note}" for note in sheet.notes(table))
