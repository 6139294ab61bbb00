"""Finds the points of a sweep with the best and the worst means over runs."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from eqt_cli.analysis.comparison.intervals import Resampling, shares
from eqt_cli.analysis.comparison.map_tables import MOST_POINTS, map_tables
from eqt_cli.analysis.comparison.maps import NOBODY, Map, compare_map
from eqt_cli.analysis.comparison.notation import Plain, significant
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.core.arrays import Array
from eqt_cli.results.result import Result

METRICS = ("mean_pose_error", "early_torque", "effort", "peak_torque")
"""Metrics whose smallest and largest means are shown."""


def extreme_points(result: Result, metrics: Sequence[str] = METRICS) -> TextTable:
    """Return the points with the smallest and largest means for each controller and metric."""
    blocks = []
    known = [metric for metric in metrics if result.has(metric)]
    for name in (each for metric in known for each in result.in_parts(metric)):
        means = result.means(name)
        rows = [
            [title, end, *_at(result, point), significant(column[point])]
            for title, column in zip(result.titles, means.T, strict=True)
            if np.isfinite(column).any()
            for end, point in (("best", np.nanargmin(column)), ("worst", np.nanargmax(column)))
        ]
        unit = result.unit_in_words(name).replace("^2", "²")
        title = result.quantity(name).described + (f", {unit}" if unit else "")
        blocks.append(Block(title, rows))
    if result.has("settled"):
        blocks.append(Block("share of settled runs, with its 95 % interval", _settled(result)))
    return TextTable(
        "best",
        "Points with the best and the worst mean over runs, among points without failed runs",
        ["law", "which", "point", *(key.key for key in result.swept_keys), "mean"],
        blocks,
    )


def _settled(result: Result) -> list[list[str]]:
    """Return the points where most and fewest runs settle, for each controller."""
    rows = []
    for title, column in zip(
        result.titles, np.moveaxis(shares(result.metric("settled")), 1, 0), strict=True
    ):
        share: Array = column[:, 0]
        if np.isfinite(share).any():
            for end, point in (("best", np.nanargmax(share)), ("worst", np.nanargmin(share))):
                value = Plain().interval(*column[point].tolist())
                rows.append([title, end, *_at(result, point), value])
    return rows


def _at(result: Result, point: np.intp) -> list[str]:
    """Return the number of a point and the values of its keys."""
    values = [key.named(int(point)) for key in result.swept_keys]
    return [str(point), *(value if isinstance(value, str) else f"{value:.4g}" for value in values)]


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
