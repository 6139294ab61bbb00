"""Figure of a design trade-off: every point by two metrics, and the Pareto front."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import OfSweep
from eqt_cli.plots.drawing.cells import scale
from eqt_cli.plots.drawing.curve_labels import name_points
from eqt_cli.plots.drawing.labels import free_text, metric_label
from eqt_cli.plots.drawing.layout import add_legend
from eqt_cli.plots.drawing.style import WIDTHS, Width, line_style
from eqt_cli.plots.shown.sweep import ShownSweep
from eqt_cli.tuning.ranking import front

_HEIGHTS: dict[Width, float] = {"column": 2.4, "page": 3.4, "slide": 2.6}
_PALE = 0.45

MOST_NAMED = 16
"""Most points on fronts that are named on a page; more would hide each other."""
_LONGEST, _ALONG = 40, 25
"""Most characters in a line of a name, and points on a step that names keep clear of."""


@dataclass(frozen=True)
class Pareto(OfSweep):
    """Every point of a sweep by two metrics, of which lower is better, and the Pareto front.

    Only of design choices: gains and options of laws. Points are means over the runs; a line joins
    the Pareto front of each law. On a page, few such points carry the values of the swept keys, as
    far as there is room.

    Attributes
    ----------
    cost, error
        The metrics across and up, by their names in the result; by default the effort and the mean
        pose error, of the first part where parts have units of their own.
    log
        Logarithmic scales; by default, of the metrics that span more than a decade.
    """

    name: ClassVar[str] = "pareto"

    cost: str = ""
    error: str = ""
    log: bool | None = None

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw the means over the runs of every point, and the front of every controller."""
        swept.require_choices()
        cost_name = self.cost or swept.of_one_unit("effort")
        error_name = self.error or swept.of_one_unit("mean_pose_error")
        cost, error = swept.means(cost_name), swept.means(error_name)
        drawing = Drawing(figsize=(WIDTHS[width], _HEIGHTS[width]))
        panel = drawing.add_subplot()
        lines, fronts = [], []
        for k, (of, title) in enumerate(zip(swept.looks, swept.titles, strict=True)):
            look = line_style(of) | {"marker": of.marker, "label": title}
            x, y = cost[:, k], error[:, k]
            pale = {"color": look["color"], "alpha": _PALE, "linewidths": 0}
            panel.scatter(x, y, s=16, marker=look["marker"], label=title, **pale)
            best = front(x, y)
            # Steps, since the first of two points of the front dominates all between them.
            lines += panel.plot(x[best], y[best], drawstyle="steps-post", markersize=4.5, **look)
            fronts.append(best)
        panel.margins(0.03)
        scale(panel, "x", cost, log=self.log)
        scale(panel, "y", error, log=self.log)
        panel.set_xlabel(metric_label(swept.results, cost_name, 36))
        panel.set_ylabel(metric_label(swept.results, error_name, 36))
        add_legend(drawing, lines, swept.titles)
        if width != "column" and sum(map(len, fronts)) <= MOST_NAMED:
            _name_fronts(panel, swept, fronts, cost, error)
        swept.remarks.append(f"Each point: mean over {swept.count}.")
        return drawing


def _name_fronts(
    panel: Axes, swept: ShownSweep, fronts: list[Array], cost: Array, error: Array
) -> None:
    """Write the swept values beside the points of the fronts."""
    points, texts, colours, corners = [], [], [], [np.column_stack([cost.ravel(), error.ravel()])]
    for k, (best, look) in enumerate(zip(fronts, swept.looks, strict=True)):
        x, y = cost[best, k], error[best, k]
        points.append(np.column_stack([x, y]))
        texts += [free_text(swept.point_name(int(point)), _LONGEST) for point in best]
        colours += [look.colour] * len(best)
        corners += [steps(x, y)]
    name_points(panel, np.concatenate(points), texts, colours, np.concatenate(corners))


def steps(x: Array, y: Array) -> Array:
    """Return points along the steps between points, ``(any, 2)``."""
    share = np.linspace(0, 1, _ALONG)[:, None]
    across = np.stack([x[:-1] + share * np.diff(x), y[:-1] + 0 * share], axis=-1)
    down = np.stack([x[1:] + 0 * share, y[:-1] + share * np.diff(y)], axis=-1)
    return np.concatenate([across, down]).reshape(-1, 2)
