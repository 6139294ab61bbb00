"""Grid of panels over time: a row for each quantity, and a column for each law."""

from collections.abc import Callable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from eqt_cli.plots.drawing import layout
from eqt_cli.plots.drawing.style import WIDTHS, Width
from eqt_cli.plots.shown.controllers import Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns

MOST: dict[Width, int] = {"column": 4, "page": 8, "slide": 6}
"""Most laws side by side."""

_BESIDE = 0.7
"""Width of the labels beside the first column and of the gaps between columns, in."""
_TALLEST = 5.0
"""Largest height of all rows together, in."""

Row = dict[str, Axes]
"""Panels of a row, by label of the law."""


def law_columns(
    runs: ShownRuns,
    width: Width,
    rows: Sequence[str],
    shows: Callable[[str, Ensemble], bool] = lambda row, law: True,
) -> tuple[Drawing, dict[str, Row]]:
    """Return the figure and the panels of each row, which share the scale of its first panel.

    Parameters
    ----------
    rows
        Names of the rows.
    shows
        Whether a row shows a law.

    Raises
    ------
    EqtError
        If there is no room for so many laws.
    """
    laws = runs.shown
    if len(laws) > MOST[width]:
        raise runs.error(
            f"has a column of panels per law, and width '{width}' has room for "
            f"{MOST[width]}, not {len(laws)}; choose some with the option 'controllers'"
        )
    mosaic = [[f"{row} {e.label}" if shows(row, e) else layout.EMPTY for e in laws] for row in rows]
    drawing, panels = layout.sheet(width, mosaic, runs.span, runs.unit("time"), _TALLEST)
    by_row: dict[str, Row] = {row: {} for row in rows}
    for row, names in zip(rows, mosaic, strict=True):
        for law, name in zip(laws, names, strict=True):
            if name != layout.EMPTY:
                by_row[row][law.label] = panels[name]
        layout.share_scale(by_row[row].values())
    for k, law in enumerate(laws):
        top = next((names[k] for names in mosaic if names[k] != layout.EMPTY), layout.EMPTY)
        if top != layout.EMPTY:
            layout.add_title(panels[top], law.title, (WIDTHS[width] - _BESIDE) / len(laws))
    layout.hide_inner_scales(panels, mosaic)
    return drawing, by_row
