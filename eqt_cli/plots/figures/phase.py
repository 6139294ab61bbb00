"""Figure of the error's phase plane: velocity error over pose error, run by run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.critical_points import critical_sets
from eqt_cli.plots.base import OfFirstRuns
from eqt_cli.plots.drawing import layout
from eqt_cli.plots.drawing.cells import scale_norm
from eqt_cli.plots.drawing.curves import draw_density, draw_paths, path_legend
from eqt_cli.plots.drawing.labels import signal_label
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink
from eqt_cli.plots.shown.controllers import Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns

_HEIGHTS: dict[Width, float] = {"column": 1.35, "page": 1.75, "slide": 1.35}
_COLUMNS: dict[Width, int] = {"column": 2, "page": 4, "slide": 4}
_BESIDE = 0.15
"""Width of a panel's place that its scale takes from the title, in."""
_CELLS = 48
"""Number of cells along each scale in which passing runs are counted."""
_POSE, _VELOCITY = "pose_error", "velocity_error"
_HALF_TURN: dict[str, Any] = {
    "linestyle": "none",
    "marker": "*",
    "markersize": 5,
    "clip_on": False,
    "zorder": 3,
}


@dataclass(frozen=True)
class PhaseFigure(OfFirstRuns):
    """Phase plane of the error: norm of the velocity error over that of the pose error.

    Some single runs, from a hollow dot at the start to a filled one at the end; darker shading:
    more runs pass there. A panel per law, and a column per part where parts have units of
    their own. A star marks the unstable equilibria, if they are within the axes: the
    rotation error of the critical points of Υ other than I, which are half-turns for every weight.

    Attributes
    ----------
    log
        Logarithmic scales. The default is linear, since all runs go to the point (0, 0), which is
        the middle of the picture and has no logarithm.
    """

    name: ClassVar[str] = "phase"

    log: bool = False

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a row per law and a column per part; with one part, controllers in rows."""
        shown, parts = runs.shown, runs.parts
        places = layout.panels_by_controller([e.label for e in shown], parts, _COLUMNS[width])
        drawing, panels = layout.blank_sheet(width, places, _HEIGHTS[width])
        room = WIDTHS[width] / len(places[0]) - _BESIDE
        marked = False
        for part in parts:
            column = [panels[layout.panel(e.label, part)] for e in shown]
            for axes in column[1:]:
                axes.sharex(column[0])
                axes.sharey(column[0])
            for ensemble, axes in zip(shown, column, strict=True):
                self._fill(axes, runs, ensemble, part)
                layout.add_title(axes, layout.panel_title(ensemble.title, part), room)
            self._scale(column)
            if self.density:
                self._shade(column, runs, part)
            marked |= _mark_half_turns(column, runs.group, part)
        _hide_scales(panels, places, parts)
        handles = path_legend(shown, self.runs, density=self.density)
        if marked:
            handles["unstable equilibria"] = Line2D([], [], color=ink(), **_HALF_TURN)
        layout.add_legend(drawing, list(handles.values()), list(handles))
        return drawing

    def _fill(self, axes: Axes, runs: ShownRuns, ensemble: Ensemble, part: str) -> None:
        pose, velocity = _POSE + part, _VELOCITY + part
        x, y = (runs.values(norm, ensemble, self.runs) for norm in (pose, velocity))
        numbers = runs.numbers(ensemble, self.runs)
        draw_paths(axes, dict(zip(numbers, zip(x, y, strict=True), strict=True)), ensemble)
        axes.set_xlabel(signal_label(ensemble.results, pose))
        layout.name_scale(axes, signal_label(ensemble.results, velocity))

    def _shade(self, column: Sequence[Axes], runs: ShownRuns, part: str) -> None:
        """Shade where all runs pass; keep the common scale as it is."""
        first = column[0]
        limits = first.get_xlim(), first.get_ylim()
        scale = np.geomspace if first.get_xscale() == "log" else np.linspace
        edges = scale(*limits[0], _CELLS + 1), scale(*limits[1], _CELLS + 1)
        for ensemble, axes in zip(runs.shown, column, strict=True):
            x, y = (runs.values(norm + part, ensemble) for norm in (_POSE, _VELOCITY))
            draw_density(axes, list(zip(x, y, strict=True)), edges, ensemble.look)
        first.set(xlim=limits[0], ylim=limits[1])

    def _scale(self, column: Sequence[Axes]) -> None:
        """Set one scale for a part, after all runs are drawn, since it must hold them."""
        for axes in column:
            axes.margins(x=0.04)
            scale_norm(axes, log=self.log, direction="x")
            scale_norm(axes, log=self.log)
        if column[0].get_xscale() == "linear":
            column[0].xaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))


def _hide_scales(panels: Mapping[str, Axes], places: layout.Mosaic, parts: Sequence[str]) -> None:
    """Name and number a scale once, below and to the left of the panels that share it."""
    numbered = layout.numbered_below(places)
    for name, axes in panels.items():
        axes.tick_params(labelbottom=name in numbered)
        axes.xaxis.label.set_visible(name in numbered)
    if len(parts) == 1:
        layout.hide_inner_scales(panels, places)


def _mark_half_turns(column: Sequence[Axes], group: MatrixLieGroup | None, part: str) -> bool:
    """Mark the error of half-turns if it is within the axes; return whether it is."""
    errors = _half_turns(group, part) if group is not None else []
    errors = [error for error in errors if error <= column[0].get_xlim()[1]]
    for axes in column:
        for error in errors:
            axes.plot([error], [0], transform=axes.get_xaxis_transform(), color=ink(), **_HALF_TURN)
    return bool(errors)


def _half_turns(group: MatrixLieGroup, suffix: str) -> list[float]:
    """Return ‖I − R‖_F at the critical points of Υ other than I, for a part that is a rotation.

    Their rotations are half-turns whatever the weight, about axes that depend on it; so do their
    translations, which are therefore not marked. Any weight gives the rotations: here it is I.
    """
    named = [part for part in group.parts if suffix in ("", f"_{part.name}")]
    sets = critical_sets(group, group.identity)
    if sets is None or len(named) != 1 or not named[0].turns:
        return []
    blocks = [(group.identity - each.Q)[named[0].entries] for each in sets]
    return sorted({round(float(np.linalg.norm(block)), 12) for block in blocks} - {0.0})
