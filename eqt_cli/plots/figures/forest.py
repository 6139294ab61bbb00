"""Figure of cases: the difference of two laws in each, and the share of runs that settle."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import PercentFormatter

from eqt_cli.analysis.comparison.intervals import FEWEST, relative_difference, shares
from eqt_cli.analysis.comparison.pairs import resolved_differences
from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import Extras, OfDifferences
from eqt_cli.plots.drawing.labels import free_text, metric_label
from eqt_cli.plots.drawing.layout import add_legend
from eqt_cli.plots.drawing.style import WIDTHS, Look, Width, ink
from eqt_cli.plots.shown.sweep import ShownSweep
from eqt_cli.results.result import Result
from eqt_cli.tuning.held_out import side_by_side

MOST_ROWS = 40

Settings = dict[str, Any]

_ROW, _AROUND = 0.2, 0.85
"""Height of a row, and of scales and legend, in."""
_LONGEST = 24
"""Most characters in a line of a name."""
_BESIDE = 0.16
"""Offset of the shares of the two laws from the middle of their row, in heights of a row."""
_SMALL = 3.5
"""Size of markers, pt; small, since the intervals matter."""


@dataclass(frozen=True)
class Forest(OfDifferences):
    """A row for each point of a sweep: the paired difference of two laws, and who settles.

    The difference of the means over all runs, in per cent of the second law's mean, with its
    interval (Fieller); filled where the interval leaves out 0. Beside it, the share of runs of both
    laws that settle, with Wilson intervals.
    """

    name: ClassVar[str] = "forest"

    def subject(self, results: Sequence[Result], extras: Extras) -> ShownSweep:
        """Return the points; of a tuning, the winners unless others are chosen."""
        shown = self._only(results, "sweep")
        laws = self.controllers or (side_by_side(shown) if shown.is_sweep else ())
        return ShownSweep(shown, self.name, self.chosen._replace(controllers=laws))

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw two panels with the same rows, the first point on top."""
        if len(swept.controllers) != 2:
            raise swept.error(
                f"compares two laws, and here are {len(swept.controllers)}: "
                f"{', '.join(swept.titles)}; choose two by the option controllers"
                if len(swept.controllers) > 2
                else f"compares two laws, and here is one: {swept.titles[0]}"
            )
        values = swept.metric(self.metric_of(swept))
        if (points := len(values)) > MOST_ROWS:
            raise swept.error(
                f"has a row for each point, at most {MOST_ROWS}, and here are {points}"
            )
        settled = swept.settled(0)
        rows = np.arange(points)
        size = (WIDTHS[width], _AROUND + _ROW * points)
        drawing = Drawing(figsize=size)
        left, right = drawing.subplots(1, 2, sharey=True, width_ratios=(3, 2))
        first, second = swept.titles
        differences = np.array([self._difference(*of_point) for of_point in values])
        _draw_differences(left, rows, 100 * differences, f"{first} − {second}")
        label = metric_label(swept.results, self.metric_of(swept), 40)
        left.set_xlabel(f"{label}\n{first} − {second}, % of {second}")
        for k, look in enumerate(swept.looks):
            share = shares(settled[:, k].astype(float), self.confidence)
            _draw_shares(right, rows + (2 * k - 1) * _BESIDE, share, look, swept.titles[k])
        right.set_xlim(-0.04, 1.04)
        right.set_xlabel("share settled (%)")
        right.xaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=""))
        left.set_yticks(rows, [free_text(swept.point_name(int(k)), _LONGEST) for k in rows])
        left.set_ylim(points - 0.4, -0.6)
        for panel in (left, right):
            panel.grid(axis="y", visible=False)
            panel.tick_params(axis="y", length=0)
        add_legend(drawing, right.lines[:2], swept.titles)
        swept.remarks += self._remarks(swept, differences, first)
        return drawing

    def _difference(self, first: Array, second: Array) -> tuple[float, float, float]:
        return relative_difference(resolved_differences(first, second), second, self.confidence)

    def _remarks(self, swept: ShownSweep, differences: Array, first: str) -> list[str]:
        quantity = swept.results.quantity(self.metric_of(swept))
        side = {"lower": "Left", "higher": "Right"}.get(quantity.better)
        better = f" {side} of 0: {first} is better." if side else ""
        notes = [
            f"{swept.count} per row.{better} "
            f"Intervals of {100 * self.confidence:g} %, each by itself; filled where they exclude "
            "0. Failed runs are no part of the differences."
        ]
        if not np.isfinite(differences).all():
            notes.append(f"No interval from fewer than {FEWEST} runs, or where the mean may be 0.")
        return notes


def _draw_differences(panel: Axes, rows: Array, differences: Array, name: str) -> None:
    mean, low, high = differences.T
    panel.axvline(0, color=ink(0.5), linewidth=0.6, label="no difference")
    known = np.isfinite(low) & np.isfinite(high)
    ends = np.array([mean - low, high - mean])[:, known]
    bars: Settings = {"fmt": "none", "ecolor": ink(0.8), "elinewidth": 0.9}
    if known.any():
        panel.errorbar(mean[known], rows[known], xerr=ends, label=f"{name}, intervals", **bars)
    decided = known & ((low > 0) | (high < 0))
    look: Settings = {"marker": "D", "markersize": _SMALL, "linestyle": "", "color": ink(0.8)}
    hollow = look | {"markerfacecolor": ink(0)}
    for some, which, style in ((decided, "without 0", look), (~decided, "with 0", hollow)):
        if some.any():
            panel.plot(mean[some], rows[some], label=f"{name}, {which}", **style)
    panel.margins(x=0.06)


def _draw_shares(panel: Axes, rows: Array, shares: Array, of: Look, title: str) -> None:
    share, low, high = shares.T
    look: Settings = {"marker": of.marker, "markersize": _SMALL, "color": of.colour}
    panel.plot(share, rows, label=title, linestyle="", **look)
    bars: Settings = {"fmt": "none", "ecolor": of.colour, "elinewidth": 0.8}
    ends = [share - low, high - share]
    panel.errorbar(share, rows, xerr=ends, label=f"{title}, intervals", **bars)
