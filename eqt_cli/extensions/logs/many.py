"""Many flights at once: a line for a flight, and its errors."""

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.api.loading import path_from
from eqt_cli.base.arrays import norm
from eqt_cli.base.errors import EqtError
from eqt_cli.base.files import content_of, refusals
from eqt_cli.base.reporting import Block, TextTable, significant, step
from eqt_cli.extensions.logs import api, logs
from eqt_cli.extensions.logs.flight_list import ListedFlight, flights_in, write_list
from eqt_cli.extensions.logs.logs import Series
from eqt_cli.extensions.logs.same_motion import Motion, motion_of, twins

SMOOTH = 0.1
"""Time over which a speed is measured, s, so that noise from row to row is none."""

NEEDED = ("position", "attitude")
"""What is named as missing."""


@dataclass(frozen=True)
class FlightLine:
    """What a recording holds, in a line.

    Attributes
    ----------
    flight
        The recording, as a list has it.
    seconds, rate, gaps, speed
        Its length, s, rows in a s, number of gaps, and mean speed, m/s; NaN if unknown.
    error, unit
        Rms distance from the setpoints, m, or of attitudes deg; NaN without setpoints.
    missing
        Which of position, attitude and setpoints it lacks.
    twice
        An earlier recording of the same flight, in words; else empty.
    problem
        Why it cannot be used; else empty.
    notes
        Rows that were left out.
    """

    flight: ListedFlight
    seconds: float = math.nan
    rate: float = math.nan
    gaps: int = 0
    speed: float = math.nan
    error: float = math.nan
    unit: str = ""
    missing: tuple[str, ...] = ()
    twice: str = ""
    problem: str = ""
    notes: tuple[str, ...] = ()

    @property
    def record(self) -> dict[str, Any]:
        """The line, for programs."""
        one = {"file": f"{self.flight.file}", "law": self.flight.law}
        return one | {name: x for name, x in vars(self).items() if name != "flight"}


@dataclass(frozen=True)
class FlightsCheck:
    """Recordings of a list or a folder.

    Attributes
    ----------
    lines
        A line for each.
    usable
        Those that can be used, and no other one holds.
    """

    lines: list[FlightLine]

    @property
    def usable(self) -> list[ListedFlight]:
        """Return the flights that can be used, without those that stand twice."""
        return [line.flight for line in self.lines if not (line.problem or line.twice)]

    def table(self) -> TextTable:
        """Return the table of lines, with what was left out below it."""
        rows = []
        for x in self.lines:
            unit = f" {x.unit}" if x.unit else ""
            numbers = (significant(value, 3) for value in (x.seconds, x.rate))
            rest = [f"{x.gaps}", significant(x.speed, 3), f"{significant(x.error, 3)}{unit}"]
            words = [", ".join(x.missing) or "-", x.twice.partition(",")[0] or "-"]
            rows.append([x.flight.file.name, x.flight.law or "-", *numbers, *rest, *words])
        header = ["file", "law", "s", "Hz", "gaps", "m/s", "error", "missing", "twice"]
        notes = [f"{x.flight.file.name}: {note}." for x in self.lines for note in x.notes]
        return TextTable("flights", "", header, [Block("", rows)], notes, spare=("law",))


def check_flights(
    path: str | os.PathLike[str],
    mapping: api.MappingSource = None,
    *,
    format: str = "csv",
    out: str | os.PathLike[str] | None = None,
) -> FlightsCheck:
    """Check all recordings of a list or a folder, and find flights that stand twice.

    Parameters
    ----------
    path
        A list of flights, a folder, or a recording.
    mapping, format
        As for `check_log`, for recordings without a mapping in the list.
    out
        Path of a list of the usable flights, such as ``flights.csv``, which must not exist.

    Returns
    -------
    FlightsCheck
        A line for each recording.

    Raises
    ------
    EqtError
        If the list or the folder cannot be read, or the new list cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> from pathlib import Path
    >>> t = np.linspace(0, 20, 201)
    >>> for law, size in (("pid", 0.9), ("lee", 1.1)):
    ...     Path("flights", law).mkdir(parents=True, exist_ok=True)
    ...     rows = np.c_[t, np.sin(t), size * np.cos(t), 0 * t]
    ...     np.savetxt(f"flights/{law}/1.csv", rows, delimiter=",", header="t,x,y,z", comments="")
    >>> check = eqt_cli.check_flights("flights", out="flights.csv")
    >>> [(line.flight.law, round(line.rate), line.missing) for line in check.lines]
    [('lee', 10, ('attitude', 'setpoints')), ('pid', 10, ('attitude', 'setpoints'))]
    """
    flights, motions = flights_in(path), dict[str, Motion]()
    first, lines = dict[str, int](), list[FlightLine]()
    with step("flights", len(flights)) as progress:
        for number, flight in enumerate(flights):
            line, motion = _line(flight, mapping, format)
            if not line.problem:
                same = first.setdefault(_digest(flight), number)
                if same != number:
                    words = f"{flights[same].file.name}, the same file"
                    line = replace(line, twice=words)
                elif motion is not None:
                    motions[f"{number}"] = motion
            lines.append(line)
            progress.advance(1)
    for twin in twins(motions):
        longer, other = sorted((int(twin.first), int(twin.name)), key=lambda k: -lines[k].seconds)
        lines[other] = replace(lines[other], twice=f"{flights[longer].file.name}, {twin.words}")
    check = FlightsCheck(lines)
    if out is not None:
        if not check.usable:
            raise EqtError(f"{path}: holds no flight that can be used; {lines[0].problem}")
        shared = Path(mapping) if isinstance(mapping, str | os.PathLike) else None
        rows = [replace(x, mapping=x.mapping or shared) for x in check.usable]
        write_list(rows, path_from("out", out))
    return check


def _line(
    flight: ListedFlight, mapping: api.MappingSource, format: str
) -> tuple[FlightLine, Motion | None]:
    """Return the line of a recording, and its motion."""
    how = {"mapping": mapping, "format": format} | flight.how
    file, columns = flight.file, how["mapping"]
    with api.reading_once():
        try:
            measured = api.measured_series(file, columns, format)
            check = api.check_log(file, columns, format=format) if {*NEEDED} & {*measured} else None
            if check is None or check.problems:
                why = check.problems[0] if check else "holds neither positions nor attitudes"
                return FlightLine(flight, problem=why), None
        except EqtError as error:
            return FlightLine(flight, problem=f"{error}".partition("\n")[0]), None
        ends = span_of(flight, check.begin, check.end)
        gaps = [t for t, _ in check.gaps if ends[0] <= t < ends[1]]
        line = FlightLine(flight, ends[1] - ends[0], check.rate, len(gaps))
        if ends[0] >= ends[1]:
            why = f"begin: no rows are left; the recording is from {check.begin:.13g}"
            return replace(line, problem=f"{file}: {why} to {check.end:.13g} s"), None
        measured = {name: _part(series, *ends) for name, series in measured.items()}
        motion = motion_of(measured)
        missing = [name for name in NEEDED if name not in measured]
        try:
            errors = api.log_errors(flight.file, **how)
        except EqtError:
            missing.append("setpoints")
            line = replace(line, notes=tuple(x for x in check.notes if "left out" in x))
        else:
            size, motion = errors.sizes[0], motion_of(errors.actual) or motion
            line = replace(line, error=size.rms, unit=size.unit, notes=errors.remarks)
    speed = _speed(measured["position"]) if "position" in measured else math.nan
    return replace(line, speed=speed, missing=tuple(missing)), motion


def span_of(flight: ListedFlight, first: float, last: float) -> tuple[float, float]:
    """Return the part of a recording that a row of a list takes, s."""
    ends = [first, last]
    for k, text in enumerate((flight.begin, flight.end)):
        if text:
            ends[k] = float(text) + (first if text.startswith("+") else 0.0)
    return max(ends[0], first), min(ends[1], last)


def _part(series: Series, begin: float, end: float) -> Series:
    rows = (begin <= series.times) & (series.times <= end)
    return series._replace(times=series.times[rows], numbers=series.numbers[rows])


def _speed(position: Series) -> float:
    """Return the mean speed, m/s, by steps of `SMOOTH`."""
    t = position.times
    rows = np.unique(np.searchsorted(t, np.arange(t[0], t[-1], SMOOTH)))
    length = float(norm(np.diff(position.numbers[rows], axis=0)).sum())
    return length / float(t[-1] - t[0]) if t[-1] > t[0] else math.nan


def _digest(flight: ListedFlight) -> str:
    """Return what tells a part of a file from others."""
    with refusals(flight.file, "read"):
        return digest_of(flight.file) + f" {flight.begin} {flight.end}"


def digest_of(file: Path) -> str:
    """Return the SHA-256 of a recording."""
    parts = sorted(file.iterdir()) if file.is_dir() else [file]
    return sha256(b"".join(content_of(part, logs.MAX_BYTES) for part in parts)).hexdigest()


@contextmanager
def placed(flight: ListedFlight) -> Iterator[None]:
    """Say in which row of a list an error is."""
    try:
        yield
    except EqtError as error:
        if not flight.place:
            raise
        raise EqtError(f"{flight.place}: {error.args[0]}", lines=error.lines) from None


# Errors of all flights ----------------------------------------------------------------------------


@dataclass(frozen=True)
class FlightErrors:
    """The errors of the flights of a list.

    Attributes
    ----------
    rows
        Of each flight, file, law, condition and factors, the rms error by the quantity in its
        unit, and the delay of the first one, s; NaN where it is not significant.
    notes
        Rows that were left out, and what is compared.
    """

    rows: list[dict[str, Any]]
    notes: list[str]

    def table(self) -> TextTable:
        """Return the table of all flights."""
        names = dict.fromkeys(name for row in self.rows for name in row)
        cells = [[row.get(name, "") for name in names] for row in self.rows]
        texts = [
            [significant(x, 3) if type(x) is float else x or "-" for x in row] for row in cells
        ]
        return TextTable("errors", "", [*names], [Block("", texts)], self.notes)


def errors_of_flights(flights: Sequence[ListedFlight], **how: Any) -> FlightErrors:
    """Measure the errors of flights; arguments as of `log_errors`, for all that a row leaves open.

    Raises
    ------
    EqtError
        If a flight cannot be read, or has nothing to compare.
    """
    rows, notes = list[dict[str, Any]](), dict[str, None]()
    with step("flights", len(flights)) as progress:
        for flight in flights:
            one = flight.file.name
            with placed(flight):
                errors = api.log_errors(flight.file, **how | flight.how)
            row: dict[str, Any] = {"file": one, "law": flight.law} | flight.settings
            whole = {x.quantity: x for x in reversed(errors.sizes)}
            for size in reversed([*whole.values()]):
                row[f"{size.quantity}, {size.unit}"] = size.rms
            row["delay, s"] = errors.sizes[0].delay
            rows.append(row)
            notes |= {f"{one}: {remark}.": None for remark in errors.remarks}
            progress.advance(1)
    return FlightErrors(rows, [*notes])
