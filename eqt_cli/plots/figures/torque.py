"""The figure of torque components: mean and range over runs, a panel per axis and controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import OverTime
from eqt_cli.plots.drawing.curves import BAND_NAMES, Bands, band_look, draw_band
from eqt_cli.plots.drawing.labels import component, quantity
from eqt_cli.plots.drawing.layout import (
    add_legend,
    add_title,
    hide_inner_scales,
    name_scale,
    share_scale,
    sheet,
)
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink, line_style
from eqt_cli.plots.figure_data import ShownRuns

_MOST_CONTROLLERS: dict[Width, int] = {"column": 4, "page": 8}
_DESIRED: dict[str, Any] = {"linewidth": 0.6, "linestyle": (0, (2, 1.5))}
_ANY = 0.7
"""The share of ink in the grey that stands for every controller's colour in the legend."""


@dataclass(frozen=True)
class Torque(OverTime):
    """Torque components: their mean over runs, a row per axis and a column per controller.

    Components in the body frame, with the range from the 10 % to the 90 % quantile over runs unless
    told otherwise; the desired torque is drawn in every panel.

    Attributes
    ----------
    bands
        ``quantiles`` shades the range from the 10 % to the 90 % quantile over runs, ``bootstrap``
        the 95 % interval of the mean at each time.
    """

    name: ClassVar[str] = "torque"

    bands: Bands = "quantiles"

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Axes downwards with a scale each, controllers to the right."""
        shown, most = runs.shown, _MOST_CONTROLLERS[width]
        if len(shown) > most:
            raise runs.error(
                f"has a column of panels per controller, and width '{width}' has room for "
                f"{most}, not {len(shown)}; "
                + ("take width 'page' or " if width == "column" else "")
                + "choose some with the option 'controllers'"
            )
        rows = [[f"{axis} {e.label}" for e in shown] for axis, _ in runs.axes]
        drawing, panels = sheet(width, rows, runs.span, runs.unit("time"))
        grid = [[panels[name] for name in row] for row in rows]
        for row, (axis, unit) in zip(grid, runs.axes, strict=True):
            share_scale(row)
            name_scale(row[0], quantity(component(r"\tau", axis), unit))
        hide_inner_scales(panels, rows)
        for column, ensemble in zip(zip(*grid, strict=True), shown, strict=True):
            add_title(column[0], ensemble.title, WIDTHS[width] / len(shown))
            colour = line_style(ensemble.look)["color"]
            times, values = runs.times(ensemble), runs.values("torque", ensemble)
            desired = runs.desired("torque", ensemble)
            for k, axes in enumerate(column):
                self._fill(axes, times, values[..., k], desired[:, k], colour)
        self._add_legend(drawing)
        return drawing

    def _fill(self, axes: Axes, times: Array, values: Array, desired: Array, colour: str) -> None:
        axes.plot(times, values.mean(axis=0), color=colour, label="mean")
        axes.plot(times, desired, label="desired", color=ink(), **_DESIRED)
        draw_band(axes, times, values, self.bands, colour, "of runs")

    def _add_legend(self, drawing: Drawing) -> None:
        any_colour = ink(_ANY)
        handles: dict[str, Artist] = {
            "mean": Line2D([], [], color=any_colour),
            r"$\tau_d$": Line2D([], [], color=ink(), **_DESIRED),
        }
        if self.bands in BAND_NAMES:
            handles[BAND_NAMES[self.bands]] = Patch(**band_look(any_colour))
        add_legend(drawing, list(handles.values()), list(handles))
