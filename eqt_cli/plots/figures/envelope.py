"""The figure of how far a loop carries: the share of runs that settle over a swept number."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.analysis.comparison.shares import shares
from eqt_cli.core.arrays import Array
from eqt_cli.core.problems import Problems
from eqt_cli.plots.base import OfSweep
from eqt_cli.plots.drawing.curve_labels import name_curves
from eqt_cli.plots.drawing.curves import band_look
from eqt_cli.plots.drawing.key_labels import key_label
from eqt_cli.plots.drawing.layout import add_title, blank_sheet, hide_scale, rows_of
from eqt_cli.plots.drawing.scales import number_values
from eqt_cli.plots.drawing.style import WIDTHS, Width, line_style, marker
from eqt_cli.plots.shown.sweep import ShownSweep
from eqt_cli.results.swept_key import SweptKey

_HEIGHTS: dict[Width, float] = {"column": 1.9, "page": 2.4}
_IN_A_ROW: dict[Width, int] = {"column": 2, "page": 4}
_MOST_PANELS = 12
_POINTS: dict[str, Any] = {"markersize": 4.5, "markerfacecolor": "none"}
_BESIDE = 0.6
"""in, that the scale up and the margins take of the width."""


@dataclass(frozen=True)
class Envelope(OfSweep):
    """The share of runs that have settled, over a swept number, with 95 % Wilson intervals.

    A run that failed has not settled. A second swept key has a panel for each of its values.

    Attributes
    ----------
    by
        s, by when a run must have settled for good; its end if 0.
    """

    name: ClassVar[str] = "envelope"

    by: float = 0.0

    def check(self, problems: Problems) -> None:
        """A time from 0."""
        if not self.by >= 0:
            problems.at("by").add(f"expected a time of 0 s or more, got {self.by:g}")

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """A curve and a band per controller; a panel per value of a second key."""
        across, other = self._axes(swept)
        settled = swept.settled(self.by)
        levels = np.unique(other.values) if other else np.zeros(1)
        names = [f"panel {k}" for k in range(len(levels))]
        mosaic = rows_of(names, min(_IN_A_ROW[width], len(names)))
        drawing, panels = blank_sheet(width, mosaic, _HEIGHTS[width])
        room = WIDTHS[width] / len(mosaic[0])
        lines = []
        for name, level in zip(names, levels, strict=True):
            axes = panels[name]
            points = np.flatnonzero(other.values == level) if other else np.arange(len(settled))
            order = points[np.argsort(across.values[points], kind="stable")]
            lines = [
                self._curve(axes, across.values[order], settled[order, k], position, title)
                for k, (position, title) in enumerate(
                    zip(swept.controllers, swept.titles, strict=True)
                )
            ]
            self._scales(axes, across, swept, room)
            if other:
                add_title(axes, f"{other.key} {other.at(int(points[0]))}", room)
            if name not in [row[0] for row in mosaic]:
                hide_scale(axes)
        name_curves(drawing, panels.values(), lines, swept.titles)
        swept.remarks.append(f"Each point: {swept.count}; bands: 95 % Wilson intervals.")
        return drawing

    def _axes(self, swept: ShownSweep) -> tuple[SweptKey, SweptKey | None]:
        """The number across, and the other key if there is one."""
        axes = swept.axes
        numbers = [axis for axis in axes if not axis.texts]
        if not numbers or len(axes) > 2:
            keys = ", ".join(axis.key for axis in axes) or "none"
            raise swept.error(
                f"shows a swept number and at most one more key, and here are: {keys}"
            )
        other = next((axis for axis in axes if axis is not numbers[0]), None)
        if other and len(np.unique(other.values)) > _MOST_PANELS:
            raise swept.error(
                f"has a panel for each value of {other.key}, at most {_MOST_PANELS}, and here are "
                f"{len(np.unique(other.values))}"
            )
        return numbers[0], other

    def _curve(self, axes: Axes, across: Array, settled: Array, position: int, title: str) -> Any:
        found = shares(settled)
        style = line_style(position)
        band = band_look(style["color"])
        axes.fill_between(across, found[:, 1], found[:, 2], label=title, **band)
        (line,) = axes.plot(
            across, found[:, 0], label=title, marker=marker(position), **_POINTS, **style
        )
        return line

    def _scales(self, axes: Axes, across: SweptKey, swept: ShownSweep, room: float) -> None:
        end = f"by {self.by:g} s" if self.by else "at the end"
        axes.set_ylim(-0.03, 1.03)
        axes.set_ylabel(f"share settled {end}")
        axes.set_xlabel(key_label(swept.results, across.key))
        axes.margins(x=0.03)
        if across.logarithmic:
            axes.set_xscale("log")
        number_values(axes, across.values, room - _BESIDE)
