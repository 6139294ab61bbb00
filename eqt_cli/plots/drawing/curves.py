"""How several figures draw curves and scales; it knows no single figure and no result."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes

from eqt_cli.analysis.comparison.bootstrap import intervals_of_means
from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.style import Look
from eqt_cli.plots.drawing.style import line_style

BAND = (0.1, 0.9)
"""The quantiles over runs between which a band lies."""

CONFIDENCE, RESAMPLES, SEED = 0.95, 2000, 0
"""Of bands that say how well a mean is known."""

THIN = 0.35
"""pt, the width of the line of a single run."""

Bands = Literal["none", "quantiles", "bootstrap"]
"""``quantiles`` shades where most runs are, from 10 % to 90 %; ``bootstrap`` shades where the mean
over all runs that there could be is, with 95 % confidence at each time."""

BAND_NAMES: dict[Bands, str] = {
    "quantiles": "10–90 % of runs",
    "bootstrap": "95 % interval of the mean",
}


def draw_band(
    axes: Axes, times: Array, values: Array, bands: Bands, colour: str, name: str
) -> None:
    """Shade a band around the mean over runs, of values ``(runs, samples)``."""
    if bands == "quantiles":
        low, high = np.quantile(values, BAND, axis=0)
    elif bands == "bootstrap":
        found = intervals_of_means(values, confidence=CONFIDENCE, resamples=RESAMPLES, seed=SEED)
        low, high = found.low, found.high
    else:
        return
    axes.fill_between(times, low, high, label=name, **band_look(colour))


def band_look(colour: str) -> dict[str, Any]:
    """A tint of the colour, with edges that tell overlapping bands apart."""
    return {"facecolor": (colour, 0.1), "edgecolor": (colour, 0.8), "linewidth": 0.35}


def thin_line(look: Look, count: int) -> dict[str, Any]:
    """The line style of one of so many single runs of a controller of this look."""
    opacity = min(0.8, 4 / np.sqrt(count))  # few lines are seen, many make shades
    return {"color": (line_style(look)["color"], opacity), "linewidth": THIN}


def scale_norm(axes: Axes, *, log: bool, direction: Literal["x", "y"] = "y") -> None:
    """A scale for curves that are never negative: logarithmic if asked and possible, or from 0."""
    across = direction == "x"
    drawn = (line.get_xdata() if across else line.get_ydata() for line in axes.lines)
    if log and any(np.any(np.asarray(values) > 0) for values in drawn):
        axes.set(**{f"{direction}scale": "log"})
    elif across:
        axes.set_xlim(left=0)
    else:
        axes.set_ylim(bottom=0)
