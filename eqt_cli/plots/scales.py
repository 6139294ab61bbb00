"""Scales with as many numbers as there is room for; it knows no figure and no result."""

from __future__ import annotations

from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from eqt_cli.core.arrays import Array

Direction = Literal["x", "y"]


def even() -> MaxNLocator:
    """About five round numbers at equal distances."""
    return MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10])


def scale_log(axes: Axes, direction: Direction, seen: Array) -> None:
    """A logarithmic scale for positive values, with numbers wherever there is room for them."""
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


def _number(value: float, _position: int | None) -> str:
    mantissa, _, exponent = f"{value:g}".partition("e")
    return rf"${mantissa} \times 10^{{{int(exponent)}}}$" if exponent else mantissa
