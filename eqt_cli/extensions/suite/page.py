"""The tables of the suite as one HTML page, without scripts."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from eqt_cli.base.reporting import TextTable

_STYLE = """
body { font: 15px/1.4 system-ui, sans-serif; margin: 2em auto; max-width: 70em; padding: 0 1em; }
table { border-collapse: collapse; margin: 1em 0 2em; }
th, td { padding: .2em .7em; text-align: left; vertical-align: top; }
td + td { font-variant-numeric: tabular-nums; }
thead th { border-bottom: 1px solid; }
tbody th { padding-top: 1em; }
.better { color: #1a7f37; } .worse, .fails { color: #b42318; }
.undecided, .no { color: inherit; }
@media (prefers-color-scheme: dark) {
  body { background: #111; color: #ddd; } .better { color: #4ac26b; }
  .worse, .fails { color: #ff7b72; }
}
"""


def page(title: str, lines: Sequence[str], tables: Sequence[TextTable]) -> str:
    """Return a page with sentences and tables; a verdict has a colour only if it is resolved."""
    body = [f"<h1>{escape(title)}</h1>", *(f"<p>{escape(line)}</p>" for line in lines)]
    body += [part for table in tables for part in _table(table)]
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width">'
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}<title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head>\n<body>\n" + "\n".join(body) + "\n</body></html>\n"
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
