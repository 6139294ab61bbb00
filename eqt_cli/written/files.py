"""Poses in files: tables with named columns, and trajectories in the formats TUM and EuRoC."""

import csv
import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.groups.product import ProductGroup
from eqt_cli.written.poses import QUATERNION_TOLERANCE

TrajectoryFormat: TypeAlias = Literal["csv", "tum", "euroc"]

QUATERNION = ("qx", "qy", "qz", "qw")

_WITHOUT_HEADER = {
    "tum": (("t", "x", "y", "z", *QUATERNION), None),
    "euroc": (
        ("t", "x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz"),
        ",",
    ),
}
"""What stands in the columns of formats that have no header of their own, and what parts them."""


MOST_IN_LINE = 100_000
"""Characters; a pose takes a few hundred."""

MOST_SHOWN = 30
"""Characters of an entry, in a message."""

MOST_DIGITS = 19
"""Of a time in nanoseconds; the year 2262 has as many."""


@dataclass(frozen=True)
class Table:
    """Numbers in named columns.

    Attributes
    ----------
    name
        The file, for messages.
    columns
        The numbers of each column by its name, ``(rows,)``.
    lines
        The line of the file that each row stands in.
    """

    name: str
    columns: dict[str, Array]
    lines: list[int]

    def __len__(self) -> int:
        return len(self.lines)

    def error(self, row: int, message: str) -> InputError:
        """What is wrong in a row."""
        return InputError(f"{self.name}:{self.lines[row]}: {message}")

    def get(self, names: Sequence[str]) -> Array:
        """The numbers of some columns, ``(rows, len(names))``."""
        return np.stack([self.columns[name] for name in names], axis=-1)


def read_trajectory(
    text: str, name: str, kind: TrajectoryFormat, G: MatrixLieGroup
) -> tuple[Array, Array]:
    """Times ``(n,)``, s, and poses ``(n, d, d)`` from a file.

    Times of TUM and EuRoC files count from their first row.

    Raises
    ------
    InputError
        That says in which line what is wrong.
    """
    is_csv = kind == "csv"
    table = read_table(text, name, G, time=True) if is_csv else _read_rows(text, name, kind)
    if len(table) < 2:
        raise table.error(-1, f"expected two rows or more, got {len(table)}")
    times = table.columns["t"]
    if kind != "csv":
        times = times - times[0]
    steps = np.flatnonzero(np.diff(times) <= 0)
    if len(steps):
        row = int(steps[0]) + 1
        before, here = times[row - 1], times[row]
        raise table.error(row, f"expected a time after {before:.9g} s, got {here:.9g} s")
    return times, table_poses(table, G)


def read_table(text: str, name: str, G: MatrixLieGroup, time: bool = False) -> Table:
    """Numbers with a header of names, parted by commas: poses of a group, perhaps with a time.

    Of a file with another header, no message shows a part: it may be any file.

    Raises
    ------
    InputError
        That says in which line what is wrong.
    """
    lines = _lines(text, ",", name)
    number, header = next(lines, (1, []))
    names = [entry.removeprefix("#").strip() for entry in header]
    if not names or any(_is_number(entry) for entry in names):
        raise InputError(
            f"{name}:{number}: expected a header that names the columns, such as t, qx, qy, qz, qw"
        )
    if time and "t" not in names:
        raise InputError(f"{name}:{number}: missing column t, the time in seconds")
    _require_pose(f"{name}:{number}", names, G)
    if len(set(names)) < len(names):
        twice = next(entry for entry in names if names.count(entry) > 1)
        raise InputError(f"{name}:{number}: two columns are named {twice}")
    return _numbers(lines, name, names, len(names))


def _read_rows(text: str, name: str, kind: str) -> Table:
    """Rows of a format that has no header of names."""
    names, delimiter = _WITHOUT_HEADER[kind]
    rows = ((number, row) for number, row in _lines(text, delimiter, name) if row[0][0] != "#")
    return _numbers(rows, name, list(names), 8, nanoseconds=kind == "euroc")


def _lines(text: str, delimiter: str | None, name: str) -> Iterator[tuple[int, list[str]]]:
    """The entries of every line that is not empty, with its number."""
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        if line.strip():
            if len(line) > MOST_IN_LINE:
                raise InputError(
                    f"{name}:{number}: expected a line of at most {MOST_IN_LINE} characters, "
                    f"got {len(line)}"
                )
            entries = next(csv.reader([line])) if delimiter else line.split()
            yield number, [entry.strip() or " " for entry in entries]


def _numbers(
    rows: Iterator[tuple[int, list[str]]],
    name: str,
    names: list[str],
    least: int,
    *,
    nanoseconds: bool = False,
) -> Table:
    """A table of rows with at least so many entries; those without a name are left out."""
    found: list[list[float]] = []
    lines, first = [], 0
    for line, entries in rows:
        if len(entries) < least or (len(entries) > len(names) and not nanoseconds):
            raise InputError(f"{name}:{line}: expected {least} entries, got {len(entries)}")
        numbers = []
        for column, entry in zip(names, entries, strict=False):
            if nanoseconds and column == "t":
                if not (entry.isdecimal() and len(entry) <= MOST_DIGITS):
                    got = _shown(entry)
                    raise InputError(f"{name}:{line}: expected whole nanoseconds, got {got}")
                first = int(entry) if not found else first
                numbers.append((int(entry) - first) / 1e9)  # exact until it is divided
            elif _is_number(entry) and math.isfinite(float(entry)):
                numbers.append(float(entry))
            else:
                got = _shown(entry)
                raise InputError(
                    f"{name}:{line}: expected a finite number in column {column}, got {got}"
                )
        found.append(numbers)
        lines.append(line)
    if not found:
        raise InputError(f"{name}: holds no rows of numbers")
    width = min(map(len, found))
    table = np.array([row[:width] for row in found])
    return Table(name, dict(zip(names[:width], table.T, strict=True)), lines)


def _shown(entry: str) -> str:
    """What stands where a number should; other text may be of any file, and is not shown."""
    return f"'{entry}'" if _is_number(entry) and len(entry) <= MOST_SHOWN else "text"


def _is_number(entry: str) -> bool:
    try:
        float(entry)
    except ValueError:
        return False
    return True


def read_starts(text: str, name: str, G: MatrixLieGroup) -> tuple[Array, Array | None]:
    """Poses ``(n, d, d)`` and velocities ``(n, m)``, if there are any, a row for each run.

    Raises
    ------
    InputError
        That says in which line what is wrong.
    """
    table = read_table(text, name, G)
    poses = table_poses(table, G)
    coordinates = coordinate_names(G)
    for columns in (
        [f"V{k}" for k in range(1, G.dimension + 1)],
        [f"V_{coordinate}" for coordinate in coordinates],
        coordinates,
    ):
        of_poses = set(columns) & set(used_columns(table.columns, G))
        found = [column for column in columns if column in table.columns]
        if found and not of_poses:
            if len(found) < len(columns):
                missing = ", ".join(column for column in columns if column not in found)
                raise InputError(
                    f"{name}:{table.lines[0] - 1}: missing column {missing}; a velocity on "
                    f"{G.name} has {', '.join(columns)}"
                )
            return poses, table.get(columns)
    return poses, None


# Poses --------------------------------------------------------------------------------------------


def coordinate_names(G: MatrixLieGroup) -> list[str]:
    """The coordinates of the algebra as they are typed: ``wz`` for ωz, ``v2`` for v₂."""
    digits = {ord("₀") + digit: str(digit) for digit in range(10)}
    return [axis.replace("ω", "w").translate(digits) for axis in G.axis_names]


def pose_columns(G: MatrixLieGroup, suffix: str = "") -> list[str]:
    """The columns of a pose: quaternion (or angle), then translations; none where not known."""
    if isinstance(G, ProductGroup):
        parts = [pose_columns(factor, str(k)) for k, factor in enumerate(G.factors, start=1)]
        return [column for part in parts for column in part] if all(parts) else []
    if not isinstance(G, EuclideanGroup) or G.space > 3:
        return []
    turn = {0: (), 1: ("angle",)}.get(G.rotations, QUATERNION)
    letters = {"position": "", "velocity": "v"}
    moves = [
        letters.get(column, column) + axis for column in G.columns for axis in "xyz"[: G.space]
    ]
    return [column + suffix for column in (*turn, *moves)]


def table_poses(table: Table, G: MatrixLieGroup) -> Array:
    """A pose from each row: by quaternion and translation, or by the coordinates of the group."""
    columns, coordinates = pose_columns(G), coordinate_names(G)
    used = used_columns(table.columns, G)
    if used == columns:
        return _assembled(table, G, "")
    if used == coordinates:
        return G.exp(table.get(coordinates))
    if used:
        return table.get(used).reshape(len(table), G.size, G.size)
    _require_pose(f"{table.name}:{table.lines[0] - 1}", table.columns, G)
    raise AssertionError("a table with poses has columns of them")


def _require_pose(place: str, names: Collection[str], G: MatrixLieGroup) -> None:
    """Raise an `InputError` if columns of these names hold no poses of a group."""
    if used_columns(names, G):
        return
    columns, coordinates = pose_columns(G), coordinate_names(G)
    wanted = columns or coordinates
    missing = ", ".join(name for name in wanted if name not in names)
    others = f" (or the coordinates {', '.join(coordinates)})" if columns else ""
    raise InputError(
        f"{place}: missing column {missing}; a pose of {G.name} has {', '.join(wanted)}{others}"
    )


def used_columns(names: Collection[str], G: MatrixLieGroup) -> list[str]:
    """The columns that hold the poses of a table; none where some are missing."""
    digits = range(1, G.size + 1)
    entries = [f"Q{row}{column}" for row in digits for column in digits]
    ways = (pose_columns(G), coordinate_names(G), entries)
    return next((way for way in ways if way and set(way) <= set(names)), [])


def _assembled(table: Table, G: MatrixLieGroup, suffix: str) -> Array:
    if isinstance(G, ProductGroup):
        return G.assemble(
            [_assembled(table, factor, str(k)) for k, factor in enumerate(G.factors, start=1)]
        )
    assert isinstance(G, EuclideanGroup)
    columns = pose_columns(G, suffix)
    turn = columns[: len(columns) - G.space * len(G.columns)]
    rotations = np.broadcast_to(np.eye(G.space), (len(table), G.space, G.space))
    if len(turn) == 1:
        angle = table.get(turn)
        rotations = G.rotation(G.exp(np.pad(angle, ((0, 0), (0, G.dimension - 1)))))
    elif turn:
        q = table.get(turn)
        norms = np.linalg.norm(q, axis=-1)
        wrong = np.flatnonzero(abs(norms - 1) > QUATERNION_TOLERANCE)
        if len(wrong):
            row = int(wrong[0])
            raise table.error(row, f"expected a quaternion of norm 1, got norm {norms[row]:.6g}")
        rotations = G.rotation_towards(q)
    moves = table.get(columns[len(turn) :]) if G.columns else np.zeros((len(table), 0))
    columns_of = moves.reshape(len(table), len(G.columns), G.space).swapaxes(-1, -2)
    return G.assemble(rotations, columns_of)
