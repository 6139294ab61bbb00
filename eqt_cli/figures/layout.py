"""Sheets of panels, their names, legends and remarks, and the curves that several figures share."""

import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from io import BytesIO
from itertools import zip_longest
from string import ascii_lowercase
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.textpath import text_to_path
from matplotlib.ticker import FixedLocator, MaxNLocator, ScalarFormatter

from eqt_cli.analysis.intervals import Resampling
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.figures.labels import free_text, quantity
from eqt_cli.figures.shown import Ensemble, ShownControllers
from eqt_cli.figures.style import WIDTHS, Look, Width, ink, line_style, size_of_type

EMPTY = "."
"""Empty place in a mosaic."""

_PANEL_HEIGHTS: dict[Width, float] = {"column": 1.25, "page": 1.65, "slide": 1.4}
LONGEST: dict[Width, float] = {"column": 8.4, "page": 8.4, "slide": 2.8}
"""Largest height of all panels, in: a page, unless panels get lower than `LOWEST_PANEL`."""
TALLEST: dict[Width, float] = {"column": 4.4, "page": 4.4, "slide": 2.8}
"""Largest height of all panels over time, in: 124 mm with a legend and a remark."""
LOWEST_PANEL = 0.54
_LABEL = 8.0
"""Size of label type that these heights assume, pt."""
_REMARK_HEIGHT = 1.5
"""Height of a line of small text over the size of its type."""
_NARROW = 1.1
"""Width below which a panel has fewer numbers along its time axis, in."""
_SAMPLE = "abcdefghijklmnopqrstuvwxyz ABCDEFGHIJKL 0123456789"
"""Characters as frequent as in names."""
_PROSE = 0.95
"""Share of the width that is filled by an average line."""
_SMALL = 0.833
"""Size of small type over the usual size, as in Matplotlib."""

_LEAST_SIZE = 0.75
"""Least size of a title over the usual size: of 8 pt, the 6 pt that journals ask for."""

COLOUR_SCALE = "<colorbar>"
"""Matplotlib's label of the panel of a colour scale, which shows no numbers of its own."""
NO_NUMBERS = "<density>"
"""Label of artists whose numbers are not kept: counts in cells, which jump where rounding moves a
sample over an edge."""
_LEAST_IN_LINE = 12
"""Least characters in a line of a name, so that few words are broken."""
_BETWEEN = 0.06
"""Least gap between two numbers side by side, in."""
_LETTER = 0.2
"""Width of the letter of a panel, in."""
_LETTERED = 1.3
"""Width per column of panels from which they have letters, in."""
_MOST_LETTERS = 12
"""Most panels that have letters, a to l."""
_SMALLER = re.compile(r"\$[^$]*(\^|_|\\frac)")
"""Mathematics with letters that are smaller than the others."""
_LABEL_REACH = 1.2
"""Length of a label over the height of its panel, before the panels are arranged."""
_FULL = 0.97
"""Most of the width of a figure that a legend takes."""
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
        for panel in self.panels.values():
            hide_crowded(panel.xaxis)
        last = [*self.panels.values()][-1]
        name, size = last.xaxis.label, _SMALL * size_of_type("font.size")
        most = _characters(last.get_window_extent().width / last.figure.dpi, size)
        text = "\n".join(free_text(remark, most) for remark in remarks)
        note = last.annotate(text, (0.5, 0), (0, -4), xycoords=name, textcoords="offset points")
        note.set(fontproperties=name.get_fontproperties(), size=size, ha="center", va="top")
        return last.figure.figure


def one_panel(width: Width, height: float) -> tuple[Figure, Axes]:
    """Return a figure of so many inches, and its only panel."""
    drawing, panels = blank_sheet(width, [["panel 1"]], height)
    return drawing, panels["panel 1"]


def sheet(width: Width, mosaic: Mosaic, span: tuple[float, float], unit: str) -> Page:
    """Return a figure of panels with a common time axis, and its panels by name.

    Parameters
    ----------
    mosaic
        Names of the panels, row by row; a repeated name spans its places, and `EMPTY` is no panel.
    span, unit
        Range of the time axis and its unit.
    """
    taller = max(1.0, size_of_type("axes.labelsize") / _LABEL)  # a label is as long as a panel
    height = taller * min(_PANEL_HEIGHTS[width], TALLEST[width] / len(mosaic))
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


class Sheet(Figure):
    """A figure that a notebook shows, without pyplot, too."""

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        self.savefig(file, format="png", dpi=100)
        return file.getvalue()


def blank_sheet(width: Width, mosaic: Mosaic, height: float, **options: Any) -> Page:
    """Return a figure of independent panels, and its panels by name.

    Parameters
    ----------
    mosaic
        Names of the panels, as in `sheet`.
    height
        Height of a row of panels, in; reduced where the rows would not fit a page.
    options
        Of Matplotlib's `subplot_mosaic`, such as the ratios of the widths of columns.
    """
    if own_axes is None:
        rows = len(mosaic)
        height = max(LOWEST_PANEL, min(height, LONGEST[width] / rows))
        drawing = Sheet(figsize=(WIDTHS[width], height * rows))
        FigureCanvasAgg(drawing)  # without one, Matplotlib makes one for every text it measures
        layout: Any = mosaic
        return drawing, drawing.subplot_mosaic(layout, empty_sentinel=EMPTY, **options)
    names = list(dict.fromkeys(name for row in mosaic for name in row if name != EMPTY))
    axes = own_axes if isinstance(own_axes, Mapping) else np.ravel(own_axes)
    panels = dict(axes if isinstance(axes, Mapping) else zip_longest(names, axes))
    if {*panels} != {*names} or not all(isinstance(panel, Axes) for panel in panels.values()):
        raise EqtError(
            f"axes: expected {len(names)} Axes, for {', '.join(names)}; got {len(axes)}: "
            f"{', '.join(map(str, axes))}; choose panels by options of the figure, or give as many"
        )
    place = OwnPage()
    place.panels = {name: panels[name] for name in names}
    return place, place.panels


def rows_of(names: Sequence[str], columns: int) -> Mosaic:
    """Return panels row by row, the last row filled up with empty places."""
    rows = [list(names[start : start + columns]) for start in range(0, len(names), columns)]
    rows[-1] += [EMPTY] * (min(columns, len(names)) - len(rows[-1]))
    return rows


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
    """Label a vertical scale, in several lines or smaller type where the panel is low."""
    # On the baseline, so that labels with and without descenders line up from panel to panel.
    label = axes.set_ylabel(text, va="baseline", labelpad=4)
    room = _LABEL_REACH * axes.get_window_extent().height
    if label.get_window_extent().height > room:
        size = size_of_type("axes.labelsize")
        fit = max(_characters(room / axes.figure.dpi, size), _LEAST_IN_LINE)
        lines = text.replace(" $(", "\n$(").split("\n")
        label.set_text("\n".join(free_text(line, fit) for line in lines))
        label.set_fontsize(size * min(1.0, room / label.get_window_extent().height))


def hide_inner_scales(panels: Mapping[str, Axes], mosaic: Mosaic) -> None:
    """Name and number a vertical scale in the first panel of a row only."""
    for name in (name for row in mosaic for name in row[1:] if name != EMPTY and own_axes is None):
        panels[name].tick_params(labelleft=False)
        panels[name].set_ylabel("")


def add_title(axes: Axes, name: str, *, at_right: bool = False) -> None:
    """Write a user's text as the title of a panel beside its letter: centred, or small at right."""
    letters = len(_lettered(axes.figure.figure)) > 1
    room = axes.get_window_extent().width / axes.figure.dpi - letters * _LETTER
    size = size_of_type("axes.titlesize") * (_SMALL if at_right else 1.0)
    # A little smaller rather than on two lines.
    lines = max(1, len(name)) / max(1, _characters(room, size, name or _SAMPLE))
    size *= max(_LEAST_SIZE, 1 / max(1.0, lines))
    fit = _characters(room, size, name or _SAMPLE)
    if fit < len(name):  # one of its lines may have wider letters than the name
        fit = min(fit, _characters(room, size))
    fit = max(fit, *map(len, name.split()), 1)
    axes.set_title(free_text(name, fit), loc="right" if at_right else "center", fontsize=size)


def add_letters(figure: Figure) -> None:
    """Letter the panels, (a), (b), …, above their left corners; a single panel needs none.

    Nor do many or narrow ones, which have names, or a column and a row with names.
    """
    panels = _lettered(figure)
    for number, axes in enumerate(panels if len(panels) > 1 else []):
        axes.set_title(f"({ascii_lowercase[number]})", loc="left")


def _lettered(figure: Figure) -> list[Axes]:
    """Return the panels of a figure that has room for their letters; none of others."""
    panels = [axes for axes in figure.axes if axes.get_label() != COLOUR_SCALE]
    places = [place for axes in panels if (place := axes.get_subplotspec())]
    columns = max((place.get_gridspec().ncols for place in places), default=1)
    has_room = figure.get_figwidth() > columns * _LETTERED and len(panels) <= _MOST_LETTERS
    return panels if has_room else []


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
    room = 0.8 * (figure.get_figwidth() - 0.5)  # a reader's font may be wider
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
        readable = 1.0 if "$" in "".join(remarks) else _SMALL  # with indices, too
        size, room = readable * size_of_type("font.size"), _PROSE * figure.get_figwidth()
        text = "\n".join(free_text(remark, _characters(room, size, remark)) for remark in remarks)
        figure.supxlabel(text, x=0.01, ha="left", fontsize=size)
        height = _REMARK_HEIGHT * size / 72 * (text.count("\n") + 1)
        figure.set_figheight(figure.get_figheight() + height)


def freeze(figure: Figure) -> None:
    """Arrange the panels once and for all, so that every format shows the same picture.

    Raises
    ------
    EqtError
        If a style's type is so large that it leaves no room for the panels.
    """
    scales = [scale for axes in figure.axes for scale in (axes.xaxis, axes.yaxis)]
    for scale in scales:
        _set_power(scale)
        numbers = [number.get_text() for number in scale.get_majorticklabels()]
        if _SMALLER.search(" ".join([*numbers, scale.get_major_formatter().get_offset()])):
            scale.set_tick_params(labelsize="medium")  # so that exponents can be read
            scale.get_offset_text().set_fontsize("medium")
    parts: Sequence[FigureBase] = figure.subfigs or [figure]
    for part in parts:
        part.align_ylabels([a for a in figure.axes if a.figure is part and a.get_ylabel()])
    engine = figure.get_layout_engine() or ConstrainedLayoutEngine()
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "constrained_layout not applied", UserWarning)
        try:
            engine.execute(figure)
            measured = _numbers(scales)
            for scale in scales:
                _set_power(scale)  # which may differ in the new room
            narrowed = any(axes.get_aspect() != "auto" for axes in figure.axes)
            if narrowed or _numbers(scales) != measured:
                _keep_numbers(scales)
                engine.execute(figure)
        except UserWarning as warning:
            raise EqtError(
                f"the font size of the style leaves no room for the panels in a figure "
                f"{figure.get_figwidth():g} in wide; use a wider figure or smaller type"
            ) from warning
    figure.set_layout_engine("none")
    # Names stay where they are; Matplotlib would measure all numbers anew for every format.
    for axes in figure.axes:
        axes.apply_aspect()
    # The panel of a colour scale gets its place when it is drawn.
    for axes in [axes for axes in figure.axes if axes.get_label() != COLOUR_SCALE]:
        for scale in (axes.xaxis, axes.yaxis):
            hide_crowded(scale)
            place = scale.label.get_transform().transform(scale.label.get_position())
            scale.set_label_coords(*axes.transAxes.inverted().transform(place))


def _set_power(scale: Axis) -> None:
    """Number a scale; write a power of ten that all numbers share as 10⁻³, not as 1e−3."""
    scale.get_majorticklabels()
    formatter = scale.get_major_formatter()
    if isinstance(formatter, ScalarFormatter) and formatter.get_offset():
        formatter.set_useMathText(True)


def _keep_numbers(scales: Iterable[Axis]) -> None:
    """Keep the numbers of scales: else they and the room that they leave may change in turns."""
    for scale in scales:
        if isinstance(scale.get_major_locator(), MaxNLocator):
            scale.set_major_locator(FixedLocator([*scale.get_majorticklocs()]))


def _numbers(scales: Iterable[Axis]) -> list[str]:
    """Return the numbers and words along scales."""
    return [tick.label1.get_text() for scale in scales for tick in scale.majorTicks]


def hide_crowded(scale: Axis) -> None:
    """Hide the numbers of a horizontal or logarithmic scale that would cover the one before."""
    scale.get_tightbbox()  # which places them
    end, across = -np.inf, scale is scale.axes.xaxis
    if across or scale.get_scale() == "log":
        for tick in scale.majorTicks:
            box = tick.label1.get_window_extent()
            first, last = (box.x0, box.x1) if across else (box.y0, box.y1)
            if first < end:
                tick.label1.set_visible(False)
            elif tick.label1.get_visible():
                end = last + _BETWEEN * scale.axes.figure.dpi * across


def _characters(room: float, size: float, sample: str = _SAMPLE) -> int:
    """Return how many characters like those of a sample, `size` pt, fit in a line, in."""
    font = FontProperties(size=size)
    wide, *_ = text_to_path.get_text_width_height_descent(sample, font, ismath=False)
    return int(len(sample) * 72 * room / wide)


# Curves that several figures share: bands, single runs, paths -------------------------------------


BAND = (0.1, 0.9)
"""Quantiles over runs at the edges of a band."""

BANDS = 2
"""Most laws with a band: the first two, which are compared first."""

_FAINT_BAND = 0.1
"""Opacity of a band beside another one."""

RESAMPLING = Resampling(confidence=0.95, resamples=2000)
"""Bootstrap settings of bands around means."""

THIN = 0.35
"""Line width of a single run, pt."""

_MOST_IN_BAND = 401
"""Most samples at the edges of a band."""


def draw_middle(axes: Axes, times: Array, values: Array, of: Ensemble, middle: str) -> None:
    """Draw the ``mean``, ``median`` or ``quartiles`` over runs of values ``(runs, samples)``."""
    look = line_style(of.look)
    levels = (0.5, 0.25, 0.75) if middle == "quartiles" and len(values) > 1 else (0.5,)
    curves = [values.mean(axis=0)] if middle == "mean" else np.quantile(values, levels, axis=0)
    drawn, *edges = curves
    axes.plot(times, drawn, label=of.label, **look)
    if edges:
        step = -(-len(times) // _MOST_IN_BAND)  # an edge is not simplified
        some = np.unique(np.append(np.arange(0, len(times), step), len(times) - 1))
        band = band_look(look["color"], _FAINT_BAND)
        axes.fill_between(times[some], *(edge[some] for edge in edges), label=of.label, **band)


def band_look(colour: str, opacity: float = 0.18) -> dict[str, Any]:
    """Return the style of a band: a tint without edges, which would look like curves."""
    return {"facecolor": (colour, opacity), "linewidth": 0}


def thin_line(look: Look, count: int) -> dict[str, Any]:
    """Return the line style of one of `count` single runs of a controller."""
    opacity = min(0.8, 4 / np.sqrt(count))  # few lines are visible, many make shades
    return {"color": (look.colour, opacity), "linewidth": THIN}


FAR = 10.0
"""A law has diverged whose last value exceeds so many times every value of the others."""


def diverging(curves: Mapping[str, Array]) -> list[str]:
    """Return the names of the curves ``(samples,)`` that end far above all values of the others."""
    peaks = {name: float(np.nanmax(curve)) for name, curve in curves.items()}
    others, far = -np.inf, list[str]()
    for name in sorted(peaks, key=lambda label: peaks[label]):
        if np.isfinite(others) and curves[name][-1] > FAR * others > 0:
            far.append(name)
        else:
            others = max(others, peaks[name])
    return far


def leaving(shown: ShownControllers, errors: Iterable[Mapping[str, Array]]) -> set[str]:
    """Return the labels of laws of which an error diverges, and say that they are cut off."""
    far = {label for error in errors for label in diverging(error)}
    if len(far) == len(shown.shown):  # of each, another number; so none leaves what others do
        return set()
    if far:
        titles = ", ".join(f"“{e.title}”" for e in shown.shown if e.label in far)
        shown.remarks.append(f"Cut off where it leaves the reference: {titles}.")
        shown.note = ", ".join(filter(None, [shown.note, f"{titles} cut off"]))
    return far


def cut_off(axes: Axes, far: set[str]) -> None:
    """End curves where they leave what the other curves of a panel need."""
    near = [line.get_ydata() for line in axes.lines if line.get_label() not in far]
    if not far or not near:
        return
    values = np.concatenate(near)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if low == high:  # nothing else moves there
        return
    low, high = low - 0.2 * (high - low), high + 0.2 * (high - low)
    axes.set_ylim(low, high)
    for line in (line for line in axes.lines if line.get_label() in far):
        drawn = np.asarray(line.get_ydata())
        least = 0.0 if min(map(np.nanmin, near)) >= 0 else low  # a norm leaves upwards
        inside = np.logical_and.accumulate((drawn >= least) & (drawn <= high))
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
            top = max(float(panel.dataLim.ymax) for panel in shared if panel.has_data())
            axes.set_ylim(floor, top * (top / floor) ** _MARGIN)


def _start_on_scale(axes: Axes) -> None:
    """Draw curves that start below a logarithmic scale, such as at 0, from where they enter it.

    Else a vertical line at the start would show nothing but the end of the scale.
    """
    floor = axes.get_ylim()[0]
    for line in axes.lines:
        values = np.asarray(line.get_ydata(), float)
        start = int(np.argmax(values >= floor))
        if (
            0 < start <= max(1, _USUAL * len(values))
        ):  # masked, so that its numbers stay the curve's
            line.set_ydata(np.ma.array(values, mask=np.arange(len(values)) < start))


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
    if axes.get_yscale() == "log":
        _start_on_scale(axes)
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
