"""Figure of the region of convergence: the share of runs that settle over two swept keys."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure as Drawing

from eqt_cli.analysis.comparison.intervals import shares
from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import OfSettled
from eqt_cli.plots.drawing.cells import Cells, map_columns
from eqt_cli.plots.drawing.layout import add_title, sheet_of_maps
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink
from eqt_cli.plots.shown.sweep import ShownSweep

_ROW, _AROUND = 0.34, 0.5
"""Height of a row of cells, with two lines in each, and of the surroundings of a map, in."""
_MOST, _LEAST = 2.6, 1.3
"""Largest and smallest height of a map with its surroundings, in."""
_SCALES = 1.15
"""Width of the vertical scale and the colour scale, in."""
_ROUNDING = 1e-9
"""Rounding error of an end of an interval, per cent."""


@dataclass(frozen=True)
class Region(OfSettled):
    """The share of runs that settle over two swept keys, a map for each law.

    In each cell, if it has room, the share in per cent, and below it its 95 % Wilson interval. A
    run that failed has not settled.
    """

    name: ClassVar[str] = "region"

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw maps with common scales and colours from 0 to 100 %."""
        if len(swept.axes) != 2:
            raise swept.error(
                f"shows two swept keys, and here are {len(swept.axes)} ({swept.keys}); figure "
                "'envelope' shows a swept number"
            )
        cells, count = Cells(*swept.axes), len(swept.titles)
        columns = map_columns(count, width)
        height = min(max(_LEAST, _ROW * cells.shape[0] + _AROUND), _MOST)
        drawing, panels = sheet_of_maps(count, columns, width, height)
        percent = 100 * shares(swept.settled(self.by).astype(float))
        room = (WIDTHS[width] - _SCALES) / columns, height - _AROUND
        look: dict[str, Any] = {"vmin": 0, "vmax": 100, "edgecolors": ink(0), "linewidth": 0.4}
        written = []
        for index, (panel, title) in enumerate(zip(panels, swept.titles, strict=True)):
            share, low, high = percent[:, index].T
            image = cells.draw(panel, share, label=title, **look)
            alone = [_per_cent(number) for number in share]
            ends = map(_interval, low, high)
            both = [f"{text}\n{end}" for text, end in zip(alone, ends, strict=True)]
            written.append(cells.write(panel, share, image, room, both))
            if not written[-1]:
                cells.write(panel, share, image, room, alone)
            add_title(panel, title, WIDTHS[width] / columns)
            edges = {"leftmost": index % columns == 0, "lowest": index + columns >= count}
            below = cells.scales(panel, swept.results, room[0], **edges)
        drawing.set_figheight(drawing.get_figheight() + below)
        when = f"by {self.by:g} s" if self.by else "at the end"
        drawing.colorbar(image, ax=panels, label=f"share settled {when} (%)")
        swept.remarks.append(
            f"A cell per tested value, of {swept.count}; {_intervals(percent, written)}."
        )
        return drawing


def _intervals(percent: Array, written: list[bool]) -> str:
    """Return a note on the intervals: in the cells, or their widths if there is no room."""
    if all(written):
        return "below the share, its 95 % Wilson interval"
    share, low, high = np.moveaxis(percent, -1, 0)
    most = np.max(np.maximum(high - share, share - low))
    return f"95 % Wilson intervals of at most ±{most:.2g} percentage points"


def _interval(low: float, high: float) -> str:
    """Return an interval in per cent, rounded outwards unless it is narrow."""
    if high - low < 1:
        return f"{low:.4g}–{high:.4g}"
    return f"{math.floor(low + _ROUNDING)}–{math.ceil(high - _ROUNDING)}"


def _per_cent(number: float) -> str:
    """Return a share in per cent; 0 and 100 only for none and all."""
    if number < 0.5:
        return f"{number:.1g}"
    if number > 99.5:
        return f"{100 - float(f'{100 - number:.1g}'):.10g}"
    return f"{number:.0f}"
