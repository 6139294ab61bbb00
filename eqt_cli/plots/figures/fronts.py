"""Figure of a search with two objectives: the front of each law, on held-out runs."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.analysis.comparison.bootstrap import intervals_of_means
from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import OfTuning
from eqt_cli.plots.drawing.curves import RESAMPLING
from eqt_cli.plots.drawing.labels import metric_label
from eqt_cli.plots.drawing.layout import add_legend
from eqt_cli.plots.drawing.scales import scale
from eqt_cli.plots.drawing.style import WIDTHS, Width, line_style, marker
from eqt_cli.plots.shown.fronts import ShownFronts

_HEIGHTS: dict[Width, float] = {"column": 2.6, "page": 3.8, "slide": 2.7}
_SMALL = 3.5
"""Size of markers, pt; small, since the intervals matter."""


@dataclass(frozen=True)
class Fronts(OfTuning):
    """The winners of each law by both objectives on held-out runs, with 95 % intervals.

    The line joins the Pareto front of these runs; hollow points are not on it.
    A cross marks the starting gains of each law.

    Attributes
    ----------
    log
        Logarithmic scales, where all numbers are positive; by default, of the objectives that span
        more than a decade.
    """

    name: ClassVar[str] = "fronts"

    log: bool | None = None

    def compose(self, shown: ShownFronts, width: Width) -> Drawing:
        """Draw one panel; laws have the colours and markers of all other figures."""
        drawing = Drawing(figsize=(WIDTHS[width], _HEIGHTS[width]))
        panel = drawing.add_subplot()
        lines, seen = [], []
        for front, of in zip(shown.fronts, shown.looks, strict=True):
            look = line_style(of)
            points = [_intervals(values) for values in shown.values(front)]
            best = front.best
            others = np.setdiff1d(np.arange(len(front.labels)), best)
            style: dict[str, Any] = look | {"marker": marker(of), "markersize": _SMALL}
            x, y = (each[best, 0] for each in points)
            lines += panel.plot(x, y, label=front.law, **style)
            _crosses(panel, points, best, look["color"], f"{front.law}, intervals")
            if len(others):
                x, y = (each[others, 0] for each in points)
                hollow = style | {"linestyle": "", "markerfacecolor": "none"}
                panel.plot(x, y, label=f"{front.law}, dominated", **hollow)
            start = shown.start(front)
            panel.plot(*start, "x", color=look["color"], label=f"{front.law}, start")
            seen += points
        panel.margins(0.03)
        scale(panel, "x", np.concatenate(seen[0::2]), log=self.log)
        scale(panel, "y", np.concatenate(seen[1::2]), log=self.log)
        panel.set_xlabel(metric_label(shown.results, shown.objectives[0], 36))
        panel.set_ylabel(metric_label(shown.results, shown.objectives[1], 36))
        add_legend(drawing, lines, shown.titles)
        return drawing


def _intervals(values: Array) -> Array:
    """Return the mean and the interval of each row, ``(rows, 3)``."""
    found = intervals_of_means(values.T, RESAMPLING)
    return np.stack([found.mean, found.low, found.high], axis=-1)


def _crosses(panel: Axes, points: list[Array], rows: Array, colour: str, name: str) -> None:
    """Draw intervals along both scales."""
    (x, left, right), (y, low, high) = (each[rows].T for each in points)
    panel.errorbar(
        x,
        y,
        xerr=[x - left, right - x],
        yerr=[y - low, high - y],
        fmt="none",
        ecolor=(colour, 0.5),
        elinewidth=0.5,
        label=name,
    )
