"""The figure of what a law asks for and what the actuators give, in a single run."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from eqt_cli.core.arrays import Array
from eqt_cli.core.problems import Problems
from eqt_cli.plots.base import OverTime
from eqt_cli.plots.drawing.labels import force_component, free_text, in_words, quantity
from eqt_cli.plots.drawing.layout import (
    add_legend,
    add_title,
    hide_inner_scales,
    name_scale,
    share_scale,
    sheet,
)
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink, line_style
from eqt_cli.plots.shown.controllers import Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns

_MOST_CONTROLLERS: dict[Width, int] = {"column": 4, "page": 8}
_ASKED: dict[str, Any] = {"linewidth": 0.6, "linestyle": (0, (2, 1.2))}
_ANY = 0.7
"""The share of ink in the grey that stands for every controller's colour in the legend."""
_SHADE = 0.13
"""The share of ink in what lies behind the curves."""
_MARGIN = 0.06
"""Of the range of a thruster, shown on either side of it."""
_MOST_NAME = 16
"""Characters of the name of a thruster."""


@dataclass(frozen=True)
class Commands(OverTime):
    """What a law asks for and what its actuators give in one run; the time at a limit is shaded.

    A row per axis and a column per controller. In an ideal loop the two are the same.

    Attributes
    ----------
    run
        Which run, by its number.
    thrusters
        Show the thrust of each thruster instead, a row each; what is beyond its limits is shaded.
    """

    name: ClassVar[str] = "commands"

    run: int = 0
    thrusters: bool = False

    def check(self, problems: Problems) -> None:
        """A run has a number from 0."""
        if self.run < 0:
            problems.at("run").add(f"expected 0 or more, got {self.run}")

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Axes downwards with a scale each, controllers to the right."""
        shown, most = runs.shown, _MOST_CONTROLLERS[width]
        if len(shown) > most:
            raise runs.error(
                f"has a column of panels per controller, and width '{width}' has room for "
                f"{most}, not {len(shown)}; choose some with the option 'controllers'"
            )
        names = runs.thrusters if self.thrusters else [axis for axis, _ in runs.axes]
        rows = [[f"{name} {e.label}" for e in shown] for name in names]
        drawing, panels = sheet(width, rows, runs.span, runs.unit("time"))
        grid = [[panels[name] for name in row] for row in rows]
        labels = [quantity(force_component(axis, unit), unit) for axis, unit in runs.axes]
        if self.thrusters:
            labels = [in_words(free_text(name, _MOST_NAME), runs.unit("thrust")) for name in names]
        for row, label in zip(grid, labels, strict=True):
            share_scale(row)
            name_scale(row[0], label)
        hide_inner_scales(panels, rows)
        fill, limited = self._fill_thrusts if self.thrusters else self._fill, False
        for column, ensemble in zip(zip(*grid, strict=True), shown, strict=True):
            add_title(column[0], ensemble.title, WIDTHS[width] / len(shown))
            limited |= fill(column, runs, ensemble)
        self._add_legend(drawing, limited)
        return drawing

    def _fill_thrusts(self, column: tuple[Axes, ...], runs: ShownRuns, ensemble: Ensemble) -> bool:
        """Draw the thrusts of a controller; whether they have limits."""
        times, thrust = runs.times(ensemble), runs.of_run("thrust", ensemble, self.run)
        limits = runs.thrust_limits(ensemble, self.run)
        colour = line_style(ensemble.look)["color"]
        for k, axes in enumerate(column):
            axes.plot(times, thrust[:, k], color=colour, label="thrust")
            if limits is None:
                continue
            low, high = limits[0][k], limits[1][k]
            beyond = _MARGIN * (high - low)
            for start, end in ((low - beyond, low), (high, high + beyond)):
                axes.axhspan(start, end, facecolor=ink(_SHADE), linewidth=0, zorder=0)
            axes.set_ylim(low - beyond, high + beyond)
        return limits is not None

    def _fill(self, column: tuple[Axes, ...], runs: ShownRuns, ensemble: Ensemble) -> bool:
        """Draw the panels of a controller; whether its run is ever at a limit."""
        times, given = runs.times(ensemble), runs.of_run("torque", ensemble, self.run)
        asked, at_limit = given, np.zeros(len(times))
        if ensemble.results.has("command"):
            asked = runs.of_run("command", ensemble, self.run)
        if ensemble.results.has("at_limit"):
            at_limit = runs.of_run("at_limit", ensemble, self.run)
        colour = line_style(ensemble.look)["color"]
        for k, axes in enumerate(column):
            for start, end in _stretches(times, at_limit > 0):
                axes.axvspan(start, end, facecolor=ink(_SHADE), linewidth=0, zorder=0)
            axes.plot(times, given[:, k], color=colour, label="given")
            axes.plot(times, asked[:, k], color=ink(), label="asked", **_ASKED)
        return bool(at_limit.any())

    def _add_legend(self, drawing: Drawing, limited: bool) -> None:
        given = "thrust" if self.thrusters else "given by the actuators"
        handles: dict[str, Artist] = {given: Line2D([], [], color=ink(_ANY))}
        if not self.thrusters:
            handles["asked by the law"] = Line2D([], [], color=ink(), **_ASKED)
        if limited:
            words = "beyond its limits" if self.thrusters else "at a limit"
            handles[words] = Patch(facecolor=ink(_SHADE), linewidth=0)
        add_legend(drawing, list(handles.values()), list(handles))


def _stretches(times: Array, inside: Array) -> list[tuple[float, float]]:
    """From the first to the last sample of each stretch that is inside, half a step more around."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    between = np.concatenate([times[:1], (times[:-1] + times[1:]) / 2, times[-1:]])
    return [(float(between[a]), float(between[b])) for a, b in edges.reshape(-1, 2)]
