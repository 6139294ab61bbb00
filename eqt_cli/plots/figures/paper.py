"""The four panels of the paper's figure for any result: means over runs of errors, torque and L."""

from dataclasses import dataclass
from typing import ClassVar

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.plots.base import OverTime
from eqt_cli.plots.drawing.curve_labels import name_curves
from eqt_cli.plots.drawing.curves import Bands, draw_mean, of_bands
from eqt_cli.plots.drawing.labels import part_name
from eqt_cli.plots.drawing.layout import add_title, name_scale, sheet
from eqt_cli.plots.drawing.scales import scale_norm
from eqt_cli.plots.drawing.style import WIDTHS, Width
from eqt_cli.plots.shown.trajectories import ShownRuns

_NORMS = ("pose_error", "velocity_error", "torque_norm")


@dataclass(frozen=True)
class Paper(OverTime):
    """Means over runs of pose error, velocity error, torque norm and Lyapunov function.

    Figure 3 of Hampsey et al. (2025), on any group: where rotation and translation have units of
    their own, the norms of both are shown, side by side, instead of the mixed ones.

    Attributes
    ----------
    log
        A logarithmic scale for what converges to zero: the errors and L, but not the torque. The
        default is linear, as in the paper, so that the two can be compared.
    bands
        ``quantiles`` shades the range from the 10 % to the 90 % quantile over runs, ``bootstrap``
        the 95 % interval of the mean at each time.
    degrees
        The attitude error as the angle of the rotation, in degrees.
    """

    name: ClassVar[str] = "paper"

    log: bool = False
    bands: Bands = "none"
    degrees: bool = False

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Two by two panels, or a row per norm and a column per part."""
        runs.require_attitude(degrees=self.degrees)
        parts = runs.parts
        norms = [[norm + part for part in parts] for norm in _NORMS]
        if len(parts) > 1:
            mosaic = [*norms, ["lyapunov"] * len(parts)]
        else:
            mosaic = [["pose_error", "velocity_error"], ["torque_norm", "lyapunov"]]
        drawing, panels = sheet(width, mosaic, runs.span, runs.unit("time"))
        for signal, axes in panels.items():
            self._fill(axes, signal, runs)
        for signal, part in zip(norms[0], parts, strict=True):
            add_title(panels[signal], part_name(part), WIDTHS[width] / len(parts))
        complete = [axes for axes in panels.values() if len(axes.lines) == len(runs.shown)]
        name_curves(drawing, complete, panels[norms[0][0]].lines, [e.title for e in runs.shown])
        runs.remarks.append(f"Curves: mean over runs, {runs.count()}{of_bands(self.bands)}.")
        return drawing

    def _fill(self, axes: Axes, signal: str, runs: ShownRuns) -> None:
        for ensemble in runs.with_function() if signal == "lyapunov" else runs.shown:
            values = runs.errors(signal, ensemble, degrees=self.degrees)
            draw_mean(axes, runs.times(ensemble), values, self.bands, ensemble)
        scale_norm(axes, log=self.log and not signal.startswith("torque_norm"))
        name_scale(axes, runs.error_label(signal, degrees=self.degrees))
