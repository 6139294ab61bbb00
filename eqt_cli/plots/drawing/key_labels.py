"""Labels of configuration keys along a scale, with units; it knows no figure."""

import re

from matplotlib.axes import Axes

from eqt_cli.config.option_scales import scale_of
from eqt_cli.core.option_types import TORQUE
from eqt_cli.plots.drawing.labels import free_text, quantity
from eqt_cli.plots.drawing.scales import number_values
from eqt_cli.results.result import Result
from eqt_cli.results.swept_key import SweptKey

_LONGEST = 36
"""Most characters in a line of a label."""
_LETTER = 0.065
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
    return free_text(scale.label + of, _LONGEST), unit


def scale_along(panel: Axes, result: Result, axis: SweptKey, room: float) -> None:
    """Name and number the horizontal scale of a panel `room` inches wide."""
    panel.margins(x=_MARGIN)
    panel.set_xlabel(key_label(result, axis))
    if axis.texts:
        texts = [free_text(text, _LONGEST) for text in axis.names.values()]
        panel.set_xticks(list(axis.texts), texts)
        longest = max(len(line) for text in texts for line in text.split("\n"))
        if longest * len(texts) * _LETTER > room - _BESIDE:
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
    """Return a unit; empty for a torque with mixed units."""
    if not unit.startswith(TORQUE):
        return unit
    torque = result.units("peak_torque") if result.has("peak_torque") else "mixed"
    if torque in ("mixed", "1", ""):
        return ""
    return torque + unit.removeprefix(TORQUE)
