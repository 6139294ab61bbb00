"""Text tables as LaTeX and CSV; this module knows no command."""

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from eqt_cli.analysis.text_tables import TextTable

_MATHEMATICS = {"d": "$d$"}
"""Headings that are formulas."""

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Characters that begin a formula in a spreadsheet."""

_NUMBER = re.compile(r"[-+$]*\d[\d.]*( \\?%)?")


MOST_COLUMNS = 7
"""Maximum number of columns of a LaTeX table that fits a page."""


def as_latex(table: TextTable) -> str:
    """Return booktabs tables, with the caption and the notes as comments."""
    return "\n\n".join(map(_tabular, table.narrow(MOST_COLUMNS)))


def _tabular(table: TextTable) -> str:
    numeric = [_is_numeric(column) for column in zip(*table.rows, strict=True)]
    layout = "".join("r" if right else "l" for right in numeric)
    lines = [f"% {table.caption}", rf"\begin{{tabular}}{{{layout}}}", r"\toprule"]
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
    r"""Return a heading, in two lines if it ends with a window and a unit: ``effort, 0--20\,s``."""
    measure, comma, end = text.rpartition(", ")
    if comma and end[:1].isdigit():
        return rf"\shortstack[l]{{{measure} \\ {end}}}"
    return _MATHEMATICS.get(text, text)


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
    return value


def _latex_row(cells: Iterable[str]) -> str:
    return " & ".join(cells) + r" \\"


def _is_numeric(column: Iterable[str]) -> bool:
    return all(_NUMBER.fullmatch(cell) for cell in column if cell not in ("", "-"))
