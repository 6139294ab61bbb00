"""Curves with bands, and labels beside them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from eqt_cli.analysis.intervals import Resampling, intervals_of_means
from eqt_cli.base.arrays import Array
from eqt_cli.figures.labels import free_text
from eqt_cli.figures.layout import NO_NUMBERS, add_legend, add_letters, arrange
from eqt_cli.figures.shown import Ensemble
from eqt_cli.figures.style import Look, darker, ink, line_style

# Names beside curves and points where there is room, else in a legend; it knows no signal ---------


MOST_NAMED = 6
"""Most curves of a panel that are named directly."""
LONGEST = 14
"""Most characters of a name beside a curve."""
_PLACES = 33
"""Number of positions along a panel that are tried."""
_GAP, _PAD = 2.0, 1.5
"""Distance of a name from its curve, and its least distance from all curves, pt."""
_NEARER = 1.6
"""Least ratio of the distances of a name from the next curve and from its own."""
_STEP = 2.0
"""Distance between the points of a curve that a name must not hide, pt."""


Box = tuple[Array, Array]
"""Lower left and upper right corner of a name, pt."""


def name_curves(
    drawing: Figure, panels: Iterable[Axes], lines: Sequence[Line2D], names: Sequence[str]
) -> None:
    """Name each curve beside it, in the first panel with room; else in a legend above.

    Set the scales first, since the room depends on them.

    Parameters
    ----------
    panels
        Panels, each with the named curves first, in the order of the names.
    lines, names
        Handles for the legend, and texts of a user.
    """
    wanted = [free_text(name, LONGEST) for name in names]
    if 2 <= len(names) <= MOST_NAMED and all(len(name) <= LONGEST for name in names):
        add_letters(drawing)  # letters take room
        arrange(drawing)
        for panel in panels:
            if places := _places(panel, wanted):
                _write(panel, wanted, places)
                return
    add_legend(drawing, lines, names)


def _write(axes: Axes, names: Sequence[str], places: Sequence[Box]) -> None:
    to_data = axes.transData.inverted()
    for line, name, (low, high) in zip(axes.lines, names, places, strict=False):
        x, y = to_data.transform((low + high) / 2 * axes.figure.dpi / 72)
        look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": "small"}
        look["path_effects"] = [Stroke(linewidth=1.5, foreground=ink(0)), Normal()]
        axes.text(float(x), float(y), name, color=darker(str(line.get_color())), **look)


def _places(axes: Axes, names: Sequence[str]) -> list[Box]:
    """Return the places of all names; none if one finds no room."""
    if len(axes.lines) < len(names):
        return []
    curves = [_points(axes, line) for line in axes.lines]
    if any(not len(points) for points in curves[: len(names)]):
        return []
    places: list[Box] = []
    for index, name in enumerate(names):
        others = np.concatenate([*curves[:index], *curves[index + 1 :]])
        room = _size(axes, name) + 2 * max(map(_marked, axes.lines))
        place = _best(axes, curves[index], others, room, places)
        if place is None:
            return []
        places.append(place)
    return places


def _best(axes: Axes, curve: Array, others: Array, size: Array, taken: Sequence[Box]) -> Box | None:
    """Return the place beside a curve that is farthest from all others."""
    low, high = _points_of(axes, axes.bbox.get_points())
    best, farthest = None, -np.inf
    for x in np.linspace(low[0], high[0], _PLACES)[1:-1]:
        beside = curve[np.abs(curve[:, 0] - x) <= size[0] / 2 + _PAD]
        if not len(beside):
            continue
        for y in (beside[:, 1].max() + _GAP + size[1] / 2, beside[:, 1].min() - _GAP - size[1] / 2):
            middle = np.array([x, y])
            corner, opposite = middle - size / 2, middle + size / 2
            if (corner < low + _PAD).any() or (opposite > high - _PAD).any():
                continue
            if any((corner < end).all() and (start < opposite).all() for start, end in taken):
                continue
            away = _distance(others, corner, opposite)
            if away < _PAD or away < _NEARER * max(_distance(curve, corner, opposite), _GAP):
                continue
            if away > farthest:
                best, farthest = (corner, opposite), away
    return best


def _distance(points: Array, low: Array, high: Array) -> float:
    """Return the distance from a box to the nearest of some points."""
    if not len(points):
        return np.inf
    beyond = np.maximum(np.maximum(low - points, points - high), 0)
    return float(np.hypot(*beyond.T).min())


def _points(axes: Axes, line: Line2D) -> Array:
    """Return closely spaced visible points along a curve, pt."""
    with np.errstate(all="ignore"):
        corners = _points_of(axes, axes.transData.transform(np.column_stack(line.get_data())))
    corners = corners[np.isfinite(corners).all(axis=1)]
    if len(corners) < 2:
        return corners
    low, high = _points_of(axes, axes.bbox.get_points())
    corners = np.clip(corners, low - 1e4, high + 1e4)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    steps = np.linspace(0, along[-1], max(2, min(5000, int(along[-1] / _STEP))))
    points = np.column_stack([np.interp(steps, along, corners[:, k]) for k in (0, 1)])
    return points[((points >= low) & (points <= high)).all(axis=1)]


def _size(axes: Axes, name: str) -> Array:
    """Return width and height of a name, pt."""
    written = axes.text(0, 0, name, fontsize="small")
    box = Text.get_window_extent(written)
    written.remove()
    return _points_of(axes, np.array([box.width, box.height]))


def _marked(line: Line2D) -> float:
    """Return how far markers reach beyond a curve, pt."""
    return 0.0 if line.get_marker() in ("None", None, "", " ") else float(line.get_markersize()) / 2


def _points_of(axes: Axes, pixels: Array) -> Array:
    return pixels * 72 / axes.figure.dpi


_BESIDE: dict[str, Any] = {"xytext": (4, 3), "textcoords": "offset points", "fontsize": "small"}


def name_points(axes: Axes, points: Array, texts: Sequence[str], colours: Sequence[str]) -> None:
    """Write a text above and right of every point; one that would hide another is left out.

    Set scales and legends first, since the room depends on them.

    Parameters
    ----------
    points : (points, 2)
        Points that the texts name.
    """
    assert isinstance(axes.figure, Figure)
    arrange(axes.figure)
    written: list[Bbox] = []
    for (x, y), text, colour in zip(points.tolist(), texts, colours, strict=True):
        name = axes.annotate(text, (x, y), color=colour, **_BESIDE)
        box = name.get_window_extent()
        if box.count_overlaps(written) or axes.bbox.count_contains(box.corners()) < 4:
            name.remove()
        else:
            written.append(box)


# Curves shared by several figures: bands, single runs, paths; it knows no signal ------------------


BAND = (0.1, 0.9)
"""Quantiles over runs at the edges of a band."""

RESAMPLING = Resampling(confidence=0.95, resamples=2000)
"""Bootstrap settings of bands around means."""

THIN = 0.35
"""Line width of a single run, pt."""

_PATH = 0.6
"""Line width of a path, pt."""

_ARROWS = (0.2, 0.55)
"""Positions of the arrows on a path, in shares of its length."""
_ARROW: dict[str, Any] = {
    "arrowstyle": "-|>,head_length=0.35,head_width=0.18",
    "linewidth": 0,
    "mutation_scale": 10,
    "shrinkA": 0,
    "shrinkB": 0,
}
_DARKEST, _FAINT = 3.0, 0.5
"""Share of runs that would give a cell the full colour: above 1, so that paths stay visible on it;
and the exponent of the colour scale, which makes few runs visible."""
_FINER = 4
"""Points per sample of a path whose cells are counted."""

Path = tuple[Array, Array]
"""Horizontal and vertical coordinates of the samples."""

_POINTS: dict[str, Any] = {"markersize": 4.5, "markerfacecolor": "none"}
"""Style of hollow markers, all visible where curves coincide."""

_DOT: dict[str, Any] = {"linestyle": "none", "marker": "o"}
_START = _DOT | {"markersize": 2.2, "markeredgewidth": 0.5}
_END = _DOT | {"markersize": 1.8, "markeredgewidth": 0}

Bands = Literal["none", "quantiles", "bootstrap"]
"""Kinds of bands: ``quantiles`` from 10 % to 90 % of the runs; ``bootstrap``, the 95 % confidence
interval of the population mean at each time."""

BAND_NAMES: dict[Bands, str] = {
    "quantiles": "10–90 % of runs",
    "bootstrap": "95 % interval of the mean",
}


def of_bands(bands: Bands) -> str:
    """Return words for the bands, as the end of a sentence; empty where there are none."""
    return f"; bands: {BAND_NAMES[bands]}" if bands in BAND_NAMES else ""


def draw_band(
    axes: Axes, times: Array, values: Array, bands: Bands, colour: str, name: str
) -> None:
    """Shade a band around the mean over runs of values ``(runs, samples)``."""
    if bands == "quantiles":
        low, high = np.quantile(values, BAND, axis=0)
    elif bands == "bootstrap":
        means = intervals_of_means(values, RESAMPLING)
        low, high = means.low, means.high
    else:
        return
    axes.fill_between(times, low, high, label=name, **band_look(colour))


def draw_mean(axes: Axes, times: Array, values: Array, bands: Bands, ensemble: Ensemble) -> None:
    """Draw the mean over runs of values ``(runs, samples)``, and the band around it."""
    look = line_style(ensemble.look)
    axes.plot(times, values.mean(axis=0), label=ensemble.label, **look)
    draw_band(axes, times, values, bands, look["color"], ensemble.label)


def draw_points(
    axes: Axes, across: Array, up: Array, band: tuple[Array, Array], of: Look, title: str
) -> list[Line2D]:
    """Draw a curve with a hollow marker at every point, and the band around it."""
    look = line_style(of)
    axes.fill_between(across, *band, label=title, **band_look(look["color"]))
    return axes.plot(across, up, label=title, marker=of.marker, **_POINTS, **look)


def band_look(colour: str) -> dict[str, Any]:
    """Return the style of a band: a tint, with edges that tell overlapping bands apart."""
    return {"facecolor": (colour, 0.1), "edgecolor": (colour, 0.8), "linewidth": 0.35}


def thin_line(look: Look, count: int) -> dict[str, Any]:
    """Return the line style of one of `count` single runs of a controller."""
    opacity = min(0.8, 4 / np.sqrt(count))  # few lines are visible, many make shades
    return {"color": (look.colour, opacity), "linewidth": THIN}


def thin_line_legend(shown: Sequence[Ensemble], most: int) -> dict[str, Artist]:
    """Return a legend handle by name, where at most `most` good runs are drawn."""
    runs = max(np.count_nonzero(ensemble.good) for ensemble in shown)
    name = "single runs" if runs <= most else f"first {most} runs"
    return {name: Line2D([], [], color=ink(0.5), linewidth=2 * THIN)}


def draw_paths(axes: Axes, paths: Mapping[int, Path], ensemble: Ensemble) -> None:
    """Draw paths with arrows, a hollow dot at each start and a filled one at each end.

    Parameters
    ----------
    paths
        Paths by number of the run; NaN leaves a gap, but must not be at the ends.
    """
    look = thin_line(ensemble.look, len(paths)) | {"linewidth": _PATH}
    for number, (x, y) in paths.items():
        axes.plot(x, y, label=f"run {number}", **look)
        for place in _ARROWS:
            _draw_arrow(axes, x, y, place, look["color"][0])
    start = _start(look["color"][0])
    for name, at, dot in (("start", 0, start), ("end", -1, {"color": ink(), **_END})):
        ends = [(x[at], y[at]) for x, y in paths.values()]
        axes.plot(*zip(*ends, strict=True), label=name, **dot)


def _draw_arrow(axes: Axes, x: Array, y: Array, place: float, colour: str) -> None:
    """Draw an arrow along a path, at a share of its length."""
    steps = np.nan_to_num(np.hypot(np.diff(x), np.diff(y)))
    along = np.cumsum(steps)
    at = int(np.searchsorted(along, place * along[-1]))
    ends = [(float(x[k]), float(y[k])) for k in (at, min(at + 1, len(x) - 1))]
    if np.isfinite(ends).all() and ends[0] != ends[1]:
        axes.annotate("", ends[1], ends[0], arrowprops=_ARROW | {"color": colour})


def draw_density(axes: Axes, paths: Sequence[Path], edges: tuple[Array, Array], look: Look) -> None:
    """Shade the cells that paths cross, darker for more paths."""
    visits = np.zeros([len(edge) - 1 for edge in edges])
    for path in paths:
        across, up = _between(path)
        visits += np.histogram2d(across, up, bins=list(edges))[0] > 0
    shades = LinearSegmentedColormap.from_list("", [ink(0), look.colour])
    norm = PowerNorm(_FAINT, vmin=0, vmax=_DARKEST)
    seen = np.ma.masked_equal(visits.T / max(len(paths), 1), 0)
    cells: dict[str, Any] = {"cmap": shades, "norm": norm, "zorder": 0.4, "linewidth": 0}
    axes.pcolormesh(*edges, seen, label=NO_NUMBERS, rasterized=True, **cells)


def _between(path: Path) -> list[Array]:
    """Return a path refined between its samples, so that it skips no cell."""
    x, y = (np.asarray(each, float) for each in path)
    fine = np.linspace(0, len(x) - 1, _FINER * (len(x) - 1) + 1)
    return [np.nan_to_num(np.interp(fine, np.arange(len(x)), each), nan=-np.inf) for each in (x, y)]


def _start(colour: Any) -> dict[str, Any]:
    return _START | {"markeredgecolor": colour, "markerfacecolor": ink(0)}


def path_legend(shown: Sequence[Ensemble], most: int, *, density: bool) -> dict[str, Artist]:
    """Return legend handles by name, where at most `most` good runs are drawn."""
    shade = {"where runs pass": Patch(facecolor=ink(0.25), linewidth=0)} if density else {}
    return {
        **thin_line_legend(shown, most),
        "start": Line2D([], [], **_start(ink(0.7))),
        "end": Line2D([], [], color=ink(), **_END),
        **shade,
    }
