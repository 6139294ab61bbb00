"""Scales with their numbers, and labels of configuration keys along them; it knows no figure."""

import re
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from eqt_cli.config.json_schema import scale_of
from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import POSE, STIFFNESS, TORQUE, VELOCITY
from eqt_cli.plots.drawing.labels import free_text, quantity
from eqt_cli.results.result import Result
from eqt_cli.results.swept_key import SweptKey

Direction = Literal["x", "y"]

FEW = 12
"""Most values that are written below a scale instead of round numbers."""
_LETTER, _BETWEEN = 0.055, 0.06
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
        half = _LETTER * (len(number) - 0.5 * ("." in number)) / 2
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


_LONGEST = 36
"""Most characters in a line of a label."""
_KEY_LETTER = 0.065
"""Width of a letter, in."""
_MARGIN = 0.03
"""Margin in shares of the width, so that markers at the ends are whole."""
_BESIDE = 0.6
"""Width of the vertical scale and the margins, in."""


def key_label(result: Result, swept: SweptKey) -> str:
    """Return the name of a swept key with its unit; the key itself where it has no name."""
    words, unit = _named(result, swept)
    return words + quantity("", unit).removeprefix("$$")


def key_at(result: Result, swept: SweptKey, point: int) -> str:
    """Return a swept key with its value and unit at a point: ``initial angle 90 deg``."""
    words, unit = _named(result, swept)
    of_value = "" if swept.unit or unit in ("", "1") else f" {unit}"  # some values have their own
    return f"{words} {swept.at(point)}{of_value}"


def _named(result: Result, swept: SweptKey) -> tuple[str, str]:
    """Return the name or symbol of a swept key, as text to draw, and its unit."""
    key, scale = swept.key, scale_of(result.config, swept.key)
    if scale is None:
        return free_text(key, _LONGEST), swept.unit
    of, unit = _owner(result, key), swept.unit or _unit(result, scale.unit)
    if scale.is_symbol:
        return f"${scale.label}$" + free_text(of, _LONGEST), unit
    label = re.sub(r"(?<= )[gcnq]$", r"$\g<0>$", scale.label)  # the letter of a weight
    return free_text(label + of, _LONGEST), unit


def scale_along(panel: Axes, result: Result, axis: SweptKey, room: float) -> None:
    """Name and number the horizontal scale of a panel `room` inches wide."""
    panel.margins(x=_MARGIN)
    panel.set_xlabel(key_label(result, axis))
    if axis.texts:
        texts = [free_text(text, _LONGEST) for text in axis.names.values()]
        panel.set_xticks(list(axis.texts), texts)
        longest = max(len(line) for text in texts for line in text.split("\n"))
        if longest * len(texts) * _KEY_LETTER > room - _BESIDE:
            panel.tick_params(axis="x", labelrotation=90)
        return
    if axis.logarithmic:
        panel.set_xscale("log")
    number_values(panel, axis.values, room - _BESIDE)


def _owner(result: Result, key: str) -> str:
    """Return the owner of a key among several controllers, ``" of TITLE"``; else nothing."""
    found = re.match(r"controllers\[(\d+)\]", key)
    if found is None or len(result.labels) < 2 or int(found[1]) >= len(result.titles):
        return ""
    return f" of {result.titles[int(found[1])]}"


def _unit(result: Result, unit: str) -> str:
    """Return a unit; empty for coordinates with mixed units."""
    unit = TORQUE if unit == STIFFNESS else unit
    if unit in (POSE, VELOCITY):
        return ""
    if not unit.startswith(TORQUE):
        return unit
    torque = result.units("peak_torque") if result.has("peak_torque") else "mixed"
    if torque in ("mixed", "1", ""):
        return ""
    return torque + unit.removeprefix(TORQUE)
