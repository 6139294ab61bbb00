"""Sheets of panels over time, legends and remarks; it knows no signal and no controller."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from eqt_cli.core.arrays import Array
from eqt_cli.plots.labels import quantity, set_name
from eqt_cli.plots.style import WIDTHS, Width

EMPTY = "."
"""An empty place in a mosaic."""

_PANEL_HEIGHTS: dict[Width, float] = {"column": 1.15, "page": 1.55}
_REMARK_HEIGHT = 0.14
"""in, of a line of small text."""

Mosaic = list[list[str]]


def sheet(width: Width, mosaic: Mosaic, times: Array, unit: str) -> tuple[Figure, dict[str, Axes]]:
    """A figure of panels with a common time axis, and its panels by name.

    Parameters
    ----------
    mosaic
        The names of the panels, row by row; a name that is repeated spans its places, and `EMPTY`
        is no panel. The lowest panels carry the labels of the time axis.
    times, unit
        The range of the time axis and its unit.
    """
    drawing = Figure(figsize=(WIDTHS[width], _PANEL_HEIGHTS[width] * len(mosaic)))
    panels: dict[str, Axes] = drawing.subplot_mosaic(mosaic, empty_sentinel=EMPTY)
    columns = [[name for name in column if name != EMPTY] for column in zip(*mosaic, strict=True)]
    lowest = {column[-1] for column in columns}
    for name, axes in panels.items():
        axes.set_xlim(times[0], times[-1])
        axes.xaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
        axes.tick_params(labelbottom=name in lowest)
        if name in lowest:
            axes.set_xlabel(quantity("t", unit))
    return drawing, panels


def share_scale(panels: Iterable[Axes]) -> None:
    """Give panels one vertical scale; call it before anything is drawn."""
    first, *others = panels
    for axes in others:
        axes.sharey(first)


def hide_scale(axes: Axes) -> None:
    """Leave out the numbers of a vertical scale that the panel to the left shows."""
    axes.tick_params(labelleft=False)


def add_legend(figure: Figure, handles: Sequence[Line2D], names: Sequence[str]) -> None:
    """Name the curves above the panels, in as few rows as fit the width; the figure grows by them.

    Names are a user's text.
    """
    width, height = figure.get_size_inches()
    renderer = RendererAgg(width, height, figure.dpi)
    for columns in range(len(names), 0, -1):
        legend = figure.legend(handles, [""] * len(names), loc="outside upper center", ncols=columns)
        for text, name in zip(legend.get_texts(), names, strict=True):
            set_name(text, name)
        extent = legend.get_window_extent(renderer)
        if extent.width <= figure.bbox.width or columns == 1:
            break
        legend.remove()
    figure.set_figheight(height + extent.height / figure.dpi)


def add_remarks(figure: Figure, remarks: Sequence[str]) -> None:
    """Print remarks below the panels, a line each; the figure grows by them."""
    if remarks:
        figure.set_figheight(figure.get_figheight() + _REMARK_HEIGHT * len(remarks))
        text = figure.supxlabel("", x=0.01, ha="left", fontsize="small")
        set_name(text, "\n".join(remarks))


def freeze(figure: Figure) -> None:
    """Arrange the panels once and for all, so that every format shows the same picture."""
    figure.align_ylabels()
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
