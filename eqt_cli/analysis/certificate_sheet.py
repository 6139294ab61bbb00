"""Certificates as a table of text; it must not know how they were found."""

from __future__ import annotations

from collections.abc import Sequence

from eqt_cli.analysis.certificates import Row, Verdict
from eqt_cli.analysis.comparison.tables import Section, Sheet

_KINDS = {
    "identity": "Identities, at random states: difference of both sides, bound of its rounding",
    "trajectory": "Trajectories, over the runs: error or change, tolerance",
    "hypothesis": "Hypotheses: what the theorems assume",
}
_HEADER = ["statement", "what", "law", "measured", "bound", "verdict", "remark"]


def certificate_sheet(rows: Sequence[Row]) -> Sheet | None:
    """A section per kind, in the order of the rows; None if there are none."""
    sections = [
        Section(title, [_cells(row) for row in rows if row.kind == kind])
        for kind, title in _KINDS.items()
    ]
    sections = [section for section in sections if section.rows]
    if not sections:
        return None
    judged = [row for row in rows if row.kind != "hypothesis"]
    holding = sum(row.verdict is Verdict.HOLDS for row in judged)
    failing = sum(row.verdict is Verdict.FAILS for row in judged)
    return Sheet(
        "certificates",
        f"The paper's statements, checked on this experiment: {holding} of {len(judged)} hold, "
        f"{failing} fail",
        _HEADER,
        sections,
    )


def _cells(row: Row) -> list[str]:
    numbers = [_number(row.measured), _number(row.bound)]
    return [row.statement, row.name, row.controller, *numbers, str(row.verdict), row.remark]


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.1e}" if value and abs(value) < 1e-2 else f"{value:.3g}"
