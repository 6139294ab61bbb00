"""Curves shared by several figures: bands, single runs, paths; it knows no signal."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from eqt_cli.analysis.intervals import Resampling
from eqt_cli.base.arrays import Array
from eqt_cli.figures.labels import free_text
from eqt_cli.figures.shown import Ensemble, ShownControllers
from eqt_cli.figures.style import Look, ink, line_style

BAND = (0.1, 0.9)
"""Quantiles over runs at the edges of a band."""

_FAINT_BAND = 0.1
"""Opacity of a band among those of other laws."""

RESAMPLING = Resampling(confidence=0.95, resamples=2000)
"""Bootstrap settings of bands around means."""

THIN = 0.35
"""Line width of a single run, pt."""

_POINTS: dict[str, Any] = {"markersize": 4.5, "markerfacecolor": "none"}
"""Style of hollow markers, all visible where curves coincide."""

Bands = Literal["none", "quartiles"]
"""Kinds of bands: ``quartiles`` around the median, from 25 % to 75 % of the runs."""

_MOST_IN_BAND = 401
"""Most samples at the edges of a band."""


def of_bands(bands: Bands) -> str:
    """Return words for the bands, as the end of a sentence; empty where there are none."""
    return "; bands: quartiles" if bands == "quartiles" else ""


def middle_of(bands: Bands) -> str:
    """Return the name of the curve in a band."""
    return "median" if bands == "quartiles" else "mean"


def draw_middle(axes: Axes, times: Array, values: Array, bands: Bands, ensemble: Ensemble) -> None:
    """Draw the mean or median over runs of values ``(runs, samples)``, and the band around it."""
    look = line_style(ensemble.look)
    if bands == "quartiles":
        low, middle, high = np.quantile(values, (0.25, 0.5, 0.75), axis=0)
    else:
        middle = values.mean(axis=0)
    axes.plot(times, middle, label=ensemble.label, **look)
    if bands == "quartiles" and len(values) > 1:
        step = -(-len(times) // _MOST_IN_BAND)  # an edge is not simplified
        some = np.unique(np.append(np.arange(0, len(times), step), len(times) - 1))
        band = band_look(look["color"], _FAINT_BAND)
        axes.fill_between(times[some], low[some], high[some], label=ensemble.label, **band)


def draw_points(
    axes: Axes,
    across: Array,
    up: Array,
    band: tuple[Array, Array],
    of: Look,
    title: str,
    beside: float | None = None,
) -> list[Line2D]:
    """Draw a curve with a hollow marker at every point, and the band around it.

    With `beside`, points have no order: bars in place of the band, at this distance to the right.
    """
    look = line_style(of)
    if beside is None:
        axes.fill_between(across, *band, label=title, **band_look(look["color"]))
    else:
        across, look = across + beside, look | {"linestyle": ""}
        axes.vlines(across, *band, label=title, color=look["color"], linewidth=0.8)
    return axes.plot(across, up, label=title, marker=of.marker, **_POINTS, **look)


def beside(texts: Mapping[float, str], index: int, count: int) -> float | None:
    """Return where the curve with this index lies beside a text; None where there are numbers."""
    return (index - (count - 1) / 2) * min(0.15, 0.6 / count) if texts else None


def band_look(colour: str, opacity: float = 0.18) -> dict[str, Any]:
    """Return the style of a band: a tint without edges, which would look like curves."""
    return {"facecolor": (colour, opacity), "linewidth": 0}


def thin_line(look: Look, count: int) -> dict[str, Any]:
    """Return the line style of one of `count` single runs of a controller."""
    opacity = min(0.8, 4 / np.sqrt(count))  # few lines are visible, many make shades
    return {"color": (look.colour, opacity), "linewidth": THIN}


def thin_line_legend(shown: Sequence[Ensemble], most: int) -> dict[str, Artist]:
    """Return a legend handle by name, where at most `most` good runs are drawn."""
    runs = max(np.count_nonzero(ensemble.good) for ensemble in shown)
    name = "single runs" if runs <= most else f"first {most} runs"
    return {name: Line2D([], [], color=ink(0.5), linewidth=2 * THIN)}


FAR = 10.0
"""A law has diverged whose last value exceeds so many times every value of the others."""


def diverging(curves: Mapping[str, Array]) -> list[str]:
    """Return the names of the curves ``(samples,)`` that end far above all values of the others."""
    peaks = {name: float(np.nanmax(curve)) for name, curve in curves.items()}
    others, far = -np.inf, list[str]()
    for name in sorted(peaks, key=lambda each: peaks[each]):
        if np.isfinite(others) and curves[name][-1] > FAR * others > 0:
            far.append(name)
        else:
            others = max(others, peaks[name])
    return far


def leaving(shown: ShownControllers, errors: Iterable[Mapping[str, Array]]) -> set[str]:
    """Return the labels of laws of which an error diverges, and say that they are cut off."""
    far = {label for each in errors for label in diverging(each)}
    if far:
        titles = ", ".join(f"“{e.title}”" for e in shown.shown if e.label in far)
        shown.remarks.append(f"Cut off where it leaves the reference: {titles}.")
    return far


def cut_off(axes: Axes, far: set[str]) -> None:
    """End curves where they leave what the other curves of a panel need."""
    kept = [line.get_ydata() for line in axes.lines if line.get_label() not in far]
    if not far or not kept:
        return
    values = np.concatenate(kept)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    low, high = low - 0.2 * (high - low), high + 0.2 * (high - low)
    axes.set_ylim(low, high)
    for line in (line for line in axes.lines if line.get_label() in far):
        drawn = np.asarray(line.get_ydata())
        inside = np.logical_and.accumulate((drawn >= low) & (drawn <= high))
        line.set_ydata(np.where(inside, drawn, np.nan))


_MOST_NAME = 16
"""Most characters in a line of the name of a law that diverges."""
_USUAL = 0.02
"""Share of the time in which a curve may leave a logarithmic scale: a start at 0, a dip."""
_MARGIN = 0.05
"""Room above curves, in shares of a logarithmic scale."""


def bound_below(axes: Axes, curves: Sequence[Array], error: float) -> None:
    """End a logarithmic scale at a tenth of what curves exceed nearly always, or at an error."""
    usual = [np.quantile(curve[curve > 0], _USUAL) for curve in curves if np.any(curve > 0)]
    if axes.get_yscale() == "log" and usual:
        floor = min(max(min(usual) / FAR, error), max(float(curve.max()) for curve in curves) / FAR)
        if floor > axes.get_ylim()[0]:
            shared = axes.get_shared_y_axes().get_siblings(axes)
            top = max(float(each.dataLim.ymax) for each in shared if each.has_data())
            axes.set_ylim(floor, top * (top / floor) ** _MARGIN)


def bound(axes: Axes, error: float, titles: Mapping[str, str]) -> None:
    """Bound a scale by what its curves say; name the laws that diverge.

    Parameters
    ----------
    error
        Error of the solver, below which a logarithmic scale shows nothing.
    titles
        Names of the curves by label. One that diverges is cut off at ten times all others.
    """
    lines = {str(line.get_label()): line for line in axes.lines}
    curves = {label: np.asarray(line.get_ydata(), float) for label, line in lines.items()}
    far = diverging(curves)
    kept = [curve for label, curve in curves.items() if label not in far]
    bound_below(axes, kept, error)
    if far:
        axes.set_ylim(top=FAR * max(float(curve.max()) for curve in kept))
    for number, label in enumerate(far):
        text = f"{free_text(titles[label], _MOST_NAME)} diverges"
        look: dict[str, Any] = {"color": lines[label].get_color(), "ha": "right", "va": "top"}
        look["bbox"] = {"facecolor": ink(0), "edgecolor": "none", "pad": 0.8}
        place = (0.97, 0.96 - 0.13 * number)
        axes.annotate(text, place, xycoords="axes fraction", fontsize="small", **look)


def open_frame(axes: Axes) -> None:
    """Leave out the frame's upper and right sides."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(which="both", top=False, right=False)
