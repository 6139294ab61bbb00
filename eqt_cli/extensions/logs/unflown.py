"""Finds rows of a table that were not flown: lost telemetry, jumps, a law that is switched off.

Such rows become blank lines, so that the others keep their line numbers.
"""

import csv
from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import InputError
from eqt_cli.base.reporting import count_of
from eqt_cli.components.pose_tables import LogMapping
from eqt_cli.extensions.logs.log_table import MOST_ODD, Sheet, open_sheet, with_units
from eqt_cli.extensions.logs.recording import in_span
from eqt_cli.extensions.logs.setpoints import setpoint_columns
from eqt_cli.extensions.logs.usual_names import Column

ROWS, COLUMNS, LONGER = 25, 6, 4
"""Least number of rows and of columns that go straight on, and by how many times longer they do so
at the end than before: rows between those of slow telemetry lie on straight lines, too."""

STRAIGHT = 1e-6
"""Largest second difference of a straight line, as a share of the largest number of its column:
tables have numbers of seven digits or more."""

FASTER, FASTEST = 4.0, 10.0
"""A step between rows is a jump if it differs from those before and after, and its speed is more
than so many times the 95th percentile of the steps, and more than so many m/s: positions that were
lost, and are written as 0 or taken from another body, give 12 to 200 m/s."""

OFF, LAST, FEWEST = 8.0, 0.01, 3
"""By how many times a setpoint or a command steps more than in 99 % of its steps where a law was
switched off, and the share, or the number, of the last rows among which this is looked for."""

MOST_SHOWN = 4
"""Number of times that a remark names."""

AXES, WRENCH = [*"xyz"], "tx ty tz fx fy fz".split()


def flown_rows(text: str, name: str, mapping: LogMapping) -> tuple[str, list[str]]:
    """Return a table without the rows that were not flown, and remarks on these.

    They are looked for among the rows that a mapping keeps. Lost telemetry stays where it states an
    end of its own, and jumps where they are more than `MOST_ODD` of the rows.
    """
    sheet = open_sheet(text, name, "csv", mapping)
    if "t" not in sheet.names or len(sheet.lines) <= FEWEST:
        return text, []
    table = with_units(sheet, mapping, ["t"]).table(["t"])
    times = (table.columns["t"] + table.since) * mapping.time.scale
    inside, flown, remarks = in_span(mapping.time, times), np.ones(len(times), bool), list[str]()
    for rows, words in _unflown(sheet, times, mapping):
        left = flown & ~np.isin(np.arange(len(times)), rows)
        if np.any(flown & inside & ~left) and np.sum(left & inside) > FEWEST:
            flown, remarks = left, [*remarks, words]
    if not remarks:
        return text, []
    lines = text.removeprefix("\ufeff").splitlines()
    for row in np.flatnonzero(~flown).tolist():
        lines[sheet.numbers[row] - 1] = ""
    return "\n".join([*lines, ""]), remarks


def _unflown(sheet: Sheet, times: Array, mapping: LogMapping) -> Iterator[tuple[Array, str]]:
    """Yield rows that were not flown, with what they are."""
    if mapping.time.end is None and (lost := lost_at_end(sheet, times)):
        yield np.flatnonzero(times > lost.time), f"{lost}"
    if {*AXES} <= {*sheet.names}:
        with suppress(InputError):  # which is raised where the poses are read
            places = with_units(sheet, mapping, AXES).table(AXES).get(AXES)
            yield from _jumps(places, times)
    columns = setpoint_columns(sheet, mapping).values()
    headings = {x.heading for x in columns if isinstance(x, Column)}
    pairs = zip(sheet.names, sheet.headings, strict=True)
    if commands := [name for name, heading in pairs if heading in headings or name in WRENCH]:
        with suppress(InputError):
            yield from _switched_off(sheet.numbers_of(commands), times)


class Lost(NamedTuple):
    """Where straight lines begin: the time of the row, s, and the columns and rows on them."""

    time: float
    columns: int
    rows: int

    def __str__(self) -> str:
        """What is there, and what to do."""
        what = f"{self.columns} columns go straight on in the last {self.rows} rows"
        where = f"from {self.time:.13g} s: telemetry was lost there, and these rows are left out"
        return f"{what}, {where}; `time: {{end: …}}` in a mapping keeps them until then"


def lost_at_end(sheet: Sheet, times: Array) -> Lost | None:
    """Return where most numbers of a table begin to go straight on until its end, if they do."""
    numbers = _numbers(sheet)
    if len(numbers) != len(times) or len(numbers) < 2 * ROWS:
        return None
    scale = np.abs(numbers).max(axis=0)
    steps = np.diff(numbers, axis=0) / np.where(scale > 0, scale, 1.0)
    uneven = np.diff(times)[:, None]  # rows need not be equally far apart
    slopes = steps / np.where(uneven > 0, uneven, np.nan)
    with np.errstate(invalid="ignore"):
        bent = abs(np.diff(slopes, axis=0) * uneven[1:]) > STRAIGHT
        moves = abs(steps[1:]) > STRAIGHT
    goes_on = moves & ~bent
    is_straight = goes_on.sum(axis=1) >= COLUMNS
    breaks = np.flatnonzero(~is_straight)
    last = len(is_straight) - 1 - (breaks[-1] if len(breaks) else -1)
    before = np.diff(breaks, prepend=-1).max(initial=1) - 1
    if last < max(ROWS, LONGER * before):
        return None
    columns = int(goes_on[-last:].all(axis=0).sum())
    return Lost(float(times[-last - 1]), columns, int(last)) if columns >= COLUMNS else None


def _numbers(sheet: Sheet) -> Array:
    """Return all columns of numbers but the time; none where rows differ in their length."""
    rows = csv.reader(sheet.lines) if sheet.delimiter else (line.split() for line in sheet.lines)
    numbers = list[Array]()
    with suppress(ValueError):
        columns = [*zip(*rows, strict=True)]
        for name, column in zip(sheet.names, columns, strict=False):
            with suppress(ValueError):  # a column of text
                numbers += [np.array(column, float)] if name != "t" else []
    finite = [column for column in numbers if np.isfinite(column).all()]
    return np.stack(finite, axis=-1) if finite else np.empty((0, 0))


@np.errstate(all="ignore")  # absurd numbers overflow
def _jumps(places: Array, times: Array) -> Iterator[tuple[Array, str]]:
    """Yield rows between jumps, to which no plausible speed leads from the rows around them."""
    rows = np.flatnonzero(np.isfinite(places).all(axis=1) & np.isfinite(times))
    if len(rows) <= FEWEST:
        return
    p, t = places[rows], times[rows]
    steps, apart = np.diff(p, axis=0), np.diff(t)
    apart = np.maximum(apart, np.median(apart))  # stamps may jitter
    speeds = norm(steps) / apart
    limit = max(FASTER * float(np.percentile(speeds, 95)), FASTEST)
    turns = norm(np.diff(steps, axis=0))
    alone = np.r_[True, turns > limit / 2 * apart[1:]]
    alone[:-1] &= turns > limit / 2 * apart[:-1]
    edges = np.flatnonzero((speeds > limit) & alone) + 1
    parts = np.split(np.arange(len(p)), edges)

    def leads(i: int, j: int) -> bool:
        return bool(norm(p[j] - p[i]) <= limit * max(t[j] - t[i], float(np.median(apart))))

    longest = max(range(len(parts)), key=lambda k: len(parts[k]))
    flown = [parts[longest]]
    for part in parts[longest + 1 :]:
        flown += [part] if leads(flown[-1][-1], part[0]) else []
    for part in parts[:longest][::-1]:
        flown = [part, *flown] if leads(part[-1], flown[0][0]) else flown
    out = np.setdiff1d(np.arange(len(p)), np.concatenate(flown))
    if not len(out) or len(out) > MOST_ODD * len(p):
        return
    begins = out[np.diff(out, prepend=-2) > 1]
    when = [f"{time:.10g}" for time in t[begins[:MOST_SHOWN]].tolist()]
    more = f" and {len(begins) - MOST_SHOWN} times more" if len(begins) > MOST_SHOWN else ""
    zeros = int(np.sum(~p[out].any(axis=1)))
    at_zero = f", {zeros} of them at 0" if zeros else ""
    fastest = speeds[edges - 1].max()
    words = f"positions jump by up to {fastest:.3g} m/s at {', '.join(when)} s{more}"
    yield rows[out], f"{words}: {count_of(len(out), 'row')} left out{at_zero}"


def _switched_off(numbers: Array, times: Array) -> Iterator[tuple[Array, str]]:
    """Yield the last rows, from where setpoints or commands step as they do nowhere before."""
    last = max(FEWEST, int(LAST * len(times)))
    steps = abs(np.diff(numbers, axis=0))
    if len(steps) < 4 * last or not np.isfinite(numbers).all():
        return
    usual = np.array([np.percentile(x[x > 0], 99) if x.any() else np.inf for x in steps[:-last].T])
    odd = np.flatnonzero((steps[-last:] > OFF * usual).any(axis=1))
    if len(odd):
        row = len(times) - last + int(odd[0])
        what = f"setpoints or commands step as nowhere before at {times[row]:.10g} s"
        left = f"{count_of(len(times) - row, 'row')} at the end left out"
        yield np.arange(row, len(times)), f"{what}, as where a law is switched off: {left}"
