"""Tables of text as terminals, LaTeX and spreadsheets take them; it knows no command."""

from __future__ import annotations

import csv
import io
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from eqt_cli.analysis.text_tables import TextTable
from eqt_cli.cli.shared.output import columns, room

_NUMBER = re.compile(r"[-+$]*\d[\d.]*( \\?%)?")
_WIDTH = 100
"""Of notes, at most."""


def as_text(table: TextTable) -> str:
    """For a terminal: caption, columns under their headings, blocks, notes."""
    titled = any(block.title for block in table.blocks)
    indent = "  " if titled else ""
    width = room()
    head, lines = columns(table.header, table.rows, width and width - len(indent))
    out = [table.caption, "", *(indent + line for line in head)]
    remaining = (line.replace("\n", "\n" + indent) for line in lines)
    for block in table.blocks:
        if block.title:
            out.append(block.title)
        out += [indent + next(remaining) for _ in block.rows]
    if table.notes:
        out += ["", *(textwrap.fill(note, min(width or _WIDTH, _WIDTH)) for note in table.notes)]
    return "\n".join(out)


def as_latex(table: TextTable) -> str:
    """A `tabular` of the package booktabs, with the caption and the notes as comments."""
    numeric = [_is_numeric(column) for column in zip(*table.rows, strict=True)]
    layout = "".join("r" if right else "l" for right in numeric)
    lines = [f"% {table.caption}", rf"\begin{{tabular}}{{{layout}}}", r"\toprule"]
    lines.append(_latex_row([_latex_heading(heading) for heading in table.header]))
    for block in table.blocks:
        lines.append(r"\midrule")
        if block.title:
            width = len(table.header)
            lines.append(rf"\multicolumn{{{width}}}{{l}}{{{block.title}}} \\")
        lines += [_latex_row(row) for row in block.rows]
    lines += [r"\bottomrule", r"\end{tabular}", *(f"% {note}" for note in table.notes)]
    return "\n".join(lines)


def as_csv(records: Sequence[Mapping[str, Any]]) -> str:
    """Comma-separated values with a line of names; missing ones are empty."""
    names = list(dict.fromkeys(name for record in records for name in record))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: _csv_cell(v) for k, v in record.items()} for record in records)
    return stream.getvalue().rstrip("\n")


def _csv_cell(value: Any) -> Any:
    missing = value is None or (isinstance(value, float) and value != value)
    return "" if missing else value


def _latex_row(cells: Iterable[str]) -> str:
    return " & ".join(cells) + r" \\"


def _latex_heading(text: str) -> str:
    return {"d": "$d$", "P(better)": r"$P(\text{better})$"}.get(text, text)


def _is_numeric(column: Iterable[str]) -> bool:
    return all(_NUMBER.fullmatch(cell) for cell in column if cell not in ("", "-"))
