"""Figure of a comparison over a sweep: which law wins where, and by how much."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Patch

from eqt_cli.analysis.comparison.maps import NOBODY, Map, compare_map
from eqt_cli.plots.base import OfDifferences
from eqt_cli.plots.drawing.cells import Cells
from eqt_cli.plots.drawing.curves import RESAMPLING
from eqt_cli.plots.drawing.labels import metric_label
from eqt_cli.plots.drawing.layout import add_legend, add_title
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink, mixed
from eqt_cli.plots.shown.sweep import ShownSweep

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
FAILED = "////"


@dataclass(frozen=True)
class Winners(OfDifferences):
    """Which law wins at each point of a sweep over one or two keys, and by how many per cent.

    A law wins where it is better than every other one, run by run, with all tests of the map
    counted (`eqt compare` on the sweep). White: undecided. Hatched: some runs failed.
    """

    name: ClassVar[str] = "winners"

    def compose(self, swept: ShownSweep, width: Width) -> Drawing:
        """Draw one map; laws have the colours of all other figures."""
        axes = swept.one_or_two()
        swept.results.check_metrics([self.metric_of(swept)], who=f"figure '{self.name}'")
        resampling = replace(RESAMPLING, confidence=self.confidence)
        wins = compare_map(swept.results, self.metric_of(swept), resampling, swept.controllers)
        cells = Cells(*axes)
        rows, columns = cells.shape
        height = min(max(_LEAST, _CELL * rows + 0.6), _MOST)
        drawing = Drawing(figsize=(WIDTHS[width], height))
        panel = drawing.add_subplot()
        own = [look.colour for look in swept.looks]
        # Cells have no dashes: a colour that the style gives to several laws is paler for each.
        colours = [ink(0), *(mixed(c, ink(0), 0.5 ** own[:k].count(c)) for k, c in enumerate(own))]
        winners = np.array([cell.winner - NOBODY for cell in wins.cells], dtype=float)
        look = {"vmin": -0.5, "vmax": len(colours) - 0.5, "alpha": _TINT, "label": "winner"}
        look |= {"edgecolors": ink(0.25), "linewidth": 0.4}
        panel.grid(False)
        panel.tick_params(length=0)
        cells.draw(panel, winners, cmap=ListedColormap(colours), **look)
        failed = [cell.point for cell in wins.cells if any(cell.failed)]
        cells.hatch(panel, failed, FAILED)
        room = (WIDTHS[width] - _SCALE) / columns
        if room >= _NUMBER and height / rows >= _CELL * 0.6:
            _number_leads(panel, cells, wins, int(room / _LETTER))
        below = cells.scales(panel, swept.results, WIDTHS[width] - _SCALE)
        drawing.set_figheight(height + below)
        add_title(
            panel, f"better {metric_label(swept.results, self.metric_of(swept), 60)}", WIDTHS[width]
        )
        _explain(drawing, colours, wins, bool(failed))
        share = f"{100 * (1 - self.confidence):g} %"
        swept.remarks += [
            "Numbers: lead over the next law in per cent of its mean.",
            f"{wins.tests} points tested, {wins.runs} runs each; expected share of false wins "
            f"≤ {share}.",
        ]
        return drawing


def _number_leads(panel: Axes, cells: Cells, wins: Map, characters: int) -> None:
    """Write each lead, and the law if its name fits in a line of `characters`."""
    for cell in wins.cells:
        if cell.winner != NOBODY and np.isfinite(cell.lead.value):
            place = cells.columns[cell.point], cells.rows[cell.point]
            lead, title = f"{100 * abs(cell.lead.value):.2g}", wins.titles[cell.winner]
            text = f"{title} {lead}" if len(title) + len(lead) < characters else lead
            panel.annotate(text, place, ha="center", va="center", fontsize="small")


def _explain(drawing: Drawing, colours: Sequence[str], wins: Map, failed: bool) -> None:
    """Add a legend of the laws that win somewhere."""
    frame: dict[str, Any] = {"edgecolor": ink(0.4), "linewidth": 0.5}
    patches = {f"undecided: {wins.wins(NOBODY)}": Patch(facecolor=colours[0], **frame)}
    for law, title in enumerate(wins.titles):
        name = f"{title}: {wins.wins(law)}"
        patches[name] = Patch(facecolor=(colours[law + 1], _TINT), **frame)
    if failed:
        hatched = Patch(fill=False, hatch=FAILED, edgecolor=ink(0.35), linewidth=0)
        patches["with failed runs"] = hatched
    add_legend(drawing, list(patches.values()), list(patches))
