"""The table of single runs, and stored runs in a few bytes, for a page that draws one of them."""

from base64 import b64encode
from collections.abc import Sequence
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.style import house_style, line_style
from eqt_cli.plots.shown.controllers import looks as looks_of
from eqt_cli.results.quantity import FLOAT, ValuePer
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.results.result import Result, meaning_of

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
    """Return columns with names and units, and a row per law and run.

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
    values = [result[name] * result.factor(name) for name in names]
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


SAMPLES = 101
"""Maximum number of samples of a run that are kept."""

LARGEST = 1_400_000
"""Maximum number of bytes of all curves in the page; further runs are omitted."""

POWER = 4
"""Root of the rounding scale: on 4th roots, small values keep their relative accuracy."""

LEVELS = 65534
"""Code of the largest value; the next code marks a missing value."""

SIGNALS = ("pose_error", "position_error", "velocity_error", "torque_norm", "lyapunov")


def curves(result: Result) -> Document | None:
    """Return the data for drawing runs; None if the result holds no trajectories.

    Returns
    -------
    dict
        ``times``, ``runs``, ``stored`` (how many runs there are), ``controllers`` with their line
        styles, and ``panels``: name, unit, largest value, and codes of 16 bits, little endian, by
        controller, run and sample, in base 64.
    """
    stored, times = result.stored_runs, result.times
    if not stored.size:
        return None
    names = [
        name
        for signal in SIGNALS
        if result.has(signal)
        for name in (result.split(signal) if result.units(signal) == "mixed" else [signal])
    ]
    kept = np.unique(np.linspace(0, len(times) - 1, SAMPLES).round().astype(int))
    per_run = len(names) * len(result.labels) * len(kept) * 2 * 4 / 3
    runs = slice(0, min(len(stored), max(1, int(LARGEST / per_run))))
    chosen = {result.run_dimension: runs, "time": kept.tolist()}
    return {
        "times": [round(float(t), 6) for t in times[kept]],
        "runs": stored[runs].tolist(),
        "stored": len(stored),
        "samples": len(times),
        "controllers": looks(result),
        "power": POWER,
        "levels": LEVELS,
        "panels": [_panel(result, head, chosen) for head in columns(result, names)],
    }


def _panel(result: Result, head: Document, chosen: dict[str, Any]) -> Document:
    """Return the curves of a signal, without L of laws that do not claim that it falls."""
    values = result.read(head["metric"], **chosen) * result.factor(head["metric"])
    if head["metric"] == "lyapunov" and result.without_function:
        values[[result.labels.index(label) for label in result.without_function]] = np.nan
    codes, largest = quantised(values)
    return {
        **head,
        "largest": largest,
        "codes": b64encode(codes.astype("<u2").tobytes()).decode("ascii"),
    }


def quantised(values: Array) -> tuple[Array, float]:
    """Return codes of nonnegative values, and the value of the largest code."""
    finite = np.isfinite(values)
    largest = float(np.max(values, initial=0.0, where=finite)) or 1.0
    scaled = np.where(finite, np.clip(values, 0, largest), 0) / largest
    codes: Array = np.where(finite, np.rint(LEVELS * scaled ** (1 / POWER)), LEVELS + 1)
    return codes, largest


def looks(result: Result) -> list[Document]:
    """Return label, title, colour and dashes of every controller, as in the figures."""
    with house_style():
        styles = [line_style(look) for look in looks_of([result], [range(len(result.labels))])]
    return [
        {
            "label": label,
            "title": title,
            "colour": style["color"],
            "dashes": [] if style["linestyle"] == "-" else list(style["linestyle"][1]),
        }
        for label, title, style in zip(result.labels, result.titles, styles, strict=True)
    ]
