"""`eqt show --run` and `eqt show --failures`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import Block, TextTable, count_of, listed, significant
from eqt_cli.cli import output
from eqt_cli.extensions.failures import causes
from eqt_cli.extensions.failures.causes import BadRuns, Candidate, Cause
from eqt_cli.results.result import Result
from eqt_cli.results.summary import compared_first, unit_in_words

ENOUGH = 20
"""Least number of runs that can tell where a law fails."""

MOST_ROWS = 5
"""Most numbers that the table has of each law, beside those that differ."""


@purposes.show_run
def show_run(result: Result, run: int, names: Sequence[str], *, json: bool) -> None:
    """Print how a run ended under each law, what it drew, and where it starts.

    Raises
    ------
    EqtError
        Of a sweep, or if there is no such run or law.
    """
    result.single("--run shows a run of one experiment")
    if not 0 <= run < result.runs:
        raise EqtError(f"{result.path}: has no run {run}; choose one of 0 to {result.runs - 1}")
    laws = [result.position_of(name) for name in names] or range(len(result.labels))
    candidates = causes.known_before(result)
    numbers = [name for name in compared_first(result) if name in result.metrics]
    ends = {k: _ending(result, k, run) for k in laws}
    document = {
        "run": run,
        "controllers": [
            {
                "controller": result.labels[k],
                "status": int(result.status[k, run]),
                "outcome": ends[k],
                **{name: float(result.metric(name, k)[run]) for name in numbers},
            }
            for k in laws
        ],
        "drawn": [
            {"name": x.name, "value": float(x.values[run]), "unit": x.unit, "below": _below(x, run)}
            for x in candidates
        ],
    }
    header = ["law", f"run {run}", *(_heading(result, name) for name in numbers)]
    rows = [
        [result.titles[k], ends[k], *(significant(result.metric(n, k)[run]) for n in numbers)]
        for k in laws
    ]
    drawn = [
        [x.name, significant(x.values[run]), _unit(x.unit), f"{100 * _below(x, run):.0f} %"]
        for x in candidates
    ]
    tables = [TextTable("run", "", header, [Block("", rows)])]
    if drawn:
        about = ["drawn, or start", "value", "unit", "runs below"]
        tables.append(TextTable("drawn", "", about, [Block("", drawn)]))
    pieces = [piece for table in tables for piece in (output.laid_out(table), "")][:-1]
    output.print_findings(document, *pieces, json=json)


def _heading(result: Result, name: str) -> str:
    unit = unit_in_words(result, name)
    return f"{result.quantity(name).plain}, {unit}" if unit else result.quantity(name).plain


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def _below(candidate: Candidate, run: int) -> float:
    """Return the share of the runs whose number is lower."""
    return float(np.mean(candidate.values < candidate.values[run]))


def _ending(result: Result, controller: int, run: int) -> str:
    """Say how a run ended."""
    if result.status[controller, run]:
        return f"failed: {result.messages(np.array([[controller, run]]))[0]}"
    if not result.has("settling_time"):
        return "ended"
    time = result.metric("settling_time", controller)[run]
    return f"settled after {time:.3g} s" if np.isfinite(time) else "did not settle"


# Where laws fail ----------------------------------------------------------------------------------


@purposes.show_failures
def show_failures(result: Result, names: Sequence[str], *, json: bool) -> None:
    """Print where laws fail: an answer for each, and the numbers that differ most.

    Raises
    ------
    EqtError
        As `causes.of_result`.
    """
    answers = causes.of_result(result, names, "--failures")
    document = [
        {
            "controller": result.labels[law.controller],
            "bad": law.words,
            "bad_runs": np.flatnonzero(law.bad).tolist(),
            "runs": sum(law.counts),
            "answer": answer(result, law, rows),
            "findings": [_record(row) for row in rows],
        }
        for law, rows in answers
    ]
    lines = [answer(result, law, rows) for law, rows in answers]
    output.print_findings(document, *lines, "", output.laid_out(_table(result, answers)), json=json)


def answer(result: Result, law: BadRuns, rows: Sequence[Cause]) -> str:
    """Return where a law fails, in a sentence or two."""
    bad, others = law.counts
    title = result.titles[law.controller]
    runs = f"{title}: {bad} of {count_of(bad + others, 'run')} {law.words}"
    if law.words.startswith("worst"):
        runs = f"{title}: the {law.words}, {bad} of {count_of(bad + others, 'run')}"
    telling = [row for row in rows if row.telling]
    if bad + others < ENOUGH:
        return f"{runs}; too few runs to tell where: set ensemble.runs to {ENOUGH} or more"
    if not telling:
        least = f"; the least p is {rows[0].p_value:.2g}" if rows else ""
        return f"{runs}; no number that was drawn, and none of the start, tells which{least}"
    first, *more = telling
    also = (
        f"; also {listed([f'{row.candidate.name} {row.way}' for row in more[:4]])}" if more else ""
    )
    return f"{runs}, mostly where {where(first)}{also}"


def where(row: Cause) -> str:
    """Say where a number parts bad runs from others, with their counts on both sides."""
    low, cut = (
        row.way in ("low", "in the middle"),
        f"{row.cut:.3g} {_unit(row.candidate.unit)}".strip(),
    )
    side = f"up to {cut}" if low else f"from {cut} on"
    if row.way in ("at both ends", "in the middle"):
        side = f"{'less' if low else 'more'} than {cut} from its median"
    (bad, runs), (rest, of) = row.beyond, row.within
    return (
        f"{row.candidate.name} is {row.way}: {bad} of {count_of(runs, 'run')} {side}, "
        f"{rest} of {of} elsewhere (p = {row.p_value:.1g})"
    )


def _table(result: Result, answers: Sequence[tuple[BadRuns, Sequence[Cause]]]) -> TextTable:
    blocks = []
    for law, rows in answers:
        few = [row for k, row in enumerate(rows) if k < MOST_ROWS or row.telling]
        cells = [list(_cells(law, row)) for row in few]
        blocks.append(Block(result.titles[law.controller], cells))
    tests = 2 * sum(len(rows) for _, rows in answers)
    notes = [
        "bad runs, others: median [10 %, 90 %]",
        "pairs: in so many pairs of a bad and another run, the bad one lies more so",
        f"p: of the rank test, after Holm over {tests} tests; up to {causes.LEVEL:g}, it differs",
    ]
    header = ["number", "unit", "bad runs", "others", "bad runs lie", "pairs", "p"]
    return TextTable("failures", "", header, blocks, notes, ("unit", "pairs"))


def _cells(law: BadRuns, row: Cause) -> Iterator[str]:
    yield from (row.candidate.name, _unit(row.candidate.unit))
    yield from (_spread(row.candidate.values[runs]) for runs in (law.bad, law.others))
    yield from (row.way, f"{100 * row.share:.0f} %", f"{row.p_value:.2g}")


def _spread(values: Array) -> str:
    low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
    return f"{middle:.3g} [{low:.3g}, {high:.3g}]"


def _record(row: Cause) -> dict[str, Any]:
    (bad, runs), (rest, of) = row.beyond, row.within
    return {
        "name": row.candidate.name,
        "unit": row.candidate.unit,
        "bad_runs_lie": row.way,
        "p_value": row.p_value,
        "pairs": row.share,
        "cut": row.cut,
        "beyond": {"bad": bad, "runs": runs},
        "within": {"bad": rest, "runs": of},
    }
