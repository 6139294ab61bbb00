"""Figure of commanded and delivered torque, thrust or momentum of wheels in a single run."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import CountOrNone
from eqt_cli.plots.base import OverTime, Panelled
from eqt_cli.plots.drawing.labels import force_component, free_text, quantity
from eqt_cli.plots.drawing.layout import add_legend, name_scale
from eqt_cli.plots.drawing.style import Width, ink
from eqt_cli.plots.law_columns import law_columns
from eqt_cli.plots.shown.controllers import Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns

_ASKED: dict[str, Any] = {"linewidth": 0.6, "linestyle": (0, (2, 1.2))}
_ANY = 0.7
"""Share of ink in the grey that stands for every controller's colour in the legend."""
_SHADE = 0.13
"""Share of ink in the shading behind the curves."""
_NEAR = 1e-6
"""Relative tolerance within which a limit counts as reached."""
_SEEN = 2.0
"""Multiple of the largest value up to which a limit is drawn."""
Limits = tuple[Array, Array] | None

_GIVEN = {"torque": "given", "thrust": "thrust", "wheel_momentum": "momentum"}
_FEW = 4
"""Most thrusters or wheels whose panels have room for several laws in a column."""
_MOST_NAME = 11
"""Most characters in a line of the name of a thruster, where there are many."""


@dataclass(frozen=True)
class Commands(Panelled, OverTime):
    """What a law asks for and what its actuators give in one run; the time at a limit is shaded.

    A row per axis and a column per law, with the limits of each axis. Limits of other kinds,
    such as of the norm, shade all axes.

    Attributes
    ----------
    run
        Number of the run.
    thrusters
        Show the thrust of each thruster instead, a row each.
    wheels
        Show the momentum of each wheel instead, a row each.
    """

    name: ClassVar[str] = "commands"

    run: CountOrNone = 0
    thrusters: bool = False
    wheels: bool = False

    @property
    def _signal(self) -> str:
        """The signal whose rows are shown."""
        return "thrust" if self.thrusters else "wheel_momentum" if self.wheels else "torque"

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a row with its own scale per axis, and a column per law."""
        signal = self._signal
        if signal == "torque" and not any(e.results.has("command") for e in runs.shown):
            raise runs.error(
                "finds no actuators in this loop, so what a law asks for is what acts; figure "
                "'torque' shows it"
            )
        axes = {name: quantity(force_component(name, unit), unit) for name, unit in runs.axes}
        if signal != "torque":
            names = runs.members(signal)
            if len(names) > _FEW and width == "column" and not self.controllers:
                runs.ensembles = runs.shown[:1]
                runs.remarks.append("Of the first law; --controller chooses others.")
            unit = runs.unit(signal).replace(" ", "\u00a0")  # not broken there
            most = 2 * _MOST_NAME // (1 + len(names) // _FEW)
            axes = {name: free_text(f"{name} ({unit})", most) for name in names}
        places, wanted = list(axes), self.picked(list(axes))
        drawing, rows = law_columns(runs, width, wanted)
        kinds: set[str] = set()
        limits = {e.label: runs.limits(e, self.run, signal) for e in runs.shown}
        for name in wanted:
            name_scale(next(iter(rows[name].values())), axes[name])
            for ensemble in runs.shown:
                k, panel = places.index(name), rows[name][ensemble.label]
                kinds |= self._fill(panel, runs, ensemble, k, limits[ensemble.label])
        self._add_legend(drawing, runs, kinds)
        runs.remarks.append(f"Run {self.run}.")
        return drawing

    def _fill(
        self, axes: Axes, runs: ShownRuns, ensemble: Ensemble, k: int, ends: Limits
    ) -> set[str]:
        """Draw one axis, thruster or wheel of a controller; shade where it is at a limit.

        Return the names of what the legend explains.
        """
        times, signal = runs.times(ensemble), self._signal
        given = runs.of_run(signal, ensemble, self.run)[:, k]
        command = given
        if signal == "torque" and ensemble.results.has("command"):
            command = runs.of_run("command", ensemble, self.run)[:, k]
        if ends is not None:
            low, high = float(ends[0][k]), float(ends[1][k])
            beyond = (command <= low + _NEAR * abs(low)) | (command >= high - _NEAR * abs(high))
        else:
            low, high = -np.inf, np.inf
            beyond = np.zeros(len(times), dtype=bool)
            if ensemble.results.has("at_limit") and signal == "torque":
                beyond = runs.of_run("at_limit", ensemble, self.run) > 0
        for start, end in _stretches(times, beyond):
            axes.axvspan(start, end, facecolor=ink(_SHADE), linewidth=0, zorder=0)
        kinds = {"at a limit"} if beyond.any() else set()
        reach = _SEEN * np.max(np.abs(given), initial=0.0, where=np.isfinite(given))
        for number, end in enumerate((low, high)):
            if np.isfinite(end) and abs(end) <= reach:
                axes.axhline(end, label=f"limit {number}", **_limit())
                kinds.add("limit")
        axes.plot(times, given, color=ensemble.look.colour, label=_GIVEN[signal])
        if signal == "torque":
            axes.plot(times, command, color=ink(), label="asked", **_ASKED)
        return kinds

    def _add_legend(self, drawing: Drawing, runs: ShownRuns, kinds: set[str]) -> None:
        alone = runs.shown[0].look.colour if len(runs.shown) == 1 else ink(_ANY)
        given = {**_GIVEN, "torque": "given by the actuators"}[self._signal]
        handles: dict[str, Artist] = {given: Line2D([], [], color=alone)}
        if self._signal == "torque":
            handles["asked by the law"] = Line2D([], [], color=ink(), **_ASKED)
        if "limit" in kinds:
            handles["limit"] = Line2D([], [], **_limit())
        if "at a limit" in kinds:
            handles["at a limit"] = Patch(facecolor=ink(_SHADE), linewidth=0)
        add_legend(drawing, list(handles.values()), list(handles))


def _limit() -> dict[str, Any]:
    return {"color": ink(_ANY), "linewidth": 0.6, "linestyle": (0, (6, 2)), "zorder": 1.5}


def _stretches(times: Array, inside: Array) -> list[tuple[float, float]]:
    """Return start and end of each stretch of samples inside, extended by half a step."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    between = np.concatenate([times[:1], (times[:-1] + times[1:]) / 2, times[-1:]])
    return [(float(between[a]), float(between[b])) for a, b in edges.reshape(-1, 2)]
