"""Curves as several figures draw them: bands, single runs, paths; it knows no signal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from eqt_cli.analysis.comparison.bootstrap import Resampling, intervals_of_means
from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.style import Look, ink, line_style
from eqt_cli.plots.figure_data import Ensemble

BAND = (0.1, 0.9)
"""The quantiles over runs between which a band lies."""

RESAMPLING = Resampling(confidence=0.95, resamples=2000)
"""Of bands that say how well a mean is known."""

THIN = 0.35
"""pt, the width of the line of a single run."""

Path = tuple[Array, Array]
"""Across and up, a number per sample each."""

_DOT: dict[str, Any] = {"linestyle": "none", "marker": "o"}
_START = _DOT | {"markersize": 2.2, "markeredgewidth": 0.5}
_END = _DOT | {"markersize": 1.8, "markeredgewidth": 0}

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
        found = intervals_of_means(values, RESAMPLING)
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


def thin_line_legend(runs: int, most: int) -> dict[str, Artist]:
    """A handle by name, for that many runs of a controller of which so many are drawn."""
    name = "single runs" if runs <= most else f"first {most} runs"
    return {name: Line2D([], [], color=ink(0.5), linewidth=2 * THIN)}


def draw_paths(axes: Axes, paths: Mapping[int, Path], ensemble: Ensemble) -> None:
    """Thin lines, a hollow dot at each start and a filled one at each end.

    Parameters
    ----------
    paths
        By the number of the run; a gap where they are NaN, but not at their ends.
    """
    look = thin_line(ensemble.look, len(paths))
    for number, (x, y) in paths.items():
        axes.plot(x, y, label=f"run {number}", **look)
    start = _start(look["color"][0])
    for name, at, marker in (("start", 0, start), ("end", -1, {"color": ink(), **_END})):
        across, up = (
            [coordinate[at] for coordinate in pair] for pair in zip(*paths.values(), strict=True)
        )
        axes.plot(across, up, label=name, **marker)


def _start(colour: Any) -> dict[str, Any]:
    return _START | {"markeredgecolor": colour, "markerfacecolor": ink(0)}


def path_legend(good: Sequence[int], most: int) -> dict[str, Artist]:
    """Handles by name, for controllers with so many good runs of which so many are drawn."""
    return {
        **thin_line_legend(max(good), most),
        "start": Line2D([], [], **_start(ink(0.7))),
        "end": Line2D([], [], color=ink(), **_END),
    }
