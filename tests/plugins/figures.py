"""Figures of each of the three subjects, with eqt's own sheets, legends and styles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from matplotlib.figure import Figure as Drawing

from eqt_cli.extend import (
    WIDTHS,
    OfMetrics,
    OfSweep,
    OverTime,
    ShownMetrics,
    ShownRuns,
    ShownSweep,
    Width,
    add_legend,
    add_title,
    blank_sheet,
    component,
    draw_middle,
    free_text,
    ink,
    line_style,
    marker,
    mean_over_runs,
    metric_label,
    name_scale,
    quantity,
    rows_of,
    scale_log,
    sheet,
)
from eqt_cli.figures.cells import even


@dataclass(frozen=True)
class Decay(OverTime):
    """L over time, on a logarithmic scale, and the first torque component under it.

    Attributes
    ----------
    middle
        The curve over runs.
    """

    name: ClassVar[str] = "decay"

    middle: Literal["mean", "median", "quartiles"] = "quartiles"

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Two panels."""
        places = [["lyapunov"], ["torque"]]
        drawing, panels = sheet(width, places, runs.span, runs.unit("time"))
        axis, unit = runs.axes[0]
        name_scale(panels["lyapunov"], quantity(r"\mathcal{L}", runs.unit("lyapunov")))
        name_scale(panels["torque"], quantity(component(r"\tau", axis), unit))
        for ensemble in runs.shown:
            look = line_style(ensemble.look)
            times = runs.times(ensemble)
            mean = runs.values("lyapunov", ensemble).mean(axis=0)
            panels["lyapunov"].plot(times, mean, label=ensemble.label, **look)
            torque = runs.values("torque", ensemble)[..., 0]
            draw_middle(panels["torque"], times, torque, ensemble, self.middle)
        panels["torque"].plot(times, runs.desired("torque", ensemble)[:, 0], color=ink(0.5))
        scale_log(panels["lyapunov"], "y", mean[mean > 0])
        add_title(panels["lyapunov"], "decay")
        add_legend(drawing, panels["lyapunov"].lines, [e.title for e in runs.shown])
        return drawing


@dataclass(frozen=True)
class Medians(OfMetrics):
    """The median and the mean of every metric, a point per controller.

    Attributes
    ----------
    order
        Of the controllers.
    """

    name: ClassVar[str] = "medians"

    order: Literal["given", "reversed"] = "given"

    def compose(self, metrics: ShownMetrics, width: Width) -> Drawing:
        """A panel per metric."""
        places = rows_of(metrics.metrics, 2)
        drawing, panels = blank_sheet(width, places, 1.2)
        shown = metrics.shown if self.order == "given" else metrics.shown[::-1]
        for metric, axes in panels.items():
            axes.set_xlabel(metric_label(metrics.results[0], metric, 20))
            axes.xaxis.set_major_locator(even())
            axes.set_yticks(range(len(shown)), [free_text(e.title, 14) for e in shown])
            for row, ensemble in enumerate(shown):
                sample = metrics.samples[metric, ensemble.label]
                colour = line_style(ensemble.look)["color"]
                axes.plot(sample.quantiles([0.5]), [row], marker="o", color=colour)
                axes.plot([sample.mean], [row], marker="d", color=colour)
        return drawing


@dataclass(frozen=True)
class Scatter(OfSweep):
    """Every point of a sweep by two metrics.

    Attributes
    ----------
    across, up
        The metrics.
    """

    name: ClassVar[str] = "scatter"

    across: str = "effort"
    up: str = "mean_pose_error"

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """One panel."""
        x, y = (mean_over_runs(swept.metric(name)) for name in (self.across, self.up))
        drawing = Drawing(figsize=(WIDTHS[width], 2.4))
        axes = drawing.add_subplot()
        lines = []
        for k, (position, title) in enumerate(zip(swept.controllers, swept.titles, strict=True)):
            look = line_style(position) | {"linestyle": "", "marker": marker(position)}
            lines += axes.plot(x[:, k], y[:, k], label=title, **look)
        axes.set_xlabel(metric_label(swept.results, self.across, 36))
        axes.set_ylabel(metric_label(swept.results, self.up, 36))
        axes.set_title(free_text(swept.results.point_name(0), 40))
        add_legend(drawing, lines, swept.titles)
        return drawing
