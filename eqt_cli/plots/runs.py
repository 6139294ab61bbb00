"""The figure of single runs: thin lines under their mean, a panel per controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import OverTime
from eqt_cli.plots.curves import scale_norm
from eqt_cli.plots.good_runs import GoodRuns
from eqt_cli.plots.labels import SYMBOLS, part_name, quantity
from eqt_cli.plots.layout import (
    EMPTY,
    Mosaic,
    add_legend,
    add_title,
    hide_scale,
    name_scale,
    share_scale,
    sheet,
)
from eqt_cli.plots.style import WIDTHS, Width, ink, line_style

MOST_LINES = 200
"""Single runs drawn per controller, the first ones; more would be a solid area and a large file."""

_THIN = 0.35


@dataclass(frozen=True)
class Runs(OverTime):
    """Single runs as thin lines and the mean over runs, a panel per controller.

    Where a norm has parts with units of their own, such as rotation and translation, each part has
    a column of panels.

    Attributes
    ----------
    signal
        What is drawn over time.
    log
        A logarithmic scale.
    """

    name: ClassVar[str] = "runs"

    signal: Literal["pose_error", "velocity_error", "torque_norm", "lyapunov"] = "pose_error"
    log: bool = False

    def compose(self, runs: GoodRuns, width: Width) -> Drawing:
        """A row per controller and a column per part, or else controllers two by two."""
        shown = runs.shown
        parts = [""] if self.signal == "lyapunov" else runs.parts
        mosaic = _mosaic([e.index for e in shown], parts)
        room = WIDTHS[width] / len(mosaic[0])
        drawing, panels = sheet(width, mosaic, runs.span, runs.unit("time"))
        for part in parts:
            share_scale(panels[_panel(e.index, part)] for e in shown)
        for ensemble in shown:
            for part in parts:
                axes, signal = panels[_panel(ensemble.index, part)], self.signal + part
                values = runs.values(signal, ensemble)
                self._fill(axes, runs.times(ensemble), values, ensemble.index)
                add_title(axes, _title(ensemble.title, part), room)
                name_scale(axes, quantity(SYMBOLS[self.signal], runs.unit(signal)))
        for axes in panels.values():  # now that every curve of a common scale is there
            scale_norm(axes, log=self.log)
        if len(parts) == 1:
            for _, right in (row for row in mosaic if len(row) == 2 and row[1] != EMPTY):
                hide_scale(panels[right])
        add_legend(drawing, *_legend(max(int(e.good.sum()) for e in shown)))
        return drawing

    def _fill(self, axes: Axes, times: Array, values: Array, index: int) -> None:
        drawn = values[:MOST_LINES]
        opacity = min(0.8, 4 / np.sqrt(len(drawn)))  # few lines are seen, many make shades
        colour = (line_style(index)["color"], opacity)
        axes.plot(times, drawn.T, color=colour, linewidth=_THIN)
        axes.plot(times, values.mean(axis=0), color=ink(), label="mean")


def _title(controller: str, part: str) -> str:
    return f"{controller}, {part_name(part)}" if part else controller


def _panel(controller: int, part: str) -> str:
    return f"{controller}{part}"


def _mosaic(controllers: list[int], parts: list[str]) -> Mosaic:
    """Panels by controller and part."""
    if len(parts) > 1 or len(controllers) == 1:
        return [[_panel(index, part) for part in parts] for index in controllers]
    places = [_panel(index, parts[0]) for index in controllers]
    pairs = zip(places[::2], [*places[1::2], EMPTY], strict=False)
    return [[left, right] for left, right in pairs]


def _legend(runs: int) -> tuple[list[Line2D], list[str]]:
    single = Line2D([], [], color=ink(0.5), linewidth=2 * _THIN)
    mean = Line2D([], [], color=ink())
    lines = "single runs" if runs <= MOST_LINES else f"first {MOST_LINES} runs"
    return [single, mean], [lines, "mean over runs"]
