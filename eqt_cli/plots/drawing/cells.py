"""The points of a sweep as cells of a map over one or two keys; it knows no metric."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.key_labels import key_label
from eqt_cli.plots.drawing.labels import free_text
from eqt_cli.plots.drawing.style import ink
from eqt_cli.results.result import Result, SweptKey

_LONGEST = 36
"""Characters in a line of a label."""

_MOST_LEVELS = 6
"""Values along a scale that are written."""


@dataclass(frozen=True)
class Cells:
    """Where the points of a sweep lie in a map.

    Attributes
    ----------
    across, up
        The swept keys; without the second, the map is a single row.
    """

    across: SweptKey
    up: SweptKey | None = None

    @cached_property
    def columns(self) -> Array:
        """Of each point."""
        return np.searchsorted(self._levels(self.across), self.across.values)

    @cached_property
    def rows(self) -> Array:
        """Of each point."""
        if self.up is None:
            return np.zeros_like(self.columns)
        return np.searchsorted(self._levels(self.up), self.up.values)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return int(self.rows.max()) + 1, int(self.columns.max()) + 1

    def grid(self, values: Array) -> Array:
        """Numbers of all points, ``(rows, columns)``; NaN where there is no point."""
        found = np.full(self.shape, np.nan)
        found[self.rows, self.columns] = values
        return found

    def draw(self, panel: Axes, values: Array, **look: Any) -> Any:
        """Colour the cells by the numbers of the points."""
        rows, columns = self.shape
        return panel.pcolormesh(np.arange(columns), np.arange(rows), self.grid(values), **look)

    def hatch(self, panel: Axes, points: Iterable[int], pattern: str) -> None:
        """Hatch the cells of some points."""
        look = {"fill": False, "hatch": pattern, "edgecolor": ink(0.35), "linewidth": 0}
        self._rectangles(panel, points, look)

    def mark(self, panel: Axes, point: int) -> None:
        """Draw a frame around the cell of a point, seen on every colour."""
        for colour, width in ((ink(0), 2.2), (ink(), 1.0)):
            look = {"fill": False, "edgecolor": colour, "linewidth": width, "zorder": 3}
            self._rectangles(panel, [point], look, 0.06)

    def _rectangles(
        self, panel: Axes, points: Iterable[int], look: dict[str, Any], inset: float = 0.0
    ) -> None:
        side = 1 - 2 * inset
        for point in points:
            corner = self.columns[point] - side / 2, self.rows[point] - side / 2
            panel.add_patch(Rectangle(corner, side, side, **look))

    def scales(self, panel: Axes, result: Result, *, leftmost: bool = True) -> None:
        """Name the keys, and number the cells along them."""
        self._number(panel, "x", self.across, result)
        if self.up is None:
            panel.set_yticks([])
        elif leftmost:
            self._number(panel, "y", self.up, result)

    def _number(self, panel: Axes, direction: str, key: SweptKey, result: Result) -> None:
        levels = self._levels(key)
        shown = range(0, len(levels), max(1, len(levels) // _MOST_LEVELS))
        numbers = [f"{levels[k]:.3g}".replace("-", "−") for k in shown]
        names = [
            key.texts.get(float(levels[k]), text) for k, text in zip(shown, numbers, strict=True)
        ]
        texts = [free_text(name, _LONGEST) for name in names]
        panel.set(**{f"{direction}ticks": list(shown), f"{direction}ticklabels": texts})
        panel.set(**{f"{direction}label": key_label(result, key.key)})

    @staticmethod
    def _levels(key: SweptKey) -> Array:
        return np.unique(key.values)
