"""Lays out certificates as a text table. Does not know how they were found."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from eqt_cli.analysis.certificates.base import Row, Verdict
from eqt_cli.analysis.text_tables import Block, TextTable

_KINDS = {
    "identity": "Identities, at random states: difference of both sides, bound of its rounding",
    "trajectory": "Trajectories, over the runs: error or change, tolerance",
    "hypothesis": "Hypotheses: what the theorems assume",
    "code": "Laws in C, against the laws that they claim to be: difference of torques, bound",
}
_HOLDS, _PROVED, _FAILS = Verdict.HOLDS, Verdict.PROVED, Verdict.FAILS
_LEGEND = {
    Verdict.PROVED: "both sides are equal as rational functions of the state; p bounds the "
    "probability that all exact states that were drawn hide a difference",
    Verdict.UNDECIDED: "the numbers neither confirm nor refute it",
    Verdict.UNCLAIMED: "the paper does not claim this for the law",
    Verdict.NOT_COVERED: "the theorems do not cover this loop",
    Verdict.MORSE_BOTT: "the critical points form manifolds, so the paper's Morse condition is "
    "met only across them",
    Verdict.GROWING: "the largest value over the second half of the horizon exceeds the first's, "
    "so that a bound is in doubt",
    Verdict.VIOLATED: "the theorems do not cover this experiment",
    Verdict.UNKNOWN: "the program cannot decide this",
}
"""Explanations of the verdicts, except for holds and FAILS."""

_HEADER = ["statement", "what", "law", "measured", "bound", "verdict", "remark"]
_SPARE = ("statement",)  # a measured value means nothing without its bound

_LISTED = (Verdict.UNCLAIMED, Verdict.NOT_COVERED)
"""Verdicts that do not concern the experiment; a brief table lists their rows in one note."""


def with_titles(rows: Sequence[Row], titles: Mapping[str, str]) -> list[Row]:
    """Return the rows with the display names of the controllers."""
    return [replace(row, controller=titles.get(row.controller, row.controller)) for row in rows]


def certificate_table(rows: Sequence[Row], *, brief: bool = False) -> TextTable | None:
    """Return a table with a block for each kind of row; None if it would be empty.

    Parameters
    ----------
    brief
        Whether to show only rows that do not hold or could not be proved. Rows that are not claimed
        or not covered are then listed in the notes.
    """
    expected = (_HOLDS, _PROVED, *_LISTED)
    shown = [row for row in rows if row.verdict not in expected or row.not_proved]
    shown = shown if brief else list(rows)
    blocks = [
        Block(title, cells)
        for kind, title in _KINDS.items()
        if (cells := [_cells(row) for row in shown if row.kind == kind])
    ]
    notes = _notes(rows, brief=brief)
    if not (blocks or notes):
        return None
    doubts = doubtful(rows)
    assumed = f"; of the hypotheses {'; '.join(doubts)}" if doubts else ""
    return TextTable(
        "certificates",
        f"The paper's statements, checked on this experiment: {tally(rows)}{assumed}",
        _HEADER,
        blocks,
        notes,
        _SPARE,
    )


def _notes(rows: Sequence[Row], *, brief: bool) -> list[str]:
    """Explain the verdicts that occur; a brief table also lists rows here."""
    notes = []
    for verdict, meaning in _LEGEND.items():
        if having := [row for row in rows if row.verdict is verdict]:
            named = f": {_named(having)}" if brief and verdict in _LISTED else ""
            notes.append(f"{verdict}: {meaning}{named}.")
    return notes


def _named(rows: Sequence[Row]) -> str:
    """List rows by name with their laws: ``decrease of L (lee2010, lee2012)``."""
    laws: dict[str, list[str]] = {}
    for row in rows:
        laws.setdefault(row.name, []).extend([row.controller] if row.controller else [])
    return "; ".join(f"{name} ({', '.join(of)})" if of else name for name, of in laws.items())


def tally(rows: Sequence[Row]) -> str:
    """Count the verdicts of all rows but hypotheses: ``41 hold, 2 undecided, 0 fail``."""
    counts = Counter(row.verdict for row in rows if row.kind != "hypothesis")
    others = [f"{count} {v}" for v, count in counts.items() if v not in (_HOLDS, _FAILS)]
    return ", ".join([f"{counts[_HOLDS]} hold", *sorted(others), f"{counts[_FAILS]} fail"])


def doubtful(rows: Sequence[Row]) -> list[str]:
    """List the hypotheses that are violated or in doubt: ``growing: Q_d is bounded``."""
    return [
        f"{row.verdict}: {row.name}{f' ({row.controller})' if row.controller else ''}"
        for row in rows
        if row.kind == "hypothesis" and row.verdict in (Verdict.VIOLATED, Verdict.GROWING)
    ]


def _cells(row: Row) -> list[str]:
    numbers = [_number(row.measured), _number(row.bound)]
    return [row.statement, row.name, row.controller, *numbers, str(row.verdict), row.remark]


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.1e}" if value and abs(value) < 1e-2 else f"{value:.3g}"
