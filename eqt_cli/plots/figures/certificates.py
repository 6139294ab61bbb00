"""Figure of certificates: the measured number of each statement over its bound."""

import re
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from eqt_cli.analysis.certificates.base import Row, Verdict
from eqt_cli.core.option_types import CountOrNone
from eqt_cli.plots.base import OfCertificates
from eqt_cli.plots.drawing.labels import notation
from eqt_cli.plots.drawing.layout import add_legend
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink
from eqt_cli.plots.shown.certificates import ShownCertificates

_ROW_HEIGHT = 0.155
_GAP = 0.12
"""Half of the gap in the frame between 0 and the least number, decades."""
_MARKER: dict[str, Any] = {"linestyle": "", "markersize": 3.5}
_STROKE: dict[str, Any] = {
    "marker": [(-0.5, -1), (0.5, 1)],
    "markersize": 6,
    "markeredgewidth": 0.6,
}
_NO_LAW, _BEYOND = 0.65, 0.07
"""Shares of ink of markers in rows independent of the law, and of the ground beyond the bound."""

_DETAIL, _LONG = r", (eq|its|§).*", 16
"""Details of a place in the paper, and the length of a place, that no column has room for."""
_MOST = 1e300
"""Largest ratio that is drawn: an axis needs room beyond it."""


@dataclass(frozen=True)
class Certificates(OfCertificates):
    """Certificates: what was measured over what is allowed, a row per statement of the paper.

    Shown are the statements that come nearest to their bounds, or beyond them.

    Allowed are rounding for identities and a multiple of the solver's tolerance for trajectories.
    Values left of 1 hold (filled). Hollow: undecided. Lower half filled: the theorem does not cover
    the loop. Left half filled: nothing is claimed. Cross: fails. The scale is logarithmic; 0 is
    left of the axis break.

    Attributes
    ----------
    rows
        Most statements to show; 0 for all.
    """

    name: ClassVar[str] = "certificates"

    rows: CountOrNone = 16

    def compose(self, shown: ShownCertificates, width: Width) -> Drawing:
        """Draw identities above trajectories, in the paper's order downwards."""
        worst = {name: max(map(_ratio, shown.rows(name))) for name in shown.names}
        nearest = sorted(shown.names, key=lambda name: -worst[name])[: self.rows or None]
        shown.keep(nearest)
        drawing = Drawing(figsize=(WIDTHS[width], 0.5 + _ROW_HEIGHT * len(shown.names)))
        axes = drawing.add_subplot(label="certificates")
        looks = {e.label: {"color": e.look.colour, "marker": e.look.marker} for e in shown.laws}
        looks[""] = {"color": ink(_NO_LAW), "marker": "|"}
        ratios = list(map(_ratio, shown.shown))
        smallest = min([*(ratio for ratio in ratios if ratio > 0), 1.0])
        least = float(10.0 ** (np.floor(np.log10(smallest)) - 1))  # a decade below
        for height, name in enumerate(shown.names):
            rows = shown.rows(name)
            shifts = np.linspace(-0.27, 0.27, len(rows)) if len(rows) > 1 else [0.0]
            for row, shift in zip(rows, shifts, strict=True):
                at = max(_ratio(row), least)  # an exact 0 stands at the left end
                style = _MARKER | looks[row.controller] | _shape(row.verdict)
                label = f"{row.name} {row.controller}".strip()
                axes.plot([at], [height + shift], label=label, **style)
        _name_rows(axes, shown, width)
        _name_scale(axes, least, max(10.0, *ratios))
        handles = _legend(shown, looks)
        add_legend(drawing, list(handles.values()), list(handles))
        return drawing


def _legend(source: ShownCertificates, looks: dict[str, dict[str, Any]]) -> dict[str, Artist]:
    """Return legend handles of the laws and of the shapes of markers."""
    shown = {row.controller for row in source.shown}
    titles = {law.label: law.title for law in source.laws} | {"": "independent of the law"}
    handles: dict[str, Artist] = {
        titles[label]: Line2D([], [], **_MARKER, **look)
        for label, look in looks.items()
        if label in shown
    }
    any_law = {"color": ink(_NO_LAW), "marker": "o"}
    for verdict in source.verdicts:
        handles[str(verdict)] = Line2D([], [], **(_MARKER | any_law | _shape(verdict)))
    return handles


def _ratio(row: Row) -> float:
    """Return the ratio of measured to bound; 0 where both are 0."""
    assert row.measured is not None and row.bound is not None
    return min(abs(row.measured) / row.bound, _MOST) if row.measured else 0.0


def _shape(verdict: Verdict) -> dict[str, Any]:
    """Return the marker of a verdict, which keeps the law's shape unless it fails."""
    looks: dict[Verdict, dict[str, Any]] = {
        Verdict.HOLDS: {},
        Verdict.PROVED: {},
        Verdict.FAILS: {"marker": "x", "markersize": 5, "markeredgewidth": 1.4},
        Verdict.NOT_COVERED: {"fillstyle": "bottom", "markerfacecoloralt": ink(0)},
        Verdict.UNCLAIMED: {"fillstyle": "left", "markerfacecoloralt": ink(0)},
    }
    return looks.get(verdict, {"markerfacecolor": ink(0)})


def _name_rows(axes: Axes, shown: ShownCertificates, width: Width) -> None:
    """Name the rows by their statements, with their place in the paper, abbreviated in a column."""
    firsts = [shown.rows(name)[0] for name in shown.names]
    places = [row.statement for row in firsts]
    if width == "column":
        places = [re.sub(r"Theorem(s?)", r"Thm\1.", re.sub(_DETAIL, "", each)) for each in places]
    statements = [f"{each}:  " * (0 < len(each) < _LONG or width != "column") for each in places]
    texts = [notation(where + row.name) for where, row in zip(statements, firsts, strict=True)]
    axes.set_yticks(range(len(texts)), texts)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(texts) - 0.4, -0.6)
    for height, (row, following) in enumerate(pairwise(firsts)):
        if row.kind != following.kind:
            axes.axhline(height + 0.5, label=f"below {row.kind}", color=ink(), linewidth=0.5)


def _name_scale(axes: Axes, least: float, most: float) -> None:
    axes.set_xscale("log")
    axes.set_xlim(least / 2, 3 * most)
    shade: dict[str, Any] = {"color": ink(), "alpha": _BEYOND, "linewidth": 0, "zorder": 0}
    axes.axvspan(1, 3 * most, label="beyond the bound", **shade)
    axes.axvline(1, label="the bound", color=ink(), linewidth=0.8)
    axes.grid(visible=False, axis="y")
    axes.xaxis.set_major_locator(LogLocator(numticks=4))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("measured / bound")
    axes.tick_params(axis="x", top=False)
    ticks = [tick for tick in axes.get_xticks() if 10 * least <= tick <= 3 * most]
    numbers = [f"$10^{{{round(np.log10(tick))}}}$" for tick in ticks]
    axes.set_xticks([least, *ticks], ["0", *numbers])
    _break(axes, least * 10**0.5)
    place: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
    above: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": "small"}
    axes.annotate("bound", (1, 1), (0, 1), **place, **above)


def _break(axes: Axes, place: float) -> None:
    """Show that the scale does not reach 0, by a gap in the frame between two strokes."""
    clear: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "clip_on": False}
    for edge in (0, 1):
        gap = [place / 10**_GAP, place * 10**_GAP]
        clear["label"] = f"gap {edge}"
        axes.plot(gap, [edge, edge], color=ink(0), linewidth=1.6, zorder=4, **clear)
        clear["label"] = f"ends of gap {edge}"
        axes.plot(gap, [edge, edge], linestyle="", zorder=5, **_STROKE, color=ink(), **clear)
    axes.axvline(place, label="gap", color=ink(0), linewidth=4, zorder=1)
