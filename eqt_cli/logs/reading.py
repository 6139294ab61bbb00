"""Reads poses with their times, and initial states, from the text of a file."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array, apply_matrix, transpose
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.columns import (
    PoseColumns,
    RecordedColumns,
    coordinate_names,
    recorded_columns,
    require_norms,
    require_pose,
    table_poses,
)
from eqt_cli.logs.mapping import LogMapping, MappingError, TrajectoryFormat
from eqt_cli.logs.table import Sheet, Table, open_sheet, with_units

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
    """

    sheet: Sheet
    table: Table
    columns: PoseColumns
    times: Array
    recorded: list[RecordedColumns]
    group: MatrixLieGroup
    mapping: LogMapping

    @cached_property
    def poses(self) -> Array:
        """Poses ``(n, d, d)``; raises an `InputError` where the log is not usable."""
        return table_poses(self.table, self.columns, self.group, self.mapping)

    @property
    def unused(self) -> list[str]:
        """Headings of the columns that are not used."""
        named = zip(self.sheet.names, self.sheet.headings, strict=True)
        return [heading for name, heading in named if name not in self.table.columns]

    @cached_property
    def gaps(self) -> Array:
        """The rows after which rows are missing."""
        steps = np.diff(self.times)
        return (
            np.flatnonzero(steps > GAP * np.median(steps)) if len(steps) > 2 else np.empty(0, int)
        )

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
        poses = self.poses[:, recorded.block, recorded.block]
        return apply_matrix(transpose(recorded.group.rotation(poses)), numbers)

    def with_mapping(self, **changes: Any) -> Self:
        """Return the log, read with other values of some keys of the mapping."""
        return replace(self, mapping=replace(self.mapping, **changes))

    def part(self, rows: slice) -> Self:
        """Return the log with some of its rows."""
        columns = {name: numbers[rows] for name, numbers in self.table.columns.items()}
        table = replace(self.table, columns=columns, lines=self.table.lines[rows])
        return replace(self, table=table, times=self.times[rows])

    def require_usable(self) -> None:
        """Raise an `InputError` if its times, its poses or their axes make it no motion."""
        if len(self.table) < 2:
            raise self.table.error(-1, f"expected two rows or more, got {len(self.table)}")
        steps = np.flatnonzero(np.diff(self.times) <= 0)
        if len(steps):
            row = int(steps[0]) + 1
            before, here = self.times[row - 1], self.times[row]
            raise self.table.error(row, f"expected a time after {before:.9g} s, got {here:.9g} s")
        require_norms(self.table, self.columns)
        _ = self.poses


def read_log(
    text: str, name: str, form: TrajectoryFormat, G: MatrixLieGroup, mapping: LogMapping
) -> Log:
    """Read a recording, whether it can be used or not.

    In the formats tum and euroc, times are counted from the first row.

    Raises
    ------
    InputError
        With the line and the error; a `MappingError` where the mapping does not fit the file.
    """
    sheet = open_sheet(text, name, form, mapping)
    columns = require_pose(sheet, G, time=True)
    others = set(sheet.names) - set(columns.names)
    recorded = [each for each in recorded_columns(G) if set(each.names) <= others]
    used = ["t", *columns.names, *(name for each in recorded for name in each.names)]
    sheet = with_units(sheet, mapping, used)
    table, times = _timed(sheet.table(used), form, mapping)
    sheet = replace(sheet, lines=[])  # frees memory of the size of the file
    return Log(sheet, table, columns, times, recorded, G, mapping)


def _timed(table: Table, form: TrajectoryFormat, mapping: LogMapping) -> tuple[Table, Array]:
    """Return the rows that the mapping keeps, and their times."""
    time, times, since = mapping.time, table.columns["t"], table.since
    if form != "csv":
        times, since = times - times[0], 0.0
    times, since = times * time.scale, since * time.scale
    if time.begin is not None or time.end is not None:
        begin = -np.inf if time.begin is None else time.begin
        end = np.inf if time.end is None else time.end
        kept = (begin - since <= times) & (times <= end - since)
        if not kept.any():
            low, high = float(times.min()) + since, float(times.max()) + since
            key = "end" if end < low else "begin"
            raise MappingError(
                ("time", key),
                f"no row of {table.name} is left: its times are from {low:.9g} to {high:.9g} s",
            )
        columns = {column: numbers[kept] for column, numbers in table.columns.items()}
        lines = [table.lines[row] for row in np.flatnonzero(kept).tolist()]
        table, times = Table(table.name, columns, lines, table.since), times[kept]
    if time.offset == "first":
        return table, times - times[0]
    late = since + (time.offset or 0.0)
    return table, times + late if late else times


START_KEYS = ("columns", "units", "quaternion", "euler", "attitude", "world", "body")
"""The keys of a mapping that a table of initial states may have."""


def read_starts(
    text: str, name: str, G: MatrixLieGroup, mapping: LogMapping
) -> tuple[Array, Array | None]:
    """Read initial poses ``(n, d, d)`` and velocities ``(n, m)``, if any, one row per run.

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
    sheet = open_sheet(text, name, "csv", mapping)
    columns, coordinates = require_pose(sheet, G), coordinate_names(G)
    velocity: list[str] = []
    for names in (
        [f"V{k}" for k in range(1, G.dimension + 1)],
        [f"V_{coordinate}" for coordinate in coordinates],
        coordinates,
    ):
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
    table = with_units(sheet, mapping, used).table(used)
    require_norms(table, columns)
    poses = table_poses(table, columns, G, mapping)
    return poses, _in_body_axes(table.get(velocity), G, mapping) if velocity else None


def _in_body_axes(velocities: Array, G: MatrixLieGroup, mapping: LogMapping) -> Array:
    """Return velocities in the wanted axes of the body; in the plane, the axes stay."""
    rotated = velocities.copy()
    for part in G.parts:
        if (of_part := velocities[:, part.axes]).shape[1] == 3:
            rotated[:, part.axes] = of_part @ mapping.axes("body").T
    return rotated
