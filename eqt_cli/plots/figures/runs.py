"""Figure of single runs: thin lines under their mean, a panel per law."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.plots.base import OverTime
from eqt_cli.plots.drawing import layout
from eqt_cli.plots.drawing.cells import scale_norm, spans_decade
from eqt_cli.plots.drawing.curves import thin_line, thin_line_legend
from eqt_cli.plots.drawing.style import WIDTHS, Look, Width, ink
from eqt_cli.plots.shown.controllers import Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns

MOST_LINES = 200
"""Most single runs per law, from the first; more give a solid area and a large file."""

ESTIMATED = {"pose_error": "estimate_error"}
"""Signals that are shaded below others where a law reads an estimate."""

_WHOLE = ("position_error", "heading_error", "lyapunov")
"""Signals that have no parts."""

_SHADE = 0.16
"""Share of ink in the shading behind the curves."""


@dataclass(frozen=True)
class RunsFigure(OverTime):
    """Single runs as thin lines and the mean over runs, a panel per law.

    Where a norm has parts with units of their own, such as rotation and translation, each part has
    a column of panels. Where a law reads an estimate, the mean error of that is shaded.

    Attributes
    ----------
    signal
        Signal that is drawn over time.
    log
        A logarithmic scale; by default, for errors and L where they span more than a decade.
    degrees
        The attitude error as the angle of the rotation, in degrees; of signal ``pose_error``.
    """

    name: ClassVar[str] = "runs"

    signal: Literal[
        "pose_error", "position_error", "heading_error", "velocity_error", "torque_norm", "lyapunov"
    ] = "pose_error"
    log: bool | None = None
    degrees: bool = False

    def check(self, problems: Problems) -> None:
        """Refuse degrees for signals other than ``pose_error``."""
        if self.degrees and self.signal != "pose_error":
            problems.at("degrees").add(f"belongs to signal pose_error; {self.signal} is no angle")

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a row per law and a column per part, or else controllers two by two."""
        runs.require_attitude(degrees=self.degrees)
        shown, parts = runs.shown, runs.parts
        if self.signal in _WHOLE:
            parts = [""]
        if self.signal == "lyapunov":
            shown = runs.with_function()
            if not shown:
                raise runs.error("has no L to show: none of these laws claims that its own falls")
        places, estimated = layout.panels_by_controller([e.label for e in shown], parts), False
        room = WIDTHS[width] / len(places[0])
        drawing, panels = layout.sheet(width, places, runs.span, runs.unit("time"))
        for part in parts:
            column = [panels[layout.panel(e.label, part)] for e in shown]
            signal = self.signal + part
            layout.share_scale(column)
            for ensemble, axes in zip(shown, column, strict=True):
                values = runs.errors(signal, ensemble, degrees=self.degrees)
                self._fill(axes, runs.times(ensemble), values, ensemble.look)
                estimated |= self._shade(axes, runs, ensemble, part)
                layout.add_title(axes, layout.panel_title(ensemble.title, part), room)
                layout.name_scale(axes, runs.error_label(signal, degrees=self.degrees))
            self._scale(column)  # after all curves of the common scale
        if len(parts) == 1:
            layout.hide_inner_scales(panels, places)
        handles = thin_line_legend(shown, MOST_LINES)
        handles["mean over runs"] = Line2D([], [], color=ink())
        if estimated:
            handles["mean error of the estimate"] = Patch(facecolor=ink(_SHADE), linewidth=0)
        layout.add_legend(drawing, list(handles.values()), list(handles))
        runs.remarks.append(f"Mean over {runs.count()}.")
        return drawing

    def _scale(self, panels: Sequence[Axes]) -> None:
        """Set one scale; for a torque, which need not converge to zero, linear by default."""
        log = self.log
        if log is None:
            seen = [np.ravel(line.get_ydata()) for axes in panels for line in axes.lines]
            log = self.signal != "torque_norm" and spans_decade(np.concatenate(seen))
        for axes in panels:
            scale_norm(axes, log=log)

    def _shade(self, axes: Axes, runs: ShownRuns, ensemble: Ensemble, part: str) -> bool:
        """Shade up to the mean error of the estimate; return whether the law reads one."""
        signal = ESTIMATED.get(self.signal, "") + part
        if not ensemble.results.has(signal):
            return False
        error = runs.errors(signal, ensemble, degrees=self.degrees).mean(axis=0)
        shade: dict[str, Any] = {"facecolor": ink(_SHADE), "linewidth": 0, "zorder": 0}
        axes.fill_between(runs.times(ensemble), 0.0 * error, error, label="estimate", **shade)
        return True

    def _fill(self, axes: Axes, times: Array, values: Array, look: Look) -> None:
        drawn = values[:MOST_LINES]
        axes.plot(times, drawn.T, **thin_line(look, len(drawn)))
        on_paper = [Stroke(linewidth=2.4, foreground=ink(0)), Normal()]  # visible on dark lines too
        axes.plot(times, values.mean(axis=0), color=ink(), label="mean", path_effects=on_paper)
