"""Figures of where a body went: paths in space and on the sphere, and its pose over time."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Count, CountOrNone
from eqt_cli.components.groups import MatrixLieGroup, Part, moving_parts
from eqt_cli.extensions.paths.coloured import add_bar, draw_by_error, shades_of
from eqt_cli.figures import layout
from eqt_cli.figures.cells import even
from eqt_cli.figures.figure import OverTime, ShownRuns, first_laws, keep_laws
from eqt_cli.figures.labels import component, in_words, part_curves, quantity, symbols
from eqt_cli.figures.layout import THIN, cut_off, leaving, open_frame, thin_line
from eqt_cli.figures.many_laws import by_late_mean, draw_laws
from eqt_cli.figures.shapes import camera, course, outline, upright
from eqt_cli.figures.shown import MOST_COLOURS, Ensemble, looks
from eqt_cli.figures.style import WIDTHS, Width, ink, line_style, mixed

# Figure of paths, in planes, in space, or of an axis on the sphere --------------------------------

View = Literal["", "xy", "xz", "yz", "planes", "space", "sphere"]

_FLAT = 0.02
"""A motion whose extent along an axis is a smaller share of its largest one lies in a plane."""
_LEAST_MOTION = 1e-3
"""A reference that moves by a smaller share of the extent is drawn as a cross."""
_LEAST = 0.3
"""Least extent of a panel, as a share of the largest."""
_MARGIN, _OBLIQUE, _GLOBE = 0.06, 0.17, 2.4
"""Room around paths in a plane and, for the numbers around them, in an oblique view, in their
largest extents; and extent of a panel over the radius of a sphere."""
_WIDER = 1.6
"""Most that a panel is wider than its paths need."""
_TALLEST = {"column": (4.0, 6.5), "page": (4.6, 6.5), "slide": (2.5, 2.9)}
"""Largest height of all panels together, of a law or two and of more laws, in."""
_ASIDE, _GAP, _ABOVE, _BELOW = 0.4, 0.08, 0.15, 0.42
"""Room for numbers beside a panel, between panels, for a title, and below all panels, in."""
_MOST_SPHERES: dict[Width, int] = {"column": 8, "page": 16, "slide": 12}
"""Most laws with a sphere each."""
_MOST_TURNS = 2.0
"""Most turns around the sphere that a path can be followed through."""
_MANY = 10
"""Most runs of a single law that are drawn by default."""
_BODY = 0.045
"""Length of a body's axes, in extents of the paths."""
_LINE, _PALE, _BEHIND, _FINE = 0.9, 0.3, 0.3, 0.35
"""Line width of a single path, pt; shares of ink in the reference, and of colour in what is on the
far side of the sphere; line width of a grid, pt."""
_STEEPEST, _TURNED, _GRID = np.deg2rad(55), np.deg2rad(25), np.deg2rad(30)
"""Greatest height from which a sphere is seen, the turn of the eye from the paths, and the angle
between the lines on the sphere, rad."""
_AXES = "xyz"
_GREY = 0.05
"""Largest difference between the channels of a grey."""


class Flown(NamedTuple):
    """The paths of a law: in space, or of the tip of a body axis on the sphere.

    Attributes
    ----------
    law
        The law.
    rotation : (runs, samples, 3, 3)
        Body to inertial frame.
    places : (runs, samples, 3)
        What is drawn of each run.
    desired : (samples, 3)
        The same of the reference.
    """

    law: Ensemble
    rotation: Array
    places: Array
    desired: Array


@dataclass(frozen=True)
class PathFigure(OverTime):
    """Where the bodies went, with the reference: paths in space, or of a body axis on the sphere.

    All scales of a figure are equal. A ring is a start, a dot an end. A panel for each law is drawn
    of several runs, and on the sphere.

    Attributes
    ----------
    view
        ``xy``, ``xz`` or ``yz``; ``planes``: x–y and x–z; ``space``: obliquely from above, with the
        shadow of the reference; ``sphere``: where a body axis points, pale on the far side.
        Default: the plane of all paths, else ``planes``; without positions ``sphere``, or the angle
        from the reference over time where a path winds around it more than twice.
    axis
        Body axis of ``sphere``. Default: the axis of `task: point`, else ``z``.
    error
        On the sphere, where the attitude error R_E = R R_dᵀ takes the axis.
    runs
        Most runs of each law. Default: one of several laws, ten of a single law.
    bodies
        Number of bodies along the first path of each law, at equal time intervals.
    colour
        ``error`` colours a path by its distance from the reference at the same time, on the sphere
        by the angle between the two axes, with a bar; each law then has a panel. Default: by law.
    """

    name: ClassVar[str] = "path"

    view: View = ""
    axis: Literal["", "x", "y", "z"] = ""
    error: bool = False
    runs: Count | None = None
    bodies: CountOrNone = 0
    colour: Literal["law", "error"] = "law"

    def check(self, problems: Problems) -> None:
        """Refuse bodies on the sphere, and errors in space."""
        if self.bodies and self.view == "sphere":
            problems.at("bodies").add("belongs to paths of positions; view sphere has none")
        if self.error and self.view not in ("", "sphere"):
            problems.at("error").add(f"belongs to view sphere, got view {self.view}")

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw all laws together, or a panel for each."""
        view = self._view(runs)
        unit, factor = runs.results[0].shown_in("", "m")
        paths = self._paths(runs, view, factor)
        if self._winds(view, paths):
            return self._over_time(runs, width, paths)
        most = _MOST_SPHERES[width] if view == "sphere" else _most_together(runs)
        laws = {law.label: law for law in _best_laws(runs, most)}
        paths = [p._replace(law=laws[p.law.label]) for p in paths if p.law.label in laws]
        away = {
            path.law.label: np.linalg.norm(path.places - path.desired, axis=-1).max(axis=0)
            for path in paths
        }
        far = leaving(runs, [away]) if view != "sphere" else []
        near = [x.reshape(-1, 3) for p in paths if p.law.label not in far for x in p[2:]]
        places = np.concatenate(near)
        ends = np.array([np.nanmin(places, axis=0), np.nanmax(places, axis=0)])
        extent = float(np.max(ends[1] - ends[0]))
        low, high = ends[0] - _MARGIN * extent, ends[1] + _MARGIN * extent
        for k, path in enumerate(paths):
            inside = ((path.places >= low) & (path.places <= high)).all(axis=-1, keepdims=True)
            inside = np.logical_and.accumulate(inside, axis=1)
            paths[k] = path._replace(places=np.where(inside, path.places, np.nan))
        view = view or _plane(ends)
        views = ("xy", "xz") if view == "planes" else (view,)
        eyes = {name: _eye(name, places) for name in views}
        shades = shades_of([errors_of(path, view) for path in paths])
        many = max(len(path.places) for path in paths) > 1
        by_error = self.colour == "error"
        apart = len(paths) > 1 and (many or view == "sphere" or by_error)
        signs = np.diag(upright(runs.results[0]))
        if len({one.described.down for one in runs.results}) > 1:
            raise runs.error("draws a last axis up or down; show these results by themselves")
        drawing, panels = _sheet(width, eyes, len(paths) if apart else 1, ends, unit, signs)
        for number, path in enumerate(paths):
            behind = apart or path.law in _one_of_each(runs.shown)
            for name, eye in eyes.items():
                axes = panels[f"{name} {number if apart else 0}"]
                self._draw_path(axes, eye, path, name, ends, many=many, behind=behind)
                if by_error:
                    draw_by_error(axes, eye, path.places, errors_of(path, view), shades, name)
            if apart:
                top = panels[f"{views[0]} {number}"]
                layout.add_title(top, path.law.title)
        handles = {} if apart or by_error else _laws(runs, linewidth=_LINE)
        if by_error:
            add_bar(drawing, [*panels.values()], shades, "" if view == "sphere" else unit)
        elif apart:
            name = "single runs" if many else "run"
            handles[name] = Line2D([], [], color=ink(0.6), linewidth=2 * THIN if many else _LINE)
        rests = all(_rests(path, ends) for path in paths)
        handles["reference"] = Line2D([], [], **_reference(many, rests=rests))
        handles |= {name: Line2D([], [], **dot) for name, dot in _ends(ink(0.7))}
        layout.add_legend(drawing, list(handles.values()), list(handles))
        turned = "under the error $R_\\mathrm{E}$" if self.error else "in space"
        what = (
            f": the body axis {self._axis(runs)[0]} {turned}, pale behind"
            if view == "sphere"
            else ""
        )
        what = "; on the ground, the shadow of the reference" if view == "space" else what
        runs.remarks.append(f"{_which(paths)}{what}.")
        return drawing

    def _view(self, runs: ShownRuns) -> str:
        """Return the view; empty for planes to choose from the data. Refuse what there is not."""
        G = runs.known_group()
        turning, moving = moving_parts(G)
        placed = moving is not None and moving.entries[0].stop - moving.entries[0].start > 1
        spatial = turning is not None and turning.entries[0].stop - turning.entries[0].start == 3
        view = self.view or ("" if (placed and not self.error) or not spatial else "sphere")
        if view == "sphere" and not spatial:
            raise runs.error(f"shows rotations in space on the sphere, and {G.name} has none")
        if view != "sphere" and not placed:
            raise runs.error(
                f"shows positions in a plane or in space, and {G.name} has none; figure 'pose' "
                "shows its coordinates over time"
            )
        if view == "sphere" and self.bodies:
            raise runs.error("draws bodies at positions; leave out the option 'bodies'")
        return view

    def _over_time(self, runs: ShownRuns, width: Width, paths: Sequence[Flown]) -> Drawing:
        """Draw the angle between the body axis and the axis of the reference over time."""
        axis, which = self._axis(runs)[0], _which(paths)
        winds = "which winds too often for a sphere; view=sphere draws it"
        runs.remarks.append(f"{which}: the body axis {axis}, {winds}.")
        plain = "the axis" if "$" not in axis else f"body axis {self.axis or 'z'}"
        runs.note = f"{which.lower()}: {plain} from the reference, too many turns for a sphere"
        what = "The angle between a body axis and the axis of the reference over time"
        if len(paths) > _most_together(runs):
            angles = {path.law.label: errors_of(path, "sphere") for path in paths}
            drawing = draw_laws(runs, width, in_words("angle", "deg"), values=angles)
            drawing.set_label(f"{what}, a panel for each law; grey: the others.")
            return drawing
        drawing, panels = layout.sheet(width, [["angle"]], runs.span, runs.unit("time"))
        for path in paths:
            of_runs, look = errors_of(path, "sphere"), line_style(path.law.look)
            look = thin_line(path.law.look, len(of_runs)) if len(of_runs) > 1 else look
            for angles in of_runs:
                panels["angle"].plot(runs.times(path.law), angles, label=path.law.label, **look)
        layout.open_frame(panels["angle"])
        layout.name_scale(panels["angle"], in_words("angle", "deg"))
        handles = _laws(runs)
        layout.add_legend(drawing, list(handles.values()), list(handles))
        drawing.set_label(f"{what}.")
        return drawing

    def _paths(self, runs: ShownRuns, view: str, factor: float) -> list[Flown]:
        """Return the paths of all laws."""
        most = self.runs or (1 if len(runs.shown) > 1 else _MANY)
        return [self._flown(runs, law, view, most, factor) for law in runs.shown]

    def _winds(self, view: str, paths: Sequence[Flown]) -> bool:
        """Whether a path winds around a sphere that nobody asked for too often to be followed."""
        is_asked = self.view or self.colour == "error"
        return view == "sphere" and not is_asked and max(map(_turns, paths)) > _MOST_TURNS

    def _axis(self, runs: ShownRuns) -> tuple[str, Array]:
        """Return the body axis of the sphere, with its name."""
        pointing = None if self.axis else runs.results[0].described.axis
        name = "that points" if pointing else f"$e_{self.axis or 'z'}$"
        return name, np.array(pointing or np.eye(3)[_AXES.index(self.axis or "z")])

    def _flown(self, runs: ShownRuns, law: Ensemble, view: str, most: int, factor: float) -> Flown:
        """Return the paths of the first runs of a law."""
        parts, axis = moving_parts(runs.known_group()), self._axis(runs)[1]
        poses = runs.values("pose", law, most), runs.desired("pose", law)
        frame = upright(law.results) if view == "space" else None
        actual, desired = (course(pose, *parts, frame) for pose in poses)
        if view == "sphere":
            R, Rd = actual[0], desired[0]
            if self.error:
                back = Rd.swapaxes(-1, -2)
                R, Rd = R @ back, Rd @ back
            return Flown(law, R, R @ axis, Rd @ axis)
        return Flown(law, actual[0], factor * actual[1], factor * desired[1])

    def _draw_path(
        self, axes: Axes, eye: Array, of: Flown, view: str, ends: Array, *, many: bool, behind: bool
    ) -> None:
        """Draw the paths of a law with ends and bodies, the reference `behind` them if wanted."""
        if behind:
            look = _reference(many, rests=_rests(of, ends))
            _draw(axes, eye, [of.desired], "desired", look, view)
        if behind and view == "space":
            ground = of.desired * [1, 1, 0] + ends[0] * [0, 0, 1]
            _draw(axes, eye, [ground], "shadow", {"color": ink(_PALE), "linewidth": 0.5})
        look = line_style(of.law.look) | {"linewidth": _LINE}
        if view == "sphere":  # alone in its panel, over a grey reference
            is_grey = np.ptp(to_rgb(of.law.look.colour)) < _GREY
            look |= {"linestyle": "-"} | ({"color": ink()} if is_grey else {})
        look = thin_line(of.law.look, len(of.places)) if many else look
        if self.colour == "error":  # the line itself has the numbers, and no ink
            look["linestyle"] = "none"
        _draw(axes, eye, of.places, of.law.label, look, view)
        seen = of.places @ eye.T
        colour = ink(0.7) if self.colour == "error" else of.law.look.colour
        for (label, dot), at in zip(_ends(colour), (0, -1), strict=True):
            axes.plot(seen[:, at, 0], seen[:, at, 1], label=label, **dot)
        self._draw_bodies(axes, eye, of, _BODY * float(np.max(ends[1] - ends[0])))

    def _draw_bodies(self, axes: Axes, eye: Array, of: Flown, length: float) -> None:
        """Draw outlines along the first path, what is nearer to the eye over what is behind."""
        look: dict[str, Any] = {"edgecolor": of.law.look.colour, "linewidth": 0.4, "zorder": 3}
        look["facecolor"] = mixed(of.law.look.colour, ink(0), 0.25)
        at = np.linspace(0, of.places.shape[1] - 1, self.bodies).round().astype(int)
        for rotation, place in zip(of.rotation[0, at], of.places[0, at], strict=True):
            if np.isfinite(place).all():
                faces = [place + length * face @ rotation.T for face in outline(of.law.results)]
                faces = sorted((face @ eye.T for face in faces), key=lambda face: face[:, 2].mean())
                shapes = [face[:, :2] for face in faces]
                axes.add_collection(PolyCollection(shapes, label=layout.NO_NUMBERS, **look))


def errors_of(of: Flown, view: str) -> Array:
    """Return the distance of paths from the reference, or on the sphere the angle, deg."""
    distance: Array = np.linalg.norm(of.places - of.desired, axis=-1)
    return np.rad2deg(2 * np.arcsin(np.minimum(distance / 2, 1))) if view == "sphere" else distance


def _turns(path: Flown) -> float:
    """Return the length of the longest path on the sphere, in turns around it."""
    steps = np.linalg.norm(np.diff(path.places, axis=1), axis=-1)
    return float(np.nansum(steps, axis=-1).max() / (2 * np.pi))


def _laws(runs: ShownRuns, **look: Any) -> dict[str, Artist]:
    """Return a legend handle of each law by its title."""
    return {e.title: Line2D([], [], **(line_style(e.look) | look)) for e in runs.shown}


def _ends(colour: Any) -> list[tuple[str, dict[str, Any]]]:
    """Return names and styles of the ends of a path: a ring, and a dot."""
    point: dict[str, Any] = {"linestyle": "none", "marker": "o"}
    ring = point | {"markersize": 2.2, "markeredgewidth": 0.5}
    ring |= {"markeredgecolor": colour, "markerfacecolor": ink(0)}
    dot = point | {"markersize": 1.8, "markeredgewidth": 0, "color": ink()}
    return [("start", ring), ("end", dot)]


def _rests(of: Flown, ends: Array) -> bool:
    """Whether a reference stays where it is."""
    return bool(np.ptp(of.desired, axis=0).max() < _LEAST_MOTION * np.ptp(ends, axis=0).max())


def _reference(over: bool = False, *, rests: bool = False) -> dict[str, Any]:
    """Return the style of the reference: pale and broad, or dark over many runs; or a cross."""
    if rests:
        cross = {"marker": "+", "markersize": 9, "markeredgewidth": 1.2, "markevery": [-1]}
        return {"color": ink(0.6), "linestyle": "", "zorder": 1.5, **cross}
    if over:
        return {"color": ink(), "linewidth": 0.8, "zorder": 2.5}
    return {"color": ink(_PALE), "linewidth": 2.2, "zorder": 1.5}


def _one_of_each(laws: Sequence[Ensemble]) -> list[Ensemble]:
    """Return the first law of each result, whose reference is drawn."""
    return [law for k, law in enumerate(laws) if law.results not in [e.results for e in laws[:k]]]


def _plane(ends: Array) -> str:
    """Return the plane of two axes in which all places lie; ``planes`` if there is none."""
    extent = np.ptp(ends, axis=0)
    across = int(extent.argmin())
    if extent[across] > _FLAT * extent.max():
        return "planes"
    return _AXES.replace(_AXES[across], "")


def _eye(view: str, places: Array) -> Array:
    """Return the axes of a view as rows: right, up, and towards the eye, ``(3, 3)``."""
    if view == "space":
        return camera()
    if view == "sphere":
        x, y, z = np.nanmean(places, axis=0)
        height = np.clip(np.arctan2(z, np.hypot(x, y)), -_STEEPEST, _STEEPEST)
        return camera(float(height), float(np.arctan2(y, x)) + _TURNED)
    right, up = (np.eye(3)[_AXES.index(axis)] for axis in view)
    return np.stack([right, up, np.cross(right, up)])


def _sheet(
    width: Width, eyes: Mapping[str, Array], laws: int, ends: Array, unit: str, signs: Array
) -> tuple[Drawing, dict[str, Axes]]:
    """Return a figure of panels to one scale, by view and number of the column of laws.

    `signs` are those of the axes of space, where the last one is drawn upwards.
    """
    boxes = {layout.EMPTY: np.zeros((2, 2)), "sphere": np.array([[-0.5], [0.5]]) * [_GLOBE, _GLOBE]}
    corners = np.array([[ends[k][n] for n, k in enumerate(of)] for of in np.ndindex(2, 2, 2)])
    extent = float(np.ptp(ends, axis=0).max()) or 1.0
    for view in (view for view in eyes if view != "sphere"):
        seen = corners @ eyes[view][:2].T
        margin = _OBLIQUE if view == "space" else _MARGIN
        half = np.maximum(np.ptp(seen, axis=0) / 2 + margin * extent, _LEAST * extent / 2)
        boxes[view] = (seen.min(axis=0) + seen.max(axis=0)) / 2 + np.array([-half, half])
    mosaic = [[f"{view} {k}" for k in range(laws)] for view in eyes]
    if len(eyes) == 1:
        # On a slide, the laws have at most three rows.
        columns = {"column": 2, "page": 4, "slide": max(4, -(-laws // 3))}[width]
        mosaic = layout.rows_of(mosaic[0], columns // (2 if "space" in eyes else 1))
    elif laws > 2 if width == "column" else laws == 1:  # a row per law
        mosaic = [list(row) for row in zip(*mosaic, strict=True)]
    sizes = np.array([[np.ptp(boxes[name.split()[0]], axis=0) for name in row] for row in mosaic])
    wide, high = sizes[..., 0].max(axis=0), sizes[..., 1].max(axis=1)
    labelled = {name.split()[0] for name in mosaic[0]} - {layout.EMPTY}
    room = WIDTHS[width] - _ASIDE * len(labelled) - _GAP * len(wide)
    inches = min(room / wide.sum(), _TALLEST[width][laws > 2] / high.sum())
    wide = wide * min(room / (inches * wide.sum()), _WIDER)
    tall = (inches * high.sum() + _BELOW) / len(high) + _ABOVE
    ratios = {"width_ratios": wide.tolist(), "height_ratios": high.tolist()}
    drawing, panels = layout.blank_sheet(width, mosaic, tall, **ratios)
    drawing.set_figheight(tall * len(high))
    for name, axes in panels.items():
        view = name.split()[0]
        r, c = next((r, row.index(name)) for r, row in enumerate(mosaic) if name in row)
        half, middle = np.array([wide[c], high[r]]) / 2, boxes[view].mean(axis=0)
        (left, bottom), (right, top) = middle - half, middle + half
        axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
        if view == "sphere":
            _draw_sphere(axes, eyes[view])
        elif view == "space":
            _draw_room(axes, eyes[view], ends, unit, signs)
        else:
            lower = mosaic[r + 1][c] if r + 1 < len(mosaic) else layout.EMPTY
            first = c == 0 or mosaic[r][c - 1].split()[0] != view
            axes.xaxis.set_major_locator(even())
            axes.yaxis.set_major_locator(even())
            axes.tick_params(labelbottom=lower[0] != view[0], labelleft=first)
            axes.set_xlabel(quantity(view[0], unit) if lower[0] != view[0] else "")
            down = bool(view[1] == "z" and signs[2] < 0)
            layout.name_scale(
                axes, quantity(view[1], unit) + (", down" if down else "") if first else ""
            )
            if down:
                axes.invert_yaxis()
            open_frame(axes)
    return drawing, panels


def _draw(
    axes: Axes, eye: Array, of: Iterable[Array], name: str, look: dict[str, Any], view: str = ""
) -> None:
    """Draw paths ``(samples, 3)`` as the eye sees them; on the sphere, the far side pale."""
    for number, path in enumerate(of):
        x, y, depth = (path @ eye.T).T
        label = f"{name} {number}"
        if view != "sphere":
            axes.plot(x, y, label=label, **look)
            continue
        pale = look | {"color": mixed(look["color"], ink(0), _BEHIND), "zorder": 1}
        for side, style, shown in (("", look, depth >= 0), (", far side", pale, depth < 0)):
            shown = shown | np.append(shown[1:], False)  # so that the two sides meet
            seen = (np.where(shown, coordinate, np.nan) for coordinate in (x, y))
            axes.plot(*seen, label=f"{label}{side}", **style)


def _draw_sphere(axes: Axes, eye: Array) -> None:
    """Draw the rim, circles of latitude and longitude, and the inertial axes."""
    axes.set_axis_off()
    axes.add_patch(Circle((0, 0), 1, fill=False, edgecolor=ink(), linewidth=0.6))
    turn = np.linspace(0, 2 * np.pi, 121)
    along, across, level = np.cos(turn), np.sin(turn), np.zeros_like(turn)
    lines = [
        np.stack([np.cos(at) * along, np.cos(at) * across, level + np.sin(at)], axis=-1)
        for at in np.arange(-2, 3) * _GRID
    ]
    lines += [
        np.stack([np.cos(at) * along, np.sin(at) * along, across], axis=-1)
        for at in np.arange(6) * _GRID
    ]
    seen = np.array(lines) @ eye.T
    near = np.where(seen[..., 2:] >= 0, seen[..., :2], np.nan)
    grid: dict[str, Any] = {"color": ink(_PALE), "linewidth": _FINE, "zorder": 0.5}
    axes.add_collection(LineCollection(list(near), label=layout.NO_NUMBERS, **grid))
    for name, (x, y, depth) in zip(_AXES, eye.T, strict=True):
        colour = ink() if depth >= 0 else ink(0.45)
        axes.plot([x, 1.1 * x], [y, 1.1 * y], color=colour, linewidth=0.6, label=f"axis {name}")
        axes.text(1.17 * x, 1.17 * y, f"${name}$", ha="center", va="center", color=colour)
    axes.set(xlabel="right", ylabel="up")  # hidden, but names the numbers behind the figure


def _draw_room(axes: Axes, eye: Array, ends: Array, unit: str, signs: Array) -> None:
    """Draw the ground with numbers along its near edges, and heights on the walls behind."""
    axes.set_axis_off()
    low, high = ends
    extent = float(np.max(high - low))
    x, y, z = np.eye(3)
    gap, lines = 0.06 * extent, []
    step = float(np.diff(MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(0, extent))[0])
    edges = [(high * y + low * z, y), (high * x + low * z, x), (high * x + low * y, -y)]
    for k, (edge, out) in enumerate(edges):
        axis = np.eye(3)[k]
        for at in step * np.arange(np.ceil(low[k] / step), np.floor(high[k] / step) + 1):
            place = edge + at * axis
            corners = [place, place + (low - high) * (y if k == 0 else x)]
            corners += [corners[1] + (high - low) * y] if k == 2 else []
            lines.append(np.array(corners) @ eye[:2].T)
            across, up = eye[:2] @ (place + gap * out)
            text = f"{signs[k] * at + 0.0:.4g}".replace("-", "−")
            axes.text(across, up, text, ha="center", va="center", fontsize="small")
        across, up = eye[:2] @ (edge + (low[k] + high[k]) / 2 * axis + 3.4 * gap * out)
        axes.text(across, up, quantity(_AXES[k], unit), ha="center", va="center")
    grid: dict[str, Any] = {"color": ink(_PALE), "linewidth": _FINE, "zorder": 0.5}
    axes.add_collection(LineCollection(lines, label=layout.NO_NUMBERS, **grid))
    axes.set(xlabel="right", ylabel="up")


# Figure of the pose of one run, component by component, and its errors ----------------------------


_STEP = 2.0
"""A line of angles breaks where one changes by more from sample to sample: a turn, rad."""
_LARGE, _BEYOND = 0.1, 1.2
"""Share of its largest value below which an error has settled, and how much more than the time
until then is shown."""
_PARTS = 0.1, 0.2, 0.3, 0.4, 0.5
"""Parts of the horizon that may be shown alone."""
_STEEP = 80.0
"""Pitch beyond which roll and yaw turn more than 1/cos 80° = 6 times faster than the body, deg."""


@dataclass(frozen=True)
class PoseFigure(OverTime):
    """The pose over time in one run, with the reference, component by component, and the errors.

    A column per part of the group. Angles are those of the turns about z, y and x, in this order,
    from −180 to 180 deg. Where a pitch comes near ±90 deg, at which roll and yaw are undefined, the
    rotation vector of the error R_E is drawn instead. Lines break where they jump. Where all errors
    fall below a tenth in the first half, the rest is left out, unless a range of time is chosen.

    Attributes
    ----------
    run
        Number of the run.
    """

    name: ClassVar[str] = "pose"

    run: CountOrNone = 0

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a row per component and, beneath, one of the errors."""
        G = runs.known_group()
        _best_laws(runs, _most_together(runs))
        parts = sorted(G.parts, key=lambda part: part.turns)
        units = {part.name: "deg" if part.turns else part.pose_unit for part in parts}
        shown_in = {name: runs.results[0].shown_in("", unit) for name, unit in units.items()}
        ends = {part.name: f"_{part.name}" if len(parts) > 1 else "" for part in parts}
        errors = {
            x: runs.drawn_signal(f"pose_error{y}") for x, y in ends.items() if y in runs.parts
        }
        drawn = self._errors(runs, errors)
        far = leaving(runs, drawn.values())
        _shorten(runs, [of[e] for of in drawn.values() for e in of if e not in far])
        drawn = self._errors(runs, errors)
        poses = {e.label: runs.of_run("pose", e, self.run) for e in runs.shown}
        desired = {e.label: runs.desired("pose", e) for e in runs.shown}
        near = [poses[e.label] for e in runs.shown if e.label not in far] + [*desired.values()]
        steep = {part.name for part in parts if part.turns and _is_steep(part, near)}
        names = {x.name: _coordinates(G, x, shown_in[x.name][0], steep) for x in parts}
        mosaic = [
            [f"{name} {k}" if k < len(of) else layout.EMPTY for name, of in names.items()]
            for k in range(max(map(len, names.values())))
        ]
        if errors:
            mosaic.append([f"{name} error" if name in errors else layout.EMPTY for name in names])
        if len(parts) == 1 and width != "column":
            mosaic = layout.rows_of([name for (name,) in mosaic], 2)
        drawing, panels = layout.sheet(width, mosaic, runs.span, runs.unit("time"))
        for part, e in product(parts, runs.shown):
            frame = desired[e.label] if part.name in steep else None
            of_reference = shown_in[part.name][1] * _values(G, part, desired[e.label], frame)
            values = shown_in[part.name][1] * _values(G, part, poses[e.label], frame)
            for k, label in enumerate(names[part.name]):
                axes, times = panels[f"{part.name} {k}"], runs.times(e)
                if e in _one_of_each(runs.shown):
                    axes.plot(times, of_reference[:, k], label="desired", **_reference())
                axes.plot(times, values[:, k], label=e.label, **line_style(e.look))
                layout.name_scale(axes, label)
        for (name, signal), e in product(errors.items(), runs.shown):
            axes, of = panels[f"{name} error"], drawn[name][e.label]
            layout.name_scale(axes, runs.error_label(signal, degrees=True))
            axes.plot(runs.times(e), of, label=e.label, **line_style(e.look))
        for name, axes in panels.items():
            open_frame(axes)
            cut_off(axes, far)
            if name.endswith(" error"):
                axes.set_ylim(bottom=0)
        handles = _laws(runs) | {"reference": Line2D([], [], **_reference())}
        layout.add_legend(drawing, list(handles.values()), list(handles))
        why = f"as a pitch comes within {90 - _STEEP:g} deg of ±90 deg"
        if steep:
            runs.remarks += [f"Angles: rotation vector of the error R_E, {why}."]
        runs.remarks.append(f"Run {self.run}.")
        return drawing

    def _errors(self, runs: ShownRuns, signals: Mapping[str, str]) -> dict[str, dict[str, Array]]:
        """Return the errors of each part by the labels of the laws."""
        return {
            name: {e.label: runs.errors(x, e, degrees=True, run=self.run) for e in runs.shown}
            for name, x in signals.items()
        }


def _shorten(runs: ShownRuns, errors: Sequence[Array]) -> None:
    """Show only the transient of errors, where that is a small part of a time that nobody chose."""
    times, chosen = runs.times(runs.shown[0]), runs.chosen
    large = [np.flatnonzero(of > _LARGE * of.max()) for of in errors if of.max() > 0]
    is_chosen = chosen.start is not None or chosen.end is not None
    if is_chosen or not large or any(len(of) != len(times) for of in errors):
        return
    begin, horizon = times[0], times[-1] - times[0]
    ends = begin + horizon * np.array(_PARTS)
    wanted = begin + _BEYOND * (times[max(at[-1] for at in large)] - begin)
    if not (ends >= wanted).any():
        return
    end = float(ends[ends >= wanted].min())
    runs.chosen = chosen._replace(end=end)
    unit = runs.unit("time")
    words = f"first {end:g} of {times[-1]:g} {unit}, then errors stay below {100 * _LARGE:g} %"
    runs.remarks.append(f"The {words} of their largest; --to {times[-1]:g} shows all.")
    runs.note = ", ".join(filter(None, [runs.note, words]))


def _which(paths: Sequence[Flown]) -> str:
    """Return which runs are drawn, in words."""
    if (several := max(len(path.places) for path in paths)) > 1:
        return f"First {several} runs"
    first = {int(x.law.results.stored_runs[x.law.good][0]) for x in paths}
    return f"Run {first.pop()}" if len(first) == 1 else "The first run of each law"


def _most_together(runs: ShownRuns) -> int:
    """Return how many laws share a panel at most."""
    return MOST_COLOURS * len(runs.results)


def _best_laws(runs: ShownRuns, most: int) -> list[Ensemble]:
    """Show only the first law and those with the least closing error; name the others."""
    shown, signal = runs.shown, runs.drawn_signal(f"pose_error{runs.parts[0]}")
    if len(shown) <= most or not all(one.is_over_time(signal) for one in runs.results):
        return first_laws(runs, most)
    middles = {e.label: np.median(runs.errors(signal, e, degrees=False), axis=0) for e in shown}
    order, first = by_late_mean(middles), shown[0]
    best, which = order[:most], f"{most} of {len(shown)} laws"
    if first.label not in best:
        best = [first.label, *order[: most - 1]]
        which = f"{first.title} and the {most - 1} of {len(shown)} laws"
    which += " with the least closing error"
    laws = [e for e in shown if e.label in best]
    places = [[e.controller for e in laws if e.results is result] for result in runs.results]
    coloured = looks(runs.results, places, runs.figure, runs.chosen)  # also laws that were grey
    laws = [replace(e, look=look) for e, look in zip(laws, coloured, strict=True)]
    return keep_laws(runs, laws, which, which)


def _euler(R: Array) -> Array:
    """Return roll, pitch and yaw, or the heading in a plane, of rotations, rad."""
    yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    if R.shape[-1] < 3:
        return yaw[:, None]
    pitch = -np.arcsin(np.clip(R[:, 2, 0], -1, 1))
    return np.column_stack([np.arctan2(R[:, 2, 1], R[:, 2, 2]), pitch, yaw])


def _is_steep(part: Part, poses: Iterable[Array]) -> bool:
    """Whether a pitch comes near ±90 deg."""
    angles = [_euler(of[(..., *part.entries)]) for of in poses]
    return any(of.shape[1] == 3 and abs(of[:, 1]).max() > np.radians(_STEEP) for of in angles)


def _values(G: MatrixLieGroup, part: Part, poses: Array, desired: Array | None) -> Array:
    """Return the coordinates of a part, ``(samples, coordinates)``; of the error from `desired`."""
    if not part.turns:
        return part_curves(G, part, "pose", poses, degrees=False)[0]
    if desired is None:
        return np.degrees(broken(_euler(poses[(..., *part.entries)])))
    return np.degrees(broken(G.log(poses @ G.inverse(desired))[:, part.axes]))


def broken(angles: Array) -> Array:
    """Return angles ``(samples, k)``, rad, with NaN where one jumps by a turn."""
    jumps = abs(np.diff(angles, axis=0, prepend=angles[:1])) > _STEP
    return np.where(jumps, np.nan, angles)


def _coordinates(G: MatrixLieGroup, part: Part, unit: str, steep: set[str]) -> list[str]:
    """Return the labels of a part's coordinates: ``x``, or ``v_{x}`` beside others, or angles."""
    if part.turns:
        words = ["roll", "pitch", "yaw"] if len(G.axis_names[part.axes]) == 3 else ["heading"]
        words = [f"error ${axis}$" for axis in _AXES] if part.name in steep else words
        return [in_words(word, unit) for word in words]
    names = [axis[1:] for axis in G.axis_names[part.axes]]
    if sum(not pose_part.turns for pose_part in G.parts) > 1 or not set(names) <= set(_AXES):
        names = [component(symbols(G, part)[0], name) for name in names]
    return [quantity(name, unit) for name in names]
