"""Summary of a sweep: the best and worst points and the winners, or every scenario."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from eqt_cli.analysis.comparison.bootstrap import Resampling
from eqt_cli.analysis.comparison.map_tables import MOST_POINTS, map_tables
from eqt_cli.analysis.comparison.maps import NOBODY, Map, compare_map
from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.extreme_points import METRICS, extreme_points
from eqt_cli.analysis.text_tables import TextTable
from eqt_cli.results.result import Result

COMPARED = ("mean_pose_error", "early_torque")
"""Metrics by which laws win points."""


def sweep_tables(result: Result, metrics: Sequence[str] = METRICS) -> list[TextTable]:
    """The best and the worst points, and which law wins how many.

    Of scenarios, such as ideal, a limit and a lag, none is a choice, so that none is best: a table
    has the means of the laws in each.
    """
    if are_scenarios(result):
        return [
            map_tables(compare_map(result, name, Resampling()), result, Plain())[1]
            for name in _compared(result)
        ]
    table = extreme_points(result, metrics)
    return [replace(table, notes=[*table.notes, *map(_won, winners(result))])]


def winners(result: Result) -> list[Map]:
    """Which law wins where, by each metric, without intervals; nothing where there is one law."""
    return [compare_map(result, name, Resampling(), intervals=False) for name in _compared(result)]


def are_scenarios(result: Result) -> bool:
    """Whether the points differ in names only, few enough to be listed, under several laws."""
    named = all(not key.is_number for key in result.swept_keys)
    return named and len(result.labels) > 1 and result.points <= MOST_POINTS


def _compared(result: Result) -> Iterator[str]:
    if len(result.labels) > 1:
        for metric in filter(result.has, COMPARED):
            yield from result.in_parts(metric)


def _won(found: Map) -> str:
    """As in ``Points won by mean ‖I − Q_E‖: EqT 3, GT 12, undecided 5``."""
    counts = {title: found.wins(law) for law, title in enumerate(found.titles)}
    counts["undecided"] = found.wins(NOBODY)
    told = ", ".join(f"{name} {count}" for name, count in counts.items())
    return f"Points won by {Plain().name(found.quantity)}: {told}."
