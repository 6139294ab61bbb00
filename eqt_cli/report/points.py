"""The points of a sweep: means over runs to sort and filter, and the best of them; no page."""

from __future__ import annotations

from typing import Any

import numpy as np

from eqt_cli.analysis.comparison.tables import Section, Sheet
from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.swept import Axis, Swept, mean_over_runs
from eqt_cli.report.runs import COLUMNS, MOST_ROWS, Document, plain, unit_of
from eqt_cli.store.reader import Results

BEST = ("mean_pose_error", "early_torque", "effort", "peak_torque")
"""Metrics whose least mean is looked for."""


def point_table(results: Results) -> Document:
    """As `run_table`, with a row per controller and point: the swept values, and means over runs.

    A run that failed is left out of the means, and its row counts it.
    """
    swept = Swept(results, "report")
    axes = swept.axes
    names = [name for name in COLUMNS if results.has(name)]
    means = np.stack([mean_over_runs(swept.metric(name)) for name in names], axis=-1)
    failed = np.count_nonzero(results["status"], axis=-1)
    runs, (points, controllers) = results.dimensions["run"], failed.shape
    order = [(c, p) for p in range(points) for c in range(controllers)]
    order = sorted(order, key=lambda row: failed[row[1], row[0]] == 0)[:MOST_ROWS]
    return {
        "item": "point",
        "columns": [{"name": axis.key, "unit": "", "given": True} for axis in axes]
        + [{"name": COLUMNS[name], "unit": unit_of(results, name)} for name in names],
        "controllers": [str(label) for label in results.coordinate("controller")],
        "rows": [
            [c, p, _status(failed[p, c], runs), *_values(axes, p), *map(plain, means[p, c])]
            for c, p in sorted(order)
        ],
        "messages": {},
        "total": points * controllers,
    }


def best_points(results: Results) -> Sheet:
    """For each controller, the point where the mean over runs of a metric is least."""
    swept = Swept(results, "report")
    axes = swept.axes
    sections = []
    for name in (name for name in BEST if results.has(name)):
        means = mean_over_runs(swept.metric(name))
        rows = [
            [title, *_best(column, axes)]
            for title, column in zip(swept.titles, means.T, strict=True)
            if np.isfinite(column).any()
        ]
        unit = unit_of(results, name).replace("^2", "²")
        sections.append(Section(COLUMNS[name] + (f", {unit}" if unit else ""), rows))
    keys = [axis.key for axis in axes]
    return Sheet(
        "best",
        "Points where the mean over runs is least, of those that were computed",
        ["controller", "point", *keys, "mean"],
        sections,
    )


def _best(means: Array, axes: list[Axis]) -> list[str]:
    point = int(np.nanargmin(means))
    values = [value if isinstance(value, str) else f"{value:.4g}" for value in _values(axes, point)]
    return [str(point), *values, f"{means[point]:.4g}"]


def _values(axes: list[Axis], point: int) -> list[Any]:
    """The swept values at a point, numbers or text."""
    found = [float(axis.values[point]) for axis in axes]
    return [axis.ticks.get(value, value) for axis, value in zip(axes, found, strict=True)]


def _status(failed: int, runs: int) -> str:
    return f"{failed} of {runs} failed" if failed else "ok"
