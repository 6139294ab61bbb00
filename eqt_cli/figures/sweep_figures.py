"""Figures of sweeps: curves and maps, trade-offs, shares of runs that settle."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Patch
from pydantic import Field

from eqt_cli.analysis.intervals import shares
from eqt_cli.analysis.maps import front
from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.extensions import function_for
from eqt_cli.figures.cells import (
    Cells,
    colours_of,
    map_columns,
    scale,
    scale_along,
    scale_log,
    spans_decade,
)
from eqt_cli.figures.figure import OfOneMetric, OfSweep
from eqt_cli.figures.labels import free_text, metric_label
from eqt_cli.figures.layout import (
    BAND,
    BANDS,
    OwnPage,
    add_legend,
    add_title,
    band_look,
    blank_sheet,
    one_panel,
    rows_of,
)
from eqt_cli.figures.shown import ShownSweep
from eqt_cli.figures.style import WIDTHS, Width, ink, line_style
from eqt_cli.results.quantity import SweptKey
from eqt_cli.results.result import laws_at
from eqt_cli.results.summary import check_metrics

# Figure of a sweep: one metric over one key as curves, over two as a map per law ------------------


_LABEL = {"boxstyle": "round,pad=0.15", "edgecolor": "none", "alpha": 0.85}
HEIGHTS: dict[Width, float] = {"column": 2.2, "page": 3.0, "slide": 2.4}

_LOWER: dict[Width, float] = {"column": 1.6, "page": 2.2, "slide": 1.6}
"""Heights of maps in several rows, in."""

_COLOURS, _AROUND = 1.15, 0.5
"""Width of the colour scale and a map's scale, and height of title and scale, in."""

FAILED, BEYOND = "xxxx", "////"
"""Hatches of cells with failed runs, and with runs beyond the horizon."""


@dataclass(frozen=True)
class SweepFigure(OfOneMetric):
    """A metric over the swept keys: curves with bands for one key, heat maps for two.

    Means over the runs of every point; bands reach from the 10 % to the 90 % quantile.

    Cells with failed runs, which have no mean, are hatched in two directions; hatched in one are
    cells with censored runs, whose number lies beyond the horizon. The means are written in the
    cells where they fit.

    Where the sweep is over the options of a law, points at which it is a law with a name of its own
    carry that name.

    Attributes
    ----------
    log
        Logarithmic scale of the metric. Default: where it spans more than a decade.
    """

    name: ClassVar[str] = "sweep"

    log: bool | None = None

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw means over the runs: one panel of curves, or a map per law."""
        name = self.metric_of(swept)
        check_metrics(swept.results, [name], who=f"figure '{self.name}'")
        if name == "settled":
            return Settled().compose(swept, width)
        axes = swept.one_or_two("; figure 'pareto' shows sweeps of any number")
        label = metric_label(swept.results, name, 36)
        means, of_runs = swept.means(name), swept.metric(name)
        bands = np.quantile(of_runs, BAND, axis=-1)
        remark = f"Mean at each point over {swept.count}"
        if len(axes) == 1:
            looks = "bands" if axes[0].is_number else "bars"
            swept.remarks.append(f"{remark}; {looks}: 10–90 % of runs.")
            swept.note = f"mean and 10–90 % of {swept.count}"
            drawing, panel = _draw_curves(swept, axes[0], means, bands, label, width)
            scale(panel, "y", means, log=self.log)
            return drawing
        swept.remarks.append(f"{remark}.")
        return self._maps(swept, axes, means, label, width)

    def _maps(
        self, swept: ShownSweep, axes: list[SweptKey], means: Array, label: str, width: Width
    ) -> Drawing:
        count, cells = len(swept.titles), Cells(*axes)
        # Two maps fit side by side even in a column, since few cells hold numbers.
        columns = count if count == 2 else map_columns(count, width)
        height = HEIGHTS[width] if count <= columns else _LOWER[width]
        norm, better = self._colours(means), swept.results.quantity(self.metric_of(swept)).better
        # Runs that failed, and runs beyond the horizon: (points, laws, runs).
        failed = swept.results.status[:, swept.controllers] != 0
        beyond = swept.results.censored(self.metric_of(swept))[:, swept.controllers]

        def draw(panel: Axes, index: int, room: tuple[float, float]) -> Any:
            image = cells.draw(panel, means[:, index], norm=norm, cmap=colours_of(better))
            cells.hatch(panel, np.flatnonzero(failed[:, index].any(axis=-1)), FAILED)
            cells.hatch(panel, np.flatnonzero(beyond[:, index].any(axis=-1)), BEYOND)
            named = laws_at(swept.results, swept.controllers[index])
            others = np.array([point not in named for point in range(len(means))])
            shown = np.where(others, means[:, index], np.nan)
            cells.write(panel, shown, image, room)
            for point, law in named.items():
                _name(panel, cells.columns[point], cells.rows[point], law)
            return image

        drawing = _draw_maps(swept, cells, columns, (width, height), label, draw)
        _explain(drawing, bool(failed.any()), bool(beyond.any()))
        return drawing

    def _colours(self, means: Array) -> Normalize:
        seen = means[np.isfinite(means)]
        ends: dict[str, Any] = {"vmin": float(seen.min()), "vmax": float(seen.max())}
        log = spans_decade(seen) if self.log is None else self.log
        return LogNorm(**ends) if log and (seen > 0).all() else Normalize(**ends)


def _draw_curves(
    swept: ShownSweep, axis: SweptKey, means: Array, bands: Array, label: str, width: Width
) -> tuple[Drawing, Axes]:
    """Draw means ``(points, laws)`` and bands ``(2, points, laws)`` over a key."""
    drawing, panel = one_panel(width, HEIGHTS[width])
    order = np.argsort(axis.values, kind="stable")
    lines, laws = [], len(swept.looks)
    if axis.is_number and laws > BANDS:
        swept.remarks.append(f"Bands are those of {' and '.join(swept.titles[:BANDS])}.")
        swept.note += f", bands of {' and '.join(swept.titles[:BANDS])}"
    for k, (look, title) in enumerate(zip(swept.looks, swept.titles, strict=True)):
        across, band, style = axis.values[order], bands[:, order, k], line_style(look)
        if axis.is_number and k < BANDS:
            panel.fill_between(across, *band, label=title, **band_look(look.colour))
        if not axis.is_number:  # texts have no order: bars, those of the laws side by side
            across = across + (k - (laws - 1) / 2) * min(0.15, 0.6 / laws)
            style["linestyle"] = ""
            panel.vlines(across, *band, label=title, color=look.colour, linewidth=0.8)
        style |= {"marker": look.marker, "markersize": 4.5, "markerfacecolor": "none"}
        lines += panel.plot(across, means[order, k], label=title, **style)  # hollow: all are seen
        for point, law in laws_at(swept.results, swept.controllers[k]).items():
            _name(panel, axis.values[point], means[point, k], law)
    scale_along(panel, swept.results, axis, WIDTHS[width])
    panel.set_ylabel(label)
    add_legend(drawing, lines, swept.titles)
    return drawing, panel


def _draw_maps(
    swept: ShownSweep,
    cells: Cells,
    columns: int,
    size: tuple[Width, float],
    label: str,
    draw: Callable[[Axes, int, tuple[float, float]], Any],
) -> Drawing:
    """Draw a map for each law, with one scale of colours.

    Parameters
    ----------
    columns, size
        Maps side by side; width of the figure, and height of a map with its surroundings, in.
    draw
        Draws the map of the n-th law into a panel with so much width and height for cells, in.
    """
    count, (width, height) = len(swept.titles), size
    mosaic = rows_of([f"panel {number}" for number in range(1, count + 1)], columns)
    drawing, by_name = blank_sheet(width, mosaic, height, sharex=True, sharey=True)
    panels, is_own = list(by_name.values()), isinstance(drawing, OwnPage)
    height = height if is_own else drawing.get_figheight() / len(mosaic)
    room = (WIDTHS[width] - _COLOURS) / columns, height - _AROUND
    for k, (panel, title) in enumerate(zip(panels, swept.titles, strict=True)):
        image = draw(panel, k, room)
        add_title(panel, title)
        edges = {"leftmost": is_own or k % columns == 0, "lowest": is_own or k + columns >= count}
        below = cells.scales(panel, swept.results, room[0], **edges)
    drawing.set_figheight(drawing.get_figheight() + below)
    bar = panels[0].figure.colorbar(image, ax=panels, label=label)
    if isinstance(image.norm, LogNorm):
        scale_log(bar.ax, "y", np.array([image.norm.vmin, image.norm.vmax]))
    return drawing


def _explain(drawing: Drawing, failed: bool, beyond: bool) -> None:
    """Add a legend of hatches."""
    hatches = {"failed runs, no mean": FAILED} if failed else {}
    if beyond:
        hatches["censored runs, counted with the horizon"] = BEYOND
    if hatches:
        look: dict[str, Any] = {"fill": False, "edgecolor": ink(0.6), "linewidth": 0}
        add_legend(drawing, [Patch(hatch=x, **look) for x in hatches.values()], list(hatches))


def _name(panel: Axes, x: float, y: float, law: str) -> None:
    """Write a law's name at its point."""
    box = _LABEL | {"facecolor": ink(0)}
    panel.annotate(free_text(law, 12), (x, y), ha="center", va="center", fontsize="small", bbox=box)


# Figure of the share of runs that settle, over one or two swept keys ------------------------------


_ROW = 0.34
"""Height of a row of cells with two lines in each, in."""
_MOST_SETTLED, _LEAST_SETTLED = 2.6, 1.3
"""Largest and smallest height of a map with its surroundings, in."""
_ROUNDING = 1e-9
"""Rounding error of an end of an interval, per cent."""


@dataclass(frozen=True)
class Settled(OfSweep):
    """The share of runs that settle, with 95 % Wilson intervals: curves over a key, maps over two.

    A cell, if it has room, has the share in per cent, and below it its interval. A run that failed
    has not settled.

    Attributes
    ----------
    by
        Time by which a run must have settled for good, s. 0: its end.
    certified
        Angle, deg, for which to print whether each law provably returns from it at the first point;
        takes some 15 s a law. 0: none.
    """

    name: ClassVar[str] = "settled"

    by: Annotated[float, Field(ge=0)] = 0.0
    certified: Annotated[float, Field(ge=0, lt=180)] = 0.0

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw a panel of curves, or a map for each law, with scales from 0 to 100 %."""
        axes, when = swept.one_or_two(), f"by {self.by:g} s" if self.by else "at the end"
        label = f"share settled {when} (%)"
        percent = 100 * shares(swept.settled(self.by).astype(float))
        share, low, high = np.moveaxis(percent, -1, 0)
        if self.certified:
            swept.remarks += function_for(purposes.figure_certified)(swept, self.certified)
        if len(axes) == 1:
            swept.remarks.append(f"Each point: {swept.count}; bands: 95 % Wilson intervals.")
            swept.note = f"95 % intervals, {swept.count}"
            page, panel = _draw_curves(swept, axes[0], share, np.array([low, high]), label, width)
            panel.set_ylim(-3, 103)
            return page
        cells, written = Cells(*axes), list[bool]()
        height = min(max(_LEAST_SETTLED, _ROW * cells.shape[0] + _AROUND), _MOST_SETTLED)
        look: dict[str, Any] = {"vmin": 0, "vmax": 100, "edgecolors": ink(0), "linewidth": 0.4}

        def draw(panel: Axes, index: int, room: tuple[float, float]) -> Any:
            of_law = share[:, index]
            image = cells.draw(panel, of_law, label=swept.titles[index], **look)
            alone, ends = map(_per_cent, of_law), map(_interval, low[:, index], high[:, index])
            both = [f"{text}\n{interval}" for text, interval in zip(alone, ends, strict=True)]
            written.append(cells.write(panel, of_law, image, room, both))
            if not written[-1]:
                cells.write(panel, of_law, image, room, [*map(_per_cent, of_law)])
            return image

        columns = map_columns(len(swept.titles), width)
        drawing = _draw_maps(swept, cells, columns, (width, height), label, draw)
        ends = _intervals(percent, written)
        swept.remarks.append(f"A cell per tested value, of {swept.count}; {ends}.")
        return drawing


def _intervals(percent: Array, written: list[bool]) -> str:
    """Return a note on the intervals: in the cells, or their widths if there is no room."""
    if all(written):
        return "below the share, its 95 % Wilson interval"
    share, low, high = np.moveaxis(percent, -1, 0)
    most = np.max(np.maximum(high - share, share - low))
    return f"95 % Wilson intervals of at most ±{most:.2g} percentage points"


def _interval(low: float, high: float) -> str:
    """Return an interval in per cent, rounded outwards unless it is narrow."""
    if high - low < 1:
        return f"{low:.4g}–{high:.4g}"
    return f"{math.floor(low + _ROUNDING)}–{math.ceil(high - _ROUNDING)}"


def _per_cent(number: float) -> str:
    """Return a share in per cent; 0 and 100 only for none and all."""
    if number < 0.5:
        return f"{number:.1g}"
    if number > 99.5:
        return f"{100 - float(f'{100 - number:.1g}'):.10g}"
    return f"{number:.0f}"


# Figure of a design trade-off: every point by two metrics, and the Pareto front -------------------


_PARETO_HEIGHTS: dict[Width, float] = {"column": 2.4, "page": 3.4, "slide": 2.6}
_PALE = 0.45


@dataclass(frozen=True)
class Pareto(OfSweep):
    """Every point of a sweep by two metrics, of which lower is better, and the Pareto front.

    Only of design choices: gains and options of laws. Points are means over the runs; a line joins
    the Pareto front of each law.

    Attributes
    ----------
    cost, error
        Names of the metrics across and up. Default: the effort (of the first part where parts
        differ in units) and the error that laws are compared by.
    log
        Logarithmic scales. Default: for metrics that span more than a decade.
    """

    name: ClassVar[str] = "pareto"

    cost: str = ""
    error: str = ""
    log: bool | None = None

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw the means over the runs of every point, and the front of every controller."""
        swept.require_choices()
        cost_name = self.cost or swept.results.in_parts("effort")[0]
        error_name = self.error or swept.error_metric
        cost, error = swept.means(cost_name), swept.means(error_name)
        drawing, panel = one_panel(width, _PARETO_HEIGHTS[width])
        lines = []
        for k, (of, title) in enumerate(zip(swept.looks, swept.titles, strict=True)):
            look = line_style(of) | {"marker": of.marker, "label": title}
            x, y = cost[:, k], error[:, k]
            pale = {"color": look["color"], "alpha": _PALE, "linewidths": 0}
            panel.scatter(x, y, s=16, marker=look["marker"], label=title, **pale)
            best = front(x, y)
            # Steps, since the first of two points of the front dominates all between them.
            lines += panel.plot(x[best], y[best], drawstyle="steps-post", markersize=4.5, **look)
        panel.margins(0.03)
        scale(panel, "x", cost, log=self.log)
        scale(panel, "y", error, log=self.log)
        panel.set_xlabel(metric_label(swept.results, cost_name, 36))
        panel.set_ylabel(metric_label(swept.results, error_name, 36))
        add_legend(drawing, lines, swept.titles)
        points = f"Each point: mean over {swept.count}."
        swept.remarks.append(f"{points} Pale: another is better in both.")
        return drawing
