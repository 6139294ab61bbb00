"""What several figures draw over time; it knows no single figure and no result."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from eqt_cli.core.arrays import Array

BAND = (0.1, 0.9)
"""The quantiles over runs between which a band lies."""


def draw_band(axes: Axes, times: Array, values: Array, colour: str, name: str) -> None:
    """Shade the range between two quantiles over runs, of values ``(runs, samples)``."""
    low, high = np.quantile(values, BAND, axis=0)
    axes.fill_between(times, low, high, label=name, **band_look(colour))


def band_look(colour: str) -> dict[str, Any]:
    """A tint of the colour, with edges that tell overlapping bands apart."""
    return {"facecolor": (colour, 0.1), "edgecolor": (colour, 0.8), "linewidth": 0.35}


def scale_norm(axes: Axes, *, log: bool) -> None:
    """A scale for curves that are never negative: logarithmic if asked and possible, or from 0."""
    if log and any(np.any(np.asarray(line.get_ydata()) > 0) for line in axes.lines):
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)
