"""Lists of flights: a table with a row for a flight, which all commands of flights take.

Its columns are those of `COLUMNS`; further ones are factors, such as the wind of a flight.
"""

import csv
import io
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eqt_cli.api.loading import path_from
from eqt_cli.base.errors import EqtError, InputError
from eqt_cli.base.files import TEXT_BYTES, near, new_file, open_regular, refusals, text_of
from eqt_cli.extensions.logs import FORMATS_BY_SUFFIX
from eqt_cli.extensions.logs.first_bytes import format_of

COLUMNS = ("file", "law", "pair", "condition", "mapping", "setpoint", "begin", "end")
"""The file of a flight; its law or setting; the number of its pair; what was the same for several
flights; a mapping; a file of what was wanted, or the topic of the setpoints; and the part to take.
"""

MOST_NAMED = 10
"""Number of bad rows that a message names."""


@dataclass(frozen=True)
class ListedFlight:
    """A row of a list of flights.

    Attributes
    ----------
    place
        The list and the line, for messages; empty for a file that stands in no list.
    file
        The recording.
    law, pair, condition
        Its setting, its pair, and what it shares with others; empty where the list has none.
    mapping, second
        Files, or None: how the recording is read, and the desired motion.
    setpoint
        The topic of the setpoints.
    begin, end
        First and last time, s, as text: 12.5, or +5 from the first row.
    factors
        Further columns.
    """

    file: Path
    place: str = ""
    law: str = ""
    pair: str = ""
    condition: str = ""
    mapping: Path | None = None
    second: Path | None = None
    setpoint: str = ""
    begin: str = ""
    end: str = ""
    factors: dict[str, str] = field(default_factory=dict)

    @property
    def how(self) -> dict[str, Any]:
        """The arguments of `log_errors` that the row gives."""
        names = ("mapping", "second", "setpoint", "begin", "end")
        return {name: getattr(self, name) for name in names if getattr(self, name)}

    @property
    def settings(self) -> dict[str, str]:
        """The condition and the factors, by name."""
        condition = {"condition": self.condition} if self.condition else {}
        return condition | {name: text for name, text in self.factors.items() if text}


def is_list(path: Any) -> bool:
    """Whether a file is a list of flights: a table with a column of files."""
    with suppress(OSError, EqtError, ValueError), open_regular(path_from("path", path)) as stream:
        head = stream.readline(TEXT_BYTES).decode("utf-8-sig")
        return "file" in _cells(head, _delimiter(head))
    return False


def flights_in(path: str | os.PathLike[str]) -> list[ListedFlight]:
    """Return the flights of a list or of a folder and those below it, or a single recording.

    A folder with ``metadata.yaml`` is a bag, and so a recording. Below a folder, the name of the
    folder of a recording is its law.
    """
    place = path_from("path", path)
    if is_list(place):
        return read_list(place)
    if not place.is_dir() or format_of(place) or (place / "metadata.yaml").exists():
        return [ListedFlight(place)]
    flights = [*_below(place, "")]
    if not flights:
        suffixes = ", ".join((*FORMATS_BY_SUFFIX, ".csv"))
        raise EqtError(f"{place}: holds no recordings; expected files that end in {suffixes}")
    return flights


def _below(folder: Path, law: str) -> Iterator[ListedFlight]:
    with refusals(folder, "read"):
        yield from (ListedFlight(file, law=law) for file in recordings_in(folder))
        for inner in sorted(x for x in folder.iterdir() if x.is_dir() and not x.is_symlink()):
            if inner.name[0] != "." and not format_of(inner):
                yield from _below(inner, inner.name)


def recordings_in(folder: Path) -> list[Path]:
    """Return the recordings in a folder, but for lists of flights."""
    suffixes = (*FORMATS_BY_SUFFIX, ".csv")
    files = (file for file in folder.iterdir() if file.is_file() or file.suffix or format_of(file))
    fits = [file for file in files if file.suffix.lower() in suffixes or format_of(file)]
    return sorted(file for file in fits if not is_list(file))


def rows_of(path: Path, *columns: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield the rows of a table that has these columns, with their places.

    Raises
    ------
    InputError
        If it lacks a column, or a row has another number of cells.
    """
    first, *lines = text_of(path, "check the path").removeprefix("\ufeff").splitlines() or [""]
    names = _names(path, _cells(first, _delimiter(first)))
    for column in columns:
        if column not in names:
            raise InputError(f"{path}:1: expected a column {column}, got {', '.join(names)}")
    for number, line in enumerate(lines, 2):
        if any(cells := _cells(line, _delimiter(first))):
            if len(cells) != len(names):
                raise InputError(f"{path}:{number}: expected {len(names)} cells, got {len(cells)}")
            yield f"{path}:{number}", dict(zip(names, cells, strict=True))


def read_list(path: Path) -> list[ListedFlight]:
    """Read a list of flights; files are relative to its folder.

    Raises
    ------
    EqtError
        With line, column, value and advice of the wrong rows.
    """
    text = text_of(path, "check the path").removeprefix("\ufeff")
    first, *lines = text.splitlines() or [""]
    delimiter = _delimiter(first)
    names = _names(path, _cells(first, delimiter))
    flights, wrong, before = list[ListedFlight](), list[str](), dict[Any, int]()
    for number, line in enumerate(lines, 2):
        cells, problems = _cells(line, delimiter), list[str]()
        if not any(cells):
            continue
        if len(cells) == len(names):
            row = dict(zip(names, cells, strict=True))
            flight = _flight(path.parent, f"{path}:{number}", row, problems)
            which = flight.file, flight.begin, flight.end
            if not problems and before.setdefault(which, number) != number:
                advice = "a flight stands once; remove a row, or give parts by begin and end"
                problems.append(f"file: '{row['file']}' is in line {before[which]}, too; {advice}")
            flights.append(flight)
        else:
            expected = f"expected {len(names)} cells, one for each column, got {len(cells)}"
            quote = f"; write a text with {delimiter} in quotes" if len(cells) > len(names) else ""
            problems.append(f"{expected}{quote}")
        wrong += [f"{path}:{number}: {problem}" for problem in problems]
    if wrong:
        more = [f"and {len(wrong) - MOST_NAMED} more"] if len(wrong) > MOST_NAMED else []
        raise InputError(wrong[0], lines=[*wrong[1:MOST_NAMED], *more])
    if not flights:
        raise InputError(f"{path}: lists no flights; add a row for each, with its file")
    return flights


def _names(path: Path, names: list[str]) -> list[str]:
    """Return the names of the columns, or refuse wrong ones."""
    for place, name in enumerate(names, 1):
        if not name or names.count(name) > 1:
            what = f"columns {place} and others are named {name}" if name else f"column {place}"
            raise InputError(f"{path}:1: {what}{'' if name else ' has no name'}; rename it")
        meant = name.lower().rstrip("s")
        if name not in COLUMNS and meant in COLUMNS:  # else it would be a factor
            raise InputError(f"{path}:1: column '{name}'; did you mean '{meant}'?")
    return names


def _flight(folder: Path, place: str, row: dict[str, str], problems: list[str]) -> ListedFlight:
    """Return the flight of a row; note what is wrong with it."""

    def file(name: str, what: str) -> Path | None:
        text = row.get(name, "")
        path = folder / text
        if text and not path.exists():
            hint = near(path, lambda entry: entry.suffix == path.suffix)
            where = f"{what}; paths start at the folder of the list"
            problems.append(f"{name}: '{text}' was not found; expected {where}{hint}")
        return path if text else None

    if not row["file"]:
        problems.append("file: is empty; give the recording of the flight, or remove the row")
    recording = file("file", "a recording")
    mapping = file("mapping", "a YAML file as for --mapping")
    goal = row.get("setpoint", "")
    second = folder / goal if goal and (folder / goal).exists() else None
    if goal and second is None and Path(goal).suffix.lower() in (".csv", *FORMATS_BY_SUFFIX):
        file("setpoint", "a recording of the desired motion, or the topic of the setpoints")
    ends = [row.get(name, "") for name in ("begin", "end")]
    for name, text in zip(("begin", "end"), ends, strict=True):
        if text and not _is_time(text):
            expected = "seconds, as 12.5 by the clock of the file or +5 from its first row"
            problems.append(f"{name}: expected {expected}, got '{text}'")
    both = all(map(_is_time, ends)) and len({text[0] == "+" for text in ends}) == 1
    if both and float(ends[0]) >= float(ends[1]):
        problems.append(f"end: expected a time after begin, {ends[0]} s, got {ends[1]} s")
    factors = {name: text for name, text in row.items() if name not in COLUMNS}
    texts = {name: row.get(name, "") for name in ("law", "pair", "condition", "begin", "end")}
    more: Any = texts | {"setpoint": "" if second else goal, "factors": factors}
    return ListedFlight(recording or folder, place, mapping=mapping, second=second, **more)


def _is_time(text: str) -> bool:
    with suppress(ValueError):
        return math.isfinite(float(text))
    return False


def _delimiter(head: str) -> str:
    return next((c for c in ",;\t" if c in head), ",")


def _cells(line: str, delimiter: str) -> list[str]:
    with suppress(csv.Error):  # of a cell of more than 128 KiB, such as a line of a large file
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    return [line[:100]]


def write_list(flights: Sequence[ListedFlight], path: Path) -> None:
    """Write a list of flights, with paths relative to its folder; replace none."""
    factors = dict.fromkeys(name for flight in flights for name in flight.factors)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*COLUMNS, *factors])
    for flight in flights:
        writer.writerow([*_row(flight, path.parent), *map(flight.factors.get, factors)])
    with refusals(path, "written"):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            new_file(path, stream.getvalue().encode())
        except FileExistsError:
            advice = "choose another name, or remove it: its laws and factors may be yours"
            raise EqtError(f"{path}: exists; {advice}") from None


def _row(flight: ListedFlight, folder: Path) -> Iterator[str]:
    for name in COLUMNS:
        value = (flight.second or flight.setpoint) if name == "setpoint" else getattr(flight, name)
        is_file = isinstance(value, Path)
        yield Path(os.path.relpath(value, folder)).as_posix() if is_file else f"{value or ''}"
