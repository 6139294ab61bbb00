"""The table of the outcome of a search for the worst run."""

from collections.abc import Iterator, Mapping
from typing import Any

from eqt_cli.analysis.comparison.notation import Plain, significant
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.results.origin import law_title
from eqt_cli.results.result import Result
from eqt_cli.tuning.law_search import values_text
from eqt_cli.tuning.luck import measured
from eqt_cli.tuning.tables import searched
from eqt_cli.tuning.worst import AGREEING

Record = Mapping[str, Any]


def worst_tables(result: Result, record: Record) -> list[TextTable]:
    """Return the table of the worst run of each law, its place, and the agreement of the searches.

    Parameters
    ----------
    result
        The opened result of all laws along each key.
    record
        Record of the search.
    """
    what = measured(result, record["objective"], Plain())
    rows = [
        [
            law_title(law["label"]),
            "a run failed" if law["failed"] else significant(law["value"]),
            values_text(law["values"]),
            str(law["run"]),
            f"{law['unsettled']} of {law['runs']}",
            f"{law['first']['unsettled']} of {law['first']['runs']}",
            f"{law['agreeing']} of {len(law['searches'])}",
        ]
        for law in record["laws"]
    ]
    header = ["law", "worst found", "at", "run", "not settled there", "in the box", "agree"]
    title = f"The worst run that was found: {what}"
    return [TextTable("worst", title, header, [Block("", rows)], list(_notes(record)))]


def _notes(record: Record) -> Iterator[str]:
    yield f"{searched(record)} Worse runs may exist: a search is not a proof."
    for law in record["laws"]:
        seen = [one["value"] for one in law["searches"]]
        if not law["failed"] and (None in seen or not _same(law["value"], seen)):
            values = ", ".join("a failed run" if v is None else f"{v:.4g}" for v in seen)
            yield (
                f"{law_title(law['label'])}: together with other points, the searches found "
                f"{values}; the run amplifies rounding, so its value is no more certain than that."
            )
    yield (
        "Not settled there: of the runs at the point that was found; in the box: of all runs of "
        "the first generations, whose points are spread over the ranges. A failed run has not "
        "settled. "
        f"Agree: searches whose worst is within {100 * AGREEING:g} % of the worst of all."
    )


def _same(value: float, seen: list[float]) -> bool:
    """Whether a run computed alone has the value that some search found."""
    return any(abs(value - other) <= AGREEING * abs(other) for other in seen)
