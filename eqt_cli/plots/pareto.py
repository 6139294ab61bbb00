"""The figure of a design's trade-off: every point by two metrics, and the front of the best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure as Drawing

from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import Figure
from eqt_cli.plots.labels import free_text
from eqt_cli.plots.layout import add_legend, add_remarks, freeze
from eqt_cli.plots.style import WIDTHS, Width, house_style, line_style
from eqt_cli.plots.swept import Swept, described, mean_over_runs
from eqt_cli.store.reader import Results

_HEIGHTS: dict[Width, float] = {"column": 2.4, "page": 3.4}


@dataclass(frozen=True)
class Pareto(Figure):
    """Every point of a sweep by two metrics, less being better, and the front that none betters.

    Attributes
    ----------
    cost, error
        The metrics across and up, by their names in the result.
    """

    name: ClassVar[str] = "pareto"
    sweeps: ClassVar[bool] = True

    cost: str = "effort"
    error: str = "mean_pose_error"

    def draw(self, results: Results, width: Width = "column") -> Drawing:
        """Draw the means over the good runs of every point; see `Figure.draw`."""
        swept = Swept(results, self.name)
        cost, error = (mean_over_runs(swept.metric(name)) for name in (self.cost, self.error))
        with house_style():
            drawing = Drawing(figsize=(WIDTHS[width], _HEIGHTS[width]))
            panel = drawing.add_subplot()
            lines = []
            for index, label in enumerate(swept.labels):
                style = line_style(index)
                tint = {"color": style["color"], "alpha": 0.4}
                panel.scatter(cost[:, index], error[:, index], s=4, label=label, **tint)
                best = front(cost[:, index], error[:, index])
                lines += panel.plot(cost[best, index], error[best, index], label=label, **style)
            for name, set_label in ((self.cost, panel.set_xlabel), (self.error, panel.set_ylabel)):
                set_label(free_text(described(results, name), 36))
            add_legend(drawing, lines, swept.labels)
            add_remarks(drawing, swept.notes())
            freeze(drawing)
        return drawing

    def compose(self, runs: object, width: Width) -> Drawing:
        """Unused: `draw` is all that this figure does."""
        raise NotImplementedError


def front(cost: Array, error: Array) -> Array:
    """The points that no other betters in both, by rising cost; NaN is bettered by all."""
    order = np.lexsort((error, cost))
    order = order[np.isfinite(cost[order]) & np.isfinite(error[order])]
    least = np.minimum.accumulate(error[order])
    strictly = np.ones(len(order), dtype=bool)
    strictly[1:] = least[1:] < least[:-1]
    return order[strictly]
