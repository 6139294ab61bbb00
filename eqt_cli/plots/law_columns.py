"""A grid of panels over time: what is shown downwards, and a column for each law."""

from collections.abc import Callable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.plots.drawing.layout import (
    EMPTY,
    add_title,
    hide_inner_scales,
    share_scale,
    sheet,
)
from eqt_cli.plots.drawing.style import WIDTHS, Width
from eqt_cli.plots.shown.controllers import Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns

MOST: dict[Width, int] = {"column": 4, "page": 8, "slide": 6}
"""Laws side by side."""

_BESIDE = 0.7
"""in, of the labels beside the first column, and between columns."""
_TALLEST = 5.0
"""in, of all rows."""

Row = dict[str, Axes]
"""The panels of a row by the labels of the laws."""


def law_columns(
    runs: ShownRuns,
    width: Width,
    rows: Sequence[str],
    shows: Callable[[str, Ensemble], bool] = lambda row, law: True,
) -> tuple[Drawing, dict[str, Row]]:
    """The panels of each row, which have one scale; its first panel carries it.

    Parameters
    ----------
    rows
        Their names.
    shows
        Whether a row shows a law.

    Raises
    ------
    EqtError
        If there are more laws than have room.
    """
    laws = runs.shown
    if len(laws) > MOST[width]:
        raise runs.error(
            f"has a column of panels per controller, and width '{width}' has room for "
            f"{MOST[width]}, not {len(laws)}; choose some with the option 'controllers'"
        )
    mosaic = [[f"{row} {e.label}" if shows(row, e) else EMPTY for e in laws] for row in rows]
    drawing, panels = sheet(width, mosaic, runs.span, runs.unit("time"), _TALLEST)
    found: dict[str, Row] = {row: {} for row in rows}
    for row, names in zip(rows, mosaic, strict=True):
        for law, name in zip(laws, names, strict=True):
            if name != EMPTY:
                found[row][law.label] = panels[name]
        share_scale(found[row].values())
    for k, law in enumerate(laws):
        top = next((names[k] for names in mosaic if names[k] != EMPTY), EMPTY)
        if top != EMPTY:
            add_title(panels[top], law.title, (WIDTHS[width] - _BESIDE) / len(laws))
    hide_inner_scales(panels, mosaic)
    return drawing, found
