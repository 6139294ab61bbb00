"""The points of a sweep as cells of a map over one or two keys; it knows no metric."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.labels import free_text
from eqt_cli.plots.drawing.scales import key_label
from eqt_cli.plots.drawing.style import Width, ink
from eqt_cli.results.result import Result
from eqt_cli.results.swept_key import SweptKey

_LONGEST = 36
"""Most characters in a line of a label."""

_LONGEST_NAME = 18
"""Most characters in a line of the name of a value that is no number."""

_TICK_LETTER = 0.06
"""Width of a letter below a map with its share of the gap to the next name, in."""

_LETTER, _BESIDE, _LINE = 0.048, 0.088, 0.16
"""Width of a letter in a cell, of the margins around a text, and height of a line, in."""
_TENS = 10
"""Numbers of at least this size are written without decimals."""
_LONGEST_NUMBER = 4
"""Most characters of a number in a cell."""
_DARK = 0.55
"""Luminance below which numbers are written in the colour of the paper."""

_WRITTEN: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6.5, "zorder": 4}

_MOST_LEVELS = 6
"""Approximate number of values written along a scale."""


@dataclass(frozen=True)
class Cells:
    """Cells of the points of a sweep in a map.

    Attributes
    ----------
    across, up
        The swept keys; without the second, the map is a single row.
    """

    across: SweptKey
    up: SweptKey | None = None

    @cached_property
    def columns(self) -> Array:
        """Column of each point."""
        return np.unique(self.across.values, return_inverse=True)[1]

    @cached_property
    def rows(self) -> Array:
        """Row of each point."""
        if self.up is None:
            return np.zeros_like(self.columns)
        return np.unique(self.up.values, return_inverse=True)[1]

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return int(self.rows.max()) + 1, int(self.columns.max()) + 1

    def grid(self, values: Array) -> Array:
        """Return values of all points as ``(rows, columns)``; NaN where there is no point."""
        found = np.full(self.shape, np.nan)
        found[self.rows, self.columns] = values
        return found

    def draw(self, panel: Axes, values: Array, **look: Any) -> Any:
        """Colour the cells by the values of the points."""
        # Edges, since the centre of a single row or column does not give its extent.
        rows, columns = (np.arange(count + 1) - 0.5 for count in self.shape)
        return panel.pcolormesh(columns, rows, self.grid(values), **look)

    def hatch(self, panel: Axes, points: Iterable[int], pattern: str) -> None:
        """Hatch the cells of some points."""
        self._outline(panel, points, hatch=pattern, edgecolor=ink(0.35), linewidth=0)

    def write(
        self,
        panel: Axes,
        values: Array,
        image: Any,
        room: tuple[float, float],
        texts: Sequence[str] | None = None,
    ) -> bool:
        """Write the values of the points in their cells if they fit; return whether they do.

        Parameters
        ----------
        image
            Image that `draw` returned, for its colours.
        room
            Width and height of the panel, in.
        texts
            Text of each point, in one line or several; its value if None.
        """
        rows, columns = self.shape
        if texts is None:
            longest, lines = _LONGEST_NUMBER, 1
            texts = [short(value) for value in values]
        else:
            longest = max(len(line) for text in texts for line in text.split("\n"))
            lines = max(text.count("\n") for text in texts) + 1
        if room[0] / columns < _LETTER * longest + _BESIDE or room[1] / rows < _LINE * lines:
            return False
        for point, value in enumerate(values):
            if np.isfinite(value):
                red, green, blue, _ = ground = image.cmap(image.norm(value))
                dark = 0.2126 * red + 0.7152 * green + 0.0722 * blue < _DARK
                panel.annotate(
                    texts[point],
                    (self.columns[point], self.rows[point]),
                    color=ink(0) if dark else ink(),
                    bbox={"facecolor": ground, "edgecolor": "none", "pad": 0.6},
                    **_WRITTEN,
                )
        return True

    def mark(self, panel: Axes, points: Sequence[int]) -> None:
        """Draw a frame, visible on every colour, around the cells of some points."""
        for colour, width in ((ink(0), 2.2), (ink(), 1.0)):
            self._outline(panel, points, 0.06, edgecolor=colour, linewidth=width, zorder=3)

    def _outline(self, panel: Axes, points: Iterable[int], inset: float = 0, **look: Any) -> None:
        side = 1 - 2 * inset
        for point in points:
            corner = self.columns[point] - side / 2, self.rows[point] - side / 2
            panel.add_patch(Rectangle(corner, side, side, fill=False, **look))

    def scales(
        self,
        panel: Axes,
        result: Result,
        room: float,
        *,
        leftmost: bool = True,
        lowest: bool = True,
    ) -> float:
        """Name the keys and number the cells along them, in a panel `room` inches wide.

        A panel that is not the leftmost or not the lowest of its row or column has no such names.

        Return the extra room below the panel, in: texts for which it is too narrow stand upright.
        """
        texts = self._number(panel, "x", self.across, result)
        longest = _TICK_LETTER * max(len(line) for text in texts for line in text.split("\n"))
        upright = longest * len(texts) > room
        if upright:
            panel.tick_params(axis="x", labelrotation=90)
        if self.up is None:
            panel.set_yticks([])
        elif leftmost:
            self._number(panel, "y", self.up, result)
        # Matplotlib hides the numbers of every panel above the last row, whether it has one below.
        panel.tick_params(axis="x", labelbottom=lowest)
        panel.xaxis.label.set_visible(lowest)
        return longest if upright else 0.0

    def _number(self, panel: Axes, direction: str, key: SweptKey, result: Result) -> list[str]:
        """Number the cells along a scale; return the texts."""
        levels = np.unique(key.values).tolist()
        shown = range(0, len(levels), max(1, len(levels) // _MOST_LEVELS))
        numbers = {level: f"{level:.3g}".replace("-", "−") for level in levels}
        names = numbers | key.names
        most = _LONGEST if key.is_number else _LONGEST_NAME
        texts = [free_text(names[levels[k]], most) for k in shown]
        panel.set(**{f"{direction}ticks": list(shown), f"{direction}ticklabels": texts})
        panel.set(**{f"{direction}label": key_label(result, key)})
        return texts


def short(value: float) -> str:
    """Return a number as it is written in a cell."""
    return f"{value:#.2g}" if abs(value) < _TENS else f"{value:.0f}"


def map_columns(count: int, width: Width) -> int:
    """Return how many of `count` maps stand side by side."""
    most = (1 if count < 3 else 2) if width == "column" else 2 if count == 4 else 3
    return min(count, most)
