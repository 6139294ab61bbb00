"""Every stored run in a few bytes, for a page that draws the one that is picked."""

from __future__ import annotations

from base64 import b64encode
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.ensembles import title_of
from eqt_cli.plots.drawing.style import house_style, line_style
from eqt_cli.store.reader import Results

SAMPLES = 101
"""Samples of a run that are kept, at most."""

LARGEST = 1_400_000
"""Bytes that all curves together may take in the page; more runs are left out."""

POWER = 4
"""Values are rounded on the scale of their 4th root: small ones keep their relative accuracy."""

LEVELS = 65534
"""The code of the largest value; the one after it says that there is none."""

SIGNALS = {
    "pose_error": "‖I − Q_E‖",
    "velocity_error": "‖V − V_d‖",
    "torque_norm": "‖τ‖",
    "lyapunov": "L",
}

Document = dict[str, Any]


def curves(results: Results) -> Document | None:
    """What the page needs to draw runs; None if the result holds no trajectories.

    Returns
    -------
    dict
        ``times``, ``runs``, ``stored`` (how many runs there are), ``controllers`` with their line
        styles, and ``panels``: name, unit, largest value, and codes of 16 bits, little endian, by
        controller, run and sample, in base 64.
    """
    if not (results.has("lyapunov") and "time" in results.dims("lyapunov")):
        return None
    names = [name for signal in SIGNALS for name in _norms(results, signal)]
    times: Array = results.coordinate("time")
    kept = np.unique(np.linspace(0, len(times) - 1, SAMPLES).round().astype(int))
    labels = [str(label) for label in results.coordinate("controller")]
    (dimension,) = (dim for dim in results.dims("lyapunov") if dim.endswith("run"))
    stored: Array = results.coordinate(dimension)
    per_run = len(names) * len(labels) * len(kept) * 2 * 4 / 3
    runs = slice(0, min(len(stored), max(1, int(LARGEST / per_run))))
    return {
        "times": [round(float(t), 6) for t in times[kept]],
        "runs": stored[runs].tolist(),
        "stored": len(stored),
        "samples": len(times),
        "controllers": looks(results),
        "power": POWER,
        "levels": LEVELS,
        "panels": [
            _panel(results, name, {dimension: runs, "time": kept.tolist()}) for name in names
        ],
    }


def _norms(results: Results, signal: str) -> list[str]:
    """The signal, or its parts where they have units of their own."""
    if results.units(signal) != "mixed":
        return [signal]
    parts = [name for name in results.names if name.startswith(signal + "_")]
    return [name for name in parts if "time" in results.dims(name)] or [signal]


def _panel(results: Results, name: str, selection: dict[str, Any]) -> Document:
    signal = next(signal for signal in SIGNALS if name.startswith(signal))
    part = name.removeprefix(signal).replace("_", " ")
    values = results.read(name, **selection)
    codes, largest = quantised(values)
    unit = results.units(name)
    return {
        "name": SIGNALS[signal] + part,
        "unit": "" if unit == "1" else unit,
        "largest": largest,
        "codes": b64encode(codes.astype("<u2").tobytes()).decode("ascii"),
    }


def quantised(values: Array) -> tuple[Array, float]:
    """Codes of values that are not negative, and the value of the largest code."""
    finite = np.isfinite(values)
    largest = float(np.max(values, initial=0.0, where=finite)) or 1.0
    scaled = np.where(finite, np.clip(values, 0, largest), 0) / largest
    codes: Array = np.where(finite, np.rint(LEVELS * scaled ** (1 / POWER)), LEVELS + 1)
    return codes, largest


def looks(results: Results) -> list[Document]:
    """Label, title, colour and dashes of every controller, as in the figures."""
    labels = [str(label) for label in results.coordinate("controller")]
    with house_style():
        styles = [line_style(index) for index in range(len(labels))]
    return [
        {
            "label": label,
            "title": title_of(results, label),
            "colour": style["color"],
            "dashes": [] if style["linestyle"] == "-" else list(style["linestyle"][1]),
        }
        for label, style in zip(labels, styles, strict=True)
    ]
