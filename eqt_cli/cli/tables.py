"""Tables on the terminal, as CSV and in LaTeX."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from typing import Any

from rich.cells import cell_len
from rich.text import Text

from eqt_cli.base.errors import printable
from eqt_cli.base.reporting import MARKS, Block, TextTable, words

# Text tables as LaTeX and CSV; this module knows no command ---------------------------------------


_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Characters that begin a formula in a spreadsheet."""

_PLAIN_NUMBER = re.compile(r"[-+$]*\d[\d.]*( \\?%)?")


MOST_COLUMNS = {1: 3, 2: 7}
"""Maximum number of columns of a LaTeX table by the columns of text that it spans."""


def as_latex(table: TextTable, text_columns: int = 2) -> str:
    """Return booktabs tables, with the caption and the notes as comments.

    A column with equal cells is left out, and the caption says what they are.
    """
    across = list(zip(table.header, *table.rows, strict=True))[table.keys :]
    same = [column[:2] for column in across if len(column) > 2 and len({*column[1:]}) == 1]
    said = "".join(f"; {heading}: {cell}" for heading, cell in same if cell not in ("", "-"))
    table = replace(table.without([heading for heading, _ in same]), caption=table.caption + said)
    columns = map(_tabular, table.narrow(MOST_COLUMNS[text_columns]))
    # Names of measures wrap in one column of text.
    first = r"{@{}p{0.28\columnwidth}" if text_columns == 1 else "{@{}l"
    return "\n\n".join(column.replace("{l", first, 1) for column in columns)


def _tabular(table: TextTable) -> str:
    numeric = [
        all(_PLAIN_NUMBER.fullmatch(cell) for cell in column if cell not in ("", "-"))
        for column in zip(*table.rows, strict=True)
    ]
    layout = "".join("r" if right else "l" for right in numeric)
    lines = [f"% {table.caption}", rf"\begin{{tabular}}{{{layout}@{{}}}}", r"\toprule"]
    lines.append(_latex_row(map(_heading, table.header)))
    for block in table.blocks:
        lines.append(r"\midrule")
        if block.title:
            width = len(table.header)
            lines.append(rf"\multicolumn{{{width}}}{{l}}{{{block.title}}} \\")
        lines += [_latex_row(row) for row in block.rows]
    lines += [r"\bottomrule", r"\end{tabular}", *(f"% {note}" for note in table.notes)]
    return "\n".join(lines)


def _heading(text: str) -> str:
    r"""Return a heading, with its window and its unit in lines of their own."""
    lines = r" \\ ".join(text.split(", "))
    return rf"\shortstack[l]{{{lines}}}" if ", " in text else text


def as_csv(records: Sequence[Mapping[str, Any]]) -> str:
    """Return comma-separated values with a header line; missing values are empty."""
    names = list(dict.fromkeys(name for record in records for name in record))
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(map(csv_cell, names))
    for record in records:
        row = [record.get(name, "") for name in names]
        # NaN is missing.
        writer.writerow("" if value != value else csv_cell(value) for value in row)
    return stream.getvalue().rstrip("\n")


def csv_cell(value: Any) -> Any:
    """Return a cell that no spreadsheet takes for a formula: prefix such text by an apostrophe.

    Numbers stay unchanged, also those written as text.
    """
    if isinstance(value, str) and value.startswith(_FORMULA):
        try:
            float(value)
        except ValueError:
            return f"'{value}"
    return value + 0.0 if isinstance(value, float) else value  # never −0.0


def _latex_row(cells: Iterable[str]) -> str:
    return " & ".join(cells) + r" \\"


# Tables fitted to the width of a terminal, or in full for programs; this module knows no command --
#
# A table that is too wide gets, in this order and only as far as needed: headings of several lines;
# text wrapped between words; fewer columns, the least important omitted first; several tables with
# some of the columns each, or one block of lines per row. Words and numbers are never broken.


_GAP = "  "
_NARROW = 16
"""Text is wrapped to this width, or that of its longest word, before a column is left out."""
_NOTES, _NOTES_PIPED = 120, 100
"""Maximum width of notes, on a terminal and for a pipe."""

_MINUS = re.compile(r"(?<![\w.)=`'])-(?=\.?\d)")
"""The sign of a number, but not in an exponent, a range, a date, or a value that users type."""

_NUMBER = re.compile(
    r"\*?[-+−±]?[\d.]+(e[-+]?\d+)?([^\d\[±]{1,10})?( ?± ?[\d.e+-]+| \[[^]]*\]( %)?)?( [✓✗=?])?"
)
"""A number, perhaps with a unit, a spread or an interval, and a mark."""

_STYLES = {
    "green": ("holds", "supported", "agrees", "better"),
    "bold red": ("FAILS", "not supported", "differs", "violated"),
    "red": ("worse",),
    "yellow": ("undecided", "growing", "unknown", "not covered", "not comparable"),
}
"""Colours of verdicts, by their first words; the text says the same without colour."""

_MARKS = {MARKS["better"]: "green", MARKS["worse"]: "red"}


class _Column:
    """A heading and the cells below it.

    Attributes
    ----------
    body
        Width of the cells.
    folded
        Width with one word of the heading per line.
    least
        Width with wrapped text.
    is_text
        Whether there are cells that may be wrapped.
    numeric
        Whether there are only numbers or per cents, which are aligned right.
    """

    def __init__(self, heading: str, cells: list[str]) -> None:
        self.heading, self.cells = heading, cells
        self.body, word = max(map(cell_len, cells), default=0), _longest_word(heading)
        self.folded = max(word, self.body)
        self.is_text, self.numeric = not all(map(_is_whole, cells)), all(map(_is_number, cells))
        unbroken = [cell_len(cell) if _is_whole(cell) else _longest_word(cell) for cell in cells]
        wrapped = min(self.folded, _NARROW)
        self.least = max([word, *unbroken, wrapped if self.is_text else 0])

    def with_heading_of(self, lines: int) -> int:
        """Return the least width of the cells and of the heading on so many lines."""
        widths = range(_longest_word(self.heading), cell_len(self.heading) + 1)
        fits = (width for width in widths if len(_wrapped(self.heading, width)) <= lines)
        return max(self.body, next(fits, 0))


@dataclass(frozen=True)
class _SideBySide:
    """Columns that stand side by side, with their widths."""

    columns: list[_Column]
    widths: list[int]

    def head(self) -> list[Text]:
        """Return the headings, aligned at the bottom, and a rule."""
        folded = [
            _wrapped(column.heading, width, "bold")
            for column, width in zip(self.columns, self.widths, strict=True)
        ]
        height = max(map(len, folded))
        raised = [[Text()] * (height - len(lines)) + lines for lines in folded]
        rule = Text(_GAP.join("─" * width for width in self.widths), "dim")
        return [*self._lines(raised), rule]

    def row(self, index: int) -> list[Text]:
        """Return the lines of a row, several if text is wrapped."""
        cells = [
            _wrapped(column.cells[index], width, _style(column, index))
            for column, width in zip(self.columns, self.widths, strict=True)
        ]
        return list(self._lines(cells))

    def _lines(self, cells: list[list[Text]]) -> list[Text]:
        lines = []
        for parts in zip_longest(*cells, fillvalue=Text()):
            line = Text()
            for part, column, width in zip(parts, self.columns, self.widths, strict=True):
                space = Text(" " * (width - part.cell_len))
                line.append_text(space + part if column.numeric else part + space)
                line.append(_GAP)
            line.rstrip()
            lines.append(line)
        return lines


def table_text(table: TextTable, room: int | None) -> Text:
    """Lay out a table: caption, columns under their headings, blocks, notes.

    Parameters
    ----------
    room
        Width of the terminal; None for the full table.
    """
    indent = "  " if any(block.title for block in table.blocks) else ""
    minus = "-" if "default" in table.header else "−"  # defaults are for users to type
    rows = [[_MINUS.sub(minus, printable(cell)) for cell in row] for row in table.rows]
    columns = [
        _Column(printable(heading), [row[index] for row in rows])
        for index, heading in enumerate(table.header)
    ]
    lines = [_prose(table.caption, room), Text()] if table.caption else []
    grids, left_out = _laid_out(columns, table, None if room is None else room - len(indent))
    notes = table.notes_without(left_out)
    if left_out:
        notes.append(f"Not shown at this width: {', '.join(left_out)}.")
    if grids is None:
        lines += _body(table.blocks, room or 0, partial(_record, columns, room or 0))
    for number, grid in enumerate(grids or ()):
        if number > 0:
            lines += [Text()]
        lines += [Text(indent) + line for line in grid.head()]
        lines += _body(table.blocks, room, grid.row, indent)
    if notes:
        lines += [
            Text(),
            *(_prose(note, min(room or _NOTES_PIPED, _NOTES), "dim") for note in notes),
        ]
    return Text("\n").join(lines)


def _laid_out(
    columns: list[_Column], table: TextTable, room: int | None
) -> tuple[list[_SideBySide] | None, list[str]]:
    """Return the grids, one below the other, and the omitted headings; None if no grid fits."""
    columns = [column for column in columns if any(column.cells)] or columns
    if (grid := _fitted(columns, room)) is not None:
        return [grid], []
    shown, left_out = columns, list[str]()
    for heading in (None, *table.spare):
        if heading is not None and any(column.heading == heading for column in shown):
            shown = [column for column in shown if column.heading != heading]
            left_out.append(heading)
        if (grid := _fitted(shown, room)) is not None:
            return [grid], left_out
    keys, others = columns[: table.keys], columns[table.keys :]
    if any(column.is_text for column in others):
        return None, []
    for count in range(2, len(others) + 1):
        size = -(-len(others) // count)
        groups = [others[start : start + size] for start in range(0, len(others), size)]
        grids = [grid for group in groups if (grid := _fitted([*keys, *group], room)) is not None]
        if len(grids) == len(groups):
            return grids, []
    return None, []


def _fitted(columns: list[_Column], room: int | None) -> _SideBySide | None:
    """Return the columns with a width each; None if they do not fit."""
    for lines in range(1, 1 + max((len(words(x.heading)) for x in columns), default=1)):
        widths = [column.with_heading_of(lines) for column in columns]
        if room is None or _total(widths) <= room:
            return _SideBySide(columns, widths)
    folded = [column.folded for column in columns]
    least = [column.least for column in columns]
    if room is None or _total(least) > room:
        return None
    return _SideBySide(columns, _grown(least, folded, room))


def _grown(widths: list[int], wanted: list[int], room: int) -> list[int]:
    """Share out the remaining width, first to the columns that lack the least."""
    grown, spare = list(widths), room - _total(widths)
    lacking = sorted(range(len(widths)), key=lambda k: wanted[k] - widths[k])
    for rank, index in enumerate(lacking):
        more = min(wanted[index] - widths[index], spare // (len(lacking) - rank))
        grown[index] += more
        spare -= more
    return grown


def _body(
    blocks: Sequence[Block], room: int | None, row: Callable[[int], list[Text]], indent: str = ""
) -> list[Text]:
    """Return the titles of the blocks and the lines of their rows."""
    lines, index = list[Text](), 0
    for block in blocks:
        lines += [_prose(block.title, room, "bold")] if block.title else []
        for _ in block.rows:
            lines += [Text(indent) + line for line in row(index)]
            index += 1
    return lines


def _record(columns: list[_Column], room: int, index: int) -> list[Text]:
    """Return a row as a block of lines, one per column, below its first cell."""
    first, *others = columns
    label = max(cell_len(column.heading) for column in others)
    lines = [Text(first.cells[index], style="bold")]
    for column in others:
        if column.cells[index]:
            width = max(room - label - 2 * len(_GAP), 1)
            parts = _wrapped(column.cells[index], width, _style(column, index))
            name = Text(_GAP + column.heading.ljust(label) + _GAP, style="dim")
            lines += [(name if k == 0 else Text(" " * len(name))) + x for k, x in enumerate(parts)]
    return lines


def _prose(text: str, room: int | None, style: str = "") -> Text:
    """Wrap text outside the cells to the width."""
    return Text("\n").join(_wrapped(_MINUS.sub("−", printable(text)), room or len(text) + 1, style))


def _wrapped(text: str, width: int, style: str = "") -> list[Text]:
    """Split a text into lines, broken between words only."""
    if cell_len(text) <= width:
        return [Text(text, style)]
    lines = [""]
    for word in words(text):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and cell_len(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return [Text(line, style) for line in lines]


def _style(column: _Column, index: int) -> str:
    cell = column.cells[index]
    if column.heading != "verdict":
        return _MARKS.get(cell[-1:], "")
    return next((style for style, starts in _STYLES.items() if cell.startswith(starts)), "")


def _total(widths: list[int]) -> int:
    return sum(widths) + len(_GAP) * (len(widths) - 1)


def _longest_word(text: str) -> int:
    return max(map(cell_len, words(text)), default=0)


def _is_whole(cell: str) -> bool:
    """Return whether a cell stays on one line: a number with its interval, or a short text."""
    return cell_len(cell) <= _NARROW or _NUMBER.fullmatch(cell) is not None


def _is_number(text: str) -> bool:
    """Return whether a cell is a number, perhaps in per cent, or a count of all: ``6/40``."""
    try:
        _ = [float(part) for part in text.removesuffix(" %").replace("−", "-").split("/")]
    except ValueError:
        return text in ("", "-")
    return True
