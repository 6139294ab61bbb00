"""Names beside curves where they can be read there, else in a legend; it knows no signal."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke
from matplotlib.text import Text

from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.labels import free_text
from eqt_cli.plots.drawing.layout import add_legend, add_letters, arrange
from eqt_cli.plots.drawing.style import darker, ink

MOST_NAMED = 6
"""Curves of a panel that are named beside them, at most."""
LONGEST = 14
"""Characters of such a name, at most."""
_PLACES = 33
"""Places along a panel that are tried."""
_GAP, _PAD = 2.0, 1.5
"""pt, from a curve to its name, and that a name keeps from all curves."""
_NEARER = 1.6
"""How much farther the next curve is than a name's own, at least."""
_STEP = 2.0
"""pt, between the points of a curve that a name must not hide."""


@dataclass(frozen=True)
class _Place:
    """The corners of a name in points of the figure, and how far other curves are."""

    low: Array
    high: Array
    margin: float


def name_curves(
    drawing: Figure, panels: Iterable[Axes], lines: Sequence[Line2D], names: Sequence[str]
) -> None:
    """Name each curve beside it in the panel with most room for that; else in a legend above.

    Scales must be there already, since the room depends on them.

    Parameters
    ----------
    panels
        Each has the curves in the order of the names, before all others.
    lines, names
        The curves as the legend would show them, and a user's texts.
    """
    wanted = [free_text(name, LONGEST) for name in names]
    if 2 <= len(names) <= MOST_NAMED and all(len(name) <= LONGEST for name in names):
        add_letters(drawing)  # which take room
        arrange(drawing)
        found = [(panel, places) for panel in panels if (places := _places(panel, wanted))]
        if found:
            panel, places = max(found, key=lambda each: min(place.margin for place in each[1]))
            _write(panel, wanted, places)
            return
    add_legend(drawing, lines, names)


def _write(axes: Axes, names: Sequence[str], places: Sequence[_Place]) -> None:
    to_data = axes.transData.inverted()
    for line, name, place in zip(axes.lines, names, places, strict=False):
        x, y = to_data.transform((place.low + place.high) / 2 * axes.figure.dpi / 72)
        look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": "small"}
        look["path_effects"] = [Stroke(linewidth=1.5, foreground=ink(0)), Normal()]
        axes.text(float(x), float(y), name, color=darker(str(line.get_color())), **look)


def _places(axes: Axes, names: Sequence[str]) -> list[_Place]:
    """Where all names are; nothing where one finds no room."""
    if len(axes.lines) < len(names):
        return []
    curves = [_points(axes, line) for line in axes.lines]
    if any(not len(points) for points in curves[: len(names)]):
        return []
    found: list[_Place] = []
    for index, name in enumerate(names):
        others = np.concatenate([*curves[:index], *curves[index + 1 :]])
        room = _size(axes, name) + 2 * max(map(_marked, axes.lines))
        place = _best(axes, curves[index], others, room, found)
        if place is None:
            return []
        found.append(place)
    return found


def _best(
    axes: Axes, own: Array, others: Array, size: Array, taken: Sequence[_Place]
) -> _Place | None:
    """The place beside a curve that is farthest from all others."""
    low, high = _points_of(axes, axes.bbox.get_points())
    free: list[_Place] = []
    for x in np.linspace(low[0], high[0], _PLACES)[1:-1]:
        beside = own[np.abs(own[:, 0] - x) <= size[0] / 2 + _PAD]
        if not len(beside):
            continue
        for y in (
            beside[:, 1].max() + _GAP + size[1] / 2,
            beside[:, 1].min() - _GAP - size[1] / 2,
        ):
            middle = np.array([x, y])
            corner, opposite = middle - size / 2, middle + size / 2
            if (corner < low + _PAD).any() or (opposite > high - _PAD).any():
                continue
            if any((corner < t.high).all() and (t.low < opposite).all() for t in taken):
                continue
            away = _distance(others, corner, opposite)
            if away < _PAD or away < _NEARER * max(_distance(own, corner, opposite), _GAP):
                continue
            free.append(_Place(corner, opposite, away))
    return max(free, key=lambda place: place.margin, default=None)


def _distance(points: Array, low: Array, high: Array) -> float:
    """From a box to the nearest of some points."""
    if not len(points):
        return np.inf
    beyond = np.maximum(np.maximum(low - points, points - high), 0)
    return float(np.hypot(*beyond.T).min())


def _points(axes: Axes, line: Line2D) -> Array:
    """Points along a curve that are seen, close to each other."""
    with np.errstate(all="ignore"):
        corners = _points_of(axes, axes.transData.transform(np.column_stack(line.get_data())))
    corners = corners[np.isfinite(corners).all(axis=1)]
    if len(corners) < 2:
        return corners
    low, high = _points_of(axes, axes.bbox.get_points())
    corners = np.clip(corners, low - 1e4, high + 1e4)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    steps = np.linspace(0, along[-1], max(2, min(5000, int(along[-1] / _STEP))))
    found = np.column_stack([np.interp(steps, along, corners[:, k]) for k in (0, 1)])
    return found[((found >= low) & (found <= high)).all(axis=1)]


def _size(axes: Axes, name: str) -> Array:
    """Width and height of a name, pt."""
    written = axes.text(0, 0, name, fontsize="small")
    box = Text.get_window_extent(written)
    written.remove()
    return _points_of(axes, np.array([box.width, box.height]))


def _marked(line: Line2D) -> float:
    """How far markers reach beyond a curve, pt."""
    return 0.0 if line.get_marker() in ("None", None, "", " ") else float(line.get_markersize()) / 2


def _points_of(axes: Axes, pixels: Array) -> Array:
    return pixels * 72 / axes.figure.dpi
