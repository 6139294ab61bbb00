"""What readers show of the search whose outcome a result judges."""

from collections.abc import Sequence
from typing import Any

from eqt_cli.base import purposes
from eqt_cli.base.reporting import TextTable
from eqt_cli.extensions.search.record import TUNE, WORST
from eqt_cli.results.conclusion import Conclusion
from eqt_cli.results.result import Result


@purposes.conclusion_of_a_result
def conclusion(result: Result) -> Conclusion | None:
    """Return the outcome of the search that a result judges; None if there is no such search."""
    tuning, worst = TUNE.beside(result), WORST.beside(result)
    if tuning:
        return _tuned(result, tuning)
    if worst:
        from eqt_cli.extensions.search.tables import worst_tables

        return Conclusion(
            *(WORST.configs, "Worst runs", "The worst runs that were found"),
            tables=lambda: worst_tables(result, worst),
            finding=_worst,
            figures={"worst": ""},
            plotted=["worst"],
        )
    return None


def _tuned(result: Result, record: dict[str, Any]) -> Conclusion:
    from eqt_cli.extensions.search.ratios import endings
    from eqt_cli.extensions.search.tables import is_sampled, tuning_tables, verdict_records

    def verdicts() -> dict[str, Any]:
        return verdict_records(result, record)

    laws, has_fronts = record["laws"], len(record["objectives"]) > 1
    best = [law for law in laws if law["winners"] and not has_fronts]
    pair = [law["winners"][0]["label"] for law in best]
    searched, variants = set[str](), dict[str, tuple[str, int]]()
    for law in laws:
        winners = [winner["label"] for winner in law["winners"]]
        others = [search["label"] for search in law["searches"]]
        of_law = dict.fromkeys([*winners[:1], law["start"], *winners[1:], *others])
        variants |= {label: (law["label"], number) for number, label in enumerate(of_law)}
        searched |= {*others}
    return Conclusion(
        *(TUNE.configs, "Tuned", "Tuned laws on held-out runs"),
        tables=lambda: tuning_tables(result, record),
        finding=lambda shown: "" if has_fronts else _better(shown, **verdicts()),
        document=lambda: {"verdicts": verdicts()} if is_sampled(record) else {},
        figures={"fronts": _CAPTION} if has_fronts else {},
        starts=[law["start"] for law in laws if law["over"]],
        further=searched.difference(w["label"] for law in laws for w in law["winners"]),
        premise=" ".join([f"{_PREMISE}.", *endings(record)]) if is_sampled(record) else "",
        pair=[*pair, best[0]["start"]] if len(best) == 1 else pair,
        variants=variants,
    )


def _worst(tables: Sequence[TextTable]) -> str:
    laws = ", ".join(" ".join(row[:2]) for row in tables[0].rows)
    return f"{tables[0].caption}: {laws}."


def _better(tables: Sequence[TextTable], remarks: Sequence[str] = (), **_: object) -> str:
    """Say which tuned law is better than which; of a single law, what tuning changed."""
    notes = [note for table in tables for note in table.notes]
    if verdict := next((note for note in notes if note.startswith("By ")), ""):
        return " ".join([*remarks, verdict])
    first = tables[0].blocks[0]
    laws = (f"{row[0]} {row[-2]} before, {row[-1]} after" for row in first.rows)
    reached = f"{first.title[:1].upper()}{first.title[1:]}: {'; '.join(laws)} tuning."
    return " ".join([*remarks, reached])


_CAPTION = (
    "Winners of the search by both objectives, means over held-out runs with 95 % "
    "intervals. The line joins the Pareto front of these runs. Half-filled: the starting gains."
)
"""Caption of the figure `fronts` in a report."""

_PREMISE = (
    "of these gains only: the intervals leave out that other training runs would give other gains; "
    "eqt show has those of the tuned laws"
)
"""What comparisons run by run leave out."""
