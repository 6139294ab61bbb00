"""Figure of a sweep: one metric over one key as curves, over two as a map per law."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Patch

from eqt_cli.analysis.comparison.intervals import shares
from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import OfOneMetric
from eqt_cli.plots.drawing.cells import Cells, map_columns, scale, scale_along, short, spans_decade
from eqt_cli.plots.drawing.curve_labels import name_curves
from eqt_cli.plots.drawing.curves import BAND, draw_points
from eqt_cli.plots.drawing.labels import free_text, metric_label
from eqt_cli.plots.drawing.layout import add_legend, add_title, sheet_of_maps
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink
from eqt_cli.plots.shown.sweep import ShownSweep
from eqt_cli.results.swept_key import SweptKey

_LABEL = {"boxstyle": "round,pad=0.15", "edgecolor": "none", "alpha": 0.85}
_HEIGHTS: dict[Width, float] = {"column": 2.2, "page": 3.0, "slide": 2.4}

_LOWER: dict[Width, float] = {"column": 1.6, "page": 2.2, "slide": 1.6}
"""Heights of maps in several rows, in."""
_EQUAL = 1e-9

_COLOURS, _AROUND = 1.0, 0.9
"""Width of the colour scale and a map's scale, and height of title and scale, in."""

FAILED, BEYOND = "xxxx", "////"
"""Hatches of cells with failed runs, and with runs beyond the horizon."""


@dataclass(frozen=True)
class SweepFigure(OfOneMetric):
    """A metric over the swept keys: curves with bands for one key, heat maps for two.

    Means over the runs of every point; bands reach from the 10 % to the 90 % quantile.

    Frames mark the best cell of each map, and those that are equal to it. Cells with failed runs,
    which have no mean, are hatched in two directions; hatched in one are cells with censored runs,
    whose number lies beyond the horizon. The means are written in the cells where they fit.

    Where the sweep is over the options of a law, points at which it is a law with a name of its own
    carry that name.

    Attributes
    ----------
    log
        A logarithmic scale of the metric; by default, where it spans more than a decade.
    """

    name: ClassVar[str] = "sweep"

    log: bool | None = None

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw means over the runs: one panel of curves, or a map per law."""
        values, means = swept.metric(self.metric_of(swept)), swept.means(self.metric_of(swept))
        axes = swept.one_or_two("; figure 'pareto' shows sweeps of any number")
        label = metric_label(swept.results, self.metric_of(swept), 36)
        counts = swept.results.quantity(self.metric_of(swept)).counts
        remark = f"Mean at each point over {swept.count}"
        if len(axes) == 1:
            bands = "95 % Wilson intervals" if counts else "10–90 % of runs"
            swept.remarks.append(f"{remark}; bands: {bands}.")
            return self._curves(swept, axes[0], values, label, width)
        if counts:
            _, low, high = np.moveaxis(shares(values), -1, 0)
            most = np.nanmax(np.maximum(high - means, means - low))
            label += f"\n(intervals to ±{most:.2f})"
        swept.remarks.append(f"{remark}.")
        return self._maps(swept, axes, means, label, width)

    def _curves(
        self, swept: ShownSweep, axis: SweptKey, values: Array, label: str, width: Width
    ) -> Drawing:
        drawing = Drawing(figsize=(WIDTHS[width], _HEIGHTS[width]))
        panel = drawing.add_subplot()
        order = np.argsort(axis.values, kind="stable")
        lines = []
        for k, (look, title) in enumerate(zip(swept.looks, swept.titles, strict=True)):
            chosen = values[order, k]
            if swept.results.quantity(self.metric_of(swept)).counts:
                _, low, high = np.moveaxis(shares(chosen), -1, 0)
            else:
                low, high = np.quantile(chosen, BAND, axis=-1)
            mean, band = np.mean(chosen, axis=-1), (low, high)
            lines += draw_points(panel, axis.values[order], mean, band, look, title)
            for point, law in swept.laws(k).items():
                _name(panel, axis.values[point], mean[order.tolist().index(point)], law)
        scale_along(panel, swept.results, axis, WIDTHS[width])
        panel.set_ylabel(label)
        drawn = np.concatenate([np.ravel(line.get_ydata()) for line in lines])
        scale(panel, "y", drawn.astype(float), log=self.log)
        if any(swept.laws(k) for k in range(len(swept.titles))):
            add_legend(drawing, lines, swept.titles)  # names of points take the room
        else:
            name_curves(drawing, [panel], lines, swept.titles)
        return drawing

    def _maps(
        self, swept: ShownSweep, axes: list[SweptKey], means: Array, label: str, width: Width
    ) -> Drawing:
        count, cells = len(swept.titles), Cells(*axes)
        # Two maps fit side by side even in a column, since few cells hold numbers.
        columns = count if count == 2 else map_columns(count, width)
        height = _HEIGHTS[width] if count <= columns else _LOWER[width]
        drawing, panels = sheet_of_maps(count, columns, width, height)
        norm = self._colours(means)
        room = (WIDTHS[width] - _COLOURS) / columns, height - _AROUND
        # Runs that failed, and runs beyond the horizon: (points, laws, runs).
        failed = swept.results.status[:, swept.controllers] != 0
        beyond = swept.results.censored(self.metric_of(swept))[:, swept.controllers]
        for index, (panel, title) in enumerate(zip(panels, swept.titles, strict=True)):
            image = cells.draw(panel, means[:, index], norm=norm)
            cells.hatch(panel, np.flatnonzero(failed[:, index].any(axis=-1)), FAILED)
            cells.hatch(panel, np.flatnonzero(beyond[:, index].any(axis=-1)), BEYOND)
            named = swept.laws(index)
            others = np.array([point not in named for point in range(len(means))])
            shown = np.where(others, means[:, index], np.nan)
            written = cells.write(panel, shown, image, room)
            better = swept.results.quantity(self.metric_of(swept)).better
            cells.mark(panel, _best(means[:, index], better, written=written))
            for point, law in named.items():
                _name(panel, cells.columns[point], cells.rows[point], law)
            add_title(panel, title, WIDTHS[width] / columns)
            edges = {"leftmost": index % columns == 0, "lowest": index + columns >= count}
            below = cells.scales(panel, swept.results, room[0], **edges)
        drawing.set_figheight(drawing.get_figheight() + below)
        drawing.colorbar(image, ax=panels, label=label)
        _explain(drawing, bool(failed.any()), bool(beyond.any()))
        return drawing

    def _colours(self, means: Array) -> Normalize:
        seen = means[np.isfinite(means)]
        ends: dict[str, Any] = {"vmin": float(seen.min()), "vmax": float(seen.max())}
        log = spans_decade(seen) if self.log is None else self.log
        return LogNorm(**ends) if log and (seen > 0).all() else Normalize(**ends)


def _best(means: Array, better: str, *, written: bool) -> list[int]:
    """Return the points with the best mean: all written alike, or equal if means are not written.

    The list is empty where no mean is better.
    """
    if better == "neither" or not np.isfinite(means).any():
        return []
    best = np.nanmax(means) if better == "higher" else np.nanmin(means)
    if not written:
        return np.flatnonzero(np.isclose(means, best, rtol=_EQUAL, atol=0)).tolist()
    return [k for k, mean in enumerate(means) if np.isfinite(mean) and short(mean) == short(best)]


def _explain(drawing: Drawing, failed: bool, beyond: bool) -> None:
    """Add a legend of frames and hatches."""
    looks: dict[str, dict[str, Any]] = {"best mean": {"linewidth": 1.0}}
    if failed:
        looks["failed runs, no mean"] = {"hatch": FAILED, "linewidth": 0}
    if beyond:
        looks["censored runs, counted with the horizon"] = {"hatch": BEYOND, "linewidth": 0}
    patches = [Patch(fill=False, edgecolor=ink(0.6), **look) for look in looks.values()]
    add_legend(drawing, patches, list(looks))


def _name(panel: Axes, x: float, y: float, law: str) -> None:
    """Write a law's name at its point."""
    box = _LABEL | {"facecolor": ink(0)}
    panel.annotate(free_text(law, 12), (x, y), ha="center", va="center", fontsize="small", bbox=box)
