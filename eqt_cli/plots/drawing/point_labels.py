"""Short texts beside points, placed where they hide nothing; it knows no figure and no result."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.layout import arrange

_DISTANCES = (5.0, 10.0, 16.0, 25.0, 36.0, 50.0, 70.0)
"""Distances from a point to its text, in the order in which they are tried, pt."""
_DIRECTIONS = ((-1, -1), (1, 1), (1, 0), (1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1))
"""Directions to try, down left first: no other point is there where less is better."""
_AROUND = 2.5
"""Least distance between a text and the drawing, pt."""
_ALONG = 20
"""Number of points on a leader that no text may hide."""
_LEADER: dict[str, Any] = {"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 0, "shrinkB": 2}
_ACROSS, _UP = ("right", "center", "left"), ("top", "center", "bottom")


def name_points(
    axes: Axes, points: Array, texts: Sequence[str], colours: Sequence[str], drawn: Array
) -> None:
    """Write a text beside every point; a text without room is left out.

    Set scales and legends first, since the room depends on them.

    Parameters
    ----------
    points : (points, 2)
        Points that the texts name.
    drawn : (any, 2)
        Points that no text may hide.
    """
    assert isinstance(axes.figure, Figure)
    arrange(axes.figure)
    places = axes.transData.transform(drawn)
    taken = [_around(axes, place) for place in places[np.isfinite(places).all(axis=1)]]
    names: list[Bbox] = []
    leaders: list[Array] = []
    for point, text, colour in zip(points, texts, colours, strict=True):
        taken += _place(axes, point, text, colour, taken, names, leaders)


def _place(
    axes: Axes,
    point: Array,
    text: str,
    colour: str,
    taken: list[Bbox],
    names: list[Bbox],
    leaders: list[Array],
) -> list[Bbox]:
    """Write one text where it fits; return the boxes of the text and of its leader.

    No leader crosses a text of `names` or another leader; `leaders` holds the two ends of each.
    """
    for distance in _DISTANCES:
        for right, up in _DIRECTIONS:
            offset = np.array([right, up]) * distance / np.hypot(right, up)
            written = axes.annotate(
                text,
                (float(point[0]), float(point[1])),
                xytext=(float(offset[0]), float(offset[1])),
                textcoords="offset points",
                ha=_ACROSS[right + 1],
                va=_UP[up + 1],
                fontsize="small",
                color=colour,
                arrowprops=_LEADER | {"color": colour} if distance > _DISTANCES[0] else None,
            )
            written.get_window_extent()  # moves the text to its place
            box = Text.get_window_extent(written)  # without its leader
            line = np.array([axes.transData.transform(point), box.get_points().mean(axis=0)])
            leader = [_around(axes, place) for place in np.linspace(line[0], line[1], _ALONG)]
            crosses = any(part.count_overlaps(names) for part in leader) or any(
                _cross(line, other) for other in leaders
            )
            if not (box.count_overlaps(taken) or crosses) and _within(axes, box):
                names.append(box)
                leaders.append(line)
                return [box, *leader]
            written.remove()
    return []


def _cross(one: Array, other: Array) -> bool:
    """Whether two line segments cross or touch."""

    def side(line: Array, point: Array) -> float:
        along, away = line[1] - line[0], point - line[0]
        return float(along[0] * away[1] - along[1] * away[0])

    return all(
        side(line, ends[0]) * side(line, ends[1]) <= 0
        for line, ends in ((one, other), (other, one))
    )


def _around(axes: Axes, place: Array) -> Bbox:
    reach = _AROUND / 72 * axes.figure.dpi
    return Bbox([place - reach, place + reach])


def _within(axes: Axes, box: Bbox) -> bool:
    room = axes.bbox.padded(-_AROUND / 72 * axes.figure.dpi)
    inner = room.x0 <= box.x0 and box.x1 <= room.x1
    return bool(inner and room.y0 <= box.y0 and box.y1 <= room.y1)
