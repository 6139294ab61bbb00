"""Numbers of a file by the names of its columns, read in C; it knows no pose.

Of a file with another header, no message shows a part: it may be any file.
"""

import csv
import math
import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError, suggestion
from eqt_cli.logs.mapping import LogMapping, MappingError, TrajectoryFormat
from eqt_cli.logs.ulog import DAMAGED, SUFFIX
from eqt_cli.logs.ulog import NAMES as PX4
from eqt_cli.logs.units import factor_of, is_known, units_of

QUATERNION = ("qx", "qy", "qz", "qw")

NUMBERED = tuple(
    tuple(form.format(k) for k in range(first, first + 4))
    for form, first in (("q{}", 0), ("q{}", 1), ("q[{}]", 0), ("q[{}]", 1), ("q_{}", 0))
)
"""Names of the four numbers of a quaternion that do not say their order."""

_WITHOUT_HEADER = {
    "tum": ("t", "x", "y", "z", *QUATERNION),
    "euroc": ("t", "x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz"),
}
"""What stands in the columns of formats that have no header of their own."""

LEAST = 8
"""Entries of a row of them: a time and a pose."""

LOOKS_LIKE = {"t": ("time", "timestamp", "stamp", "secs", "seconds")}
"""Headings that a column without eqt's name of it may have; eqt names them, and takes none."""

MOST_IN_LINE = 100_000
"""Characters; a pose takes a few hundred."""

MOST_SHOWN = 30
"""Characters of an entry, in a message."""

MOST_DIGITS = 19
"""Of a time in nanoseconds; the year 2262 has as many."""

CHUNK = 20_000
"""Lines that are read at once; of those that cannot be read, the first is looked for."""

_OURS = re.compile(r"q[xyzw]\d?|q_?\d|q\[\d\]|V\w+|Q\d+")
"""Names of columns that have no unit."""

_HEADING = re.compile(r"(.*?)\s*(?:\[(?!\d+\])([^\]]*)\]|\((?!\d+\))([^)]*)\))")
"""A name and a unit: ``angle (deg)``, ``t [ms]``; ``q[0]`` has none."""


@dataclass(frozen=True)
class Table:
    """Numbers in named columns.

    Attributes
    ----------
    name
        The file, for messages.
    columns
        The numbers of each column by its name, ``(rows,)``, in rad, m and s.
    lines
        The line of the file that each row stands in.
    since
        s: a time that was taken from those in column t, which are exact then.
    """

    name: str
    columns: dict[str, Array]
    lines: Sequence[int]
    since: float = 0.0

    def __len__(self) -> int:
        return len(self.lines)

    def error(self, row: int, message: str) -> InputError:
        """What is wrong in a row."""
        return InputError(f"{self.name}:{self.lines[row]}: {message}")

    def get(self, names: Sequence[str]) -> Array:
        """The numbers of some columns, ``(rows, len(names))``."""
        return np.stack([self.columns[name] for name in names], axis=-1)


@dataclass(frozen=True)
class Sheet:
    """A file as lines, and what its columns are called.

    Attributes
    ----------
    name
        The file, for messages.
    names
        eqt's name for each column; that of the heading where it has no other.
    headings
        The same as they stand in the file, without their units.
    units
        Those that a heading or a mapping gives, by eqt's name.
    delimiter
        What parts the entries; None for spaces.
    lines, numbers
        The rows that are not empty, and where they stand.
    head
        The line of the header.
    more
        Whether rows may have entries beyond the columns.
    order
        That of its quaternions: xyzw or wxyz; empty where they are named.
    damaged
        Whether parts of the file were skipped.
    """

    name: str
    names: list[str]
    headings: list[str]
    units: dict[str, str]
    delimiter: str | None
    lines: list[str]
    numbers: Sequence[int]
    head: int
    more: bool = False
    order: str = ""
    damaged: bool = False

    @property
    def header_place(self) -> str:
        """The line of the header."""
        return f"{self.name}:{self.head}"

    def require_different(self) -> None:
        """Raise an `InputError` if two columns have one name."""
        counts = Counter(self.names)
        if twice := next((name for name in self.names if counts[name] > 1), None):
            raise InputError(f"{self.header_place}: two columns are named {twice}")

    def table(self, wanted: Collection[str]) -> Table:
        """The numbers of some of the columns.

        Raises
        ------
        InputError
            That says in which line what is wrong.
        """
        names = [name for name in self.names if name in wanted]
        if not self.lines:
            raise InputError(f"{self.name}: holds no rows of numbers")
        self._require_widths()
        since, columns = 0.0, {}
        if "t" in names and self.units.get("t") == "ns":
            since, columns["t"] = self._nanoseconds()
            names.remove("t")
        if names:
            numbers = self._numbers(names)
            for column, name in zip(numbers.T, names, strict=True):
                factor = factor_of(name, self.units.get(name, ""))
                columns[name] = column if factor == 1.0 else column * factor
        return Table(self.name, columns, self.numbers, since)

    def _require_widths(self) -> None:
        width = len(self.names)
        for number, line in zip(self.numbers, self.lines, strict=True):
            if self.delimiter and '"' not in line:
                found = line.count(self.delimiter) + 1
            elif self.delimiter and line.count('"') % 2:
                raise InputError(f"{self.name}:{number}: expected quotes in pairs")
            else:
                found = len(_entries(line, self.delimiter))
            if found < width or (found > width and not self.more):
                raise InputError(f"{self.name}:{number}: expected {width} entries, got {found}")

    def _numbers(self, names: list[str]) -> Array:
        places = [self.names.index(name) for name in names]
        found = np.empty((len(self.lines), len(places)))
        for first in range(0, len(self.lines), CHUNK):
            chunk = self.lines[first : first + CHUNK]
            try:
                rows = np.loadtxt(
                    chunk,
                    delimiter=self.delimiter,
                    comments=None,
                    quotechar='"' if self.delimiter else None,
                    usecols=places,
                    ndmin=2,
                )
            except ValueError:
                raise self._wrong(first, len(chunk), names, places) from None
            if not np.isfinite(rows).all():
                raise self._wrong(first, len(chunk), names, places)
            found[first : first + len(chunk)] = rows
        return found

    def _wrong(self, first: int, count: int, names: list[str], places: list[int]) -> InputError:
        """The first entry of some lines that is no finite number."""
        for row in range(first, first + count):
            entries = _entries(self.lines[row], self.delimiter)
            for name, place in zip(names, places, strict=True):
                entry = entries[place]
                if not (_is_number(entry) and math.isfinite(float(entry))):
                    wanted = f"expected a finite number in column {name}"
                    place_of = f"{self.name}:{self.numbers[row]}"
                    return InputError(f"{place_of}: {wanted}, got {_shown(entry)}")
        last = self.numbers[first + count - 1]
        return InputError(f"{self.name}:{self.numbers[first]}: expected numbers up to line {last}")

    def _nanoseconds(self) -> tuple[float, Array]:
        """The first time and those after it, s; exact until they are divided."""
        place, found = self.names.index("t"), []
        for number, line in zip(self.numbers, self.lines, strict=True):
            entry = _entries(line, self.delimiter)[place] if '"' in line else ""
            entry = entry or line.split(self.delimiter, place + 1)[place].strip()
            if not (entry.isdecimal() and len(entry) <= MOST_DIGITS):
                raise InputError(
                    f"{self.name}:{number}: expected whole nanoseconds, got {_shown(entry)}"
                )
            found.append(int(entry))
        first = found[0]
        return first / 1e9, np.array([float(each - first) for each in found]) / 1e9


def open_sheet(text: str, name: str, kind: TrajectoryFormat, mapping: LogMapping) -> Sheet:
    """The lines of a file, and its columns by eqt's names.

    Raises
    ------
    InputError
        For a header that names no columns, and a mapping that does not fit it.
    """
    if kind != "csv":
        return _without_header(text, name, kind, mapping)
    lines, numbers = _lines(text, name)
    damaged = bool(lines) and lines[0] == DAMAGED
    lines, numbers = lines[damaged:], numbers[damaged:]
    number, header = (numbers[0], lines.pop(0)) if lines else (1, "")
    headings, units = [], {}
    for entry in _entries(header, ","):
        heading, unit = _heading(entry.removeprefix("#").strip())
        headings.append(heading)
        units[heading] = unit
    if _is_tum(header):
        raise InputError(f"{name}:{number}: has 8 numbers parted by spaces; use the format tum")
    if not header or any(not entry or _is_number(entry) for entry in headings):
        raise InputError(
            f"{name}:{number}: expected a header that names the columns, such as t, qx, qy, qz, qw"
        )
    eqt_names = _renamed(headings, mapping, f"{name}:{number}")
    order = mapping.quaternion or ""
    known = {eqt: units[heading] for eqt, heading in zip(eqt_names, headings, strict=True)}
    return Sheet(
        name, eqt_names, headings, known, ",", lines, numbers[1:], number, False, order, damaged
    )


def with_units(sheet: Sheet, mapping: LogMapping, used: Collection[str]) -> Sheet:
    """The same with the units of the mapping, after a look at those of the columns that are used.

    Raises
    ------
    InputError
        For a unit that its column cannot have, at its place.
    """
    units = dict(sheet.units)
    for name, unit in mapping.units.items():
        if name not in sheet.names:
            hint = suggestion(name, used) or f"; expected one of {', '.join(used)}"
            raise MappingError(("units", name), f"{sheet.name} has no column {name}{hint}")
        if name in used:
            factor_of(name, unit, ("units", name))
        if units.get(name) and units[name] != unit and is_known(name, units[name]):
            raise MappingError(
                ("units", name),
                f"the header of {sheet.name} says {units[name]} for {name}, got {unit}; remove one",
            )
        units[name] = unit
    for name in used:
        if not is_known(name, units.get(name, "")):
            try:
                factor_of(name, units[name])
            except InputError as error:
                raise InputError(f"{sheet.header_place}: {error.args[0]}") from None
    return replace(sheet, units=units)


def _renamed(headings: list[str], mapping: LogMapping, place: str) -> list[str]:
    """eqt's name for each heading."""
    for name, heading in mapping.columns.items():
        if heading not in headings:
            hint = suggestion(heading, headings) or "; write a heading of the file, without a unit"
            if name in headings and not _is_ours(name):
                hint = f"; eqt's name is first: write `{{{heading}: {name}}}`"
            raise MappingError(("columns", name), f"{place}: no column '{heading}'{hint}")
        if not _is_ours(name):
            some = ", ".join(("t", *QUATERNION, "yaw, pitch, roll, x, y, z, wx, vx"))
            raise MappingError(
                ("columns", name), f"eqt has no column of this name; it knows {some} and others"
            )
    given = {heading: name for name, heading in mapping.columns.items()}
    # A column that has the name which the mapping gives to another is none of eqt's.
    known = {each: name for each, name in PX4.items() if name not in mapping.columns}
    names = [
        given.get(each, f"{each} (file)" if each in mapping.columns else known.get(each, each))
        for each in headings
    ]
    named = next((four for four in NUMBERED if set(four) <= set(names)), None)
    if named is None or set(QUATERNION) & set(names):
        if mapping.quaternion is not None:
            raise MappingError(
                ("quaternion",),
                f"the columns of {place.rpartition(':')[0]} have names that say their order, "
                "such as qx, qy, qz, qw; remove this key",
            )
        return names
    if mapping.quaternion is None:
        raise MappingError(
            ("quaternion",),
            f"{place}: columns {', '.join(named)} do not say which is the scalar part w; add "
            f"`quaternion: wxyz` if it is {named[0]}, `quaternion: xyzw` if it is {named[3]}",
        )
    order = dict(zip(named, (f"q{axis}" for axis in mapping.quaternion), strict=True))
    return [order.get(each, each) for each in names]


def _without_header(text: str, name: str, kind: str, mapping: LogMapping) -> Sheet:
    """A file of a format that has no header of names."""
    if name.lower().endswith(SUFFIX):
        raise InputError(f"{name}: a flight of PX4 has a format of its own; leave out {kind}")
    if mapping.columns:
        raise MappingError(
            ("columns",), f"the format {kind} has no header; remove this key, or use format: csv"
        )
    delimiter = "," if kind == "euroc" else None
    lines, numbers = _lines(text, name, "#")
    names = list(_WITHOUT_HEADER[kind])
    if mapping.quaternion is not None:
        parts = iter(f"q{axis}" for axis in mapping.quaternion)
        names = [next(parts) if each in QUATERNION else each for each in names]
    if lines:
        found = len(_entries(lines[0], delimiter))
        if found < LEAST or (found > LEAST and kind == "tum"):
            parted = "by commas" if delimiter else "by spaces"
            raise InputError(
                f"{name}:{numbers[0]}: expected {LEAST} entries parted {parted}, got {found}"
            )
        names = names[: max(min(len(_entries(line, delimiter)) for line in lines), LEAST)]
    units = {"t": "ns"} if kind == "euroc" else {}
    order = mapping.quaternion or ("wxyz" if kind == "euroc" else "xyzw")
    euroc = kind == "euroc"
    return Sheet(name, names, names, units, delimiter, lines, numbers, 1, euroc, order)


def _is_ours(name: str) -> bool:
    """Whether a column of this name means something to eqt."""
    return bool(units_of(name) or _OURS.fullmatch(name))


def _is_tum(line: str) -> bool:
    entries = line.split()
    return len(entries) == LEAST and all(map(_is_number, entries))


def _heading(entry: str) -> tuple[str, str]:
    """The name and the unit of a heading."""
    found = _HEADING.fullmatch(entry)
    return (found[1], (found[2] or found[3] or "").strip()) if found else (entry, "")


def _lines(text: str, name: str, comment: str = "") -> tuple[list[str], Sequence[int]]:
    """Every line that is not empty, nor begins as comments do, and their numbers."""
    lines = text.removeprefix("\ufeff").splitlines()
    numbers: Sequence[int] = range(1, len(lines) + 1)
    if comment or not all(map(str.strip, lines)):
        stripped = ((number, line.lstrip()) for number, line in zip(numbers, lines, strict=True))
        numbers = [k for k, line in stripped if line and not (comment and line[0] == comment)]
        lines = [lines[number - 1] for number in numbers]
    if max(map(len, lines), default=0) > MOST_IN_LINE:
        row = next(row for row, line in enumerate(lines) if len(line) > MOST_IN_LINE)
        raise InputError(
            f"{name}:{numbers[row]}: expected a line of at most {MOST_IN_LINE} characters, "
            f"got {len(lines[row])}"
        )
    return lines, numbers


def _entries(line: str, delimiter: str | None) -> list[str]:
    entries = next(csv.reader([line])) if delimiter and line else line.split()
    return [entry.strip() or " " for entry in entries]


def _shown(entry: str) -> str:
    """What stands where a number should; other text may be of any file, and is not shown."""
    return f"'{entry}'" if _is_number(entry) and len(entry) <= MOST_SHOWN else "text"


def _is_number(entry: str) -> bool:
    try:
        float(entry)
    except ValueError:
        return False
    return True
