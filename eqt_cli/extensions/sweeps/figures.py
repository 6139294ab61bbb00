"""Figure `pooled`: the ratio of two laws at each point of a sweep, and over all of them."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure as Drawing

from eqt_cli.analysis.intervals import Resampling, Word
from eqt_cli.base.reporting import count_of
from eqt_cli.extensions.sweeps.pooled import interval, is_drawn, logs_of, word_of
from eqt_cli.figures.figure import OfDifferences
from eqt_cli.figures.labels import free_text, notation
from eqt_cli.figures.shown import ShownSweep
from eqt_cli.figures.style import WIDTHS, Width, ink
from eqt_cli.results.quantity import Plain

MOST_ROWS = 60
"""Largest number of points, each of which has a row."""

TICKS = (0.1, 0.2, 0.5, 0.7, 0.8, 0.9, 0.95, 1, 1.05, 1.1, 1.25, 1.5, 2, 5, 10)
"""Ratios that a scale may show."""

_ROW, _AROUND = 0.2, 0.9
_LONGEST = 24


@dataclass(frozen=True)
class PooledForest(OfDifferences):
    """A row for each point of a sweep, and one for all: the ratio of two laws.

    The geometric mean of the paired ratios of the second law to the first one, with its interval;
    hollow where its interval holds 1. The line and the band are those of all points together, as
    `eqt compare --pooled` prints them.
    """

    name: ClassVar[str] = "pooled"

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw the points, the first one on top, and the pooled ratio below them."""
        if len(swept.controllers) != 2:
            raise swept.error(
                f"compares two laws, and here is {count_of(len(swept.controllers), 'law')}; "
                "choose two by the option controllers"
            )
        metric, (first, law) = self.metric_of(swept), swept.controllers
        swept.metric(metric)
        result, how = swept.results, Resampling(self.confidence)
        logs, quantity = logs_of(result, metric, law, first), result.quantity(metric)
        if (points := len(logs)) > MOST_ROWS:
            raise swept.error(
                f"has a row for each point, at most {MOST_ROWS}, and here are {points}"
            )
        whole = interval(logs, how, drawn=is_drawn(result))
        rows = [*(interval(logs[k : k + 1], how, drawn=False) for k in range(points)), whole]
        ratios = np.exp(np.array(rows))
        places = np.array([*range(points), points + 0.5])
        drawing = Drawing(figsize=(WIDTHS[width], _AROUND + _ROW * (points + 1)))
        panel = drawing.subplots()
        panel.axvline(1, color=ink(0.5), linewidth=0.6, label="no difference")
        if np.isfinite(ratios[-1]).all():
            panel.axvspan(
                *ratios[-1, 1:], color=ink(0.12), linewidth=0, label="all points, interval"
            )
        panel.axvline(ratios[-1, 0], color=ink(0.8), linewidth=0.9, label="all points")
        for k, (ratio, place) in enumerate(zip(ratios, places, strict=True)):
            decided = word_of(type(whole)(*ratio), quantity) is not Word.UNDECIDED
            panel.plot(
                ratio[0],
                place,
                marker="D" if k == points else "o",
                markersize=4.5 if k == points else 3.5,
                linestyle="",
                color=ink(0.8),
                markerfacecolor=ink(0.8) if decided else ink(0),
                label=f"row {k}",
            )
            if np.isfinite(ratio).all():
                panel.plot(ratio[1:], [place] * 2, color=ink(0.8), linewidth=0.9, label=f"bar {k}")
        panel.set_xscale("log")
        names = [free_text(result.point_name(k), _LONGEST) for k in range(points)]
        panel.set_yticks(places, [*names, "all points"])
        panel.set_ylim(points + 1.1, -0.6)
        panel.grid(axis="y", visible=False)
        panel.tick_params(axis="y", length=0)
        low, high = min(0.999, np.nanmin(ratios)), max(1.001, np.nanmax(ratios))
        shown = [x for x in TICKS if low <= x <= high] or [1]
        panel.set_xlim(low * (low / high) ** 0.05, high * (high / low) ** 0.05)
        panel.set_xticks(shown, [f"{x:g}" for x in shown])
        panel.minorticks_off()
        one, other = swept.titles
        panel.set_xlabel(free_text(f"{notation(Plain().name(quantity))}, {other} / {one}", 60))
        side = {"lower": "Left", "higher": "Right"}.get(quantity.better)
        better = f" {side} of 1: {other} is better." if side else ""
        over = "runs and points" if is_drawn(result) else "runs, each with all its points"
        swept.remarks.append(
            f"Geometric mean of paired ratios.{better} Intervals of {100 * self.confidence:g} %; "
            f"the last one is over {over}; hollow: the interval holds 1."
        )
        swept.note = f"bars: {100 * self.confidence:g} % intervals; hollow: the interval holds 1"
        return drawing
