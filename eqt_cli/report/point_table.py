"""The points of a sweep as a table, and the best of them."""

import numpy as np

from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.comparison.shares import shares
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.core.arrays import Array
from eqt_cli.report.run_table import MOST_ROWS, Document, column_names, columns, plain, unit_of
from eqt_cli.results.result import Result

BEST = ("mean_pose_error", "early_torque", "effort", "peak_torque")
"""Metrics whose least mean is looked for."""


def point_table(result: Result) -> Document:
    """As `run_table`, with a row per controller and point: the swept values, and means over runs.

    A point at which runs failed has no means, and its row counts them; a run that has not settled
    counts as the horizon.
    """
    keys = result.swept_keys
    names = column_names(result)
    means = np.stack([result.means(name) for name in names], axis=-1)
    counts = [name for name in names if result.quantity(name).counts]
    means = np.concatenate(
        [means, *(shares(result.metric(name))[..., 1:] for name in counts)], axis=-1
    )
    failed = np.count_nonzero(result.status, axis=-1)
    points, controllers = failed.shape
    order = [(c, p) for p in range(points) for c in range(controllers)]
    order = sorted(order, key=lambda row: failed[row[1], row[0]] == 0)[:MOST_ROWS]
    return {
        "item": "point",
        "columns": [
            *({**_head("", key.key), "given": True} for key in keys),
            *columns(result, names),
            *(column for name in counts for column in _columns_of_ends(result, name)),
        ],
        "controllers": result.labels,
        "rows": [
            [
                c,
                p,
                f"{failed[p, c]} of {result.runs} failed" if failed[p, c] else "ok",
                *(key.value(p) for key in keys),
                *map(plain, means[p, c]),
            ]
            for c, p in sorted(order)
        ],
        "messages": {},
        "total": points * controllers,
    }


def best_points(result: Result) -> TextTable:
    """For each controller, the point where the mean over runs of a metric is least."""
    blocks = []
    known = [metric for metric in BEST if result.has(metric)]
    for name in (each for metric in known for each in result.in_parts(metric)):
        means = result.means(name)
        rows = [
            [title, *_best(result, column)]
            for title, column in zip(result.titles, means.T, strict=True)
            if np.isfinite(column).any()
        ]
        unit = unit_of(result, name).replace("^2", "²")
        title = result.quantity(name).described + (f", {unit}" if unit else "")
        blocks.append(Block(title, rows))
    if result.has("settled"):
        blocks.append(Block("settled, the largest share, with its 95 % interval", _most(result)))
    return TextTable(
        "best",
        "Points with the lowest mean over runs, among points without failed runs",
        ["controller", "point", *(key.key for key in result.swept_keys), "mean"],
        blocks,
    )


def _most(result: Result) -> list[list[str]]:
    """For each controller, the point where most runs settle."""
    found = shares(result.metric("settled"))
    rows = []
    for title, column in zip(result.titles, np.moveaxis(found, 1, 0), strict=True):
        if np.isfinite(column).any():
            point = int(np.nanargmax(column[:, 0]))
            value = Plain().interval(*column[point].tolist())
            rows.append([title, *_best(result, -column[:, 0])[:-1], value])
    return rows


def _columns_of_ends(result: Result, name: str) -> list[Document]:
    """The heads of the ends of the interval of a share."""
    called = result.quantity(name).described
    return [
        _head(f"{name}_{end}", f"{called}, {end} end of its interval") for end in ("low", "high")
    ]


def _head(metric: str, name: str) -> Document:
    """The head of a column of pure numbers, of which none are the better ones."""
    return {"metric": metric, "name": name, "unit": "", "better": ""}


def _best(result: Result, means: Array) -> list[str]:
    point = int(np.nanargmin(means))
    values = [key.value(point) for key in result.swept_keys]
    texts = [value if isinstance(value, str) else f"{value:.4g}" for value in values]
    return [str(point), *texts, f"{means[point]:.4g}"]
