"""Figure of the operating envelope: the share of runs that settle over a swept number."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from eqt_cli.analysis.comparison.intervals import shares
from eqt_cli.plots.base import OfSettled
from eqt_cli.plots.drawing.cells import key_at, scale_along
from eqt_cli.plots.drawing.curve_labels import name_curves
from eqt_cli.plots.drawing.curves import draw_points
from eqt_cli.plots.drawing.layout import add_title, blank_sheet, hide_inner_scales, rows_of
from eqt_cli.plots.drawing.style import WIDTHS, Width
from eqt_cli.plots.shown.sweep import ShownSweep
from eqt_cli.results.swept_key import SweptKey

_HEIGHTS: dict[Width, float] = {"column": 1.9, "page": 2.4, "slide": 2.3}
_IN_A_ROW: dict[Width, int] = {"column": 2, "page": 4, "slide": 3}
_MOST_PANELS = 12


@dataclass(frozen=True)
class Envelope(OfSettled):
    """The share of runs that have settled, over a swept number, with 95 % Wilson intervals.

    A run that failed has not settled. A second swept key has a panel for each of its values.
    """

    name: ClassVar[str] = "envelope"

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw a curve and a band per law; a panel per value of a second key."""
        across, other = self._axes(swept)
        settled = swept.settled(self.by)
        levels = np.unique(other.values) if other else np.zeros(1)
        names = [f"panel {k}" for k in range(len(levels))]
        mosaic = rows_of(names, min(_IN_A_ROW[width], len(names)))
        drawing, panels = blank_sheet(width, mosaic, _HEIGHTS[width])
        room = WIDTHS[width] / len(mosaic[0])
        laws = list(zip(swept.looks, swept.titles, strict=True))
        lines: list[Line2D] = []
        for name, level in zip(names, levels, strict=True):
            axes = panels[name]
            points = np.flatnonzero(other.values == level) if other else np.arange(len(settled))
            order = points[np.argsort(across.values[points], kind="stable")]
            x, lines = across.values[order], []
            for k, (look, title) in enumerate(laws):
                share, low, high = shares(settled[order, k]).T
                lines += draw_points(axes, x, share, (low, high), look, title)
            axes.set_ylim(-0.03, 1.03)
            axes.set_ylabel(f"share settled {f'by {self.by:g} s' if self.by else 'at the end'} (%)")
            axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=""))
            scale_along(axes, swept.results, across, room)
            if other:
                add_title(axes, key_at(swept.results, other, int(points[0])), room)
        hide_inner_scales(panels, mosaic)
        name_curves(drawing, panels.values(), lines, swept.titles)
        swept.remarks.append(f"Each point: {swept.count}; bands: 95 % Wilson intervals.")
        return drawing

    def _axes(self, swept: ShownSweep) -> tuple[SweptKey, SweptKey | None]:
        """Return the key of the horizontal scale, and the other key if there is one."""
        if (keys := swept.results.number_and_other()) is None:
            raise swept.error(
                f"shows a swept number and at most one more key, and here are: {swept.keys}"
            )
        across, other = keys
        if other and len(np.unique(other.values)) > _MOST_PANELS:
            raise swept.error(
                f"has a panel for each value of {other.key}, at most {_MOST_PANELS}, and here are "
                f"{len(np.unique(other.values))}"
            )
        return across, other
