"""Tables of numbers in files: their columns, units and frames, by name."""

import csv
import math
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any, Self, get_args

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, KeyPath, suggestion
from eqt_cli.base.reporting import count_of
from eqt_cli.base.units import factor, offered
from eqt_cli.components import pose_tables
from eqt_cli.components.pose_notation import QUATERNION_TOLERANCE
from eqt_cli.components.pose_tables import LogMapping, MappingError, TrajectoryFormat
from eqt_cli.extensions.logs import geodetic
from eqt_cli.extensions.logs.geodetic import Geodetic, Positions
from eqt_cli.extensions.logs.usual_names import usual_columns, usual_time

# Units of columns, and what messages name of a mapping --------------------------------------------


_UNITS_BY_NAME: tuple[tuple[str, tuple[str, ...]], ...] = (
    (r"t", ("s",)),
    (r"(angle|roll|pitch|yaw)\d?", ("rad",)),
    (r"[xyz]\d?", ("m",)),
    (r"w[xyz]?\d?", ("rad", "rad/s")),
    (r"[va][xyz]?\d{0,2}", ("m", "m/s", "m/s^2")),
    (r"t[xyz]\d?", ("N m",)),
    (r"f[xyz]\d?", ("N",)),
    (r"n[1-9]\d*", ("rad/s",)),
)
"""Units of eqt, one for each dimension, by a pattern of column names; other columns have none."""


def units_of(name: str) -> tuple[str, ...]:
    """Return the units of eqt that a column may be in; the first is the default."""
    return next((units for pattern, units in _UNITS_BY_NAME if re.fullmatch(pattern, name)), ())


def factor_of(name: str, unit: str, path: KeyPath = ()) -> float:
    """Return the factor that converts a column to eqt's units.

    Raises
    ------
    InputError
        If the column cannot have this unit; a `MappingError` where `path` is given.
    """
    units = units_of(name)
    if not unit or (unit == NORMALISED and units in (("N m",), ("N",))):
        return 1.0
    ratio = next(filter(None, (factor(unit, choice) for choice in units)), None)
    if ratio is not None:
        return ratio
    expected = " or ".join(map(offered, units)) if units else "no unit"
    message = f"column {name}: expected {expected}, got '{unit}'"
    raise MappingError(path, message) if path else InputError(message)


NORMALISED = "normalised"
"""Unit of a wrench that was commanded as a share of the largest."""

OF_COMMANDS = re.compile(r"thrust|torque|force|n\d*")
"""Keys of `units` that state the unit of commands, of which no column needs to have the name."""


PARTNERS = {
    "NED to ENU": "FRD to FLU",
    "ENU to NED": "FLU to FRD",
    "FRD to FLU": "NED to ENU",
    "FLU to FRD": "ENU to NED",
}
"""The change of the body's axes that usually goes with one of the world's, and back."""


DROPPING = "; add `drop: [{}]` to the mapping to leave such rows out"

MOST_ODD = 0.05
"""Largest share of the rows that are left out as such kinds without being asked for."""

# Reads the numbers of a table file by column names ------------------------------------------------
#
# Messages never quote text of a file other than headings and numbers: it may be any file.


NUMBERED = (
    ("q0", "q1", "q2", "q3"),
    ("q1", "q2", "q3", "q4"),
    ("q[0]", "q[1]", "q[2]", "q[3]"),
    ("q[1]", "q[2]", "q[3]", "q[4]"),
    ("q_0", "q_1", "q_2", "q_3"),
)
"""Column names of a quaternion that do not show which is the scalar part."""

_WITHOUT_HEADER = {
    "tum": ("t", "x", "y", "z", *pose_tables.QUATERNION),
    "euroc": ("t", "x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz"),
}
"""Columns of the formats that have no header."""

MIN_ENTRIES = 8
"""Smallest number of entries in a row of these formats: a time and a pose."""

LOOKS_LIKE = {"t": ("time", "timestamp", "stamp", "secs", "seconds")}
"""Usual headings of a column in other programs; eqt suggests them, but does not accept them."""

MAX_NAMED = 10
"""Largest number of unused columns that a remark names."""

MAX_SHOWN = 30
"""Longest entry that a message quotes, characters."""

MAX_DIGITS = 19
"""Most digits of a time in nanoseconds; enough until the year 2262."""

FIRST = 50
"""Number of rows that show whether a column is a time in s."""

CHUNK = 20_000
"""Number of lines to read at once; where that fails, they are searched for the first error."""

_WITHOUT_UNIT = re.compile(r"q[xyzw]\d?|q_?\d|q\[\d\]|V\d+|V_\w+|Q\d\d+")
"""Names of eqt's columns without a unit."""

_UNIT = re.compile(r"\[(?!\d+\])[^\]]*\]|\((?!\d+\))[^)]*\)")
"""A unit behind a name: ``(deg)``, ``[ms]``, but not ``[0]``."""

MOST_UNIT = 100
"""Most characters of a heading among which the unit is looked for, from the end."""


@dataclass(frozen=True)
class LogTable(pose_tables.Table):
    """Numbers in named columns, of which rows may be left out.

    Attributes
    ----------
    since
        Time subtracted from column t, s, so that the rest is exact.
    dropped
        The lines that a mapping drops, by the reason.
    """

    since: float = 0.0
    dropped: Mapping[pose_tables.Dropped, Sequence[int]] = field(default_factory=dict)

    def part(self, rows: slice | Array) -> Self:
        """Return the table with some of its rows."""
        columns = {name: numbers[rows] for name, numbers in self.columns.items()}
        lines = [self.lines[row] for row in np.arange(len(self))[rows].tolist()]
        return replace(self, columns=columns, lines=lines)

    def without(self, drop: Collection[pose_tables.Dropped], most: float = MOST_ODD) -> Self:
        """Return the table without rows of some kinds, and without few of the others.

        Raises
        ------
        InputError
            If nothing is left, or numbers of more rows than that are not finite.
        """
        table = self.free_of(drop)
        if not len(table):
            but = " but those that `drop` leaves out" if len(self) else ""
            raise InputError(f"{self.name}: holds no rows of numbers{but}")
        sound = table.free_of(get_args(pose_tables.Dropped))
        if len(table) - len(sound) <= most * len(table):
            return sound
        for name, numbers in table.columns.items():
            for row in np.flatnonzero(~np.isfinite(numbers))[:1].tolist():
                got = "nan or an empty cell" if np.isnan(numbers[row]) else f"{numbers[row]:g}"
                expected = f"expected a finite number in column {name}, got {got}"
                raise table.error(row, expected + DROPPING.format("invalid"))
        return table

    @np.errstate(over="ignore")  # an infinite norm is not 1
    def free_of(self, drop: Collection[pose_tables.Dropped]) -> Self:
        """Return the table without any row of some kinds."""
        table = self
        for kind in (
            choice for choice in get_args(pose_tables.Dropped) if choice in drop and len(table)
        ):
            t = table.columns.get("t", np.arange(len(table)))
            mask = np.r_[True, t[1:] > np.maximum.accumulate(t)[:-1]]
            if kind == "repeated":
                mask = np.isin(np.arange(len(t)), np.unique(t, return_index=True)[1])
            elif kind == "invalid":
                mask = np.isfinite(table.get(list(table.columns))).all(axis=1)
                for norms in pose_tables.quaternion_norms(table, table.columns):
                    mask &= abs(norms - 1) <= QUATERNION_TOLERANCE
            if not mask.all():
                dropped = {**table.dropped, kind: table.part(~mask).lines}
                table = replace(table.part(mask), dropped=dropped)
        return table


@dataclass(frozen=True)
class Sheet:
    """A file as lines, and the names of its columns.

    Attributes
    ----------
    name
        The file, for messages.
    names
        eqt's name for each column, or its heading where eqt has none.
    headings
        The headings in the file, without units.
    units
        The units given by headings or by a mapping, by eqt's name.
    delimiter
        The separator of entries; None for spaces.
    lines, numbers
        The rows that are not empty, and their line numbers.
    head
        The line of the header.
    more
        Whether rows may have entries beyond the columns.
    order
        The order of quaternions, xyzw or wxyz; empty where their columns are named.
    scale
        Factors of columns by their names.
    damaged
        Whether parts of the file were skipped.
    geodetic
        What became of latitudes and longitudes, or None.
    commands
        The columns of commands, by their names in the sheet, with eqt's name and the unit.
    unclear
        Which columns may be commands, and what a mapping must state.
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
    scale: Mapping[str, float] = field(default_factory=dict)
    geodetic: Positions | None = None
    commands: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    unclear: str = ""

    @property
    def header_place(self) -> str:
        """The file and the line of the header, for messages."""
        return f"{self.name}:{self.head}"

    def require_distinct(self) -> None:
        """Raise an `InputError` if two columns have the same name."""
        if key := next((name for name, count in Counter(self.names).items() if count > 1), ""):
            two = " and ".join(self.headings[k] for k, name in enumerate(self.names) if name == key)
            raise InputError(f"{self.header_place}: two columns are named {key}: {two}; rename one")

    def notes(self, table: LogTable) -> Iterator[str]:
        """Yield the rows that are dropped, and the columns that are not used."""
        if self.unclear:
            yield self.unclear
        for kind, lines in table.dropped.items():
            rows = count_of(len(lines), f"{kind} row")
            yield f"{rows} left out, the first in line {lines[0]}"
        pairs = zip(self.names, self.headings, strict=True)
        columns = {*table.columns, *self.commands}
        if self.geodetic is not None:
            columns |= {*geodetic.NAMES}
            yield f"latitude, longitude and altitude are {self.geodetic.words}"
        if unused := [heading for name, heading in pairs if name not in columns]:
            named = ", ".join(unused[:MAX_NAMED])
            more = f" and {len(unused) - MAX_NAMED} more" if len(unused) > MAX_NAMED else ""
            verb = "is" if len(unused) == 1 else "are"
            yield f"column{'s' if len(unused) > 1 else ''} {named}{more} {verb} not used"

    def with_positions(self, angles: Geodetic, mapping: LogMapping) -> Self:
        """Return the sheet with columns of positions behind those of the file."""
        names = [*self.names]
        for key, place in angles.places.items():
            names[place] = key
        sheet = replace(self, names=names)
        sheet._require_widths()
        positions = angles.positions(sheet._numbers([*angles.places]), mapping)
        wider = sheet.with_numbers(dict.fromkeys(geodetic.AXES, "m"), positions.rows)
        return replace(wider, geodetic=positions)

    def with_numbers(self, units: dict[str, str], rows: Array) -> Self:
        """Return the sheet with further columns, of these names and units, without headings."""
        cells = (",".join(map("{:.17g}".format, row)) for row in rows.tolist())
        return replace(
            self,
            names=[*self.names, *units],
            headings=[*self.headings, *[""] * len(units)],
            units=self.units | units,
            lines=[f"{line},{more}" for line, more in zip(self.lines, cells, strict=True)],
        )

    def table(self, wanted: Collection[str]) -> LogTable:
        """Return the numbers of some of the columns.

        Raises
        ------
        InputError
            With the line and the error.
        """
        wanted = set(wanted)
        names = [name for name in self.names if name in wanted]
        self._require_widths()
        since, columns = 0.0, {}
        if "t" in names and self.units.get("t") == "ns":  # floats cannot hold them exactly
            since, columns["t"] = self._nanoseconds()
            names.remove("t")
        if names:
            for column, name in zip(self._numbers(names).T, names, strict=True):
                factor = factor_of(name, self.units.get(name, "")) * self.scale.get(name, 1.0)
                columns[name] = column if factor == 1.0 else column * factor
        return LogTable(self.name, columns, self.numbers, since)

    def numbers_of(self, names: list[str]) -> Array:
        """Return the numbers of some columns as they are written, ``(rows, len(names))``."""
        self._require_widths()
        return self._numbers(names)

    def _require_widths(self) -> None:
        width = len(self.names)
        for number, line in zip(self.numbers, self.lines, strict=True):
            if self.delimiter and '"' not in line:
                count = line.count(self.delimiter) + 1
            elif self.delimiter and line.count('"') % 2:
                raise self._error(number, "expected quotes in pairs")
            else:
                count = len(_entries(line, self.delimiter))
            if count < width or (count > width and not self.more):
                said = f"expected {width} entries, got {count}"
                if count > width and self.delimiter == "," and "." not in line:
                    said += (
                        "; if commas separate decimals, too, save the table with decimal points, "
                        "or with semicolons between columns"
                    )
                raise self._error(number, said)

    def _error(self, number: int, message: str) -> InputError:
        """Return the error of a line."""
        return InputError(f"{self.name}:{number}: {message}")

    def _numbers(self, names: list[str]) -> Array:
        place_of = {name: place for place, name in enumerate(self.names)}
        places = [place_of[name] for name in names]
        numbers = np.empty((len(self.lines), len(places)))
        options: Any = {"ndmin": 2, "quotechar": '"' if self.delimiter else None}
        for first in range(0, len(self.lines), CHUNK):
            chunk = self.lines[first : first + CHUNK]
            for cells in (None, _cell):  # slow, for empty cells
                with suppress(ValueError):
                    rows = np.loadtxt(
                        chunk, float, None, self.delimiter, cells, 0, places, **options
                    )
                    break
            else:
                raise self._wrong(first, len(chunk), names, places)
            numbers[first : first + len(chunk)] = rows
        return numbers

    def _wrong(self, first: int, count: int, names: list[str], places: list[int]) -> InputError:
        """Return the error of the first entry of some lines that is no number."""
        rows = zip(self.numbers[first:], self.lines[first : first + count], strict=False)
        wrong = (
            self._error(number, f"expected a finite number in column {name}, got text")
            for number, entries in ((k, _entries(line, self.delimiter)) for k, line in rows)
            for name, place in zip(names, places, strict=True)
            if entries[place].strip() and not _is_number(entries[place])
        )
        return next(wrong, self._error(self.numbers[first], "expected numbers after this line"))

    def _nanoseconds(self) -> tuple[float, Array]:
        """Return the first time and the times since then, s, subtracted as whole numbers."""
        place, times = self.names.index("t"), list[Decimal]()
        for number, line in zip(self.numbers, self.lines, strict=True):
            entry = _entries(line, self.delimiter)[place] if '"' in line else ""
            entry = entry or line.split(self.delimiter, place + 1)[place].strip()
            missing = _is_number(entry or "nan") and math.isnan(_cell(entry))
            exact = not missing and _is_number(entry) and 0 <= Decimal(entry) < 10**MAX_DIGITS
            if not exact and not missing:
                raise self._error(number, f"expected nanoseconds, got {_shown(entry)}")
            times.append(Decimal(entry if exact else "nan"))
        first = next((time for time in times if time.is_finite()), Decimal())
        return float(first) / 1e9, np.array([float(time - first) for time in times]) / 1e9


# Formats of extensions ----------------------------------------------------------------------------

CONVERTED = "# converted by eqt"
"""First line of a table that an extension made of a file of another program."""

DAMAGED = f"{CONVERTED}; parts of the file are damaged and were skipped"
"""First line of the table of a damaged file."""


# The lines of a file and its columns --------------------------------------------------------------


def open_sheet(text: str, name: str, form: TrajectoryFormat, mapping: LogMapping) -> Sheet:
    """Return the lines of a file, and its columns by eqt's names.

    Raises
    ------
    InputError
        If the header names no columns; a `MappingError` where the mapping does not fit it.
    """
    if form != "csv":
        return _without_header(text, name, form, mapping)
    lines, numbers = _lines(text, name)
    converted, damaged = text.startswith(CONVERTED), text.startswith(DAMAGED)
    lines, numbers = lines[converted:], numbers[converted:]
    number, header = (numbers[0], lines.pop(0)) if lines else (1, "")
    read = [_heading(entry.removeprefix("#").strip()) for entry in _entries(header, ",")]
    headings, words = [heading for heading, _ in read], header.split()
    if len(words) == MIN_ENTRIES and all(map(_is_number, words)):
        raise InputError(f"{name}:{number}: has 8 numbers separated by spaces; use the format tum")
    if not header or any(not entry or _is_number(entry) for entry in headings):
        raise InputError(
            f"{name}:{number}: expected a header that names the columns, such as t, qx, qy, qz, qw"
        )
    eqt_names = _renamed(headings, mapping, f"{name}:{number}")
    order = mapping.quaternion or ""
    units = {eqt: unit for eqt, (_, unit) in zip(eqt_names, read, strict=True)}
    usual = _usual(eqt_names, units, lines[:FIRST], mapping)
    eqt_names = [usual.get(eqt, (eqt,))[0] for eqt in eqt_names]
    units |= {eqt: units.pop(other, "") or unit for other, (eqt, unit) in usual.items()}
    sheet = Sheet(
        name, eqt_names, headings, units, ",", lines, numbers[1:], number, False, order, damaged
    )
    geodetic.refuse_lengths(mapping, units_of)
    angles = geodetic.geodetic_of(eqt_names, headings, units, mapping)
    return sheet if angles is None or not lines else sheet.with_positions(angles, mapping)


def _usual(
    names: list[str], units: Mapping[str, str], lines: list[str], mapping: LogMapping
) -> dict[str, tuple[str, str]]:
    """Return eqt's name and the unit of columns that are named as in other programs."""
    has_angles = mapping.geodetic is not None or any(map(geodetic.is_angle, names))
    taken = {*names, *geodetic.AXES} if has_angles else {*names}
    columns = usual_columns(names, taken)
    usual = {heading: (eqt, unit) for eqt, (heading, unit) in columns.items()}
    if "t" not in names:
        rows = [_entries(line, ",") for line in lines]
        if time := usual_time(names, units, rows):
            usual[time] = "t", ""
    return usual


def with_units(sheet: Sheet, mapping: LogMapping, used: Collection[str]) -> Sheet:
    """Return the sheet with the units of the mapping, once the units in use are checked.

    Raises
    ------
    InputError
        For a unit that its column cannot have, with its place.
    """
    units = dict(sheet.units)
    for key, name in [(k, name) for k in ("units", "scale") for name in getattr(mapping, k)]:
        is_one = name in (*sheet.names, *sheet.headings) or OF_COMMANDS.fullmatch(name)
        if not is_one or (key == "scale" and name not in sheet.names):
            hint = suggestion(name, used) or f"; expected one of {', '.join(used)}"
            raise MappingError((key, name), f"{sheet.name} has no column {name}{hint}")
    for name, unit in mapping.units.items():
        if name in used:
            factor_of(name, unit, ("units", name))
        in_header = units.get(name) or unit
        if in_header != unit and any(factor(in_header, unit) for unit in units_of(name)):
            raise MappingError(
                ("units", name),
                f"the header of {sheet.name} says {in_header} for {name}, got {unit}; remove one",
            )
        units[name] = unit
    for name in used:
        try:
            factor_of(name, units.get(name, ""))
        except InputError as error:
            raise InputError(f"{sheet.header_place}: {error.args[0]}") from None
    return replace(sheet, units=units, scale=mapping.scale)


def _renamed(headings: list[str], mapping: LogMapping, place: str) -> list[str]:
    """Return eqt's name for each heading."""
    for name, heading in mapping.columns.items():
        if heading not in headings:
            hint = suggestion(heading, headings) or "; write a heading of the file, without a unit"
            if name in headings and not is_eqt_name(name):
                hint = f"; eqt's name is first: write `{{{heading}: {name}}}`"
            raise MappingError(("columns", name), f"{place}: no column '{heading}'{hint}")
        if not is_eqt_name(name) and name not in geodetic.NAMES:
            examples = ", ".join(
                ("t", *pose_tables.QUATERNION, "yaw, pitch, roll, x, y, z, wx, vx")
            )
            raise MappingError(
                ("columns", name), f"eqt has no column of this name; it knows {examples} and others"
            )
    mapped = {heading: name for name, heading in mapping.columns.items()}
    # Where the mapping gives a name to another column, the column with this heading is not eqt's.
    names = []
    for heading in headings:
        spellings = (heading, heading.lower(), heading.capitalize())
        name = next(filter(is_eqt_name, spellings), heading)
        names.append(mapped.get(heading, f"{heading} (file)" if name in mapping.columns else name))
    numbered = next((four for four in NUMBERED if set(four) <= set(names)), None)
    if numbered is None or set(pose_tables.QUATERNION) & set(names):
        if mapping.quaternion is not None:
            raise MappingError(
                ("quaternion",),
                f"the columns of {place.rpartition(':')[0]} have names that show their order, "
                "such as qx, qy, qz, qw; remove this key",
            )
        return names
    if mapping.quaternion is None:
        raise MappingError(
            ("quaternion",),
            f"{place}: columns {', '.join(numbered)} do not show which is the scalar part w; add "
            f"`quaternion: wxyz` if it is {numbered[0]}, `quaternion: xyzw` if it is {numbered[3]}",
        )
    order = dict(zip(numbered, (f"q{axis}" for axis in mapping.quaternion), strict=True))
    return [order.get(column, column) for column in names]


def _without_header(text: str, name: str, form: str, mapping: LogMapping) -> Sheet:
    """Return the sheet of a file whose format has no header."""
    if text.startswith(CONVERTED):
        raise InputError(f"{name}: its content gives the format; leave out the format {form}")
    if mapping.columns:
        raise MappingError(
            ("columns",), f"the format {form} has no header; remove this key, or use format: csv"
        )
    is_euroc = form == "euroc"
    delimiter = "," if is_euroc else None
    lines, numbers = _lines(text, name, "#")
    names = list(_WITHOUT_HEADER[form])
    if mapping.quaternion is not None:
        parts = iter(f"q{axis}" for axis in mapping.quaternion)
        names = [next(parts) if column in pose_tables.QUATERNION else column for column in names]
    if lines:
        count = len(_entries(lines[0], delimiter))
        if count < MIN_ENTRIES or (count > MIN_ENTRIES and not is_euroc):
            separator = "commas" if delimiter else "spaces"
            raise InputError(
                f"{name}:{numbers[0]}: expected {MIN_ENTRIES} entries separated by "
                f"{separator}, got {count}"
            )
        names = names[: max(min(len(_entries(line, delimiter)) for line in lines), MIN_ENTRIES)]
    units = {"t": "ns"} if is_euroc else {}
    order = mapping.quaternion or ("wxyz" if is_euroc else "xyzw")
    return Sheet(name, names, names, units, delimiter, lines, numbers, 1, is_euroc, order)


def is_eqt_name(name: str) -> bool:
    """Whether eqt has a column of this name."""
    return bool(units_of(name) or _WITHOUT_UNIT.fullmatch(name))


def _heading(entry: str) -> tuple[str, str]:
    """Return the name and the unit of a heading."""
    for at in range(max(0, len(entry) - MOST_UNIT), len(entry)):  # "a (b) (m)" is a, in b) (m
        if entry[at] in "([" and _UNIT.fullmatch(entry, at):
            return entry[:at].rstrip(), entry[at + 1 : -1].strip()
    return entry, ""


def _lines(text: str, name: str, comment: str = "") -> tuple[list[str], Sequence[int]]:
    """Return the lines that are neither empty nor comments, and their line numbers."""
    lines = text.removeprefix("\ufeff").splitlines()
    numbers: Sequence[int] = range(1, len(lines) + 1)
    if comment or not all(map(str.strip, lines)):
        stripped = ((number, line.lstrip()) for number, line in zip(numbers, lines, strict=True))
        numbers = [k for k, line in stripped if line and not (comment and line[0] == comment)]
        lines = [lines[number - 1] for number in numbers]
    if max(map(len, lines), default=0) > pose_tables.MAX_LINE:
        row = next(row for row, line in enumerate(lines) if len(line) > pose_tables.MAX_LINE)
        raise InputError(
            f"{name}:{numbers[row]}: expected a line of at most {pose_tables.MAX_LINE} characters, "
            f"got {len(lines[row])}"
        )
    return lines, numbers


def _entries(line: str, delimiter: str | None) -> list[str]:
    entries = next(csv.reader([line])) if delimiter and line else line.split()
    return [entry.strip() or " " for entry in entries]


def _shown(entry: str) -> str:
    """Return a wrong entry for a message; text is not quoted, because it may be of any file."""
    short = _is_number(entry) and len(entry) <= MAX_SHOWN
    return f"'{entry}'" if short else "text" if entry.strip() else "an empty cell"


def _cell(entry: str) -> float:
    """Return the number in an entry, NaN where it is empty; text is a `ValueError`."""
    return float(entry.strip().replace("_", "text") or "nan")  # 1_0 is a number of Python only


def _is_number(entry: str) -> bool:
    with suppress(ValueError):
        return bool(entry.strip()) and isinstance(_cell(entry), float)
    return False
