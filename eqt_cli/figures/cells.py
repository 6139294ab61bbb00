"""Scales, and the points of a sweep as cells of a map over one or two keys; it knows no metric."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import Colormap
from matplotlib.patches import Rectangle

from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import NOTHING
from eqt_cli.figures.labels import free_text, in_words
from eqt_cli.figures.layout import name_scale
from eqt_cli.figures.style import Width, ink
from eqt_cli.results.quantity import SweptKey
from eqt_cli.results.result import Result
from eqt_cli.results.summary import owner_of, unit_of_key

Direction = Literal["x", "y"]

FEW = 12
"""Most values that are written below a scale instead of round numbers."""
ROUNDING = 1e-9
"""Share of the largest value in its unit below which a component is rounding error."""


def spans_decade(values: Array) -> bool:
    """Whether positive values differ by more than a factor of 10."""
    seen = np.asarray(values)
    seen = seen[np.isfinite(seen) & (seen > 0)]
    return bool(seen.size and seen.max() > 10 * seen.min())


def even() -> ticker.MaxNLocator:
    """Return a locator of about five evenly spaced round numbers."""
    return ticker.MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10])


def scale_log(axes: Axes, direction: Direction, seen: Array) -> None:
    """Set a logarithmic scale for positive values, with numbers wherever there is room."""
    axes.set(**{f"{direction}scale": "log"})
    axis = axes.xaxis if direction == "x" else axes.yaxis
    decades = np.log10(seen.max() / seen.min())
    if decades < 1:
        axis.set_major_locator(even())
    elif decades < 2:
        axis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
    if decades < 2:
        axis.set_major_formatter(ticker.FuncFormatter(number_text))
    axis.set_minor_formatter(ticker.NullFormatter())


def scale(axes: Axes, direction: Direction, values: Array, *, log: bool | None) -> None:
    """Set a logarithmic scale if asked and possible; with None, if values span a decade."""
    seen = values[np.isfinite(values)]
    if seen.size and (seen > 0).all() and (spans_decade(seen) if log is None else log):
        scale_log(axes, direction, seen)


def scale_norm(axes: Axes, *, log: bool) -> None:
    """Set a scale for non-negative curves: logarithmic if asked and possible, else from 0."""
    lines = [
        line for sibling in axes.get_shared_y_axes().get_siblings(axes) for line in sibling.lines
    ]
    drawn = np.concatenate([[0.0], *(np.ravel(line.get_ydata()) for line in lines)])
    seen = drawn[np.isfinite(drawn) & (drawn > 0)]
    if log and seen.size:
        scale_log(axes, "y", seen)
    else:
        axes.set_ylim(bottom=0)


_PREFIXES = {-9: "n", -6: "µ", -3: "m", 3: "k", 6: "M", 9: "G"}
_UNIT = re.compile(r"(?<=\$\(\\mathrm\{)(?=(?:N|J|m|s|rad|W|Hz|T|A)(?:[\\/}]))")
"""Where a unit begins that takes a prefix: in front, without a power."""


class Prefixed(ticker.ScalarFormatter):
    """Numbers of a scale in a unit with a prefix, such as µN m."""

    def __init__(self, exponent: int) -> None:
        super().__init__()
        self.factor, self.prefix = 10.0**-exponent, _PREFIXES[exponent]
        self.set_powerlimits((exponent, exponent))

    def get_offset(self) -> str:
        """Return nothing: the prefix says the power of ten."""
        return ""


def prefix_units(panels: Iterable[Axes]) -> None:
    """Put a prefix in front of a unit, one in all panels, in place of powers of ten."""
    by_unit = dict[str, list[Axis]]()
    every: list[Axis] = [axis for axes in panels for axis in (axes.xaxis, axes.yaxis)]
    for axis in every:
        axis.get_majorticklabels()  # which gives the formatter its numbers
        _, *unit = _UNIT.split(axis.label.get_text())
        if unit and isinstance(axis.get_major_formatter(), ticker.ScalarFormatter):
            by_unit.setdefault(unit[0], []).append(axis)
    for scales in by_unit.values():
        if not any(axis.get_major_formatter().get_offset() for axis in scales):
            continue
        largest = max(abs(end) for axis in scales for end in axis.get_view_interval())
        exponent = 3 * int(np.floor(np.log10(largest) / 3))
        if exponent in _PREFIXES:
            for axis in scales:
                axis.set_major_formatter(Prefixed(exponent))
                axis.label.set_text(_UNIT.sub(_PREFIXES[exponent], axis.label.get_text()))


def number_values(axes: Axes, values: Array) -> None:
    """Number the horizontal scale at its values if they are few; else as Matplotlib does.

    Set the scale to linear or logarithmic first. Crowded numbers are hidden with the layout.
    """
    levels = np.unique(values)
    if len(levels) <= FEW:
        axes.xaxis.set_minor_locator(ticker.NullLocator())
        axes.set_xticks(levels, [number_text(level) for level in levels])
    elif axes.get_xscale() == "log":
        scale_log(axes, "x", levels)


def number_text(value: float, _position: int | None = None) -> str:
    """Return a number with at most four digits, with a power of ten in mathematics."""
    mantissa, _, exponent = f"{value:.4g}".partition("e")
    if exponent:
        return rf"${mantissa} \times 10^{{{int(exponent)}}}$"
    return rf"$\mathdefault{{{mantissa}}}$" if value < 0 else mantissa


_LONGEST_KEY = 36
"""Most characters in a line of a label."""
_MARGIN = 0.03
"""Margin in shares of the width, so that markers at the ends are whole."""
_AROUND = 0.6
"""Width of the vertical scale and the margins, in."""


def colours_of(better: str) -> Colormap:
    """Return the colour scale of a quantity, bright where it is good, as in shares that settle."""
    scale = matplotlib.colormaps[matplotlib.rcParams["image.cmap"]]
    return scale.reversed() if better == "lower" else scale


def key_label(result: Result, swept: SweptKey) -> str:
    """Return the name of a swept key with its unit; the key itself where it has none of its own."""
    names = [key.label + owner_of(result, key) for key in result.swept_keys]
    name = swept.label + owner_of(result, swept)
    is_own = bool(swept.label) and names.count(name) < 2
    text = free_text(name if is_own else swept.key, _LONGEST_KEY)
    return in_words(text, swept.unit or unit_of_key(result, swept))


def scale_along(panel: Axes, result: Result, axis: SweptKey, room: float) -> None:
    """Name and number the horizontal scale of a panel `room` inches wide."""
    panel.margins(x=_MARGIN)
    panel.set_xlabel(key_label(result, axis))
    if axis.texts:
        texts = [free_text(text, _LONGEST_KEY) for text in axis.names.values()]
        if not axis.is_number:
            panel.set_xlim(-0.5, len(texts) - 0.5)
        panel.set_xticks(list(axis.texts), texts)
        turn_upright(panel, texts, room - _AROUND)
        return
    if axis.logarithmic:
        panel.set_xscale("log")
    number_values(panel, axis.values)


_TICK_LETTER = 0.06
"""Width of a letter below a panel with its share of the gap to the next name, in."""


def turn_upright(panel: Axes, texts: Sequence[str], room: float) -> float:
    """Turn the texts below a panel `room` inches wide if they are too long; return their height."""
    longest = _TICK_LETTER * max(len(line) for text in texts for line in text.split("\n"))
    if longest * len(texts) <= room:
        return 0.0
    panel.tick_params(axis="x", labelrotation=90)
    return longest


_LONGEST_NAME = 18
"""Most characters in a line of the name of a value that is no number."""

_LETTER, _BESIDE, _LINE = 0.048, 0.088, 0.16
"""Width of a letter in a cell, of the margins around a text, and height of a line, in."""
_TENS = 10
"""Numbers of at least this size are written without decimals."""
_LONGEST_NUMBER = 4
"""Most characters of a number in a cell."""
_DARK = 0.55
"""Luminance below which numbers are written in the colour of the paper."""

_WRITTEN: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6.5, "zorder": 4}

_MOST_LEVELS = 6
"""Approximate number of values written along a scale."""


@dataclass(frozen=True)
class Cells:
    """Cells of the points of a sweep in a map.

    Attributes
    ----------
    across, up
        The swept keys; without the second, the map is a single row.
    """

    across: SweptKey
    up: SweptKey | None = None

    @cached_property
    def columns(self) -> Array:
        """Column of each point."""
        return np.unique(self.across.values, return_inverse=True)[1]

    @cached_property
    def rows(self) -> Array:
        """Row of each point."""
        if self.up is None:
            return np.zeros_like(self.columns)
        return np.unique(self.up.values, return_inverse=True)[1]

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return int(self.rows.max()) + 1, int(self.columns.max()) + 1

    def grid(self, values: Array) -> Array:
        """Return values of all points as ``(rows, columns)``; NaN where there is no point."""
        grid = np.full(self.shape, np.nan)
        grid[self.rows, self.columns] = values
        return grid

    def draw(self, panel: Axes, values: Array, **look: Any) -> Any:
        """Colour the cells by the values of the points."""
        # Edges, since the centre of a single row or column does not give its extent.
        rows, columns = (np.arange(count + 1) - 0.5 for count in self.shape)
        return panel.pcolormesh(columns, rows, self.grid(values), **look)

    def hatch(self, panel: Axes, points: Iterable[int], pattern: str) -> None:
        """Hatch the cells of some points."""
        look: dict[str, Any] = {"hatch": pattern, "edgecolor": ink(0.35), "linewidth": 0}
        for point in points:
            corner = self.columns[point] - 0.5, self.rows[point] - 0.5
            panel.add_patch(Rectangle(corner, 1, 1, fill=False, **look))

    def write(
        self,
        panel: Axes,
        values: Array,
        image: Any,
        room: tuple[float, float],
        texts: Sequence[str] | None = None,
    ) -> bool:
        """Write the values of the points in their cells if they fit; return whether they do.

        Parameters
        ----------
        image
            Image that `draw` returned, for its colours.
        room
            Width and height of the panel, in.
        texts
            Text of each point, in one line or several; its value if None.
        """
        rows, columns = self.shape
        if texts is None:
            longest, lines = _LONGEST_NUMBER, 1
            texts = [short(value) for value in values]
        else:
            longest = max(len(line) for text in texts for line in text.split("\n"))
            lines = max(text.count("\n") for text in texts) + 1
        if room[0] / columns < _LETTER * longest + _BESIDE or room[1] / rows < _LINE * lines:
            return False
        for point, value in enumerate(values):
            if np.isfinite(value):
                red, green, blue, _ = ground = image.cmap(image.norm(value))
                dark = 0.2126 * red + 0.7152 * green + 0.0722 * blue < _DARK
                place, colour = (self.columns[point], self.rows[point]), ink(0) if dark else ink()
                box = {"facecolor": ground, "edgecolor": "none", "pad": 0.6}
                panel.annotate(texts[point], place, color=colour, bbox=box, **_WRITTEN)
        return True

    def scales(
        self,
        panel: Axes,
        result: Result,
        room: float,
        *,
        leftmost: bool = True,
        lowest: bool = True,
    ) -> float:
        """Name the keys and number the cells along them, in a panel `room` inches wide.

        A panel that is not the leftmost or not the lowest of its row or column has no such names.

        Return the extra room below the panel, in: texts for which it is too narrow stand upright.
        """
        texts = self._number(panel, "x", self.across, result)
        below = turn_upright(panel, texts, room)
        if self.up is None:
            panel.set_yticks([])
        elif leftmost:
            self._number(panel, "y", self.up, result)
        # Matplotlib hides the numbers of every panel above the last row, whether it has one below.
        panel.tick_params(axis="x", labelbottom=lowest)
        panel.xaxis.label.set_visible(lowest)
        return below

    def _number(self, panel: Axes, direction: str, key: SweptKey, result: Result) -> list[str]:
        """Number the cells along a scale; return the texts."""
        levels = np.unique(key.values).tolist()
        shown = range(0, len(levels), max(1, len(levels) // _MOST_LEVELS))
        numbers = {level: f"{level:.3g}".replace("-", "−") for level in levels}
        names = numbers | key.names
        most = _LONGEST_KEY if key.is_number else _LONGEST_NAME
        texts = [free_text(names[levels[k]], most) for k in shown]
        panel.set(**{f"{direction}ticks": list(shown), f"{direction}ticklabels": texts})
        if direction == "x":
            panel.set_xlabel(key_label(result, key))
        else:
            name_scale(panel, key_label(result, key))
        return texts


def short(value: float) -> str:
    """Return a number as it is written in a cell."""
    value = 0.0 if abs(value) < NOTHING else value
    return f"{value:#.2g}" if abs(value) < _TENS else f"{value:.0f}"


def map_columns(count: int, width: Width) -> int:
    """Return how many of `count` maps stand side by side."""
    most = (1 if count < 3 else 2) if width == "column" else 2 if count == 4 else 3
    return min(count, most)
