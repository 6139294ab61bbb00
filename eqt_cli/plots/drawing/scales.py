"""Scales and their numbers; it knows no figure and no result."""

from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from eqt_cli.core.arrays import Array

Direction = Literal["x", "y"]

FEW = 12
"""Most values that are written below a scale instead of round numbers."""
_LETTER, _BETWEEN = 0.055, 0.12
"""Width of a digit, and of the gap between two numbers, in."""


def spans_decade(values: Array) -> bool:
    """Whether positive values differ by more than a factor of 10."""
    seen = np.asarray(values)
    seen = seen[np.isfinite(seen) & (seen > 0)]
    return bool(seen.size and seen.max() > 10 * seen.min())


def even() -> MaxNLocator:
    """Return a locator of about five evenly spaced round numbers."""
    return MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10])


def scale_log(axes: Axes, direction: Direction, seen: Array) -> None:
    """Set a logarithmic scale for positive values, with numbers wherever there is room."""
    axes.set(**{f"{direction}scale": "log"})
    axis = axes.xaxis if direction == "x" else axes.yaxis
    decades = np.log10(seen.max() / seen.min())
    if decades < 1:
        axis.set_major_locator(even())
    elif decades < 2:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    if decades < 2:
        axis.set_major_formatter(FuncFormatter(_number))
    axis.set_minor_formatter(NullFormatter())


def scale(axes: Axes, direction: Direction, values: Array, *, log: bool | None) -> None:
    """Set a logarithmic scale if asked and possible; with None, if values span a decade."""
    seen = values[np.isfinite(values)]
    if seen.size and (seen > 0).all() and (spans_decade(seen) if log is None else log):
        scale_log(axes, direction, seen)


def scale_norm(axes: Axes, *, log: bool, direction: Direction = "y") -> None:
    """Set a scale for non-negative curves: logarithmic if asked and possible, else from 0."""
    across = direction == "x"
    drawn = [line.get_xdata() if across else line.get_ydata() for line in axes.lines]
    if log and any(np.any(np.asarray(values) > 0) for values in drawn):
        axes.set(**{f"{direction}scale": "log"})
    elif across:
        axes.set_xlim(left=0)
    else:
        axes.set_ylim(bottom=0)


def number_values(axes: Axes, values: Array, room: float) -> None:
    """Number the horizontal scale at its values if they are few, as far as `room` inches allow.

    Many values get Matplotlib's numbers. Set the scale to linear or logarithmic first.
    """
    levels = np.unique(values)
    log = axes.get_xscale() == "log"
    if len(levels) > FEW:
        if log:
            scale_log(axes, "x", levels)
        return
    places = np.log(levels) if log else levels
    places = (places - places[0]) / (np.ptp(places) or 1.0) * room
    texts, end = [], -np.inf
    for place, level in zip(places, levels, strict=True):
        number = f"{level:.4g}"
        half = _LETTER * len(number) / 2
        fits = place - half >= end
        texts.append(_number(level) if fits else "")
        end = place + half + _BETWEEN if fits else end
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(levels, texts)


def _number(value: float, _position: int | None = None) -> str:
    mantissa, _, exponent = f"{value:.4g}".partition("e")
    if exponent:
        return rf"${mantissa} \times 10^{{{int(exponent)}}}$"
    return rf"$\mathdefault{{{mantissa}}}$" if value < 0 else mantissa
