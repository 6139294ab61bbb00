"""Sheets of panels, their names, legends and remarks, and the curves that several figures share."""

import re
import textwrap
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import zip_longest
from string import ascii_lowercase
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.textpath import text_to_path
from matplotlib.ticker import FixedLocator, MaxNLocator, ScalarFormatter

from eqt_cli.analysis.intervals import Resampling
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.figures.labels import free_text, part_name, quantity
from eqt_cli.figures.shown import Ensemble, ShownControllers
from eqt_cli.figures.style import ENLARGED, WIDTHS, Look, Width, ink, line_style, size_of_type

EMPTY = "."
"""Empty place in a mosaic."""

_PANEL_HEIGHTS: dict[Width, float] = {"column": 1.25, "page": 1.65, "slide": 1.4}
_LONGEST: dict[Width, float] = {"column": 8.4, "page": 8.4, "slide": 2.8}
"""Largest height of all panels, in: a page, unless panels get lower than `_LOWEST_PANEL`."""
_LOWEST_PANEL = 0.6
_LABEL = 8.0
"""Size of label type that these heights assume, pt."""
_REMARK_HEIGHT = 1.5
"""Height of a line of small text over the size of its type."""
_NARROW = 1.1
"""Width below which a panel has fewer numbers along its time axis, in."""
_SAMPLE = "abcdefghijklmnopqrstuvwxyz ABCDEFGHIJKL 0123456789"
"""Characters as frequent as in names."""
_OF_PROSE = 1.15
"""Characters of prose over those of names, which have more capitals and digits."""
_SMALL = 0.833
"""Size of small type over the usual size, as in Matplotlib."""

COLOUR_SCALE = "<colorbar>"
"""Matplotlib's label of the panel of a colour scale, which shows no numbers of its own."""
NO_NUMBERS = "<density>"
"""Label of artists whose numbers are not kept: counts in cells, which jump where rounding moves a
sample over an edge."""
_LEAST_OF_PANEL = 0.6
"""Least share of a panel's width for its name."""
_WHOLE = 12
"""Most characters of a word that is never broken in a name."""
_FULL = 0.97
"""Most of the width of a figure that a legend takes."""
_ROW_PITCH = 1.15
"""Distance from row to row, in heights of a panel."""
_LEAST_TYPE, _INDEX = 5.5, 0.7
"""Least size of a letter, pt, and size of an index or exponent over that of its text."""
_LETTER = 0.2
"""Width of the letter of a panel, in."""

Mosaic = list[list[str]]
"""Names of panels, row by row."""

Page = tuple[Figure, dict[str, Axes]]
"""A figure, and its panels by name."""

own_axes: Any = None
"""Axes of a user's own, or a mapping to them, that are drawn into instead of new panels."""


class OwnPage(Figure):
    """Stands for the figure of axes of a user's own, `panels`; its size means nothing."""

    panels: dict[str, Axes]

    def finish(self, remarks: Sequence[str]) -> Figure:
        """Print remarks below the last of the axes; return the figure of these."""
        last = [*self.panels.values()][-1]
        name, size = last.xaxis.label, _SMALL * size_of_type("font.size")
        most = _characters(last.get_window_extent().width / last.figure.dpi, size)
        text = "\n".join(free_text(remark, most) for remark in remarks)
        note = last.annotate(text, (0.5, 0), (0, -4), xycoords=name, textcoords="offset points")
        note.set(fontproperties=name.get_fontproperties(), size=size, ha="center", va="top")
        return last.figure.figure


def _page(width: Width, height: float, mosaic: Any, **more: Any) -> Page:
    """Return a figure of so many inches, and its panels by name."""
    if own_axes is None:
        drawing = Figure(figsize=(WIDTHS[width], height))
        FigureCanvasAgg(drawing)  # without one, Matplotlib makes one for every text it measures
        return drawing, drawing.subplot_mosaic(mosaic, empty_sentinel=EMPTY, **more)
    names = list(dict.fromkeys(name for row in mosaic for name in row if name != EMPTY))
    axes = own_axes if isinstance(own_axes, Mapping) else np.ravel(own_axes)
    panels = dict(axes if isinstance(axes, Mapping) else zip_longest(names, axes))
    if {*panels} != {*names} or not all(isinstance(one, Axes) for one in panels.values()):
        raise EqtError(
            f"axes: expected {len(names)} Axes, for {', '.join(names)}; got {len(axes)}: "
            f"{', '.join(map(str, axes))}; choose panels by options of the figure, or give as many"
        )
    page = OwnPage()
    page.panels = {name: panels[name] for name in names}
    return page, page.panels


def one_panel(width: Width, height: float) -> tuple[Figure, Axes]:
    """Return a figure of so many inches, and its only panel."""
    drawing, panels = _page(width, height, [["panel 1"]])
    return drawing, panels["panel 1"]


def sheet(
    width: Width, mosaic: Mosaic, span: tuple[float, float], unit: str, tallest: float = np.inf
) -> Page:
    """Return a figure of panels with a common time axis, and its panels by name.

    Parameters
    ----------
    mosaic
        Names of the panels, row by row; a repeated name spans its places, and `EMPTY` is no panel.
    span, unit
        Range of the time axis and its unit.
    tallest
        Largest height of all rows together, in.
    """
    taller = max(1.0, size_of_type("axes.labelsize") / _LABEL)  # a label is as long as a panel
    height = min(taller * _PANEL_HEIGHTS[width], tallest / len(mosaic))
    drawing, panels = blank_sheet(width, mosaic, height)
    numbered = numbered_below(mosaic) if own_axes is None else panels
    ticks = 3 if WIDTHS[width] / len(mosaic[0]) < _NARROW else 5
    for name, axes in panels.items():
        axes.set_xlim(*span)
        axes.xaxis.set_major_locator(MaxNLocator(nbins=ticks, steps=[1, 2, 5, 10]))
        axes.tick_params(labelbottom=name in numbered)
        if name in mosaic[-1] or own_axes is not None:
            axes.set_xlabel(quantity("t", unit))
    return drawing, panels


def blank_sheet(width: Width, mosaic: Mosaic, height: float, **ratios: Any) -> Page:
    """Return a figure of independent panels, and its panels by name.

    Parameters
    ----------
    mosaic
        Names of the panels, as in `sheet`.
    height
        Height of a row of panels, in; reduced where the rows would not fit a page.
    ratios
        Of the widths of columns and heights of rows, as Matplotlib's `subplot_mosaic` takes them.
    """
    rows = len(mosaic)
    height = max(_LOWEST_PANEL, min(height, _LONGEST[width] / rows))
    return _page(width, height * rows, mosaic, **ratios)


def sheet_of_maps(
    count: int, columns: int, width: Width, height: float
) -> tuple[Figure, list[Axes]]:
    """Return a figure of maps with common scales, each `height` inches high, and its panels."""
    mosaic = rows_of([f"panel {number}" for number in range(1, count + 1)], columns)
    drawing, panels = _page(width, height * len(mosaic), mosaic, sharex=True, sharey=True)
    return drawing, list(panels.values())


def rows_of(names: Sequence[str], columns: int) -> Mosaic:
    """Return panels row by row, the last row filled up with empty places."""
    rows = [list(names[start : start + columns]) for start in range(0, len(names), columns)]
    rows[-1] += [EMPTY] * (min(columns, len(names)) - len(rows[-1]))
    return rows


def panel(controller: str, part: str) -> str:
    """Return the name of the panel of a controller, by its label, and a part."""
    return f"runs of {controller}{part}"


def panels_by_controller(
    controllers: Sequence[str], parts: Sequence[str], columns: int = 2
) -> Mosaic:
    """Return a row per law and a column per part; with one part, controllers in rows.

    Parameters
    ----------
    controllers
        Labels of the controllers.
    parts
        Suffixes of the norms per part; a single one if parts are not told apart.
    columns
        Panels in a row where there is one part.
    """
    if len(parts) > 1:
        return [[panel(label, part) for part in parts] for label in controllers]
    return rows_of([panel(label, parts[0]) for label in controllers], columns)


def panel_title(controller: str, part: str) -> str:
    """Return the title above a panel."""
    return f"{controller}, {part_name(part)}" if part else controller


def numbered_below(mosaic: Mosaic) -> set[str]:
    """Return the panels numbered at their lower edge: no panel of equal width is below."""
    below: Mosaic = [*mosaic[1:], [EMPTY] * len(mosaic[0])]
    return {
        name
        for row, next_row in zip(mosaic, below, strict=True)
        for name, lower in zip(row, next_row, strict=True)
        if lower == EMPTY or row.count(name) != next_row.count(lower)
    }


def share_scale(panels: Iterable[Axes]) -> None:
    """Give panels one vertical scale; call it before anything is drawn."""
    first, *others = panels
    for axes in others:
        with suppress(ValueError):  # axes of a user's own may share a scale already
            axes.sharey(first)


def name_scale(axes: Axes, text: str) -> None:
    """Label a vertical scale."""
    # On the baseline, so that labels with and without descenders line up from panel to panel.
    axes.set_ylabel(text, va="baseline", labelpad=4)


def hide_inner_scales(panels: Mapping[str, Axes], mosaic: Mosaic) -> None:
    """Name and number a vertical scale in the first panel of a row only."""
    for name in (name for row in mosaic for name in row[1:] if name != EMPTY and own_axes is None):
        panels[name].tick_params(labelleft=False)
        panels[name].set_ylabel("")


def add_title(axes: Axes, name: str, room: float) -> None:
    """Write a user's text as the title of a panel `room` inches wide."""
    # Room for the letter on both sides, since the title is centred.
    room = max(room - 2.5 * _LETTER, _LEAST_OF_PANEL * room)
    size = size_of_type("axes.titlesize")
    fit = _characters(room, size)
    longest = max([len(word) for word in name.split() if len(word) <= _WHOLE], default=0)
    axes.set_title(free_text(name, max(fit, longest)), fontsize=size * min(1, fit / (longest or 1)))


def add_letters(figure: Figure) -> None:
    """Letter the panels, (a), (b), …, above their left corners; a single panel needs none."""
    panels = [axes for axes in figure.axes if axes.get_label() != COLOUR_SCALE]
    if len(panels) > 1:
        for number, axes in enumerate(panels):
            axes.set_title(f"({_letter(number)})", loc="left")


def _letter(number: int) -> str:
    """Return a letter by number: a to z, then aa, ab, …."""
    before, last = divmod(number, 26)
    return (_letter(before - 1) if before else "") + ascii_lowercase[last]


def add_legend(
    figure: Figure, handles: Sequence[Artist], names: Sequence[str], whole: int = 1
) -> None:
    """Name the curves above the panels, in as few rows as fit; the figure grows by them.

    The names are texts of a user, row by row; `whole` of them stay in one row, or start a new one.
    With axes of a user's own, they stand in the first.
    """
    if isinstance(figure, OwnPage):
        first = next(iter(figure.panels.values()))
        names, look = [free_text(name, 40) for name in names], first.xaxis.label
        first.legend(handles, names, prop=look.get_fontproperties(), frameon=True)
        return
    room = figure.get_figwidth() - 0.5  # beside the handle
    whole = whole if whole < len(names) else 1
    characters = _characters(room, size_of_type("legend.fontsize"))
    for rows in range(1, len(names) + 1):
        columns = -(-len(names) // rows)  # the fewest for so many rows, so that rows are full
        if columns > 1 and columns % whole and whole % columns:
            continue
        # Matplotlib fills column by column.
        order = [k for column in range(columns) for k in range(column, len(names), columns)]
        legend = figure.legend(
            [handles[k] for k in order],
            [""] * len(names),
            loc="outside upper center",
            ncols=columns,
        )
        for text, name in zip(legend.get_texts(), [names[k] for k in order], strict=True):
            # Not as labels above: Matplotlib leaves out those that begin with an underscore.
            text.set_text(free_text(name, characters))
        extent = legend.get_window_extent()
        if extent.width <= _FULL * figure.bbox.width or columns == 1:
            break
        legend.remove()
    figure.set_figheight(figure.get_figheight() + extent.height / figure.dpi)


def add_remarks(figure: Figure, remarks: Sequence[str]) -> None:
    """Print remarks below the panels, a line each; the figure grows by them."""
    if remarks:
        size = _SMALL * size_of_type("font.size")
        characters = _characters(_OF_PROSE * figure.get_figwidth(), size)
        label = figure.supxlabel("".join(remarks), x=0.01, ha="left", fontsize=size)
        label.set_fontsize(max(size, _least(label)))
        for most in range(characters, characters * 3 // 4, -2):
            label.set_text("\n".join(free_text(remark, most) for remark in remarks))
            if label.get_window_extent().width < 0.98 * figure.bbox.width:
                break
        lines, size = label.get_text().count("\n") + 1, float(label.get_fontsize())
        figure.set_figheight(figure.get_figheight() + _REMARK_HEIGHT * size / 72 * lines)


def freeze(figure: Figure) -> None:
    """Arrange the panels once and for all, so that every format shows the same picture.

    Raises
    ------
    EqtError
        If a style's type is so large that it leaves no room for the panels.
    """
    arrange(figure)
    scales = [scale for axes in figure.axes for scale in (axes.xaxis, axes.yaxis)]
    measured = _numbers(scales)
    _fit_to_rows(figure)
    _fit_to_columns(figure)
    for text in figure.findobj(Text):
        text.set_fontsize(max(text.get_fontsize(), _least(text)))
    for scale in scales:
        scale.get_majorticklabels()
    if _numbers(scales) != measured:  # the new room has changed them, or their size
        arrange(figure)
    for scale in scales:
        _hide_crowded(scale)
    figure.set_layout_engine("none")
    for axes in figure.axes:
        axes.apply_aspect()  # before names are placed beside it
    _keep_names(scales)


def _keep_names(scales: Iterable[Axis]) -> None:
    """Leave the names of scales where they are; those left of the panels of a column line up.

    Matplotlib would compare all numbers of the column for each of its scales, for every format.
    """
    places, lines = list[tuple[Axis, Any, float]](), dict[Any, float]()
    least = dict[Any, float]()  # so that the highest letter is on the page
    for scale in scales:
        if scale.axes.get_label() == COLOUR_SCALE:
            continue  # its panel has its place only when it is drawn
        scale.get_tightbbox()  # which places the name
        x, y = scale.label.get_transform().transform(scale.label.get_position())
        spec, side = scale.axes.get_subplotspec(), str(scale.get_label_position())
        start = spec.colspan.start if spec and side == "left" else -1 - len(places)
        column = scale.axes.figure, start  # of a part of a figure, such as the curves of a GIF
        lines[column] = min(x, lines.get(column, x))
        least[column] = max(x - scale.label.get_window_extent().x0, least.get(column, -np.inf))
        places.append((scale, column, y))
    for scale, column, y in places:
        x = max(lines[column], least[column] if column[1] == 0 else -np.inf)
        place = scale.axes.transAxes.inverted().transform((x, y))
        scale.set_label_coords(*place)


def _numbers(scales: Iterable[Axis]) -> list[tuple[str, Any]]:
    """Return the numbers and words along scales, their sizes, and the sizes of the names."""
    texts = [text for scale in scales for text in (*_labels(scale), scale.label)]
    return [(text.get_text(), text.get_fontsize()) for text in texts]


def _labels(scale: Axis) -> list[Text]:
    return [tick.label1 for tick in scale.majorTicks]


def _fit_to_rows(figure: Figure) -> None:
    """Shrink labels that are longer than their row, such as with many rows on a slide."""
    for axes in figure.axes:
        if axes.get_label() == COLOUR_SCALE:
            continue
        tall = axes.get_window_extent().height
        label = axes.yaxis.label
        _shrink([label], label.get_window_extent().height / (_ROW_PITCH * tall))
        if isinstance(axes.yaxis.get_major_locator(), FixedLocator):  # words, a line for each
            numbers = axes.get_yticklabels()
            lines = sum(number.get_window_extent().height for number in numbers)
            _shrink(numbers, lines / tall)


def _fit_to_columns(figure: Figure) -> None:
    """Break names of horizontal scales that are wider than their panel, but not in a unit."""
    for axes in figure.axes:
        label = axes.xaxis.label
        wide, room = label.get_window_extent().width, 1.15 * axes.get_window_extent().width
        if wide > room and axes.get_label() != COLOUR_SCALE:
            text = re.sub(r"\([^)]*\)", lambda unit: unit[0].replace(" ", "\xa0"), label.get_text())
            most = int(len(text) * room / wide)
            label.set_text(textwrap.fill(text, most, break_long_words=False))


def _hide_crowded(scale: Axis) -> None:
    """Hide the numbers of a logarithmic scale that would cover the one before."""
    if scale.get_scale() == "log":
        end = -np.inf
        for tick in scale.majorTicks:
            box = tick.label1.get_window_extent()
            first, last = (box.x0, box.x1) if scale is scale.axes.xaxis else (box.y0, box.y1)
            tick.label1.set_visible(tick.label1.get_visible() and first >= end)
            end = last if first >= end else end


def _shrink(texts: Iterable[Text], factor: float) -> None:
    """Divide the type size of texts by a factor above 1, down to a readable size."""
    for text in texts if factor > 1 else ():
        size = float(text.get_fontsize())
        text.set_fontsize(max(size / factor, min(size, _least(text))))


def _least(text: Text) -> float:
    """Return the least size at which a text is readable with its indices, pt."""
    page: Any = text.figure
    enlarged = ENLARGED["slide"] if page.figure.get_figwidth() == WIDTHS["slide"] else 1.0
    small = re.search(r"\$[^$]*[_^]", text.get_text()) is not None
    return _LEAST_TYPE / enlarged / (_INDEX if small else 1.0)


class _Numbers(ScalarFormatter):
    """Plain numbers, which Matplotlib measures faster than mathematics, with a power of ten."""

    def get_offset(self) -> str:
        """Return the common factor ×10ⁿ, or nothing."""
        self.set_useMathText(True)
        try:
            return super().get_offset()
        finally:
            self.set_useMathText(False)


def arrange(figure: Figure) -> None:
    """Arrange the panels, so that the sizes of artists are known.

    Raises
    ------
    EqtError
        If a style's type is so large that it leaves no room for the panels.
    """
    engine = figure.get_layout_engine()
    if engine is None:  # the panels are placed already
        return
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if type(axis.get_major_formatter()) is ScalarFormatter:
            axis.set_major_formatter(_Numbers(useMathText=False))
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "constrained_layout not applied", UserWarning)
        try:
            engine.execute(figure)
            if any(axes.get_aspect() != "auto" for axes in figure.axes):
                engine.execute(figure)  # margins are measured in places before they are narrowed
        except UserWarning as warning:
            raise EqtError(
                f"the font size of the style leaves no room for the panels in a figure "
                f"{figure.get_figwidth():g} in wide; use a wider figure or smaller type"
            ) from warning


def _characters(room: float, size: float) -> int:
    """Return how many characters of this type size (pt) fit in a line of `room` inches."""
    alike, *_ = text_to_path.get_text_width_height_descent(
        _SAMPLE, FontProperties(size=size), ismath=False
    )
    return int(len(_SAMPLE) * 72 * room / alike)


# Curves that several figures share: bands, single runs, paths -------------------------------------


BAND = (0.1, 0.9)
"""Quantiles over runs at the edges of a band."""

_FAINT_BAND = 0.1
"""Opacity of a band among those of other laws."""

RESAMPLING = Resampling(confidence=0.95, resamples=2000)
"""Bootstrap settings of bands around means."""

THIN = 0.35
"""Line width of a single run, pt."""

_POINTS: dict[str, Any] = {"markersize": 4.5, "markerfacecolor": "none"}
"""Style of hollow markers, all visible where curves coincide."""

Bands = Literal["none", "quartiles"]
"""Kinds of bands: ``quartiles`` around the median, from 25 % to 75 % of the runs."""

_MOST_IN_BAND = 401
"""Most samples at the edges of a band."""


def of_bands(bands: Bands) -> str:
    """Return words for the bands, as the end of a sentence; empty where there are none."""
    return "; bands: quartiles" if bands == "quartiles" else ""


def middle_of(bands: Bands) -> str:
    """Return the name of the curve in a band."""
    return "median" if bands == "quartiles" else "mean"


def draw_middle(axes: Axes, times: Array, values: Array, bands: Bands, ensemble: Ensemble) -> None:
    """Draw the mean or median over runs of values ``(runs, samples)``, and the band around it."""
    look = line_style(ensemble.look)
    if bands == "quartiles":
        low, middle, high = np.quantile(values, (0.25, 0.5, 0.75), axis=0)
    else:
        middle = values.mean(axis=0)
    axes.plot(times, middle, label=ensemble.label, **look)
    if bands == "quartiles" and len(values) > 1:
        step = -(-len(times) // _MOST_IN_BAND)  # an edge is not simplified
        some = np.unique(np.append(np.arange(0, len(times), step), len(times) - 1))
        band = band_look(look["color"], _FAINT_BAND)
        axes.fill_between(times[some], low[some], high[some], label=ensemble.label, **band)


def draw_points(
    axes: Axes,
    across: Array,
    up: Array,
    band: tuple[Array, Array],
    of: Look,
    title: str,
    beside: float | None = None,
) -> list[Line2D]:
    """Draw a curve with a hollow marker at every point, and the band around it.

    With `beside`, points have no order: bars in place of the band, at this distance to the right.
    """
    look = line_style(of)
    if beside is None:
        axes.fill_between(across, *band, label=title, **band_look(look["color"]))
    else:
        across, look = across + beside, look | {"linestyle": ""}
        axes.vlines(across, *band, label=title, color=look["color"], linewidth=0.8)
    return axes.plot(across, up, label=title, marker=of.marker, **_POINTS, **look)


def beside(texts: Mapping[float, str], index: int, count: int) -> float | None:
    """Return where the curve with this index lies beside a text; None where there are numbers."""
    return (index - (count - 1) / 2) * min(0.15, 0.6 / count) if texts else None


def band_look(colour: str, opacity: float = 0.18) -> dict[str, Any]:
    """Return the style of a band: a tint without edges, which would look like curves."""
    return {"facecolor": (colour, opacity), "linewidth": 0}


def thin_line(look: Look, count: int) -> dict[str, Any]:
    """Return the line style of one of `count` single runs of a controller."""
    opacity = min(0.8, 4 / np.sqrt(count))  # few lines are visible, many make shades
    return {"color": (look.colour, opacity), "linewidth": THIN}


def thin_line_legend(shown: Sequence[Ensemble], most: int) -> dict[str, Artist]:
    """Return a legend handle by name, where at most `most` good runs are drawn."""
    runs = max(np.count_nonzero(ensemble.good) for ensemble in shown)
    name = "single runs" if runs <= most else f"first {most} runs"
    return {name: Line2D([], [], color=ink(0.5), linewidth=2 * THIN)}


FAR = 10.0
"""A law has diverged whose last value exceeds so many times every value of the others."""


def diverging(curves: Mapping[str, Array]) -> list[str]:
    """Return the names of the curves ``(samples,)`` that end far above all values of the others."""
    peaks = {name: float(np.nanmax(curve)) for name, curve in curves.items()}
    others, far = -np.inf, list[str]()
    for name in sorted(peaks, key=lambda each: peaks[each]):
        if np.isfinite(others) and curves[name][-1] > FAR * others > 0:
            far.append(name)
        else:
            others = max(others, peaks[name])
    return far


def leaving(shown: ShownControllers, errors: Iterable[Mapping[str, Array]]) -> set[str]:
    """Return the labels of laws of which an error diverges, and say that they are cut off."""
    far = {label for each in errors for label in diverging(each)}
    if far:
        titles = ", ".join(f"“{e.title}”" for e in shown.shown if e.label in far)
        shown.remarks.append(f"Cut off where it leaves the reference: {titles}.")
    return far


def cut_off(axes: Axes, far: set[str]) -> None:
    """End curves where they leave what the other curves of a panel need."""
    near = [line.get_ydata() for line in axes.lines if line.get_label() not in far]
    if not far or not near:
        return
    values = np.concatenate(near)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    low, high = low - 0.2 * (high - low), high + 0.2 * (high - low)
    axes.set_ylim(low, high)
    for line in (line for line in axes.lines if line.get_label() in far):
        drawn = np.asarray(line.get_ydata())
        inside = np.logical_and.accumulate((drawn >= low) & (drawn <= high))
        line.set_ydata(np.where(inside, drawn, np.nan))


_MOST_NAME = 16
"""Most characters in a line of the name of a law that diverges."""
_USUAL = 0.02
"""Share of the time in which a curve may leave a logarithmic scale: a start at 0, a dip."""
_MARGIN = 0.05
"""Room above curves, in shares of a logarithmic scale."""


def bound_below(axes: Axes, curves: Sequence[Array], error: float) -> None:
    """End a logarithmic scale at a tenth of what curves exceed nearly always, or at an error."""
    usual = [np.quantile(curve[curve > 0], _USUAL) for curve in curves if np.any(curve > 0)]
    if axes.get_yscale() == "log" and usual:
        floor = min(max(min(usual) / FAR, error), max(float(curve.max()) for curve in curves) / FAR)
        if floor > axes.get_ylim()[0]:
            shared = axes.get_shared_y_axes().get_siblings(axes)
            top = max(float(each.dataLim.ymax) for each in shared if each.has_data())
            axes.set_ylim(floor, top * (top / floor) ** _MARGIN)


def bound(axes: Axes, error: float, titles: Mapping[str, str]) -> None:
    """Bound a scale by what its curves say; name the laws that diverge.

    Parameters
    ----------
    error
        Error of the solver, below which a logarithmic scale shows nothing.
    titles
        Names of the curves by label. One that diverges is cut off at ten times all others.
    """
    lines = {str(line.get_label()): line for line in axes.lines}
    curves = {label: np.asarray(line.get_ydata(), float) for label, line in lines.items()}
    far = diverging(curves)
    near = [curve for label, curve in curves.items() if label not in far]
    bound_below(axes, near, error)
    if far:
        axes.set_ylim(top=FAR * max(float(curve.max()) for curve in near))
    for number, label in enumerate(far):
        text = f"{free_text(titles[label], _MOST_NAME)} diverges"
        look: dict[str, Any] = {"color": lines[label].get_color(), "ha": "right", "va": "top"}
        look["bbox"] = {"facecolor": ink(0), "edgecolor": "none", "pad": 0.8}
        place = (0.97, 0.96 - 0.13 * number)
        axes.annotate(text, place, xycoords="axes fraction", fontsize="small", **look)


def open_frame(axes: Axes) -> None:
    """Leave out the frame's upper and right sides."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(which="both", top=False, right=False)
