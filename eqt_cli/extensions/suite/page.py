"""The tables of the suite as one HTML page, without scripts."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from eqt_cli.base.reporting import TextTable

_STYLE = Path(__file__).with_name("page.css")


def page(title: str, lines: Sequence[str], tables: Sequence[TextTable]) -> str:
    """Return a page with sentences and tables; a verdict has a colour only if it is resolved."""
    body = [f"<h1>{escape(title)}</h1>", *(f"<p>{escape(line)}</p>" for line in lines)]
    body += [part for table in tables for part in _table(table)]
    style = _STYLE.read_text("utf-8")
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width">'
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}<title>{escape(title)}</title>'
        f"<style>{style}</style></head>\n<body>\n" + "\n".join(body) + "\n</body></html>\n"
    )


def _table(table: TextTable) -> list[str]:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
    parts = [f"<h2>{escape(table.caption)}</h2>", "<table>", f"<thead><tr>{head}</tr></thead>"]
    for block in table.blocks:
        parts.append("<tbody>")
        if block.title:
            parts.append(f'<tr><th colspan="{len(table.header)}">{escape(block.title)}</th></tr>')
        parts += [_row(row, table.header) for row in block.rows]
        parts.append("</tbody>")
    notes = [f"<p>{escape(note)}</p>" for note in table.notes]
    return [*parts, "</table>", *notes]


def _row(row: Sequence[str], header: Sequence[str]) -> str:
    cells = []
    for heading, cell in zip(header, row, strict=True):
        kind = f' class="{escape(cell.split()[0])}"' if heading == "verdict" and cell else ""
        cells.append(f"<td{kind}>{escape(cell)}</td>")
    return f"<tr>{''.join(cells)}</tr>"
