"""Figure of a search with two objectives: the front of each law, on held-out runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.analysis.comparison.intervals import intervals_of_means
from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import Extras, Figure
from eqt_cli.plots.drawing.cells import scale
from eqt_cli.plots.drawing.curves import RESAMPLING
from eqt_cli.plots.drawing.labels import metric_label
from eqt_cli.plots.drawing.layout import add_legend
from eqt_cli.plots.drawing.style import WIDTHS, Width, line_style
from eqt_cli.plots.shown.controllers import ALL, Chosen, error_of, looks, positions
from eqt_cli.results.origin import label_named, law_title
from eqt_cli.results.result import Result
from eqt_cli.tuning.folder import TUNE
from eqt_cli.tuning.fronts import Front, fronts
from eqt_cli.tuning.held_out import held_out

_HEIGHTS: dict[Width, float] = {"column": 2.6, "page": 3.8, "slide": 2.7}
_SMALL = 3.5
"""Size of markers, pt; small, since the intervals matter."""


class ShownFronts:
    """Pareto fronts of a search with two objectives, on its held-out runs.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        See `ShownControllers`.

    Attributes
    ----------
    fronts : list of Front
        One front per law.
    titles : list of str
        Titles of the laws.
    looks : list of Look
        Looks, which determine the line styles of the laws.
    objectives : list of str
        The two metrics.

    Raises
    ------
    EqtError
        If the result is not of a search with two objectives, or there is no such law.
    """

    def __init__(self, results: Result, figure: str, chosen: Chosen = ALL) -> None:
        record = TUNE.beside(results)
        self.results = results = held_out(results, record) if record else results
        laws = [law["label"] for law in record["laws"]] if record else []
        known = {law: law_title(law) for law in laws}
        wanted = [label_named(name, known) for name in chosen.controllers]
        positions([results], figure, [name for name in wanted if name not in laws])
        if record is None or len(record["objectives"]) < 2:
            message = "shows the fronts of `eqt tune` with two `objectives`; this is none"
            raise error_of(results, figure, message)
        self.objectives = list(record["objectives"])
        drawn = [front for front in fronts(results, record) if not wanted or front.law in wanted]
        if not drawn:
            raise error_of(results, figure, "finds no front with two points")
        self.fronts = drawn
        firsts = [results.labels.index(front.labels[0]) for front in drawn]
        self.looks = looks([results], [firsts], figure, chosen, variants=False)
        self.titles = [results.given_names.get(front.law, law_title(front.law)) for front in drawn]
        self.starts = {law["label"]: results.labels.index(law["start"]) for law in record["laws"]}

    def values(self, front: Front) -> list[Array]:
        """Return both metrics of all winners of a law, ``(winners, runs)`` each."""
        rows = [self.results.labels.index(label) for label in front.labels]
        return [self.results.counted(name)[rows] for name in self.objectives]

    def start(self, front: Front) -> list[float]:
        """Return the means of both metrics at the starting gains of a law."""
        row = self.starts[front.law]
        return [float(self.results.means(name)[row]) for name in self.objectives]

    def notes(self) -> list[str]:
        """Return the notes for the reader about the points."""
        return [
            f"Means over {self.results.runs} held-out runs with 95 % intervals. Hollow: found by "
            "the search, but dominated on these runs. Half filled: starting gains."
        ]


@dataclass(frozen=True)
class Fronts(Figure[ShownFronts]):
    """The winners of each law by both objectives on held-out runs, with 95 % intervals.

    The line joins the Pareto front of these runs; hollow points are not on it.
    A half-filled point marks the starting gains of each law.

    Attributes
    ----------
    log
        Logarithmic scales where all numbers are positive, which is the default.
    """

    name: ClassVar[str] = "fronts"

    log: bool = True

    def subject(self, results: Sequence[Result], extras: Extras) -> ShownFronts:
        """Return the fronts of the laws."""
        return ShownFronts(self._only(results, "search"), self.name, self.chosen)

    def compose(self, shown: ShownFronts, width: Width) -> Drawing:
        """Draw one panel; laws have the colours and markers of all other figures."""
        drawing = Drawing(figsize=(WIDTHS[width], _HEIGHTS[width]))
        panel = drawing.add_subplot()
        lines, seen = [], []
        for front, of in zip(shown.fronts, shown.looks, strict=True):
            look = line_style(of)
            points = [_intervals(values) for values in shown.values(front)]
            best = front.best
            others = np.setdiff1d(np.arange(len(front.labels)), best)
            style: dict[str, Any] = look | {"marker": of.marker, "markersize": _SMALL}
            x, y = (each[best, 0] for each in points)
            lines += panel.plot(x, y, label=front.law, **style)
            _crosses(panel, points, best, look["color"], f"{front.law}, intervals")
            if len(others):
                x, y = (each[others, 0] for each in points)
                hollow = style | {"linestyle": "", "markerfacecolor": "none"}
                panel.plot(x, y, label=f"{front.law}, dominated", **hollow)
            half = style | {"linestyle": "", "fillstyle": "left", "markersize": 1.4 * _SMALL}
            panel.plot(*shown.start(front), label=f"{front.law}, start", **half)
            seen += points
        panel.margins(0.03)
        scale(panel, "x", np.concatenate(seen[0::2]), log=self.log)
        scale(panel, "y", np.concatenate(seen[1::2]), log=self.log)
        panel.set_xlabel(metric_label(shown.results, shown.objectives[0], 36))
        panel.set_ylabel(metric_label(shown.results, shown.objectives[1], 36))
        add_legend(drawing, lines, shown.titles)
        return drawing


def _intervals(values: Array) -> Array:
    """Return the mean and the interval of each row, ``(rows, 3)``."""
    means = intervals_of_means(values.T, RESAMPLING)
    return np.stack([means.mean, means.low, means.high], axis=-1)


def _crosses(panel: Axes, points: list[Array], rows: Array, colour: str, name: str) -> None:
    """Draw intervals along both scales."""
    (x, left, right), (y, low, high) = (each[rows].T for each in points)
    ends: dict[str, Any] = {"xerr": [x - left, right - x], "yerr": [y - low, high - y]}
    bars: dict[str, Any] = {"fmt": "none", "ecolor": (colour, 0.5), "elinewidth": 0.5}
    panel.errorbar(x, y, label=name, **ends, **bars)
