"""Recorded motions: from the columns of a table to poses, velocities and wrenches."""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from eqt_cli.base.arrays import Array, apply_matrix, transpose
from eqt_cli.base.errors import InputError, Problems, parse_key
from eqt_cli.base.units import factor
from eqt_cli.components.groups import MatrixLieGroup, ProductGroup
from eqt_cli.components.log_table import (
    DROPPING,
    LOOKS_LIKE,
    QUATERNION,
    LogMapping,
    LogTable,
    MappingError,
    Sheet,
    TimeMapping,
    TrajectoryFormat,
    open_sheet,
    with_units,
)
from eqt_cli.components.matrix_groups import EuclideanGroup, rotation_of_euler
from eqt_cli.components.pose_notation import QUATERNION_TOLERANCE, pose_from

ANGLE, EULER = ("angle",), ("yaw", "pitch", "roll")
"""Columns of an angle in the plane, and of Euler angles: about z, y and x."""

# Columns that a rotation may have by its number of coordinates, the usual ones first.
_FORMS: dict[int, Any] = {0: [()], 1: [ANGLE, QUATERNION, EULER], 3: [QUATERNION, EULER]}

# Largest angle between the z axes of a body in the plane and of the world, as noise leaves it, rad.
# The heading is uncertain by its square / 4, which is 0.005 deg.
TILT = np.deg2rad(1.0)


@dataclass(frozen=True)
class PoseColumns:
    """The columns of a table that hold poses.

    Attributes
    ----------
    names
        Names of the columns.
    layout
        ``parts`` (a rotation and translations), ``coordinates`` or ``entries`` of the matrix.
    """

    names: list[str]
    layout: str


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
    return [name for each in recorded_columns(G) if each.kind in kinds for name in each.names]


def coordinate_names(G: MatrixLieGroup) -> list[str]:
    """Return the coordinates of the algebra as they are typed: ``wz`` for ωz, ``v2`` for v₂."""
    digits = {ord("₀") + digit: str(digit) for digit in range(10)}
    return [axis.replace("ω", "w").translate(digits) for axis in G.axis_names]


def pose_columns(G: MatrixLieGroup, suffix: str = "", names: Collection[str] = ()) -> list[str]:
    """Return the columns of a pose, the rotation first; none if not known.

    Of the forms of a rotation, the first is taken whose columns are among some names.
    """
    if isinstance(G, ProductGroup):
        parts = [pose_columns(each, str(k), names) for k, each in enumerate(G.factors, start=1)]
        return [column for part in parts for column in part] if all(parts) else []
    if not isinstance(G, EuclideanGroup) or G.space > 3:
        return []
    letters, axes = {"position": "", "velocity": "v"}, "xyz"[: G.space]
    translations = [letters.get(column, column) + axis for column in G.columns for axis in axes]
    return [column + suffix for column in (*_rotation(G, suffix, names), *translations)]


def _rotation(G: EuclideanGroup, suffix: str, names: Collection[str]) -> tuple[str, ...]:
    """Return the columns of a rotation of the group, without suffix."""
    forms = _FORMS[G.rotations]
    return next((form for form in forms if all(each + suffix in names for each in form)), forms[0])


def _forms_of_pose(G: MatrixLieGroup) -> list[list[str]]:
    """Return the columns of a pose in each of its forms; none if not known."""
    alike = [[each + k for each in form for k in ("", *"123456789")] for form in _FORMS[3]]
    forms = [pose_columns(G, names=names) for names in ((), *alike)]
    return [form for k, form in enumerate(forms) if form and form not in forms[:k]]


def used_columns(names: Collection[str], G: MatrixLieGroup) -> PoseColumns | None:
    """Return the columns that hold the poses of a table; None where some are missing.

    Where the table has a part of a pose in another form, coordinates are taken for a velocity.
    """
    digits = range(1, G.size + 1)
    entries = [f"Q{row}{column}" for row in digits for column in digits]
    coords = coordinate_names(G)
    # Entries come before coordinates, because velocities have the coordinates' names, too.
    layouts = {"parts": pose_columns(G, names=names), "entries": entries, "coordinates": coords}
    fitting = (PoseColumns(each, k) for k, each in layouts.items() if each and {*each} <= {*names})
    used, others = next(fitting, None), {*entries}.union(*_forms_of_pose(G)) - {*coords}
    return None if used and used.layout == "coordinates" and others & {*names} else used


def require_pose(sheet: Sheet, G: MatrixLieGroup, mapping: LogMapping, time: bool) -> PoseColumns:
    """Return the columns of the poses, or raise an `InputError` if poses or times are missing.

    Coordinates may be a pose or its velocity, which their units tell.
    """
    if time and "t" not in sheet.names:
        alias = next((each for each in sheet.names if each.lower() in LOOKS_LIKE["t"]), None)
        hint = f"; add `columns: {{t: {alias}}}` if that is what {alias} holds" if alias else ""
        raise InputError(f"{sheet.header_place}: missing column t, the time in seconds{hint}")
    forms, coordinates = _forms_of_pose(G), coordinate_names(G)
    if used := used_columns(sheet.names, G):
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


def table_poses(
    table: LogTable, columns: PoseColumns, G: MatrixLieGroup, mapping: LogMapping
) -> Array:
    """Return the pose of each row, ``(rows, d, d)``, in the wanted axes."""
    if mapping.euler != LogMapping.euler and not any(each[:4] == "roll" for each in columns.names):
        raise MappingError(
            ("euler",), f"the poses of {table.name} have no yaw, pitch and roll; remove this key"
        )
    if columns.layout == "parts":
        return _assembled(table, G, "", columns.names, mapping)
    if columns.layout == "coordinates":
        poses = G.exp(table.get(columns.names))
    else:
        poses = table.get(columns.names).reshape(len(table), G.size, G.size)
    if isinstance(G, EuclideanGroup):
        return _in_axes(G, G.rotation(poses), G.translations(poses), mapping)
    _require_no_axes(mapping, G)
    return poses


@np.errstate(over="ignore")  # an infinite norm is reported as different from 1
def quaternion_norms(table: LogTable, columns: PoseColumns) -> dict[str, Array]:
    """Return the norm of the quaternion in each row, by the suffix of its columns."""
    return {
        name[2:]: np.linalg.norm(table.get([part + name[2:] for part in QUATERNION]), axis=-1)
        for name in columns.names
        if name.startswith("qw")
    }


def require_norms(table: LogTable, columns: PoseColumns) -> None:
    """Raise an `InputError` for the first quaternion whose norm is not 1."""
    for norms in quaternion_norms(table, columns).values():
        wrong = np.flatnonzero(abs(norms - 1) > QUATERNION_TOLERANCE)
        if len(wrong):
            row = int(wrong[0])
            message = f"expected a quaternion of norm 1, got norm {norms[row]:.6g}"
            raise table.error(row, message + DROPPING.format("invalid") * (len(wrong) < len(norms)))


def _assembled(
    table: LogTable, G: MatrixLieGroup, suffix: str, names: Collection[str], mapping: LogMapping
) -> Array:
    """Return poses from the columns of rotations and translations."""
    if isinstance(G, ProductGroup):
        factors = enumerate(G.factors, start=1)
        return G.assemble([_assembled(table, f, str(k), names, mapping) for k, f in factors])
    assert isinstance(G, EuclideanGroup)
    form, columns = _rotation(G, suffix, names), pose_columns(G, suffix, names)
    rotation = columns[: len(form)]
    rotations = np.broadcast_to(np.eye(G.space), (len(table), G.space, G.space))
    if len(form) == 1:
        rotations = G.rotation(G.exp(np.pad(table.get(rotation), ((0, 0), (0, G.dimension - 1)))))
    elif form == EULER:
        axis = dict(zip("zyx", EULER, strict=True))
        angles = table.get([axis[letter] + suffix for letter in mapping.euler.lower()])
        rotations = rotation_of_euler(mapping.euler, angles)
    elif form:
        rotations = G.rotation_towards(table.get(rotation))
    rotations = _in_plane(table, G, rotations) if G.space == 2 and form[1:] else rotations
    rows = table.get(columns[len(form) :]) if G.columns else np.zeros((len(table), 0))
    translations = rows.reshape(len(table), len(G.columns), G.space).swapaxes(-1, -2)
    return _in_axes(G, rotations, translations, mapping)


def _in_plane(table: LogTable, G: EuclideanGroup, R: Array) -> Array:
    """Return rotations of the plane from those of space about z, ``(n, 3, 3) -> (n, 2, 2)``."""
    tilts = np.arctan2(np.hypot(R[:, 0, 2], R[:, 1, 2]), R[:, 2, 2])
    if len(wrong := np.flatnonzero(tilts > TILT)):
        got = f"one that tilts it by {np.rad2deg(tilts[wrong[0]]):.3g} deg; give a column angle"
        raise table.error(wrong[0], f"expected a rotation about z for {G.name}, got {got}")
    return G.rotation_towards(np.stack([R[:, 1, 0] - R[:, 0, 1], R[:, 0, 0] + R[:, 1, 1]], axis=-1))


def _in_axes(
    G: EuclideanGroup, rotations: Array, translations: Array, mapping: LogMapping
) -> Array:
    """Return poses, body to world, in the wanted axes: A_w R A_bᵀ and A_w x."""
    if mapping.attitude == "world_to_body":
        rotations = transpose(rotations)
    if G.space != 3:
        _require_no_axes(mapping, G)
        return G.assemble(rotations, translations)
    world, body = mapping.axes("world"), mapping.axes("body")
    rotations = world @ rotations @ body.T if G.rotations else rotations
    return G.assemble(rotations, world @ translations)


def _require_no_axes(mapping: LogMapping, G: MatrixLieGroup) -> None:
    for key in ("world", "body"):
        if value := getattr(mapping, key):
            raise MappingError((key,), f"{value} are axes of space, which {G.name} does not have")


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
    columns: PoseColumns
    times: Array
    recorded: list[RecordedColumns]
    group: MatrixLieGroup
    mapping: LogMapping
    missing: Array
    speeds: Sequence[str] = ()

    @cached_property
    def poses(self) -> Array:
        """Poses in the file ``(n, d, d)``; raises an `InputError` where it is not usable."""
        return table_poses(self.table, self.columns, self.group, self.mapping)

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
    columns = require_pose(sheet, G, mapping, True)
    others = set(sheet.names) - set(columns.names)
    recorded = [each for each in recorded_columns(G) if set(each.names) <= others]
    rotors = sorted(int(name[1:]) for name in others if re.fullmatch(r"n[1-9]\d*", name))
    speeds = [f"n{k}" for k in rotors]
    used = ["t", *columns.names, *(name for each in recorded for name in each.names), *speeds]
    sheet = with_units(sheet, mapping, used)
    table, times = _timed(sheet.table(used), form, mapping)
    sheet = replace(sheet, lines=[])  # frees memory of the size of the file
    steps, longest = np.diff(times), mapping.time.gap
    if longest is None:
        longest = GAP * np.median(steps) if len(steps) > 2 else np.inf
    missing = times[:-1][steps > longest]
    if mapping.time.rate is not None:
        held = {*speeds}.union(*(each.names for each in recorded if each.kind in WRENCH))
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


def in_span(time: TimeMapping, times: Array, since: float = 0.0) -> Array:
    """Return which times a mapping keeps; one that is not a number is not outside."""
    inside = ~(times < -np.inf if time.begin is None else times < time.begin - since)
    beyond = times > (np.inf if time.end is None else time.end - since)
    for k in np.flatnonzero(beyond)[:1]:  # a clock that starts again comes to the end once more
        beyond[k:] |= times[k:] <= times[:k].max(initial=-np.inf, where=inside[:k])
    return inside & ~beyond


START_KEYS = set("columns units scale quaternion euler attitude world body drop".split())
"""The keys of a mapping that a table of initial states may have."""


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
    sheet = open_sheet(text, name, "csv", mapping)
    columns, coordinates = require_pose(sheet, G, mapping, False), coordinate_names(G)
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
    table = with_units(sheet, mapping, used).table(used).without(mapping.drop, most=0.0)
    require_norms(table, columns)
    poses = table_poses(table, columns, G, mapping)
    velocities = None
    if velocity:
        velocities = table.get(velocity)
        for part in G.parts:
            if len(range(G.dimension)[part.axes]) == 3:  # in the plane, the axes stay
                velocities[:, part.axes] = velocities[:, part.axes] @ mapping.axes("body").T
    return poses, velocities, tuple(f"{name}: {note}" for note in sheet.notes(table))
