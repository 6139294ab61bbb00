"""Horizontal box plots of samples that may be censored; it knows no result."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from eqt_cli.plots.drawing.curves import BAND
from eqt_cli.plots.drawing.style import ink
from eqt_cli.plots.shown.metrics import Sample

MOST_POINTS = 50
"""Most runs that are drawn as points; of more, only the smallest and largest are."""

LEVELS = (BAND[0], 0.25, 0.5, 0.75, BAND[1])
"""Quantiles at the ends of whiskers and box, and the median."""

_HALF = 0.3
"""Half the height of a box, where rows are 1 apart."""
_SPREAD = 0.22
"""Largest distance of points from the middle line of their box."""
_ANY = 0.7
"""Share of ink in the grey that stands for every controller's colour in the legend."""
_GOLDEN = (5**0.5 - 1) / 2
"""Golden ratio: any number of its multiples, modulo 1, are spread evenly."""


_MEDIAN: dict[str, Any] = {"linewidth": 1.2, "solid_capstyle": "butt"}
_MARK: dict[str, Any] = {"linestyle": "none"}
_MEAN = _MARK | {"marker": "D", "markersize": 3, "markeredgewidth": 0.6}
_POINT = _MARK | {"marker": "o", "markersize": 1.6, "markeredgewidth": 0}


def draw_box(axes: Axes, row: int, sample: Sample, end: float, colour: str, label: str) -> None:
    """Draw a box with its whiskers, median, mean and points.

    Parameters
    ----------
    row
        Position on the vertical axis.
    end
        Start of censored values: nothing is drawn beyond, and what reaches there stays open.
    label
        Name of the box, unique in the panel.
    """
    found = sample.quantiles(LEVELS)
    known = np.isfinite(found)
    low, lower, median, upper, high = np.where(known, found, end)
    top, bottom = row - _HALF, row + _HALF
    solid: dict[str, Any] = {"color": colour, "linewidth": 0.8, "linestyle": "-"}
    axes.plot([low, lower, np.nan, upper, high], [row] * 5, label=f"whiskers {label}", **solid)
    caps = np.where(known, found, np.nan)[[0, -1]]
    axes.plot(caps, [row, row], "|", color=colour, markersize=4, label=f"ends {label}")
    if known[1]:
        axes.add_patch(Rectangle((lower, top), upper - lower, 2 * _HALF, facecolor=_tint(colour)))
        corners = [(upper, bottom), (lower, bottom), (lower, top), (upper, top)]
        outline = corners + corners[:1] if known[3] else corners
        axes.plot(*zip(*outline, strict=True), label=f"quartiles {label}", **solid)
    if known[2]:
        axes.plot([median] * 2, [top, bottom], label=f"median {label}", color=ink(), **_MEDIAN)
    if sample.values.size <= MOST_POINTS:
        seen = np.where(np.isfinite(sample.values), sample.values, np.nan)
        heights = row + _SPREAD * (2 * (_GOLDEN * np.arange(seen.size) % 1) - 1)
        axes.plot(seen, heights, label=f"runs {label}", **_single())
    else:
        extremes = sample.seen[[0, -1]] if sample.seen.size else np.full(2, np.nan)
        if sample.censored:
            extremes[1] = np.nan
        axes.plot(extremes, [row, row], label=f"extremes {label}", **_POINT, color=colour)
    if np.isfinite(sample.mean):
        axes.plot([sample.mean], [row], label=f"mean {label}", **_mean())


def _mean() -> dict[str, Any]:
    return _MEAN | {"markerfacecolor": ink(0), "markeredgecolor": ink()}


def _single() -> dict[str, Any]:
    return _POINT | {"color": ink(), "alpha": 0.4}


def _tint(colour: str) -> tuple[str, float]:
    return colour, 0.25


def box_legend(runs: Sequence[int]) -> tuple[list[Artist], list[str]]:
    """Return handles and names of the parts of boxes with these numbers of runs."""
    any_colour = ink(_ANY)
    handles: dict[str, Artist] = {
        "quartiles, median": Patch(
            facecolor=_tint(any_colour), edgecolor=any_colour, linewidth=0.8
        ),
        "10–90 %": Line2D([], [], color=any_colour, linewidth=0.8),
        "mean": Line2D([], [], **_mean()),
    }
    if min(runs) <= MOST_POINTS:
        handles["single runs"] = Line2D([], [], **_single())
    if max(runs) > MOST_POINTS:
        handles["extremes"] = Line2D([], [], **_POINT, color=any_colour)
    return list(handles.values()), list(handles)
