"""The figure of single runs: thin lines under their mean, a panel per controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import Figure
from eqt_cli.plots.curves import scale_norm
from eqt_cli.plots.good_runs import GoodRuns
from eqt_cli.plots.labels import SYMBOLS, quantity, set_name
from eqt_cli.plots.layout import EMPTY, Mosaic, add_legend, hide_scale, share_scale, sheet
from eqt_cli.plots.style import Width, line_style


@dataclass(frozen=True)
class Runs(Figure):
    """Single runs as thin lines and the mean over runs, a panel per controller.

    Where a norm has parts with units of their own, such as rotation and translation, each part has
    a column of panels.

    Attributes
    ----------
    signal
        What is drawn over time.
    lines
        At most so many single runs are drawn, the first ones; the mean is over all.
    log
        A logarithmic scale.
    """

    name: ClassVar[str] = "runs"

    signal: Literal["pose_error", "velocity_error", "torque_norm", "lyapunov"] = "pose_error"
    lines: int = 200
    log: bool = False

    def compose(self, runs: GoodRuns, width: Width) -> Drawing:
        """A row per controller and a column per part, or else controllers two by two."""
        parts = runs.parts if self.signal != "lyapunov" else [""]
        rows = [[f"{e.index}{part}" for part in parts] for e in runs.shown]
        mosaic = rows if len(parts) > 1 else _in_two_columns([name for (name,) in rows])
        drawing, panels = sheet(width, mosaic, runs.times, runs.unit("time"))
        for names in zip(*rows, strict=True):  # the panels of one part
            share_scale([panels[name] for name in names])
        for ensemble, names in zip(runs.shown, rows, strict=True):
            for name, part in zip(names, parts, strict=True):
                axes, signal = panels[name], self.signal + part
                self._fill(axes, runs.times, runs.values(signal, ensemble), ensemble.index)
                set_name(axes.set_title(""), ", ".join([ensemble.title, *part.split("_")[1:]]))
                if any(name == row[-1] for row in mosaic) and len(parts) == 1 < len(mosaic[0]):
                    hide_scale(axes)
                else:
                    axes.set_ylabel(quantity(SYMBOLS[self.signal], runs.unit(signal)))
        single = Line2D([], [], color="0.5", linewidth=_THIN * 2)
        add_legend(drawing, [single, Line2D([], [], color=_MEAN)], ["single runs", "mean"])
        return drawing

    def _fill(self, axes: Axes, times: Array, values: Array, index: int) -> None:
        colour = line_style(index)["color"]
        axes.plot(times, values[: self.lines].T, color=colour, linewidth=_THIN, alpha=0.3)
        axes.plot(times, values.mean(axis=0), color=_MEAN)
        scale_norm(axes, log=self.log)


_MEAN, _THIN = "black", 0.3


def _in_two_columns(names: list[str]) -> Mosaic:
    if len(names) == 1:
        return [names]
    padded = [*names, EMPTY][: len(names) + len(names) % 2]
    return [padded[k : k + 2] for k in range(0, len(padded), 2)]
