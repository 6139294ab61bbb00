"""What `eqt compare` says of the result of a tuning, in place of a comparison run by run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from eqt_cli.analysis.intervals import Resampling
from eqt_cli.base import purposes
from eqt_cli.base.reporting import TextTable
from eqt_cli.extensions.search import ratios
from eqt_cli.extensions.search.fronts import at_equal_cost, equal_cost_table, fronts, held_out
from eqt_cli.extensions.search.record import TUNE
from eqt_cli.extensions.search.tables import is_sampled
from eqt_cli.results.conclusion import conclusion_of
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import Result
from eqt_cli.results.summary import check_metrics, not_shared

Answer = tuple[dict[str, Any], list[dict[str, Any]], list[TextTable]]


@purposes.answer_of_compare
def answer(
    result: Result, how: Resampling, write: Plain, metrics: Sequence[str], laws: Sequence[str]
) -> Answer | None:
    """Return what is known of tuned laws; None if the result is of no tuning, or of other laws."""
    record = TUNE.beside(result)
    if record is None:
        return None
    conclusion_of(result).compared(result)  # which may refuse
    whole = held_out(result, record)
    if is_sampled(record):
        return _of_samples(whole, record, how, write, metrics, laws)
    if len(record["objectives"]) < 2 or metrics or laws:
        return None
    table = equal_cost_table(whole, record, write, how)
    pairs = [asdict(pair) for pair in at_equal_cost(fronts(whole, record), how)]
    return {"objectives": record["objectives"], "fronts": pairs}, pairs, [table]


def _of_samples(
    result: Result,
    record: dict[str, Any],
    how: Resampling,
    write: Plain,
    metrics: Sequence[str],
    laws: Sequence[str],
) -> Answer | None:
    """Compare laws that were tuned on samples; None of one law, or of starting gains."""
    tuned = [law["label"] for law in record["laws"] if law["winners"]]
    chosen = [result.labels[result.position_of(name)] for name in laws] or tuned
    if len(chosen) < 2 or not {*chosen} <= {*tuned}:
        return None
    sought = [*record["objectives"], *(bound["metric"] for bound in record["constraints"])]
    names = list(dict.fromkeys(metrics or sought))
    check_metrics(result, names, "compare")
    pairs = ratios.ratios(result, record, names, chosen, how.confidence)
    table = ratios.ratio_table(result, pairs, record["samples"], write)
    of_chosen = record | {"laws": [law for law in record["laws"] if law["label"] in chosen]}
    said = ratios.said_first(result, of_chosen)
    said += ratios.sentences(result, pairs[: len(pairs) // len(names)], record["samples"])
    inner = {result.title_of[label]: result.described.inner.get(label) for label in chosen}
    said += not_shared(inner)
    notes = [*map(write.text, said), *table.notes, *map(write.text, ratios.unequal(record))]
    rows = ratios.answer_record(pairs)
    document = {"objectives": record["objectives"], "samples": record["samples"], "pairs": rows}
    tables = [replace(table, notes=notes), ratios.spending_table(result, record, write)]
    return document, rows, [candidate for candidate in tables if candidate.blocks]
