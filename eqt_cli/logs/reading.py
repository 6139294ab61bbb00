"""Poses with their times, and initial states, from the text of a file."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array, apply_matrix, transpose
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.columns import (
    Beside,
    PoseColumns,
    columns_beside,
    coordinate_names,
    require_norms,
    require_pose,
    table_poses,
)
from eqt_cli.logs.mapping import LogMapping, MappingError, TrajectoryFormat
from eqt_cli.logs.table import Sheet, Table, open_sheet, with_units

GAP = 5.0
"""Times the median step: what is longer is a gap."""


@dataclass(frozen=True)
class Log:
    """A recording.

    Attributes
    ----------
    sheet
        The file, with the names of all of its columns.
    table
        The numbers of those that are used, with their lines.
    columns
        Those of the poses.
    times : (n,)
        s, in the order of the file.
    recorded
        Columns of velocities and wrenches that it has and that are no part of its poses.
    group, said
        That of its poses, and the mapping.
    """

    sheet: Sheet
    table: Table
    columns: PoseColumns
    times: Array
    recorded: list[Beside]
    group: MatrixLieGroup
    said: LogMapping

    @cached_property
    def poses(self) -> Array:
        """Its poses ``(n, d, d)``, where it is usable."""
        return table_poses(self.table, self.columns, self.group, self.said)

    @property
    def unused(self) -> list[str]:
        """The headings of columns that nothing was taken from."""
        named = zip(self.sheet.names, self.sheet.headings, strict=True)
        return [heading for name, heading in named if name not in self.table.columns]

    @cached_property
    def gaps(self) -> Array:
        """The rows behind which others are missing."""
        steps = np.diff(self.times)
        return (
            np.flatnonzero(steps > GAP * np.median(steps)) if len(steps) > 2 else np.empty(0, int)
        )

    def in_body(self, beside: Beside) -> Array:
        """The numbers of columns beside the poses in the axes of the body, ``(n, k)``.

        A covector turns as a vector does, because the origin of the body stays where it is.
        """
        given, said, frame = self.table.get(beside.names), self.said, "body"
        if len(beside.names) != beside.group.space:
            return given  # of a turn in the plane, which all axes share
        if getattr(said, beside.kind) == "spatial":
            frame = "world"
        if beside.group.space == 3:
            given = given @ said.axes(frame).T
        if frame == "body":
            return given
        own = self.poses[:, beside.block, beside.block]
        return apply_matrix(transpose(beside.group.rotation(own)), given)

    def by(self, **changes: Any) -> Self:
        """The same by a mapping with other values of some keys."""
        return replace(self, said=replace(self.said, **changes))

    def part(self, rows: slice) -> Self:
        """The same with some of its rows."""
        columns = {name: numbers[rows] for name, numbers in self.table.columns.items()}
        table = replace(self.table, columns=columns, lines=self.table.lines[rows])
        return replace(self, table=table, times=self.times[rows])

    def require_usable(self) -> None:
        """Raise an `InputError` for what makes it no motion: its times, its poses, their axes."""
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
    text: str, name: str, kind: TrajectoryFormat, G: MatrixLieGroup, said: LogMapping
) -> Log:
    """A recording as it is in a file, whether it can be used or not.

    Times of the formats tum and euroc count from their first row.

    Raises
    ------
    InputError
        That says in which line what is wrong; a `MappingError` for a mapping that does not fit it.
    """
    sheet = open_sheet(text, name, kind, said)
    columns = require_pose(sheet, G, time=True)
    others = set(sheet.names) - set(columns.names)
    beside = [each for each in columns_beside(G) if set(each.names) <= others]
    used = ["t", *columns.names, *(name for each in beside for name in each.names)]
    sheet = with_units(sheet, said, used)
    table, times = _timed(sheet.table(used), kind, said)
    sheet = replace(sheet, lines=[])  # as large as the file
    return Log(sheet, table, columns, times, beside, G, said)


def _timed(table: Table, kind: TrajectoryFormat, said: LogMapping) -> tuple[Table, Array]:
    """The rows that the mapping keeps, and their times."""
    asked, times, since = said.time, table.columns["t"], table.since
    if kind != "csv":
        times, since = times - times[0], 0.0
    times, since = times * asked.scale, since * asked.scale
    if asked.begin is not None or asked.end is not None:
        begin = -np.inf if asked.begin is None else asked.begin
        end = np.inf if asked.end is None else asked.end
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
    if asked.offset == "first":
        return table, times - times[0]
    late = since + (asked.offset or 0.0)
    return table, times + late if late else times


OF_STARTS = ("columns", "units", "quaternion", "euler", "attitude", "world", "body")
"""What of a mapping a table of initial states has."""


def read_starts(
    text: str, name: str, G: MatrixLieGroup, said: LogMapping
) -> tuple[Array, Array | None]:
    """Poses ``(n, d, d)`` and velocities ``(n, m)``, if there are any, a row for each run.

    Raises
    ------
    InputError
        That says in which line what is wrong; a `MappingError` for a mapping that does not fit it.
    """
    for key, default in vars(LogMapping()).items():
        if key not in OF_STARTS and getattr(said, key) != default:
            raise MappingError(
                (key,),
                "rows of initial states have no times, and their velocities are in the body frame; "
                "remove this key",
            )
    sheet = open_sheet(text, name, "csv", said)
    columns, coordinates = require_pose(sheet, G), coordinate_names(G)
    velocity: list[str] = []
    for names in (
        [f"V{k}" for k in range(1, G.dimension + 1)],
        [f"V_{coordinate}" for coordinate in coordinates],
        coordinates,
    ):
        found = [column for column in names if column in sheet.names]
        if found and not set(names) & set(columns.names):
            if len(found) < len(names):
                missing = ", ".join(column for column in names if column not in found)
                raise InputError(
                    f"{sheet.header_place}: missing column {missing}; a velocity on "
                    f"{G.name} has {', '.join(names)}"
                )
            velocity = names
            break
    used = [*columns.names, *velocity]
    table = with_units(sheet, said, used).table(used)
    require_norms(table, columns)
    poses = table_poses(table, columns, G, said)
    return poses, _in_body_axes(table.get(velocity), G, said) if velocity else None


def _in_body_axes(velocities: Array, G: MatrixLieGroup, said: LogMapping) -> Array:
    """Velocities in the axes of the body that are wanted; those of a plane have no others."""
    turned = velocities.copy()
    for part in G.parts:
        if (own := velocities[:, part.axes]).shape[1] == 3:
            turned[:, part.axes] = own @ said.axes("body").T
    return turned
