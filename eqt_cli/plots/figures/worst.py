"""Figure of a search for the worst run: the worst along each key."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.plots.base import OfWorst
from eqt_cli.plots.drawing.key_labels import scale_along
from eqt_cli.plots.drawing.labels import metric_label
from eqt_cli.plots.drawing.layout import (
    add_legend,
    blank_sheet,
    hide_inner_scales,
    rows_of,
    share_scale,
)
from eqt_cli.plots.drawing.scales import scale
from eqt_cli.plots.drawing.style import WIDTHS, Width, line_style, marker
from eqt_cli.plots.shown.worst import Along, ShownWorst

_HEIGHTS: dict[Width, float] = {"column": 1.9, "page": 2.2, "slide": 1.35}
_IN_A_ROW: dict[Width, int] = {"column": 2, "page": 4, "slide": 4}
_SMALL, _LARGE = 2.5, 4.5
"""Sizes of markers, pt; large where the worst was found."""


@dataclass(frozen=True)
class WorstFigure(OfWorst):
    """The worst run of each law along each key, through the worst that `eqt worst` found.

    The other keys stay where the worst of the law was found; a filled marker shows this point. A
    cross at the top marks values at which a run failed.

    Attributes
    ----------
    log
        A logarithmic scale, where all numbers are positive; by default, where they span more than
        a decade.
    """

    name: ClassVar[str] = "worst"

    log: bool | None = None

    def compose(self, shown: ShownWorst, width: Width) -> Drawing:
        """Draw a panel per key; laws have the colours and markers of all other figures."""
        mosaic = rows_of(shown.keys, min(_IN_A_ROW[width], len(shown.keys)))
        drawing, panels = blank_sheet(width, mosaic, _HEIGHTS[width])
        room = WIDTHS[width] / len(mosaic[0])
        share_scale(panels.values())
        titles: dict[str, Any] = {}
        for key in shown.keys:
            panel = panels[key]
            for line in (line for line in shown.lines if line.key == key):
                drawn = _draw(panel, line)
                titles.setdefault(line.title, drawn)
            scale_along(panel, shown.results, shown.swept(key), room)
        seen = np.concatenate([line.worst for line in shown.lines])
        if np.isfinite(seen).any():
            scale(panels[mosaic[0][0]], "y", seen[np.isfinite(seen)], log=self.log)
        label = f"worst {metric_label(shown.results, shown.objective, 30)}"
        for row in mosaic:
            panels[row[0]].set_ylabel(label)
        hide_inner_scales(panels, mosaic)
        add_legend(drawing, list(titles.values()), list(titles))
        return drawing


def _draw(panel: Axes, line: Along) -> Any:
    look = line_style(line.look)
    mark: dict[str, Any] = {"marker": marker(line.look), "color": look["color"]}
    hollow = look | mark | {"markersize": _SMALL, "markerfacecolor": "none"}
    (drawn,) = panel.plot(line.values, line.worst, label=line.title, **hollow)
    found_look = mark | {"markersize": _LARGE, "linestyle": "", "clip_on": False}
    found = [line.values[line.found]], [line.worst[line.found]]
    panel.plot(*found, label=f"{line.title}, found", **found_look)
    if line.failed.any():
        x = line.values[line.failed]
        top: dict[str, Any] = {
            "transform": panel.get_xaxis_transform(),
            "linestyle": "",
            "clip_on": False,
        }
        ends = np.full(len(x), 0.97)
        panel.plot(x, ends, label=f"{line.title}, failed", marker="x", color=look["color"], **top)
    return drawn
