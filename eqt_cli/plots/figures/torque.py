"""The figure of torque components: the mean over runs of every law, a panel per axis."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import OverTime
from eqt_cli.plots.drawing.curves import Bands, draw_mean, of_bands
from eqt_cli.plots.drawing.labels import force_component, quantity
from eqt_cli.plots.drawing.layout import (
    EMPTY,
    Mosaic,
    add_legend,
    name_scale,
    rows_of,
    sheet,
)
from eqt_cli.plots.drawing.style import Width, ink
from eqt_cli.plots.shown.controllers import Ensemble, names
from eqt_cli.plots.shown.trajectories import ShownRuns

_DESIRED: dict[str, Any] = {"linewidth": 2.2, "zorder": 1.5}
_PALE = 0.25
"""The share of ink in the torque of the reference, which lies behind the curves."""
_ACROSS = 3
"""Axes of a part side by side on a page."""

Share = Literal["total", "feedback", "feedforward"]


@dataclass(frozen=True)
class Torque(OverTime):
    """Torque components in the body frame: the mean over runs, all laws in a panel per axis.

    Forces have panels of their own. The torque of the reference is drawn beside the whole torque
    and the feedforward.

    Attributes
    ----------
    share
        ``total``; or ``feedforward``, what the law gives without its gains, and ``feedback``, the
        rest. The result must be of an ideal loop, and the law must say what its feedforward is.
    bands
        ``quantiles`` shades the range from the 10 % to the 90 % quantile over runs, ``bootstrap``
        the 95 % interval of the mean at each time.
    """

    name: ClassVar[str] = "torque"

    share: Share = "total"
    bands: Bands = "none"

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """A row per part of the coordinates on a page, and a column per part in a column."""
        mosaic = _places(runs, width)
        drawing, panels = sheet(width, mosaic, runs.span, runs.unit("time"))
        for k, (axis, unit) in enumerate(runs.axes):
            name_scale(panels[axis], quantity(force_component(axis, unit), unit))
            for ensemble in runs.shown:
                values = self._values(runs, ensemble)[..., k]
                draw_mean(panels[axis], runs.times(ensemble), values, self.bands, ensemble)
        handles: dict[str, Artist] = dict(
            zip([e.title for e in runs.shown], panels[runs.axes[0][0]].lines, strict=False)
        )
        if self.share != "feedback":
            handles[r"$\tau_d$"] = _draw_desired(runs, panels)
        add_legend(drawing, list(handles.values()), list(handles))
        what = "" if self.share == "total" else f" of the {self.share}"
        runs.remarks.append(f"Curves: mean{what} over runs, {runs.count()}{of_bands(self.bands)}.")
        return drawing

    def _values(self, runs: ShownRuns, ensemble: Ensemble) -> Array:
        """What is drawn of every run, ``(runs, samples, axes)``."""
        torque = runs.values("torque", ensemble)
        if self.share == "total":
            return torque
        feedforward = runs.feedforward(ensemble)
        return feedforward if self.share == "feedforward" else torque - feedforward


def _draw_desired(runs: ShownRuns, panels: dict[str, Axes]) -> Artist:
    """The torque of each result's reference in every panel; the last of the lines."""
    line: Artist = Line2D([], [])
    for result, name in zip(runs.results, names(runs.results), strict=True):
        first = next((e for e in runs.shown if e.results is result), None)
        if first is None:
            continue
        desired = runs.desired("torque", first)
        label = f"desired, {name}" if len(runs.results) > 1 else "desired"
        for k, (axis, _) in enumerate(runs.axes):
            (line,) = panels[axis].plot(
                runs.times(first), desired[:, k], label=label, color=ink(_PALE), **_DESIRED
            )
    return line


def _places(runs: ShownRuns, width: Width) -> Mosaic:
    """The panels by their axes: those of torques and of forces apart."""
    units = dict.fromkeys(unit for _, unit in runs.axes)
    parts = [[axis for axis, of in runs.axes if of == unit] for unit in units]
    if width == "page":
        across = min(_ACROSS, max(map(len, parts)))
        rows = [row for part in parts for row in rows_of(part, across)]
        return [row + [EMPTY] * (across - len(row)) for row in rows]
    if len(parts) == 1:
        return [[axis] for axis in parts[0]]
    tallest = max(map(len, parts))
    return [[part[k] if k < len(part) else EMPTY for part in parts] for k in range(tallest)]
