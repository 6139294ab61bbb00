"""Figure of metrics over runs: a panel per metric, a box or a curve per controller."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.plots.base import OfMetrics
from eqt_cli.plots.drawing.box_plots import box_legend, draw_box
from eqt_cli.plots.drawing.labels import free_text, metric_label
from eqt_cli.plots.drawing.layout import add_legend, blank_sheet, rows_of
from eqt_cli.plots.drawing.scales import even, scale_log, spans_decade
from eqt_cli.plots.drawing.style import WIDTHS, Width, line_style
from eqt_cli.plots.shown.metrics import Sample, ShownMetrics

MOST_STEPS = 500
"""Most steps of a distribution function; beyond, each stands for several runs."""

_COLUMNS: dict[Width, int] = {"column": 2, "page": 3, "slide": 3}
_NAMES: dict[Width, int] = {"column": 14, "page": 26, "slide": 20}
"""Most characters in a line of a controller's name beside the boxes."""
_ROW, _LINE = 0.19, 0.12
"""Height of a row with a box, and of a further line of its name, in."""
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
        Logarithmic scales; by default, of the metrics that span more than a decade.
    """

    name: ClassVar[str] = "distributions"

    kind: Literal["box", "ecdf"] = "box"
    log: bool | None = None

    def compose(self, metrics: ShownMetrics, width: Width) -> Drawing:
        """Draw two panels per row in a column, three on a page."""
        places = rows_of(metrics.metrics, _COLUMNS[width])
        room = WIDTHS[width] / len(places[0])
        names = [free_text(e.title, _NAMES[width]) for e in metrics.shown]
        lines = max(name.count("\n") for name in names)
        tall = _AROUND + len(names) * (_ROW + _LINE * lines)
        height = tall if self.kind == "box" else _CURVES[width]
        drawing, panels = blank_sheet(width, places, height)
        for metric, axes in panels.items():
            axes.set_xlabel(metric_label(metrics.results[0], metric, int(18 * room)))
            samples = [metrics.samples[metric, e.label] for e in metrics.shown]
            if self.kind == "box":
                axes.set_yticks(range(len(names)), names)
                _fill_boxes(axes, metrics, samples)
            else:
                _fill_steps(axes, metrics, samples)
            self._scale(axes, metrics, samples, room)
            axes.tick_params(labelleft=metric in [row[0] for row in places])
        if self.kind == "box":
            add_legend(drawing, *box_legend([int(e.good.sum()) for e in metrics.shown]))
        else:
            for row in places:
                panels[row[0]].set_ylabel("fraction of runs")
            add_legend(drawing, panels[metrics.metrics[0]].lines, [e.title for e in metrics.shown])
        metrics.remarks.append(f"Each law: {metrics.count()} runs.")
        return drawing

    def _scale(
        self, axes: Axes, metrics: ShownMetrics, samples: Sequence[Sample], room: float
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


def _fill_boxes(axes: Axes, metrics: ShownMetrics, samples: Sequence[Sample]) -> None:
    """Draw a box per controller, the first on top."""
    for row, (ensemble, sample) in enumerate(zip(metrics.shown, samples, strict=True)):
        colour = line_style(ensemble.look)["color"]
        if sample.values.size:
            draw_box(axes, row, sample, metrics.end(ensemble), colour, ensemble.label)
    axes.set_ylim(len(samples) - 0.5, -0.5)
    axes.margins(x=0.06)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def _fill_steps(axes: Axes, metrics: ShownMetrics, samples: Sequence[Sample]) -> None:
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


def _count(axes: Axes, samples: Sequence[Sample], room: float, *, boxes: bool) -> None:
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
    axes.set_title(free_text(text, int(25 * room)), loc="right", fontsize="small")
