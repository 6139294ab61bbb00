"""Tables as a terminal has room for them, and in full where a program reads; it knows no command.

A table that is too wide gets, one after the other and only as far as needed: headings of several
lines; text wrapped between words; fewer columns, the least important left out; several tables with
some of the columns each, or one block of lines per row. No word and no number is ever broken.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import zip_longest

from rich.cells import cell_len
from rich.text import Text

from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.cli.shared.unbroken import words
from eqt_cli.core.printable import printable

_GAP = "  "
_NARROW = 16
"""Text is wrapped to half its width, but no narrower than this and its longest word,"""
_WIDE = 24
"""and no wider than this, before a column is left out."""
_NOTES = 100
"""Notes are no wider."""

_NUMBER = re.compile(r"[-+−±]?[\d.]+(e[-+]?\d+)?( ?%)?( ?± ?[\d.e+-]+| \[[^]]*\]( %)?)?")
"""With its interval."""

_STYLES = {
    "green": ("holds", "supported", "agrees"),
    "bold red": ("FAILS", "not supported", "differs", "violated"),
    "yellow": ("undecided", "seen, not all settled", "growing", "unknown", "not covered"),
}
"""Colours of verdicts; the word says the same without."""

_VERDICT = "verdict"


@dataclass(frozen=True)
class _Column:
    """A heading and the cells below it."""

    heading: str
    cells: list[str]

    @cached_property
    def full(self) -> int:
        """The width of its cells, and of its heading on one line."""
        return max(cell_len(self.heading), self.body)

    @cached_property
    def body(self) -> int:
        """The width of its cells."""
        return max(map(cell_len, self.cells), default=0)

    @cached_property
    def folded(self) -> int:
        """The same with a heading of one word a line."""
        return max(_longest_word(self.heading), self.body)

    @cached_property
    def least(self) -> int:
        """The width with its text wrapped."""
        cells = [cell_len(x) if _is_whole(x) else _longest_word(x) for x in self.cells]
        wrapped = min(self.folded, max(_NARROW, min(_WIDE, self.folded // 2)))
        return max([_longest_word(self.heading), *cells, wrapped if self.is_text else 0])

    @cached_property
    def is_text(self) -> bool:
        """Whether it has cells that may be wrapped."""
        return not all(map(_is_whole, self.cells))

    @cached_property
    def numeric(self) -> bool:
        """Whether it holds numbers, which stand to the right."""
        return all(_is_number(cell) for cell in self.cells)


@dataclass(frozen=True)
class _Grid:
    """Columns that stand side by side, with their widths."""

    columns: list[_Column]
    widths: list[int]

    def head(self) -> list[Text]:
        """The headings, at the bottom of their lines, and a rule."""
        folded = [
            _wrapped(column.heading, width)
            for column, width in zip(self.columns, self.widths, strict=True)
        ]
        height = max(map(len, folded))
        raised = [[Text()] * (height - len(lines)) + lines for lines in folded]
        rule = Text(_GAP.join("─" * width for width in self.widths))
        return [*self._lines(raised), rule]

    def row(self, index: int) -> list[Text]:
        """A row, of several lines where text is wrapped."""
        cells = [
            _wrapped(column.cells[index], width, _style(column, index))
            for column, width in zip(self.columns, self.widths, strict=True)
        ]
        return list(self._lines(cells))

    def _lines(self, cells: list[list[Text]]) -> list[Text]:
        made = []
        for parts in zip_longest(*cells, fillvalue=Text()):
            line = Text()
            for part, column, width in zip(parts, self.columns, self.widths, strict=True):
                space = Text(" " * (width - part.cell_len))
                line.append_text(space + part if column.numeric else part + space)
                line.append(_GAP)
            line.rstrip()
            made.append(line)
        return made


def table_text(table: TextTable, room: int | None) -> Text:
    """A table: caption, columns under their headings, blocks, notes.

    Parameters
    ----------
    room
        The width of the terminal; None to print all of it, however wide.
    """
    titled = any(block.title for block in table.blocks)
    indent = "  " if titled else ""
    rows = [[printable(cell) for cell in row] for row in table.rows]
    columns = [
        _Column(printable(heading), [row[index] for row in rows])
        for index, heading in enumerate(table.header)
    ]
    lines = [_prose(table.caption, room), Text()] if table.caption else []
    grids, left_out = _laid_out(columns, table, None if room is None else room - len(indent))
    notes = list(table.notes)
    if left_out:
        notes.append(f"Not shown at this width: {', '.join(left_out)}.")
    if grids is None:
        lines += _body(table.blocks, room or 0, partial(_record, columns, room or 0))
    for number, grid in enumerate(grids or ()):
        lines += [Text()] * (number > 0)
        lines += [Text(indent) + line for line in grid.head()]
        lines += _body(table.blocks, room, grid.row, indent)
    if notes:
        lines += [Text(), *(_prose(note, min(room or _NOTES, _NOTES)) for note in notes)]
    return Text("\n").join(lines)


def _laid_out(
    columns: list[_Column], table: TextTable, room: int | None
) -> tuple[list[_Grid] | None, list[str]]:
    """Grids beneath each other, and the headings that are left out; None where no grid fits."""
    if (grid := _fitted(columns, room)) is not None:
        return [grid], []
    columns = [column for column in columns if any(column.cells)]
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
        groups = _shared_out(others, count)
        grids = [grid for group in groups if (grid := _fitted([*keys, *group], room)) is not None]
        if len(grids) == len(groups):
            return grids, []
    return None, []


def _fitted(columns: list[_Column], room: int | None) -> _Grid | None:
    """Columns with a width for each; None where there is no room for them."""
    full = [column.full for column in columns]
    if room is None or _total(full) <= room:
        return _Grid(columns, full)
    folded = [column.folded for column in columns]
    if _total(folded) <= room:
        return _Grid(columns, folded)
    least = [column.least for column in columns]
    return _Grid(columns, _grown(least, folded, room)) if _total(least) <= room else None


def _grown(widths: list[int], wanted: list[int], room: int) -> list[int]:
    """The widths with what room is left, given first to those that lack the least."""
    grown, spare = list(widths), room - _total(widths)
    lacking = sorted(range(len(widths)), key=lambda k: wanted[k] - widths[k])
    for rank, index in enumerate(lacking):
        more = min(wanted[index] - widths[index], spare // (len(lacking) - rank))
        grown[index] += more
        spare -= more
    return grown


def _shared_out(columns: list[_Column], count: int) -> list[list[_Column]]:
    """Columns in so many groups of about the same size."""
    size = -(-len(columns) // count)
    return [columns[start : start + size] for start in range(0, len(columns), size)]


def _body(
    blocks: Sequence[Block], room: int | None, row: Callable[[int], list[Text]], indent: str = ""
) -> list[Text]:
    """The titles of blocks, and the lines of their rows, by the number of each."""
    lines, index = list[Text](), 0
    for block in blocks:
        lines += [_prose(block.title, room)] if block.title else []
        for _ in block.rows:
            lines += [Text(indent) + line for line in row(index)]
            index += 1
    return lines


def _record(columns: list[_Column], room: int, index: int) -> list[Text]:
    """A row as a block of lines, one per column, below its first cell."""
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


def _prose(text: str, room: int | None) -> Text:
    """Words that are no cell, in lines that fit."""
    text = printable(text)
    return Text(text) if room is None else Text("\n").join(_wrapped(text, room))


def _wrapped(text: str, width: int, style: str = "") -> list[Text]:
    """A text in lines, broken between words only."""
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
    if column.heading != _VERDICT:
        return ""
    cell = column.cells[index]
    return next((style for style, starts in _STYLES.items() if cell.startswith(starts)), "")


def _total(widths: list[int]) -> int:
    return sum(widths) + len(_GAP) * (len(widths) - 1)


def _longest_word(text: str) -> int:
    return max(map(cell_len, words(text)), default=0)


def _is_whole(cell: str) -> bool:
    """Whether a cell stays on one line: a number, with its interval and unit, or a short text."""
    return cell_len(cell) <= _NARROW or _NUMBER.fullmatch(cell) is not None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text in ("", "-")
    return True
