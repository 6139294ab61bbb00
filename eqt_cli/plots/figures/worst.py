"""Figure of a search for the worst run: the worst along each key."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import Extras, Figure
from eqt_cli.plots.drawing import layout
from eqt_cli.plots.drawing.cells import scale, scale_along
from eqt_cli.plots.drawing.labels import metric_label
from eqt_cli.plots.drawing.style import WIDTHS, Look, Width, line_style
from eqt_cli.plots.shown.controllers import ALL, Chosen, error_of, looks, positions
from eqt_cli.results.result import Result
from eqt_cli.results.swept_key import SweptKey
from eqt_cli.tuning.folder import WORST
from eqt_cli.tuning.law_search import coordinate_of
from eqt_cli.tuning.worst import costs_of_runs

_HEIGHTS: dict[Width, float] = {"column": 1.9, "page": 2.2, "slide": 1.35}
_IN_A_ROW: dict[Width, int] = {"column": 2, "page": 3, "slide": 4}
_SMALL, _LARGE = 2.5, 7.0
"""Sizes of markers, pt; large where the worst was found."""


@dataclass(frozen=True)
class Profile:
    """Costs of a law along one key through its worst case.

    Attributes
    ----------
    key
        Configuration key.
    look
        Look of the law, which determines its line style.
    title
        Title of the law.
    values : (points,)
        Values of the key.
    worst : (points,)
        Worst objective over all runs; NaN where a run failed, or none has a value.
    failed : (points,)
        Whether a run failed.
    found
        Index of the point at the worst case.
    """

    key: str
    look: Look
    title: str
    values: Array
    worst: Array
    failed: Array
    found: int


class ShownWorst:
    """Results of a search for the worst run, along each key.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        See `ShownControllers`.

    Attributes
    ----------
    lines : list of Profile
        Lines of all laws, with keys in the order of the configuration.
    objective : str
        The metric that is searched.

    Raises
    ------
    EqtError
        If the result is not of such a search, or there is no such controller.
    """

    def __init__(self, results: Result, figure: str, chosen: Chosen = ALL) -> None:
        self.results = results
        record = WORST.beside(results)
        if record is None:
            raise error_of(results, figure, "shows what `eqt worst` found; this is none")
        shown = positions([results], figure, chosen.controllers)[0]
        look_of = dict(zip(shown, looks([results], [shown], figure, chosen), strict=True))
        self.objective: str = record["objective"]
        costs = costs_of_runs(results, self.objective).max(axis=-1)
        quantity = results.quantity(self.objective)
        self._log = {key for law in record["laws"] for key in law["log"]}
        self.lines = []
        for law in record["laws"]:
            position = results.labels.index(law["label"])
            for line in law["lines"] if position in shown else ():
                key, points = line["key"], slice(*line["points"])
                values = results.coordinate(coordinate_of(key))[points].astype(float)
                cost = costs[points, position]
                worst = quantity.cost(np.where(np.isfinite(cost), cost, np.nan))
                failed, found = np.isposinf(cost), np.argmin(np.abs(values - law["values"][key]))
                look, title = look_of[position], results.title_of[law["label"]]
                self.lines.append(Profile(key, look, title, values, worst, failed, int(found)))

    @property
    def keys(self) -> list[str]:
        """The varied keys, each once."""
        return list(dict.fromkeys(line.key for line in self.lines))

    def swept(self, key: str) -> SweptKey:
        """Return a key with all values of its lines, as a swept key."""
        values = np.concatenate([line.values for line in self.lines if line.key == key])
        return SweptKey(key, values, {}, key in self._log)

    def notes(self) -> list[str]:
        """Return the notes for the reader about the curves."""
        runs = self.results.runs
        of = f"the worst of {runs} runs" if runs > 1 else "one run"
        failed = any(line.failed.any() for line in self.lines)
        return [
            f"Each point: {of}; the other keys as found for the law (large marker). "
            "Found by search: worse runs may exist.",
            *["Crosses at the top: a run failed."] * failed,
        ]


@dataclass(frozen=True)
class WorstFigure(Figure[ShownWorst]):
    """The worst run of each law along each key, through the worst that `eqt worst` found.

    The other keys stay where the worst of the law was found; a large marker shows this point. A
    cross at the top marks values at which a run failed.

    Attributes
    ----------
    log
        A logarithmic scale, where all numbers are positive; by default, where they span more than
        a decade.
    """

    name: ClassVar[str] = "worst"

    log: bool | None = None

    def subject(self, results: Sequence[Result], extras: Extras) -> ShownWorst:
        """Return the worst runs along each key."""
        return ShownWorst(self._only(results, "search"), self.name, self.chosen)

    def compose(self, shown: ShownWorst, width: Width) -> Drawing:
        """Draw a panel per key; laws have the colours and markers of all other figures."""
        mosaic = layout.rows_of(shown.keys, _IN_A_ROW[width])
        drawing, panels = layout.blank_sheet(width, mosaic, _HEIGHTS[width])
        room = WIDTHS[width] / len(mosaic[0])
        layout.share_scale(panels.values())
        titles: dict[str, Any] = {}
        for key in shown.keys:
            for line in (line for line in shown.lines if line.key == key):
                titles.setdefault(line.title, _draw(panels[key], line))
            scale_along(panels[key], shown.results, shown.swept(key), room)
        seen = np.concatenate([line.worst for line in shown.lines])
        scale(panels[mosaic[0][0]], "y", seen, log=self.log)
        label = f"worst {metric_label(shown.results, shown.objective, 30)}"
        for row in mosaic:
            panels[row[0]].set_ylabel(label)
        layout.hide_inner_scales(panels, mosaic)
        layout.add_legend(drawing, list(titles.values()), list(titles))
        return drawing


def _draw(panel: Axes, line: Profile) -> Any:
    look = line_style(line.look) | {"marker": line.look.marker}
    hollow = look | {"markersize": _SMALL, "markerfacecolor": "none"}
    (drawn,) = panel.plot(line.values, line.worst, label=line.title, **hollow)
    found_look = hollow | {"markersize": _LARGE, "linestyle": "", "clip_on": False}
    point = [line.values[line.found]], [line.worst[line.found]]
    panel.plot(*point, label=f"{line.title}, found", **found_look)
    if line.failed.any():
        x = line.values[line.failed]
        top = look | {"transform": panel.get_xaxis_transform(), "linestyle": "", "clip_on": False}
        crosses = top | {"marker": "x", "label": f"{line.title}, failed"}
        panel.plot(x, np.full(len(x), 0.97), **crosses)
    return drawn
