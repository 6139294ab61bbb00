"""The points of a sweep as a table."""

import numpy as np

from eqt_cli.analysis.comparison.shares import shares
from eqt_cli.report.run_table import MOST_ROWS, Document, column_names, columns, plain
from eqt_cli.results.result import Result


def point_table(result: Result) -> Document:
    """Return a table with a row per controller and point: the swept values, and means over runs.

    Its layout is that of `run_table`. A point with failed runs has no means, and its row counts
    them. Times beyond the horizon in some run have no mean either: the share of settled runs
    replaces them.
    """
    keys = result.swept_keys
    names = [name for name in column_names(result) if not result.censored(name).any()]
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
        "controllers": result.titles,
        "labels": result.labels,
        "rows": [
            [
                c,
                p,
                f"{failed[p, c]} of {result.runs} failed" if failed[p, c] else "ok",
                *(key.named(p) for key in keys),
                *map(plain, means[p, c]),
            ]
            for c, p in sorted(order)
        ],
        "messages": {},
        "total": points * controllers,
    }


def _columns_of_ends(result: Result, name: str) -> list[Document]:
    """Return the column heads for both ends of the interval of a share."""
    called = result.quantity(name).described
    return [
        _head(f"{name}_{end}", f"{called}, {end} end of its interval") for end in ("low", "high")
    ]


def _head(metric: str, name: str) -> Document:
    """Return the head of a column of pure numbers without a better direction."""
    return {"metric": metric, "name": name, "unit": "", "better": ""}
