"""The table of single runs: columns, units and rows as plain data; knows no page."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from eqt_cli.results.quantity import FLOAT, ValuePer
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.results.result import Result
from eqt_cli.results.stored_runs import meaning_of

MOST_ROWS = 8000
"""Maximum number of rows, controllers times runs; failed runs are kept before good ones."""

COLUMNS = tuple(
    quantity.name
    for quantity in QUANTITIES.values()
    if quantity.per is ValuePer.RUN and quantity.stored and quantity.dtype is FLOAT
    if not quantity.diagnostic
)
"""Metrics shown of a run, in the order of the table of quantities; `eqt show --table` also prints
the diagnostics, for all of which a page is not wide enough."""

Document = dict[str, Any]


def run_table(result: Result) -> Document:
    """Return columns with names and units, and a row per controller and run.

    Returns
    -------
    dict
        ``item``, what a row is about; ``columns`` with a value in any run; ``rows`` of controller,
        run, status and numbers, where null is a missing one; ``controllers``, as the page writes
        them, and their ``labels``, as a program reads them; ``total``, the number of all rows;
        ``messages`` of failed runs by row.
    """
    names = [name for name in column_names(result) if np.isfinite(result[name]).any()]
    status = result.status
    order = np.argwhere(np.ones_like(status))
    order = order[np.argsort(status[tuple(order.T)] == 0, kind="stable")][:MOST_ROWS]
    order = order[np.lexsort(order.T[::-1])]
    values = [result[name] for name in names]
    failed = order[status[tuple(order.T)] != 0]
    messages = result.messages(failed) if len(failed) and result.has("message") else []
    return {
        "item": "run",
        "columns": columns(result, names),
        "controllers": result.titles,
        "labels": result.labels,
        "rows": [
            [int(c), int(r), meaning_of(int(status[c, r])), *(plain(of[c, r]) for of in values)]
            for c, r in order
        ],
        "messages": {f"{c}-{r}": said for (c, r), said in zip(failed, messages, strict=False)},
        "total": int(status.size),
    }


def column_names(result: Result) -> list[str]:
    """Return the `COLUMNS` that a result has, split into parts with units of their own."""
    return [each for name in COLUMNS if result.has(name) for each in result.in_parts(name)]


def columns(result: Result, names: Sequence[str]) -> list[Document]:
    """Return the heads of columns: metric, description, and unit unless it is a pure number.

    ``better`` says which values are better; empty if neither are.
    """
    quantities = [result.quantity(name) for name in names]
    return [
        {
            "metric": name,
            "name": quantity.described,
            "unit": result.unit_in_words(name),
            "better": "" if quantity.better == "neither" else quantity.better,
        }
        for name, quantity in zip(names, quantities, strict=True)
    ]


def plain(value: float) -> float | None:
    """Round a number to six significant digits; None for NaN and infinity."""
    return float(f"{value:.6g}") if np.isfinite(value) else None
