"""Stored runs in a few bytes, for a page that draws the selected run."""

from base64 import b64encode
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.style import house_style, line_style
from eqt_cli.plots.shown.controllers import looks as looks_of
from eqt_cli.report.run_table import columns
from eqt_cli.results.result import Result

SAMPLES = 101
"""Maximum number of samples of a run that are kept."""

LARGEST = 1_400_000
"""Maximum number of bytes of all curves in the page; further runs are omitted."""

POWER = 4
"""Root of the rounding scale: on 4th roots, small values keep their relative accuracy."""

LEVELS = 65534
"""Code of the largest value; the next code marks a missing value."""

SIGNALS = ("pose_error", "velocity_error", "torque_norm", "lyapunov")

Document = dict[str, Any]


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
    values = result.read(head["metric"], **chosen)
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
