"""Lays out a map of winners as text tables and as plain data."""

from dataclasses import replace
from math import isfinite
from typing import Any

from eqt_cli.analysis.comparison.maps import NOBODY, Cell, Map
from eqt_cli.analysis.comparison.notation import Plain, fixed, significant
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.results.result import Result

MOST_POINTS = 60
"""Largest number of points listed one by one; with more points, wins are only counted."""


def map_tables(found: Map, result: Result, write: Plain, *, whole: bool = False) -> list[TextTable]:
    """Return the table of wins of each law, and the table of points.

    Parameters
    ----------
    whole
        Whether to list all points, however many there are.
    """
    name = write.name(found.quantity)
    unit = write.unit(found.unit)
    points = len(found.cells)
    counted = [
        [write.text(title), str(found.wins(law)), *_where(found, result, law, write)]
        for law, title in enumerate(found.titles)
    ]
    undecided = sum(cell.winner == NOBODY for cell in found.cells)
    counted.append(["undecided", str(undecided), "", ""])
    summary = TextTable(
        "winners",
        f"Which law has the better {name}, at {points} points of {found.runs} runs each",
        ["law", "points won", "largest lead", "at"],
        [Block("", counted)],
        [write.text(note) for note in _notes(found)],
    )
    if points > MOST_POINTS and not whole:
        more = f"{points} points are not listed; a table of all comes with --table points."
        return [replace(summary, notes=[*summary.notes, more])]
    rows = [
        [str(cell.point), write.text(result.point_name(cell.point)), *_row(found, cell, write)]
        for cell in found.cells
    ]
    caption = f"Mean {name} at each point" if not name.startswith("mean") else f"{name}, each point"
    header = ["point", "at", *map(write.text, found.titles), "winner", "lead", "adjusted p"]
    table = TextTable(
        "points",
        caption + (f", {unit}" if unit else ""),
        header,
        [Block("", rows)],
        spare=("adjusted p", "lead"),
        keys=2,
    )
    return [summary, table]


def _notes(found: Map) -> list[str]:
    share = f"{100 * (1 - found.confidence):g} %"
    notes = [
        "A law wins at a point where it is better than every other one there, run by run on the "
        "same initial states. The best law of a point is compared with each other one by a paired "
        f"t-test, and the largest p-value counts. The {found.tests} p-values of the points are "
        f"adjusted after Benjamini and Yekutieli (2001): expected share of false wins ≤ {share}."
    ]
    failed, censored = (
        [sum(getattr(cell, name)[law] for cell in found.cells) for law in range(len(found.labels))]
        for name in ("failed", "censored")
    )
    if any(failed):
        notes.append(
            f"Failed runs: {_listed(found, failed)}. A law of which more runs failed than of "
            "another cannot win at that point."
        )
    if unsettled := sum(cell.settled == 0 for cell in found.cells):
        notes.append(
            f"At {unsettled} of {len(found.cells)} points no run of the best law settled; no law "
            "wins there."
        )
    if any(censored):
        notes.append(f"Runs beyond the horizon, which count with it: {_listed(found, censored)}.")
    return notes


def _listed(found: Map, counts: list[int]) -> str:
    return ", ".join(f"{title} {n}" for title, n in zip(found.titles, counts, strict=True) if n)


def _where(found: Map, result: Result, law: int, write: Plain) -> list[str]:
    """Return the largest lead of a law and the point where it occurs."""
    won = [cell for cell in found.cells if cell.winner == law]
    if not won:
        return ["-", ""]
    most = max(won, key=lambda cell: abs(cell.lead.value))
    return [_lead(most, write), write.text(f"point {most.point}, {result.point_name(most.point)}")]


def _row(found: Map, cell: Cell, write: Plain) -> list[str]:
    means = [
        _mean(found.means[cell.point, law], cell.failed[law], cell.censored[law])
        for law in range(len(found.labels))
    ]
    winner = "undecided" if cell.winner == NOBODY else write.text(found.titles[cell.winner])
    p_value = "-" if cell.p_value != cell.p_value else f"{cell.p_value:.2g}"
    return [*means, winner, _lead(cell, write), p_value]


def _mean(mean: float, failed: int, censored: int) -> str:
    """Format a mean with the numbers of failed and unsettled runs."""
    marks = [f"{failed} failed"] * (failed > 0) + [f"{censored} unsettled"] * (censored > 0)
    return " ".join([significant(mean), *(f"({mark})" for mark in marks)])


def _lead(cell: Cell, write: Plain) -> str:
    """Format the lead over the next law with its interval, in percent of the next law's mean."""
    if not cell.difference.value or not all(map(isfinite, cell.lead)):
        return "-"
    mean, low, high = (fixed(100 * share, 1) for share in cell.lead)
    return write.number(f"{mean} [{low}, {high}]") + write.text(" %")


def map_records(found: Map, result: Result) -> list[dict[str, Any]]:
    """Return one record per point with full precision."""
    return [
        {
            "metric": found.quantity.name,
            "units": found.unit,
            "point": cell.point,
            **{key.key: key.value(cell.point) for key in result.swept_keys},
            "winner": None if cell.winner == NOBODY else found.labels[cell.winner],
            "best": found.labels[cell.best],
            "next": found.labels[cell.runner_up],
            "difference": cell.difference.value,
            "low": cell.difference.low,
            "high": cell.difference.high,
            "relative": cell.lead.value,
            "relative_low": cell.lead.low,
            "relative_high": cell.lead.high,
            "p_adjusted": cell.p_value,
            **{
                f"{name} of {label}": value
                for name, values in (
                    ("mean", found.means[cell.point].tolist()),
                    ("failed", cell.failed),
                    ("censored", cell.censored),
                )
                for label, value in zip(found.labels, values, strict=True)
            },
        }
        for cell in found.cells
    ]
