"""The figure of torque components: mean and range over runs, a panel per axis and controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from matplotlib.figure import Figure as Drawing

from eqt_cli.plots.base import Figure
from eqt_cli.plots.curves import draw_band
from eqt_cli.plots.good_runs import GoodRuns
from eqt_cli.plots.labels import component, quantity, set_name
from eqt_cli.plots.layout import add_legend, hide_scale, share_scale, sheet
from eqt_cli.plots.style import Width, line_style


@dataclass(frozen=True)
class Torque(Figure):
    """Torque components: their mean over runs, a row per axis and a column per controller.

    Attributes
    ----------
    bands
        ``quantiles`` shades the range from the 10 % to the 90 % quantile over runs.
    """

    name: ClassVar[str] = "torque"

    bands: Literal["none", "quantiles"] = "quantiles"

    def compose(self, runs: GoodRuns, width: Width) -> Drawing:
        """Axes downwards, controllers to the right, the desired torque in every panel."""
        rows = [[f"{axis} {e.index}" for e in runs.shown] for axis in range(len(runs.axes))]
        drawing, panels = sheet(width, rows, runs.times, runs.unit("time"))
        for names, (axis, unit) in zip(rows, runs.axes, strict=True):
            share_scale([panels[name] for name in names])
            panels[names[0]].set_ylabel(quantity(component(r"\tau", axis), unit))
            for name in names[1:]:
                hide_scale(panels[name])
        for column, ensemble in enumerate(runs.shown):
            values = runs.values("torque", ensemble)
            colour = line_style(ensemble.index)["color"]
            set_name(panels[rows[0][column]].set_title(""), ensemble.title)
            for axis, names in enumerate(rows):
                axes = panels[names[column]]
                axes.plot(runs.times, values[..., axis].mean(axis=0), color=colour)
                if self.bands == "quantiles":
                    draw_band(axes, runs.times, values[..., axis], colour)
        return drawing
