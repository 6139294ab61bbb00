"""The figure of a design's trade-off: every point by two metrics, and the front of the best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure as Drawing

from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import OfSweep
from eqt_cli.plots.layout import add_legend
from eqt_cli.plots.metric_names import metric_label
from eqt_cli.plots.scales import scale_log
from eqt_cli.plots.style import WIDTHS, Width, line_style, marker
from eqt_cli.plots.swept import Swept, mean_over_runs

_HEIGHTS: dict[Width, float] = {"column": 2.4, "page": 3.4}


@dataclass(frozen=True)
class Pareto(OfSweep):
    """Every point of a sweep by two metrics, less being better, and the front that none betters.

    Attributes
    ----------
    cost, error
        The metrics across and up, by their names in the result.
    log
        Logarithmic scales.
    """

    name: ClassVar[str] = "pareto"

    cost: str = "effort"
    error: str = "mean_pose_error"
    log: bool = False

    def compose(self, swept: Swept, width: Width) -> Drawing:
        """The means over the good runs of every point, and their front, for every controller."""
        cost, error = (mean_over_runs(swept.metric(name)) for name in (self.cost, self.error))
        drawing = Drawing(figsize=(WIDTHS[width], _HEIGHTS[width]))
        panel = drawing.add_subplot()
        lines = []
        for k, (position, title) in enumerate(zip(swept.controllers, swept.titles, strict=True)):
            style = line_style(position)
            tint = {"color": style["color"], "alpha": 0.4}
            shape = marker(position)
            panel.scatter(cost[:, k], error[:, k], s=6, marker=shape, label=title, **tint)
            best = front(cost[:, k], error[:, k])
            # Between two points of the front lies what the first of them betters.
            style |= {"drawstyle": "steps-post", "label": title}
            lines += panel.plot(cost[best, k], error[best, k], **style)
        panel.margins(0.03)
        if self.log:
            scale_log(panel, "x", cost[cost > 0])
            scale_log(panel, "y", error[error > 0])
        for name, set_label in ((self.cost, panel.set_xlabel), (self.error, panel.set_ylabel)):
            set_label(metric_label(swept.results, name, 36))
        add_legend(drawing, lines, swept.titles)
        return drawing


def front(cost: Array, error: Array) -> Array:
    """The points that no other betters in both, by rising cost; NaN is bettered by all."""
    order = np.lexsort((error, cost))
    order = order[np.isfinite(cost[order]) & np.isfinite(error[order])]
    least = np.minimum.accumulate(error[order])
    strictly = np.ones(len(order), dtype=bool)
    strictly[1:] = least[1:] < least[:-1]
    return order[strictly]
