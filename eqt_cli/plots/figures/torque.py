"""Figure of torque components: the mean over runs of every law, a panel per axis."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.plots.base import OverTime, Panelled
from eqt_cli.plots.drawing import layout
from eqt_cli.plots.drawing.cells import scale_norm
from eqt_cli.plots.drawing.curve_labels import name_curves
from eqt_cli.plots.drawing.curves import Bands, draw_mean, of_bands
from eqt_cli.plots.drawing.labels import force_component, quantity
from eqt_cli.plots.drawing.style import Width, ink
from eqt_cli.plots.law_columns import law_columns
from eqt_cli.plots.shown.controllers import names
from eqt_cli.plots.shown.trajectories import ShownRuns

_DESIRED: dict[str, Any] = {"linewidth": 2.2, "zorder": 1.5}
_PALE = 0.25
"""Share of ink in the reference torque, which lies behind the curves."""
_ACROSS = 3
"""Most axes of a part side by side on a page."""

Share = Literal["total", "feedback", "feedforward"]

_NAMED = {"total": "torque", "feedback": "signed feedback"}


@dataclass(frozen=True)
class Torque(Panelled, OverTime):
    """Torque components in the body frame: the mean over runs, all laws in a panel per axis.

    Forces have panels of their own. The torque of the reference is drawn beside the whole torque
    and the feedforward.

    Attributes
    ----------
    share
        ``feedback``; ``feedforward``, what the law gives without its gains; or ``total``. The parts
        are known in an ideal loop, of laws that say what their feedforward is: there, the default
        is ``feedback``, and else ``total``.
    log
        The size of each component on a logarithmic scale.
    bands
        ``quantiles`` shades the range from the 10 % to the 90 % quantile over runs, a column of
        panels per law; ``bootstrap`` the 95 % interval of the mean at each time.
    """

    name: ClassVar[str] = "torque"

    share: Share | None = None
    log: bool = False
    bands: Bands = "none"

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a panel per axis; with quantiles, a column of panels per law."""
        wanted = self.picked([name for name, _ in runs.axes])
        units = {name: unit for name, unit in runs.axes if name in wanted}
        share, values = self._of_laws(runs)
        size = "size of the " if self.log else ""
        what = "" if share == "total" and not size else f" of the {size}{_NAMED.get(share, share)}"
        runs.remarks.append(f"Curves: mean{what} over {runs.count()}{of_bands(self.bands)}.")
        by_law = self.bands == "quantiles" and len(runs.shown) > 1
        if by_law:  # bands would hide each other
            drawing, rows = law_columns(runs, width, wanted)
        else:
            drawing, panels = layout.sheet(
                width, _places(units, width), runs.span, runs.unit("time")
            )
            rows = {name: {e.label: panels[name] for e in runs.shown} for name in wanted}
        for k, (name, _) in enumerate(runs.axes):
            for ensemble in runs.shown if name in wanted else ():
                torques = values[ensemble.label][..., k]
                panel, drawn = rows[name][ensemble.label], abs(torques) if self.log else torques
                draw_mean(panel, runs.times(ensemble), drawn, self.bands, ensemble)
        first = list(dict.fromkeys(rows[wanted[0]].values()))
        lines = [line for axes in first for line in axes.lines[: len(runs.shown)]]
        laws = dict(zip((e.title for e in runs.shown), lines, strict=False))
        desired = {} if share == "feedback" else _draw_desired(runs, rows, log=self.log)
        for name, unit in units.items():
            symbol = force_component(name, unit)
            if share != "total":
                index = r"\mathrm{fb}" if share == "feedback" else r"\mathrm{ff}"
                base, _, axis = symbol.removesuffix("}").partition("_{")
                symbol = f"{base}_{{{','.join(filter(None, (axis, index)))}}}"
            label = quantity(f"|{symbol}|" if self.log else symbol, unit)
            layout.name_scale(next(iter(rows[name].values())), label)
            for axes in rows[name].values() if self.log else ():
                scale_norm(axes, log=True)
        handles = desired if by_law else {**laws, **desired}
        if not desired and not by_law:
            name_curves(drawing, panels.values(), list(laws.values()), list(laws))
        elif handles:
            layout.add_legend(drawing, list(handles.values()), list(handles))
        return drawing

    def _of_laws(self, runs: ShownRuns) -> tuple[Share, dict[str, Array]]:
        """Return the share and the torques by law that are drawn, ``(runs, samples, axes)``."""
        torque = {e.label: runs.values("torque", e) for e in runs.shown}
        if self.share == "total":
            return self.share, torque
        try:
            given = {e.label: runs.feedforward(e) for e in runs.shown}
        except EqtError:
            if self.share:
                raise
            return "total", torque
        if self.share == "feedforward":
            return self.share, given
        return "feedback", {label: torque[label] - given[label] for label in torque}


def _draw_desired(
    runs: ShownRuns, rows: Mapping[str, Mapping[str, Axes]], *, log: bool
) -> dict[str, Artist]:
    """Draw the reference torque of each result in every panel; return the last line by name."""
    line: Artist = Line2D([], [])
    places = [name for name, _ in runs.axes]
    for result, name in zip(runs.results, names(runs.results), strict=True):
        first = next((e for e in runs.shown if e.results is result), None)
        if first is None:
            continue
        desired = runs.desired("torque", first)
        label = f"desired, {name}" if len(runs.results) > 1 else "desired"
        look: dict[str, Any] = {"label": label, "color": ink(_PALE), **_DESIRED}
        for axis, row in rows.items():
            drawn = desired[:, places.index(axis)]
            for panel in dict.fromkeys(row.values()):
                (line,) = panel.plot(runs.times(first), abs(drawn) if log else drawn, **look)
    return {quantity(r"\tau_d", ""): line}


def _places(axes: Mapping[str, str], width: Width) -> layout.Mosaic:
    """Return the panels by axis, with torques and forces in separate rows or columns."""
    units = dict.fromkeys(axes.values())
    parts = [[axis for axis, of in axes.items() if of == unit] for unit in units]
    if width != "column":
        across = min(_ACROSS, max(map(len, parts)))
        rows = [row for part in parts for row in layout.rows_of(part, across)]
        return [row + [layout.EMPTY] * (across - len(row)) for row in rows]
    if len(parts) == 1:
        return [[axis] for axis in parts[0]]
    tallest = max(map(len, parts))
    return [[part[k] if k < len(part) else layout.EMPTY for part in parts] for k in range(tallest)]
