"""Finds where telemetry was lost at the end of a table, whose rows go on along straight lines."""

import csv
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.components.pose_tables import LogMapping
from eqt_cli.extensions.logs.log_table import Sheet, open_sheet, with_units
from eqt_cli.extensions.logs.recording import in_span

ROWS, COLUMNS, LONGER = 25, 6, 4
"""Least number of rows and of columns that go straight on, and by how many times longer they do so
at the end than before: rows between those of slow telemetry lie on straight lines, too."""

STRAIGHT = 1e-6
"""Largest second difference of a straight line, as a share of the largest number of its column:
tables have numbers of seven digits or more."""


class Lost(NamedTuple):
    """Where straight lines begin: the time of the row, s, and the columns and rows on them."""

    time: float
    columns: int
    rows: int

    def __str__(self) -> str:
        """What is there, and what to do."""
        what = f"{self.columns} columns go straight on in the last {self.rows} rows"
        advice = f"leave them out by `time: {{end: {self.time:.13g}}}` in the mapping"
        return f"{what}, from {self.time:.13g} s: telemetry was lost there; {advice}"


def remark(text: str, name: str, mapping: LogMapping) -> str:
    """Say where telemetry was lost in a table, among the rows that a mapping keeps."""
    sheet = open_sheet(text, name, "csv", mapping)
    if "t" not in sheet.names:
        return ""
    table = with_units(sheet, mapping, ["t"]).table(["t"])
    times = (table.columns["t"] + table.since) * mapping.time.scale
    lost = lost_at_end(sheet, times)
    if lost is None or np.sum(in_span(mapping.time, times) & (times > lost.time)) < ROWS:
        return ""
    return f"{lost}"


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
