"""Figures of searches: fronts of a tuning, and the worst runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import ScalarFormatter

from eqt_cli.analysis.intervals import intervals_of_means
from eqt_cli.base.arrays import Array
from eqt_cli.extensions.search.fronts import Front, fronts, held_out
from eqt_cli.extensions.search.record import TUNE, WORST, coordinate_of, costs_of_runs
from eqt_cli.figures import layout
from eqt_cli.figures.cells import even, scale, scale_along
from eqt_cli.figures.figure import Figure
from eqt_cli.figures.labels import metric_label
from eqt_cli.figures.layout import RESAMPLING, add_legend
from eqt_cli.figures.shown import ALL, Chosen, error_of, looks, positions
from eqt_cli.figures.style import WIDTHS, Look, Width, line_style
from eqt_cli.results.origin import label_named, law_title
from eqt_cli.results.quantity import SweptKey
from eqt_cli.results.result import Result, swept_key

# Figure of a search with two objectives: the front of each law, on held-out runs ------------------


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
        titles = {law: law_title(law) for law in laws}
        wanted = [label_named(name, titles) for name in chosen.controllers]
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
        self.titles = [results.custom_names.get(front.law, law_title(front.law)) for front in drawn]
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
        Logarithmic scales, where all numbers are positive.
    """

    name: ClassVar[str] = "fronts"

    log: bool = True

    def subject(self, results: Sequence[Result], measured: Any) -> ShownFronts:
        """Return the fronts of the laws."""
        return ShownFronts(self._only(results, "search"), self.name, self.chosen)

    def compose(self, shown: ShownFronts, width: Width) -> Drawing:
        """Draw one panel; laws have the colours and markers of all other figures."""
        drawing, panel = layout.one_panel(width, _HEIGHTS[width])
        lines, seen = [], []
        for front, of in zip(shown.fronts, shown.looks, strict=True):
            look = line_style(of)
            means = [intervals_of_means(values.T, RESAMPLING) for values in shown.values(front)]
            points = [np.stack([ends.mean, ends.low, ends.high], axis=-1) for ends in means]
            best = front.best
            dominated = np.setdiff1d(np.arange(len(front.labels)), best)
            style: dict[str, Any] = look | {"marker": of.marker, "markersize": _SMALL}
            (x, left, right), (y, low, high) = (ends[best].T for ends in points)
            lines += panel.plot(x, y, label=front.law, **style)
            crosses: dict[str, Any] = {"xerr": [x - left, right - x], "yerr": [y - low, high - y]}
            crosses |= {"fmt": "none", "ecolor": (look["color"], 0.5), "elinewidth": 0.5}
            panel.errorbar(x, y, label=f"{front.law}, intervals", **crosses)
            if len(dominated):
                x, y = (ends[dominated, 0] for ends in points)
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


# Figure of a search for the worst run: the worst along each key -----------------------------------


_WORST_HEIGHTS: dict[Width, float] = {"column": 1.9, "page": 2.2, "slide": 1.35}
_IN_A_ROW: dict[Width, int] = {"column": 2, "page": 3, "slide": 3}
_WORST_SMALL, _LARGE = 2.5, 7.0
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
    worst_index
        Index of the point at the worst case.
    """

    key: str
    look: Look
    title: str
    values: Array
    worst: Array
    failed: Array
    worst_index: int


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
        self.lines, self._keys = list[Profile](), dict[str, SweptKey]()
        for law in record["laws"]:
            position = results.labels.index(law["label"])
            if position in shown:
                for line in law["lines"]:
                    key, points = line["key"], slice(*line["points"])
                    stored = swept_key(results, coordinate_of(key))
                    self._keys[key] = stored.in_degrees
                    cost = costs[points, position]
                    worst = quantity.cost(np.where(np.isfinite(cost), cost, np.nan))
                    away = np.abs(stored.values[points] - law["values"][key])
                    failed, index = np.isposinf(cost), np.argmin(away)
                    values = self._keys[key].values[points]
                    look, title = look_of[position], results.title_of[law["label"]]
                    self.lines.append(Profile(key, look, title, values, worst, failed, int(index)))

    @property
    def keys(self) -> list[str]:
        """The varied keys, each once."""
        return list(dict.fromkeys(line.key for line in self.lines))

    def swept(self, key: str) -> SweptKey:
        """Return a key with all values of its lines, as a swept key."""
        values = np.concatenate([line.values for line in self.lines if line.key == key])
        return replace(self._keys[key], values=values, asks_log=key in self._log)

    def notes(self) -> list[str]:
        """Return the notes for the reader about the curves."""
        runs = self.results.runs
        of = f"the worst of {runs} runs" if runs > 1 else "one run"
        failed = any(line.failed.any() for line in self.lines)
        remarks = [
            f"Each point: {of}; the other keys as found for the law (large marker). "
            "Found by search: worse runs may exist."
        ]
        return [*remarks, "Crosses at the top: a run failed."] if failed else remarks


@dataclass(frozen=True)
class WorstFigure(Figure[ShownWorst]):
    """The worst run of each law along each key, through the worst that `eqt worst` found.

    The other keys stay where the worst of the law was found; a large marker shows this point. A
    cross at the top marks values at which a run failed.

    Attributes
    ----------
    log
        Logarithmic scale, where all numbers are positive. Default: where they span more than a
        decade.
    """

    name: ClassVar[str] = "worst"

    log: bool | None = None

    def subject(self, results: Sequence[Result], measured: Any) -> ShownWorst:
        """Return the worst runs along each key."""
        return ShownWorst(self._only(results, "search"), self.name, self.chosen)

    def compose(self, shown: ShownWorst, width: Width) -> Drawing:
        """Draw a panel per key; laws have the colours and markers of all other figures."""
        mosaic = layout.rows_of(shown.keys, _IN_A_ROW[width])
        drawing, panels = layout.blank_sheet(width, mosaic, _WORST_HEIGHTS[width])
        room = WIDTHS[width] / len(mosaic[0])
        layout.share_scale(panels.values())
        titles: dict[str, Any] = {}
        for key in shown.keys:
            for line in (line for line in shown.lines if line.key == key):
                titles.setdefault(line.title, _draw(panels[key], line))
            scale_along(panels[key], shown.results, shown.swept(key), room)
            if panels[key].get_xscale() == "linear":
                panels[key].xaxis.set_major_locator(even())
                panels[key].xaxis.set_major_formatter(ScalarFormatter())
        seen = np.concatenate([line.worst for line in shown.lines])
        scale(panels[mosaic[0][0]], "y", seen, log=self.log)
        label = f"worst {metric_label(shown.results, shown.objective, 30)}"
        for panel in panels.values():
            panel.set_ylabel(label)
        layout.hide_inner_scales(panels, mosaic)
        layout.add_legend(drawing, list(titles.values()), list(titles))
        return drawing


def _draw(panel: Axes, line: Profile) -> Any:
    look = line_style(line.look) | {"marker": line.look.marker}
    hollow = look | {"markersize": _WORST_SMALL, "markerfacecolor": "none"}
    (drawn,) = panel.plot(line.values, line.worst, label=line.title, **hollow)
    large = hollow | {"markersize": _LARGE, "linestyle": "", "clip_on": False}
    point = [line.values[line.worst_index]], [line.worst[line.worst_index]]
    panel.plot(*point, label=f"{line.title}, found", **large)
    if line.failed.any():
        x = line.values[line.failed]
        top = look | {"transform": panel.get_xaxis_transform(), "linestyle": "", "clip_on": False}
        crosses = top | {"marker": "x", "label": f"{line.title}, failed"}
        panel.plot(x, np.full(len(x), 0.97), **crosses)
    return drawn
