"""The figure of a sweep: one metric over one key as curves, over two as a map per controller."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Patch

from eqt_cli.analysis.comparison.shares import shares
from eqt_cli.core.arrays import Array
from eqt_cli.plots.base import OfSweep
from eqt_cli.plots.drawing.cells import Cells
from eqt_cli.plots.drawing.curve_labels import name_curves
from eqt_cli.plots.drawing.curves import BAND, draw_points
from eqt_cli.plots.drawing.key_labels import scale_along
from eqt_cli.plots.drawing.labels import free_text, metric_label
from eqt_cli.plots.drawing.layout import add_legend, add_title
from eqt_cli.plots.drawing.scales import scale, spans_decade
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink
from eqt_cli.plots.shown.sweep import ShownSweep
from eqt_cli.results.swept_key import SweptKey

_LABEL = {"boxstyle": "round,pad=0.15", "edgecolor": "none", "alpha": 0.85}
_HEIGHTS: dict[Width, float] = {"column": 2.2, "page": 3.0}

_COLOURS, _AROUND = 1.0, 0.9
"""in, that the scale of colours and of a map take across, and title and scale up."""

FAILED, BEYOND = "xxxx", "////"
"""Hatches of cells in which not all runs are what they should be."""


@dataclass(frozen=True)
class SweepFigure(OfSweep):
    """A metric over the swept keys: curves with bands for one key, heat maps for two.

    Means over the runs of every point; bands reach from the 10 % to the 90 % quantile.

    A frame marks the best cell of each map. Cells with failed runs, which have no mean, are
    hatched in two directions; hatched in one are cells with censored runs, whose number lies beyond
    the horizon. The means are written in the cells where they fit.

    Where the sweep is over the options of a law, points at which it is a law with a name of its own
    carry that name.

    Attributes
    ----------
    metric
        What to show, by its name in the result.
    log
        A logarithmic scale of the metric; by default, where it spans more than a decade.
    """

    name: ClassVar[str] = "sweep"

    metric: str = "mean_pose_error"
    log: bool | None = None

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """One panel of curves, or a map per controller, of means over the runs."""
        values, means = swept.metric(self.metric), swept.means(self.metric)
        axes = swept.one_or_two("; figure 'pareto' shows sweeps of any number")
        label = metric_label(swept.results, self.metric, 36)
        counts = swept.results.quantity(self.metric).counts
        remark = f"Mean over runs at each point, {swept.count}"
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
        for k, (position, title) in enumerate(zip(swept.controllers, swept.titles, strict=True)):
            found = values[order, k]
            mean, band = np.mean(found, axis=-1), self._band(swept, found)
            lines += draw_points(panel, axis.values[order], mean, band, position, title)
            for point, law in swept.laws(k).items():
                _name(panel, axis.values[point], mean[order.tolist().index(point)], law)
        scale_along(panel, swept.results, axis, WIDTHS[width])
        panel.set_ylabel(label)
        drawn = np.concatenate([np.ravel(line.get_ydata()) for line in lines])
        scale(panel, "y", drawn.astype(float), log=self.log)
        if any(swept.laws(k) for k in range(len(swept.titles))):
            add_legend(drawing, lines, swept.titles)  # since names of points take the room
        else:
            name_curves(drawing, [panel], lines, swept.titles)
        return drawing

    def _band(self, swept: ShownSweep, values: Array) -> tuple[Array, Array]:
        """Where most runs are; of what counts runs, how well their share is known."""
        if swept.results.quantity(self.metric).counts:
            _, low, high = np.moveaxis(shares(values), -1, 0)
        else:
            low, high = np.quantile(values, BAND, axis=-1)
        return low, high

    def _maps(
        self, swept: ShownSweep, axes: list[SweptKey], means: Array, label: str, width: Width
    ) -> Drawing:
        count = len(swept.titles)
        drawing = Drawing(figsize=(WIDTHS[width], _HEIGHTS[width]))
        panels = drawing.subplots(1, count, sharex=True, sharey=True, squeeze=False)[0]
        norm = self._colours(means)
        cells = Cells(*axes)
        failed, beyond = swept.failed_runs, swept.beyond(self.metric)
        for index, (panel, title) in enumerate(zip(panels, swept.titles, strict=True)):
            image = cells.draw(panel, means[:, index], norm=norm)
            cells.hatch(panel, np.flatnonzero(failed[:, index]), FAILED)
            cells.hatch(panel, np.flatnonzero(beyond[:, index]), BEYOND)
            best = _best(means[:, index], swept.results.quantity(self.metric).better)
            if best is not None:
                cells.mark(panel, best)
            named = swept.laws(index)
            room = (WIDTHS[width] - _COLOURS) / count, _HEIGHTS[width] - _AROUND
            others = np.array([point not in named for point in range(len(means))])
            cells.write(panel, np.where(others, means[:, index], np.nan), image, room)
            for point, law in named.items():
                _name(panel, cells.columns[point], cells.rows[point], law)
            add_title(panel, title, WIDTHS[width] / count)
            cells.scales(panel, swept.results, leftmost=index == 0)
        drawing.colorbar(image, ax=list(panels), label=label)
        _explain(drawing, bool(failed.any()), bool(beyond.any()))
        return drawing

    def _colours(self, means: Array) -> Normalize:
        seen = means[np.isfinite(means)]
        ends: dict[str, Any] = {"vmin": float(seen.min()), "vmax": float(seen.max())}
        log = spans_decade(seen) if self.log is None else self.log
        return LogNorm(**ends) if log and (seen > 0).all() else Normalize(**ends)


def _best(means: Array, better: str) -> int | None:
    """The point with the best mean; None where there is none, or none is better."""
    if better == "neither" or not np.isfinite(means).any():
        return None
    return int(np.nanargmax(means) if better == "higher" else np.nanargmin(means))


def _explain(drawing: Drawing, failed: bool, beyond: bool) -> None:
    """Say what frames and hatches mean."""
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
