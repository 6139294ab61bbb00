"""Figures of two or more laws over a sweep: the pooled ratio, and who wins where."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Patch

from eqt_cli.analysis.intervals import Resampling, Word
from eqt_cli.analysis.maps import NOBODY, Map, compare_map
from eqt_cli.base.reporting import count_of
from eqt_cli.extensions.sweeps.pooled import interval, is_drawn, logs_of, word_of
from eqt_cli.figures.cells import Cells
from eqt_cli.figures.figure import OfDifferences
from eqt_cli.figures.labels import free_text, notation
from eqt_cli.figures.layout import RESAMPLING, add_legend, add_title, one_panel
from eqt_cli.figures.shown import ShownSweep
from eqt_cli.figures.style import WIDTHS, Width, ink, mixed
from eqt_cli.results.quantity import Plain
from eqt_cli.results.summary import check_metrics

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


# Figure of a comparison over a sweep: which law wins where, and by how much -----------------------


_CELL = 0.32
"""Least height of a row of cells, for the number in it, in."""
_NUMBER, _LETTER = 0.30, 0.06
"""Width of a number, and of a letter beside it, in."""
_SCALE = 1.0
"""Width of the vertical scale, in."""
_LEAST, _MOST = 1.2, 3.6
"""Least and largest height of the map, in."""
_TINT = 0.55
"""Share of a law's colour in its cells, which keeps the numbers readable."""
WITH_FAILED = "////"


@dataclass(frozen=True)
class Winners(OfDifferences):
    """Which law wins at each point of a sweep over one or two keys, and by how many per cent.

    A law wins where it is better than every other one in most runs and in the mean, with all tests
    of the map counted (`eqt compare` on the sweep). White: undecided. Hatched: some runs failed.
    """

    name: ClassVar[str] = "winners"

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw one map; laws have the colours of all other figures."""
        axes = swept.one_or_two()
        check_metrics(swept.results, [self.metric_of(swept)], who=f"figure '{self.name}'")
        resampling = replace(RESAMPLING, confidence=self.confidence)
        wins = compare_map(swept.results, self.metric_of(swept), resampling, swept.controllers)
        points = len(wins.cells)
        if wins.has_too_few_runs:
            raise swept.error(
                f"shows who wins, and with {wins.runs} runs nobody can; it takes at least "
                f"{wins.fewest}: --set ensemble.runs={wins.fewest}"
            )
        if wins.wins(NOBODY) == points:
            words = ", ".join(f"{word} {count}" for word, count in wins.without_winners().items())
            raise swept.error(
                f"shows who wins, and no law wins at any of {points} points ({words}); draw "
                "'forest' for the differences, or compute more runs"
            )
        cells = Cells(*axes)
        rows, columns = cells.shape
        height = min(max(_LEAST, _CELL * rows + 0.6), _MOST)
        drawing, panel = one_panel(width, height)
        laws = [look.colour for look in swept.looks]
        # Cells have no dashes: a colour that the style gives to several laws is paler for each.
        paler = [mixed(c, ink(0), 0.5 ** laws[:k].count(c)) for k, c in enumerate(laws)]
        colours = [ink(0), *paler]
        winners = np.array([cell.winner - NOBODY for cell in wins.cells], dtype=float)
        look = {"vmin": -0.5, "vmax": len(colours) - 0.5, "alpha": _TINT, "label": "winner"}
        look |= {"edgecolors": ink(0.25), "linewidth": 0.4}
        panel.grid(False)
        panel.tick_params(length=0)
        cells.draw(panel, winners, cmap=ListedColormap(colours), **look)
        failed = [cell.point for cell in wins.cells if any(cell.failed)]
        cells.hatch(panel, failed, WITH_FAILED)
        room = (WIDTHS[width] - _SCALE) / columns
        if room >= _NUMBER and height / rows >= _CELL * 0.6:
            _number_leads(panel, cells, wins, int(room / _LETTER))
        below = cells.scales(panel, swept.results, WIDTHS[width] - _SCALE)
        drawing.set_figheight(drawing.get_figheight() + below)
        quantity = swept.results.quantity(self.metric_of(swept))
        add_title(panel, f"better {quantity.plain}, by %")
        _explain_winners(drawing, colours, wins, bool(failed))
        swept.remarks += [
            "Law and number: the better mean, and the median difference from the next law in per "
            "cent; white: undecided or no difference.",
            f"{points} points, {wins.runs} runs each; failures of less than {3 / wins.runs:.2g} of "
            "all runs are not excluded.",
        ]
        return drawing


def _number_leads(panel: Axes, cells: Cells, wins: Map, characters: int) -> None:
    """Write each lead, and the laws if all names fit in a line of `characters`."""
    won = [x for x in wins.cells if np.isfinite(x.lead.value) and x.winner != NOBODY]
    leads = [f"{100 * abs(cell.lead.value):.2g}" for cell in won]
    named = [f"{wins.titles[x.best]} {lead}" for x, lead in zip(won, leads, strict=True)]
    if max(map(len, named), default=0) > characters:
        named = leads
    for cell, text in zip(won, named, strict=True):
        place = cells.columns[cell.point], cells.rows[cell.point]
        panel.annotate(text, place, ha="center", va="center", fontsize="small")


def _explain_winners(drawing: Drawing, colours: Sequence[str], wins: Map, failed: bool) -> None:
    """Add a legend of the laws with the number of their wins."""
    frame: dict[str, Any] = {"edgecolor": ink(0.4), "linewidth": 0.5}
    none = ", ".join(f"{word}: {points}" for word, points in wins.without_winners().items())
    patches = {none: Patch(facecolor=colours[0], **frame)}
    for law, title in enumerate(wins.titles):
        patch = Patch(facecolor=(colours[law + 1], _TINT), **frame)
        patches[f"{title}: {wins.wins(law)}"] = patch
    if failed:
        hatched = Patch(fill=False, hatch=WITH_FAILED, edgecolor=ink(0.35), linewidth=0)
        patches["with failed runs"] = hatched
    add_legend(drawing, list(patches.values()), list(patches))
