"""Figures that compare laws: distributions, differences."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import PercentFormatter

from eqt_cli.analysis.intervals import NEGLIGIBLE, Resampling, median_difference, shares
from eqt_cli.analysis.maps import NOBODY, compare_map
from eqt_cli.base.arrays import Array
from eqt_cli.figures.cells import even, scale_log, spans_decade
from eqt_cli.figures.figure import OfDifferences, OfMetrics, first_laws
from eqt_cli.figures.labels import free_text, metric_label, notation
from eqt_cli.figures.layout import (
    BAND,
    LONGEST,
    add_legend,
    blank_sheet,
    hide_inner_scales,
    rows_of,
)
from eqt_cli.figures.shown import MOST_COLOURS, MetricValues, ShownMetrics, ShownSweep
from eqt_cli.figures.style import WIDTHS, Width, ink, line_style, size_of_type
from eqt_cli.results.conclusion import side_by_side
from eqt_cli.results.result import Result
from eqt_cli.results.summary import repeats

# Figure of distributions: metrics of single runs as box plots, which may be censored --------------


MOST_POINTS = 50
"""Most runs that are drawn as points; of more, only the smallest and largest are."""

LEVELS = (BAND[0], 0.25, 0.5, 0.75, BAND[1])
"""Quantiles at the ends of whiskers and box, and the median."""

_HALF = 0.3
"""Half the height of a box, where rows are 1 apart."""
_SPREAD = 0.22
"""Largest distance of points from the middle line of their box."""
_ANY = 0.7
"""Share of ink in the grey that stands for every controller's colour in the legend."""
_GOLDEN = (5**0.5 - 1) / 2
"""Golden ratio: any number of its multiples, modulo 1, are spread evenly."""


_MEDIAN: dict[str, Any] = {"linewidth": 1.2, "solid_capstyle": "butt"}
_MARK: dict[str, Any] = {"linestyle": "none"}
_MEAN = _MARK | {"marker": "D", "markersize": 3, "markeredgewidth": 0.6}
_POINT = _MARK | {"marker": "o", "markersize": 1.6, "markeredgewidth": 0}
_RUN = _POINT | {"alpha": 0.4}
_TINT = 0.25
"""Share of a law's colour in its box."""


def draw_box(
    axes: Axes, row: int, sample: MetricValues, end: float, colour: str, label: str
) -> None:
    """Draw a box with its whiskers, median, mean and points.

    Parameters
    ----------
    row
        Position on the vertical axis.
    end
        Start of censored values: nothing is drawn beyond, and what reaches there stays open.
    label
        Name of the box, unique in the panel.
    """
    quantiles = sample.quantiles(LEVELS)
    finite = np.isfinite(quantiles)
    low, lower, median, upper, high = np.where(finite, quantiles, end)
    top, bottom = row - _HALF, row + _HALF
    solid: dict[str, Any] = {"color": colour, "linewidth": 0.8, "linestyle": "-"}
    axes.plot([low, lower, np.nan, upper, high], [row] * 5, label=f"whiskers {label}", **solid)
    caps = np.where(finite, quantiles, np.nan)[[0, -1]]
    axes.plot(caps, [row, row], "|", color=colour, markersize=4, label=f"ends {label}")
    if finite[1]:
        tint = colour, _TINT
        axes.add_patch(Rectangle((lower, top), upper - lower, 2 * _HALF, facecolor=tint))
        corners = [(upper, bottom), (lower, bottom), (lower, top), (upper, top)]
        outline = corners + corners[:1] if finite[3] else corners
        axes.plot(*zip(*outline, strict=True), label=f"quartiles {label}", **solid)
    if finite[2]:
        axes.plot([median] * 2, [top, bottom], label=f"median {label}", color=ink(), **_MEDIAN)
    if sample.values.size <= MOST_POINTS:
        seen = np.where(np.isfinite(sample.values), sample.values, np.nan)
        heights = row + _SPREAD * (2 * (_GOLDEN * np.arange(seen.size) % 1) - 1)
        axes.plot(seen, heights, label=f"runs {label}", color=ink(), **_RUN)
    else:
        extremes = sample.seen[[0, -1]] if sample.seen.size else np.full(2, np.nan)
        if sample.censored:
            extremes[1] = np.nan
        axes.plot(extremes, [row, row], label=f"extremes {label}", **_POINT, color=colour)
    if np.isfinite(sample.mean):
        hollow = _MEAN | {"markerfacecolor": ink(0), "markeredgecolor": ink()}
        axes.plot([sample.mean], [row], label=f"mean {label}", **hollow)


def box_legend(runs: Sequence[int]) -> tuple[list[Artist], list[str]]:
    """Return handles and names of the parts of boxes with these numbers of runs."""
    any_colour = ink(_ANY)
    handles: dict[str, Artist] = {
        "quartiles, median": Patch(facecolor=(any_colour, _TINT), edgecolor=any_colour, lw=0.8),
        "10–90 %": Line2D([], [], color=any_colour, linewidth=0.8),
        "mean": Line2D([], [], **_MEAN, markerfacecolor=ink(0), markeredgecolor=ink()),
    }
    if min(runs) <= MOST_POINTS:
        handles["single runs"] = Line2D([], [], color=ink(), **_RUN)
    if max(runs) > MOST_POINTS:
        handles["extremes"] = Line2D([], [], **_POINT, color=any_colour)
    return list(handles.values()), list(handles)


_MOST_COUNTS = 4
"""Most laws whose counts of unsettled runs stand above a panel of distribution functions."""

MOST_STEPS = 500
"""Most steps of a distribution function; beyond, each stands for several runs."""

_COLUMNS: dict[Width, int] = {"column": 2, "page": 3, "slide": 3}
_NAMES: dict[Width, int] = {"column": 17, "page": 26, "slide": 20}
"""Most characters in a line of a controller's name beside the boxes."""
_ROW, _LINE = 0.155, 0.12
"""Height of a row with a box, and of a further line of its name, in."""
_LEAST_NAME = 5.6
"""Least size of the names of laws, pt."""
_AROUND = 0.5
"""Height of the numbers and the name below a panel and the room above it, in."""
_CURVES: dict[Width, float] = {"column": 1.45, "page": 1.8, "slide": 1.25}

_BESIDE: dict[str, Any] = {
    "xycoords": ("axes fraction", "data"),
    "textcoords": "offset points",
    "va": "center",
    "fontsize": "small",
    "annotation_clip": False,
}


@dataclass(frozen=True)
class Distributions(OfMetrics):
    """How metrics are distributed over runs: box plots or distribution functions.

    A box holds the quartiles and the median, whiskers reach from the 10 % to the 90 % quantile, a
    diamond is the mean; points are single runs, or the smallest and the largest where there are
    many. Runs that had not settled by their end count as larger than all others and are given as
    numbers; with any of them there is no mean, and a distribution function ends below 1.

    Attributes
    ----------
    kind
        ``box``, or ``ecdf`` for the fraction of runs up to a value.
    log
        Logarithmic scales. Default: for metrics that span more than a decade.
    """

    name: ClassVar[str] = "distributions"

    kind: Literal["box", "ecdf"] = "box"
    log: bool | None = None

    def compose(self, metrics: ShownMetrics, width: Width) -> Drawing:
        """Draw two panels per row in a column, three on a page."""
        if all(result.runs < 2 or repeats(result) for result in metrics.results):
            raise metrics.error("shows how runs differ, and here all runs of a law are alike")
        if self.kind == "ecdf":
            first_laws(metrics, MOST_COLOURS * len(metrics.results))
        names = [free_text(e.title, _NAMES[width]) for e in metrics.shown]
        lines = max(name.count("\n") for name in names)
        tall = _AROUND + len(names) * (_ROW + _LINE * lines)
        height = tall if self.kind == "box" else _CURVES[width]
        # Names are smaller where many share a page; their heights are those over the size of type.
        heights = len(names) * (1.2 + 1.5 * lines)
        least = _AROUND + heights * _LEAST_NAME / 72 if self.kind == "box" else height
        most = _COLUMNS[width] * max(1, int(LONGEST[width] / least))
        if others := metrics.metrics[most:]:
            metrics.metrics = metrics.metrics[:most]
            metrics.remarks.append(f"No room for {', '.join(others)} (option 'metrics').")
        places = rows_of(metrics.metrics, _COLUMNS[width])
        room = WIDTHS[width] / len(places[0])
        drawing, panels = blank_sheet(width, places, height)
        room_up = drawing.get_figheight() / len(places) - _AROUND
        size = min(size_of_type("ytick.labelsize"), 72 * room_up / heights)
        for metric, axes in panels.items():
            axes.set_xlabel(metric_label(metrics.results[0], metric, int(18 * room)))
            samples = [metrics.samples[metric, e.label] for e in metrics.shown]
            if self.kind == "box":
                axes.set_yticks(range(len(names)), names, fontsize=size)
                _fill_boxes(axes, metrics, samples)
            else:
                _fill_steps(axes, metrics, samples)
            self._scale(axes, metrics, samples, room)
        if self.kind == "box":
            add_legend(drawing, *box_legend([int(e.good.sum()) for e in metrics.shown]))
        else:
            for axes in panels.values():
                axes.set_ylabel("fraction of runs")
            names = [e.title for e in metrics.shown]
            whole = len(names) // len(metrics.results)
            add_legend(drawing, panels[metrics.metrics[0]].lines, names, whole)
        hide_inner_scales(panels, places)
        metrics.remarks.append(f"Distributions over {metrics.count()}.")
        metrics.note = ", ".join(filter(None, [metrics.count(), metrics.note]))
        return drawing

    def _scale(
        self, axes: Axes, metrics: ShownMetrics, samples: Sequence[MetricValues], room: float
    ) -> None:
        """Set the horizontal scale; where runs had not settled, it ends with the runs."""
        seen = np.concatenate([sample.seen for sample in samples])
        log = spans_decade(seen) and bool((seen > 0).all()) if self.log is None else self.log
        if log and np.any(seen > 0):
            scale_log(axes, "x", seen[seen > 0])
        else:
            axes.xaxis.set_major_locator(even())
        if any(sample.censored for sample in samples):
            end = max(metrics.end(e) for e in metrics.shown)
            axes.set_xlim(left=None if seen.size else 0, right=end)
            _count(axes, samples, room, boxes=self.kind == "box")


def _fill_boxes(axes: Axes, metrics: ShownMetrics, samples: Sequence[MetricValues]) -> None:
    """Draw a box per law, the first on top."""
    for row, (ensemble, sample) in enumerate(zip(metrics.shown, samples, strict=True)):
        if sample.values.size:
            end, colour = metrics.end(ensemble), ensemble.look.colour
            draw_box(axes, row, sample, end, colour, ensemble.label)
    axes.set_ylim(len(samples) - 0.5, -0.5)
    axes.margins(x=0.06)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def _fill_steps(axes: Axes, metrics: ShownMetrics, samples: Sequence[MetricValues]) -> None:
    """Draw the fraction of runs up to every value, of all runs with one, settled or not."""
    for ensemble, sample in zip(metrics.shown, samples, strict=True):
        seen = sample.seen
        ranks = np.unique(np.linspace(1, seen.size, min(seen.size, MOST_STEPS)).round()).astype(int)
        across = np.concatenate([seen[:1], seen[ranks - 1]])
        up = np.concatenate([[0.0], ranks / max(sample.values.size, 1)])[: across.size]
        if sample.censored:
            across, up = np.append(across, metrics.end(ensemble)), np.append(up, up.max(initial=0))
        look = line_style(ensemble.look)
        axes.plot(across, up, drawstyle="steps-post", label=ensemble.label, **look)
    axes.set_ylim(0, 1.03)
    axes.margins(x=0.03)


def _count(axes: Axes, samples: Sequence[MetricValues], room: float, *, boxes: bool) -> None:
    """Write how many runs had not settled: right of every box, or above all curves."""
    totals = [sample.values.size for sample in samples]
    common = len(set(totals)) == 1
    counts = [
        f"{sample.censored}" if common else f"{sample.censored}/{sample.values.size}"
        for sample in samples
    ]
    of = f" of {totals[0]}" if common else ""
    if boxes:
        for row, count in enumerate(counts):
            axes.annotate(count, (1, row), (3, 0), **_BESIDE)
        text = f"not settled{of}"
    else:
        text = f"not settled: {', '.join(counts)}{of}"
        if len(counts) > _MOST_COUNTS:
            text = f"not settled: {sum(sample.censored for sample in samples)} of {sum(totals)}"
    axes.set_title(free_text(text, int(25 * room)), loc="right", fontsize="small")


# Figure of cases: the difference of two laws in each, and the share of runs that settle -----------


MOST_ROWS = 40

Settings = dict[str, Any]

_FOREST_ROW, _FOREST_AROUND = 0.187, 0.85
"""Height of a row, and of scales and legend, in."""
_LONGEST = 24
"""Most characters in a line of a name."""
_LONGEST_SCALE: dict[Width, int] = {"column": 28, "page": 60, "slide": 40}
"""Most characters in a line below the differences."""
_FOREST_BESIDE = 0.16
"""Offset of the shares of the two laws from the middle of their row, in heights of a row."""
_SMALL = 3.5
"""Size of markers, pt; small, since the intervals matter."""


@dataclass(frozen=True)
class Forest(OfDifferences):
    """A row for each point of a sweep: the paired difference of two laws, and who settles.

    The median over runs of the difference in per cent of the second law, with its interval; filled
    where a law wins as in figure `winners` or, within 1 %, they do not differ, and hollow where
    that is undecided. Beside it, the share of runs of both laws that settle, with Wilson intervals.
    """

    name: ClassVar[str] = "forest"

    def subject(self, results: Sequence[Result], measured: Any) -> ShownSweep:
        """Return the points; of a tuning, the winners unless others are chosen."""
        shown = self._only(results, "sweep")
        laws = self.controllers or (side_by_side(shown) if shown.is_sweep else ())
        return ShownSweep(shown, self.name, self.chosen._replace(controllers=laws))

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw two panels with the same rows, the first point on top."""
        if len(swept.controllers) != 2:
            raise swept.error(
                f"compares two laws, and here are {len(swept.controllers)}: "
                f"{', '.join(swept.titles)}; choose two by the option controllers"
                if len(swept.controllers) > 2
                else f"compares two laws, and here is one: {swept.titles[0]}"
            )
        values = swept.metric(self.metric_of(swept))
        if (points := len(values)) > MOST_ROWS:
            raise swept.error(
                f"has a row for each point, at most {MOST_ROWS}, and here are {points}"
            )
        settled = swept.settled(0)
        rows = np.arange(points)
        drawing = Drawing(figsize=(WIDTHS[width], _FOREST_AROUND + _FOREST_ROW * points))
        left, right = drawing.subplots(1, 2, sharey=True, width_ratios=(3, 2))
        first, second = swept.titles
        quantity = swept.results.quantity(self.metric_of(swept))
        cases = zip(values, ~swept.results.good[:, swept.controllers], strict=True)
        leads = [median_difference(quantity, *case, self.confidence) for case in cases]
        differences = np.array(leads)
        decided = self._decided(swept)
        _draw_differences(left, rows, 100 * differences, decided, f"{first} − {second}")
        words = free_text(notation(quantity.plain), _LONGEST_SCALE[width])
        name = free_text(f"{first} − {second} (% of {second})", _LONGEST_SCALE[width])
        left.set_xlabel(f"{words}\n{name}")
        for k, look in enumerate(swept.looks):
            share, low, high = shares(settled[:, k].astype(float), self.confidence).T
            beside, ends = rows + (2 * k - 1) * _FOREST_BESIDE, [share - low, high - share]
            marks: Settings = {"marker": look.marker, "markersize": _SMALL, "color": look.colour}
            right.plot(share, beside, label=swept.titles[k], linestyle="", **marks)
            bars: Settings = {"fmt": "none", "ecolor": look.colour, "elinewidth": 0.8}
            name = f"{swept.titles[k]}, intervals"
            right.errorbar(share, beside, xerr=ends, label=name, **bars)
        right.set_xlim(-0.04, 1.04)
        right.set_xlabel("share settled (%)")
        right.xaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=""))
        left.set_yticks(rows, [free_text(swept.results.point_name(int(k)), _LONGEST) for k in rows])
        left.set_ylim(points - 0.4, -0.6)
        for panel in (left, right):
            panel.grid(axis="y", visible=False)
            panel.tick_params(axis="y", length=0)
        add_legend(drawing, right.lines[:2], swept.titles)
        swept.remarks += self._remarks(swept, differences, first)
        interval = f"bars: {100 * self.confidence:g} % intervals"
        swept.note = f"median paired differences; {interval}; hollow: undecided"
        return drawing

    def _decided(self, swept: ShownSweep) -> Array:
        """Return whether the runs decide at each point, by the rule of all comparisons."""
        metric, how = self.metric_of(swept), Resampling(self.confidence)
        if swept.results.quantity(metric).better == "neither":
            return np.zeros(len(swept.metric(metric)), bool)
        points = compare_map(swept.results, metric, how, swept.controllers, intervals=False)
        return np.array([cell.winner != NOBODY or cell.alike for cell in points.cells])

    def _remarks(self, swept: ShownSweep, differences: Array, first: str) -> list[str]:
        quantity = swept.results.quantity(self.metric_of(swept))
        side = {"lower": "Left", "higher": "Right"}.get(quantity.better)
        better = f" {side} of 0: {first} is better." if side else ""
        notes = [
            f"{swept.count} per row.{better} "
            f"Intervals of {100 * self.confidence:g} %, each by itself; filled: better, worse, or "
            f"no difference within {100 * NEGLIGIBLE:g} %, by sign tests that count all points; "
            "hollow: undecided. A failed run is worse than any other."
        ]
        if not np.isfinite(differences).all():
            notes.append("No interval where the runs are too few for it, or failed in most pairs.")
        return notes


def _draw_differences(
    panel: Axes, rows: Array, differences: Array, decided: Array, name: str
) -> None:
    mean, low, high = differences.T
    panel.axvline(0, color=ink(0.5), linewidth=0.6, label="no difference")
    finite = np.isfinite(low) & np.isfinite(high)
    ends = np.array([mean - low, high - mean])[:, finite]
    bars: Settings = {"fmt": "none", "ecolor": ink(0.8), "elinewidth": 0.9}
    if finite.any():
        panel.errorbar(mean[finite], rows[finite], xerr=ends, label=f"{name}, intervals", **bars)
    look: Settings = {"marker": "D", "markersize": _SMALL, "linestyle": "", "color": ink(0.8)}
    hollow = look | {"markerfacecolor": ink(0)}
    for some, which, style in ((decided, "decided", look), (~decided, "undecided", hollow)):
        if some.any():
            panel.plot(mean[some], rows[some], label=f"{name}, {which}", **style)
    panel.margins(x=0.06)
