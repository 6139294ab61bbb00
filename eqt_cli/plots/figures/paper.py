"""Figure of the paper for any result: means over runs of errors, torque norm and L."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.plots.base import OverTime, Panelled
from eqt_cli.plots.drawing import layout
from eqt_cli.plots.drawing.cells import scale_norm, spans_decade
from eqt_cli.plots.drawing.curve_labels import name_curves
from eqt_cli.plots.drawing.curves import Bands, draw_mean, of_bands
from eqt_cli.plots.drawing.labels import part_name
from eqt_cli.plots.drawing.style import WIDTHS, Width
from eqt_cli.plots.law_columns import law_columns
from eqt_cli.plots.shown.controllers import Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns

_NORMS = ("pose_error", "velocity_error", "torque_norm")
_FUNCTION = "lyapunov"


@dataclass(frozen=True)
class Paper(Panelled, OverTime):
    """Means over runs of pose error, velocity error, torque norm and Lyapunov function.

    Figure 3 of Hampsey et al. (2025), on any group: where rotation and translation have units of
    their own, the norms of both are shown, side by side, instead of the mixed ones.

    Attributes
    ----------
    log
        Logarithmic scales. The default is linear, as in the paper, so that the two can be
        compared.
    log_torque
        A logarithmic scale for the torque; by default as `log`, if the torque spans a decade.
    bands
        ``quantiles`` shades the range from the 10 % to the 90 % quantile over runs, a column of
        panels per law; ``bootstrap`` the 95 % interval of the mean at each time.
    degrees
        The attitude error as the angle of the rotation, in degrees; its rate in deg/s.
    """

    name: ClassVar[str] = "paper"

    log: bool = False
    log_torque: bool | None = None
    bands: Bands = "none"
    degrees: bool = False

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw two by two panels, or a row per norm and a column per part; quantiles by law."""
        runs.require_attitude(degrees=self.degrees)
        norms = self.picked((*_NORMS, _FUNCTION))
        draw = self._by_law if self.bands == "quantiles" else self._together
        drawing = draw(runs, width, norms)  # such bands would hide each other
        runs.remarks.append(f"Curves: mean over {runs.count()}{of_bands(self.bands)}.")
        return drawing

    def _together(self, runs: ShownRuns, width: Width, norms: Sequence[str]) -> Drawing:
        """Draw all laws in each panel."""
        parts = runs.parts
        rows = [[norm + part for part in parts] for norm in norms if norm != _FUNCTION]
        if len(parts) > 1:
            mosaic = [*rows, *([_FUNCTION] * len(parts) for norm in norms if norm == _FUNCTION)]
        else:
            mosaic = layout.rows_of([*(row[0] for row in rows), *norms[len(rows) :]], 2)
        drawing, panels = layout.sheet(width, mosaic, runs.span, runs.unit("time"))
        for signal, axes in panels.items():
            for ensemble in self._shown(runs, signal):
                self._draw(axes, signal, runs, ensemble)
            self._scale([axes], signal, runs)
        for signal, part in zip(rows[0], parts, strict=True) if rows else ():
            layout.add_title(panels[signal], part_name(part), WIDTHS[width] / len(parts))
        complete = [axes for axes in panels.values() if len(axes.lines) == len(runs.shown)]
        lines = max(panels.values(), key=lambda axes: len(axes.lines)).lines
        name_curves(drawing, complete, lines, [e.title for e in runs.shown])
        return drawing

    def _by_law(self, runs: ShownRuns, width: Width, norms: Sequence[str]) -> Drawing:
        """Draw a row per norm and part, and a column per law."""
        of_parts = {norm: [""] if norm == _FUNCTION else runs.parts for norm in norms}
        signals = [norm + part for norm in norms for part in of_parts[norm]]
        drawing, rows = law_columns(runs, width, signals, lambda s, e: e in self._shown(runs, s))
        for signal, row in rows.items():
            for ensemble in self._shown(runs, signal):
                self._draw(row[ensemble.label], signal, runs, ensemble)
            self._scale(list(row.values()), signal, runs)
        return drawing

    def _shown(self, runs: ShownRuns, signal: str) -> list[Ensemble]:
        return runs.with_function() if signal == _FUNCTION else runs.shown

    def _draw(self, axes: Axes, signal: str, runs: ShownRuns, ensemble: Ensemble) -> None:
        values = runs.errors(signal, ensemble, degrees=self.degrees)
        draw_mean(axes, runs.times(ensemble), values, self.bands, ensemble)

    def _scale(self, panels: Sequence[Axes], signal: str, runs: ShownRuns) -> None:
        log = self.log
        if signal.startswith("torque_norm"):
            drawn = np.concatenate([line.get_ydata() for axes in panels for line in axes.lines])
            log = log and spans_decade(drawn) if self.log_torque is None else self.log_torque
        for axes in panels:
            scale_norm(axes, log=log)
        layout.name_scale(panels[0], runs.error_label(signal, degrees=self.degrees))
