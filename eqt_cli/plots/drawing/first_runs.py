"""Single runs as paths in a panel per controller; it knows no signal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.plots.base import OverTime
from eqt_cli.plots.drawing.curves import THIN, thin_line
from eqt_cli.plots.drawing.ensembles import Ensemble
from eqt_cli.plots.drawing.style import ink

Path = tuple[Array, Array]
"""Across and up, a number per sample each."""

_START: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 2.2,
    "markeredgewidth": 0.5,
}
_END: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 1.8,
    "markeredgewidth": 0,
}


@dataclass(frozen=True)
class OfFirstRuns(OverTime):
    """A figure of single runs as paths, each with its start and end.

    Attributes
    ----------
    runs
        How many runs of each controller are drawn at most, the first ones.
    """

    runs: int = 20

    def __post_init__(self) -> None:
        """Check what types cannot say."""
        if self.runs < 1:
            raise EqtError(
                f"figure '{self.name}', option 'runs': got {self.runs}; expected 1 or more"
            )


def draw_paths(axes: Axes, paths: Mapping[int, Path], ensemble: Ensemble) -> None:
    """Thin lines, a hollow dot at each start and a filled one at each end.

    Parameters
    ----------
    paths
        By the number of the run; a gap where they are NaN, but not at their ends.
    """
    look = thin_line(ensemble.look, len(paths))
    for number, (x, y) in paths.items():
        axes.plot(x, y, label=f"run {number}", **look)
    start = _start(look["color"][0])
    for name, at, marker in (("start", 0, start), ("end", -1, {"color": ink(), **_END})):
        across, up = (
            [coordinate[at] for coordinate in pair] for pair in zip(*paths.values(), strict=True)
        )
        axes.plot(across, up, label=name, **marker)


def _start(colour: Any) -> dict[str, Any]:
    return _START | {"markeredgecolor": colour, "markerfacecolor": ink(0)}


def path_legend(good: Sequence[int], most: int) -> dict[str, Artist]:
    """Handles by name, for controllers with so many good runs of which so many are drawn."""
    lines = "single runs" if max(good) <= most else f"first {most} runs"
    return {
        lines: Line2D([], [], color=ink(0.5), linewidth=2 * THIN),
        "start": Line2D([], [], **_start(ink(0.7))),
        "end": Line2D([], [], color=ink(), **_END),
    }
