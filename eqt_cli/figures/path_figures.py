"""Figures of where a body went: paths in space and on the sphere, and its pose over time."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Count, CountOrNone
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.figures import layout
from eqt_cli.figures.animation import camera
from eqt_cli.figures.bodies import course, moving_parts, outline
from eqt_cli.figures.cells import even
from eqt_cli.figures.curves import THIN, diverging, draw_ends, end_legend, open_frame, thin_line
from eqt_cli.figures.figure import OverTime, ShownRuns
from eqt_cli.figures.labels import component, in_words, part_curves, part_name, quantity, symbols
from eqt_cli.figures.shown import Ensemble
from eqt_cli.figures.style import WIDTHS, Width, ink, line_style, mixed

# Figure of paths, in planes, in space, or of an axis on the sphere --------------------------------

View = Literal["", "xy", "xz", "yz", "planes", "space", "sphere"]

_FLAT = 0.02
"""A motion whose extent along an axis is a smaller share of its largest one lies in a plane."""
_LEAST = 0.3
"""Least extent of a panel, as a share of the largest."""
_AROUND, _OBLIQUE, _GLOBE = 1.1, 1.3, 2.4
"""Extents of a panel over those of the paths in a plane and, for the numbers around them, of an
oblique view; and over the radius of a sphere."""
_WIDER = 1.6
"""Most that a panel is wider than its paths need."""
_TALLEST: dict[Width, tuple[float, float]] = {
    "column": (4.0, 6.5),
    "page": (5.2, 6.5),
    "slide": (2.4, 2.4),
}
"""Largest height of all panels together, of all laws and with a panel for each, in."""
_HIGH = 3.3
"""The same of spheres and oblique views, in."""
_ASIDE, _BELOW, _CLOSE = 0.45, 0.3, 0.1
"""Room for the numbers and names beside and below a panel, and for a gap or half a title, in."""
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

Grid = list[list[tuple[str, int]]]
"""Panels row by row: the view and the number of the column of laws."""


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
    """Where the bodies went, beside the reference: paths in space, or of a body axis on the sphere.

    All scales of a figure are equal. A ring is a start, a dot an end. A panel for each law is drawn
    of several runs, and on the sphere.

    Attributes
    ----------
    view
        ``xy``, ``xz`` or ``yz``; ``planes``, x–y and x–z; ``space``, obliquely from above, with the
        shadow of the reference; or ``sphere``, where a body axis points, pale on the far side. By
        default the plane in which all paths lie, else ``planes``; without positions ``sphere``.
    axis
        Body axis of ``sphere``.
    error
        On the sphere, where the attitude error R_E = R R_dᵀ takes the axis; no error leaves it.
    runs
        Most runs of each law, from the first; by default one of several laws, ten of a single one.
    bodies
        Number of bodies along the first path of each law, at equal intervals of time.
    """

    name: ClassVar[str] = "path"

    view: View = ""
    axis: Literal["x", "y", "z"] = "z"
    error: bool = False
    runs: Count | None = None
    bodies: CountOrNone = 0

    def check(self, problems: Problems) -> None:
        """Refuse bodies on the sphere, and errors in space."""
        if self.bodies and self.view == "sphere":
            problems.at("bodies").add("belongs to paths of positions; view sphere has none")
        if self.error and self.view not in ("", "sphere"):
            problems.at("error").add(f"belongs to view sphere, got view {self.view}")

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw all laws together, or a panel for each."""
        view = self._view(runs)
        most = self.runs or (1 if len(runs.shown) > 1 else _MANY)
        unit, factor = runs.results[0].shown_in("", "m")
        paths = [self._flown(runs, law, view, most, factor) for law in runs.shown]
        paths = _cut(runs, paths) if view != "sphere" else paths
        places = np.concatenate([x.reshape(-1, 3) for path in paths for x in path[2:]])
        ends = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
        eyes = _eyes(view or _plane(*ends), places)
        many = max(len(path.places) for path in paths) > 1
        columns = [[path] for path in paths] if many or view == "sphere" else [paths]
        drawing, panels = _sheet(width, eyes, len(columns), ends, unit)
        for (name, number), axes in panels.items():
            eye = eyes[name]
            if name == "space":
                ground = np.where(np.arange(3) == 2, ends[0], columns[number][0].desired)
                _draw(axes, eye, [ground], "shadow", {"color": ink(_PALE), "linewidth": 0.5})
            for path in columns[number]:
                if path.law in _one_of_each([each.law for each in columns[number]]):
                    _draw(axes, eye, [path.desired], "desired", _reference(many), name)
                look = line_style(path.law.look) | {"linewidth": _LINE}
                if many:
                    look = thin_line(path.law.look, len(path.places))
                _draw(axes, eye, path.places, path.law.label, look, name)
                seen = [(x, y) for x, y, _ in (path.places @ eye.T).swapaxes(1, 2)]
                draw_ends(axes, seen, path.law.look.colour)
                self._draw_bodies(axes, eye, path, float(np.max(ends[1] - ends[0])))
            if len(columns) > 1 and name == next(iter(eyes)):
                layout.add_title(axes, path.law.title, panels.room)
        self._add_legend(drawing, runs, many, len(columns) > 1)
        turned = "under the error $R_\\mathrm{E}$" if self.error else "in space"
        what = f": the body axis $e_{self.axis}$ {turned}" if view == "sphere" else ""
        first = {int(runs.numbers(law, 1)[0]) for law in runs.shown}
        which = f"Run {first.pop()}" if len(first) == 1 else "The first run of each law"
        which = f"First {max(len(p.places) for p in paths)} runs" if many else which
        runs.remarks.append(f"{which}{what}.")
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

    def _flown(self, runs: ShownRuns, law: Ensemble, view: str, most: int, factor: float) -> Flown:
        """Return the paths of the first runs of a law."""
        parts, axis = moving_parts(runs.known_group()), _AXES.index(self.axis)
        poses = runs.values("pose", law, most), runs.desired("pose", law)
        actual, desired = (course(each, *parts) for each in poses)
        if view == "sphere":
            R, Rd = actual[0], desired[0]
            if self.error:
                back = Rd.swapaxes(-1, -2)
                R, Rd = R @ back, Rd @ back
            return Flown(law, R, R[..., axis], Rd[..., axis])
        return Flown(law, actual[0], factor * actual[1], factor * desired[1])

    def _draw_bodies(self, axes: Axes, eye: Array, of: Flown, extent: float) -> None:
        """Draw outlines along the first path, what is nearer to the eye over what is behind."""
        look: dict[str, Any] = {"edgecolor": of.law.look.colour, "linewidth": 0.4, "zorder": 3}
        look["facecolor"] = mixed(of.law.look.colour, ink(0), 0.25)
        at = np.linspace(0, of.places.shape[1] - 1, self.bodies).round().astype(int)
        for rotation, place in zip(of.rotation[0, at], of.places[0, at], strict=True):
            if np.isfinite(place).all():
                faces = [
                    place + _BODY * extent * face @ rotation.T for face in outline(of.law.results)
                ]
                faces = sorted((face @ eye.T for face in faces), key=lambda face: face[:, 2].mean())
                shapes = [face[:, :2] for face in faces]
                axes.add_collection(PolyCollection(shapes, label=layout.NO_NUMBERS, **look))

    def _add_legend(self, drawing: Drawing, runs: ShownRuns, many: bool, apart: bool) -> None:
        laws = [] if apart else runs.shown
        handles: dict[str, Artist] = {
            e.title: Line2D([], [], **(line_style(e.look) | {"linewidth": _LINE})) for e in laws
        }
        if apart:
            name = "single runs" if many else "run"
            handles[name] = Line2D([], [], color=ink(0.6), linewidth=2 * THIN if many else _LINE)
        handles |= {"reference": Line2D([], [], **_reference(many)), **end_legend()}
        layout.add_legend(drawing, list(handles.values()), list(handles))


def _reference(over: bool = False) -> dict[str, Any]:
    """Return the style of the reference: pale and broad, or dark over many runs."""
    if over:
        return {"color": ink(), "linewidth": 0.8, "zorder": 2.5}
    return {"color": ink(_PALE), "linewidth": 2.2, "zorder": 1.5}


def _one_of_each(laws: Sequence[Ensemble]) -> list[Ensemble]:
    """Return the first law of each result, whose reference is drawn."""
    return [law for k, law in enumerate(laws) if law.results not in [e.results for e in laws[:k]]]


def _cut(runs: ShownRuns, paths: Sequence[Flown]) -> list[Flown]:
    """Return paths that end where they leave the surroundings of all others for good."""
    away = {
        path.law.title: np.linalg.norm(path.places - path.desired, axis=-1).max(axis=0)
        for path in paths
    }
    far = diverging(away)
    kept = [x.reshape(-1, 3) for p in paths if p.law.title not in far for x in p[2:]]
    low, high = (end(np.concatenate(kept), axis=0) for end in (np.nanmin, np.nanmax))
    beyond = 0.05 * (high - low).max()
    if far:
        runs.remarks.append(f"Cut off, since it leaves the reference: {', '.join(far)}.")
    return [
        path._replace(
            places=np.where(
                ((path.places > low - beyond) & (path.places < high + beyond)).all(
                    axis=-1, keepdims=True
                ),
                path.places,
                np.nan,
            )
        )
        if path.law.title in far
        else path
        for path in paths
    ]


def _plane(low: Array, high: Array) -> str:
    """Return the plane of two axes in which all places lie; ``planes`` if there is none."""
    extent = high - low
    across = int(extent.argmin())
    if extent[across] > _FLAT * extent.max():
        return "planes"
    return _AXES.replace(_AXES[across], "")


def _eyes(view: str, places: Array) -> dict[str, Array]:
    """Return the axes of each view as rows: right, up, and towards the eye, ``(3, 3)``."""
    x, y, z = np.eye(3)
    planes = {"xy": np.stack([x, y, z]), "xz": np.stack([x, z, -y]), "yz": np.stack([y, z, x])}
    if view in planes or view == "planes":
        return {name: planes[name] for name in (("xy", "xz") if view == "planes" else (view,))}
    if view == "space":
        return {view: camera()}
    x, y, z = np.nanmean(places, axis=0)
    height = np.clip(np.arctan2(z, np.hypot(x, y)), -_STEEPEST, _STEEPEST)
    return {view: camera(float(height), float(np.arctan2(y, x)) + _TURNED)}


class Panels(dict[tuple[str, int], Axes]):
    """Panels by view and column of laws, and their width, in."""

    room: float = 0.0


def _grids(views: Sequence[str], laws: int) -> Iterator[Grid]:
    """Yield arrangements: the views of a law above or beside each other, or laws in rows."""
    yield [[(view, k) for k in range(laws)] for view in views]
    yield [[(view, k) for view in views] for k in range(laws)]
    if len(views) == 1:
        for columns in range(2, laws):
            cells = [(views[0], k) for k in range(laws)]
            yield [cells[start : start + columns] for start in range(0, laws, columns)]


def _sheet(
    width: Width, eyes: Mapping[str, Array], laws: int, ends: tuple[Array, Array], unit: str
) -> tuple[Drawing, Panels]:
    """Return a figure of panels to one scale, the largest for which there is room."""
    corners = np.array([[ends[k][n] for n, k in enumerate(of)] for of in np.ndindex(2, 2, 2)])
    flat = {name: corners @ eye[:2].T for name, eye in eyes.items()}
    boxes = {name: np.stack([x.min(axis=0), x.max(axis=0)]) for name, x in flat.items()}
    around = _OBLIQUE if "space" in eyes else _AROUND
    sizes = {name: around * np.ptp(box, axis=0) for name, box in boxes.items()}
    if "sphere" in eyes:
        boxes, sizes = {"sphere": np.zeros((1, 2))}, {"sphere": np.full(2, _GLOBE)}
    least = _LEAST * max(size.max() for size in sizes.values()) or 1.0
    sizes = {name: np.maximum(size, least) for name, size in sizes.items()}
    framed = not {"space", "sphere"} & set(eyes)
    aside = _ASIDE if framed else _CLOSE

    def below(grid: Grid) -> float:
        """Return the height of all titles, and of the numbers and names below panels."""
        views = [row[0][0] for row in grid]
        named = sum(here != lower for here, lower in zip(views, [*views[1:], ""], strict=True))
        return _CLOSE * len(grid) * (1 + (laws > 1)) + (named * _BELOW if framed else 0.0)

    def scale(grid: Grid) -> tuple[float, Array, Array]:
        rows = np.array([max(sizes[name][1] for name, _ in row) for row in grid])
        wide = [
            max(sizes[row[k][0]][0] for row in grid if k < len(row)) for k in range(len(grid[0]))
        ]
        room = WIDTHS[width] - aside * len(wide)
        high = (_TALLEST[width][laws > 1] if framed else _HIGH) - below(grid)
        found = min(room / sum(wide), high / rows.sum())
        more = min(room / (found * sum(wide)), _WIDER if framed else 1.0)
        return found, more * np.array(wide), rows

    grid = max(_grids(list(eyes), laws), key=lambda each: scale(each)[0])
    inches, wide, rows = scale(grid)
    drawing = Drawing(figsize=(WIDTHS[width], inches * rows.sum() + below(grid)))
    FigureCanvasAgg(drawing)
    places = drawing.add_gridspec(len(rows), len(wide), width_ratios=wide, height_ratios=rows)
    panels = Panels()
    panels.room = inches * wide[0]
    for r, row in enumerate(grid):
        for c, (name, k) in enumerate(row):
            axes = panels[name, k] = drawing.add_subplot(places[r, c], label=f"{name} {k}")
            half, middle = np.array([wide[c], rows[r]]) / 2, boxes[name].mean(axis=0)
            (left, bottom), (right, top) = middle - half, middle + half
            axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
            if name == "sphere":
                _draw_sphere(axes, eyes[name])
            elif name == "space":
                _draw_room(axes, eyes[name], ends, unit)
            else:
                lower = grid[r + 1] if r + 1 < len(grid) else []
                outer = not (c < len(lower) and lower[c][0] == name)
                first = not (c and row[c - 1][0] == name)
                axes.xaxis.set_major_locator(even())
                axes.yaxis.set_major_locator(even())
                axes.tick_params(labelbottom=outer, labelleft=first)
                axes.set_xlabel(quantity(name[0], unit) if outer else "")
                layout.name_scale(axes, quantity(name[1], unit) if first else "")
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
            seen = (np.where(shown, each, np.nan) for each in (x, y))
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


def _draw_room(axes: Axes, eye: Array, ends: tuple[Array, Array], unit: str) -> None:
    """Draw the ground with numbers along its near edges, and heights on the walls behind."""
    axes.set_axis_off()
    low, high = ends
    extent = float(np.max(high - low))
    x, y, z = np.eye(3)
    gap, lines = 0.06 * extent, []
    edges = [(high * y + low * z, y), (high * x + low * z, x), (high * x + low * y, -y)]
    for k, (edge, out) in enumerate(edges):
        axis, count = np.eye(3)[k], max(1, round(5 * (high - low)[k] / extent))
        ticks = MaxNLocator(count, steps=[1, 2, 5, 10]).tick_values(low[k], high[k])
        for at in ticks[(ticks >= low[k]) & (ticks <= high[k])]:
            place = edge + at * axis
            corners = [place, place + (low - high) * (y if k == 0 else x)]
            corners += [corners[1] + (high - low) * y] if k == 2 else []
            lines.append(np.array(corners) @ eye[:2].T)
            across, up = eye[:2] @ (place + gap * out)
            text = f"{at:.4g}".replace("-", "−")
            axes.text(across, up, text, ha="center", va="center", fontsize="small")
        across, up = eye[:2] @ (edge + (low[k] + high[k]) / 2 * axis + 2.6 * gap * out)
        axes.text(across, up, quantity(_AXES[k], unit), ha="center", va="center")
    grid: dict[str, Any] = {"color": ink(_PALE), "linewidth": _FINE, "zorder": 0.5}
    axes.add_collection(LineCollection(lines, label=layout.NO_NUMBERS, **grid))
    axes.set(xlabel="right", ylabel="up")


# Figure of the pose of one run, component by component, and its errors ----------------------------


_TALLEST_POSE = 5.4
"""Largest height of all rows together, in."""
_STEP = 2.0
"""An angle that changes by more from sample to sample is at a singularity of its angles, rad."""


@dataclass(frozen=True)
class PoseFigure(OverTime):
    """The pose over time in one run beside the reference, component by component, with the errors.

    A column per part of the group. Angles are those of the turns about z, y and x, in this order,
    without jumps by whole turns; a line has a gap where they are singular.

    Attributes
    ----------
    run
        Number of the run.
    angles
        ``rpy``, roll, pitch and yaw; or ``rotvec``, the rotation vector.
    degrees
        Angles in degrees.
    """

    name: ClassVar[str] = "pose"

    run: CountOrNone = 0
    angles: Literal["rpy", "rotvec"] = "rpy"
    degrees: bool = True

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a row per component and, beneath, one of the errors."""
        G = runs.known_group()
        parts = sorted(G.parts, key=lambda part: part.turns)
        desired = {e.label: self._components(runs, G, parts, e) for e in runs.shown}
        shown = {e.label: self._components(runs, G, parts, e, desired[e.label]) for e in runs.shown}
        first = next(iter(desired.values()))
        errors = {
            part.name: runs.in_space(f"pose_error{end}")
            for part in parts
            if (end := f"_{part.name}" if len(parts) > 1 else "") in runs.parts
        }
        rows = max(map(len, first.values()))
        mosaic = [
            [f"{part.name} {k}" if k < len(first[part.name]) else layout.EMPTY for part in parts]
            for k in range(rows)
        ]
        last = [f"{part.name} error" if part.name in errors else layout.EMPTY for part in parts]
        mosaic += [last] if errors else []
        if len(parts) == 1 and width != "column":
            mosaic = layout.rows_of([name for (name,) in mosaic], 2)
        drawing, panels = layout.sheet(width, mosaic, runs.span, runs.unit("time"), _TALLEST_POSE)
        for part in parts:
            for k, label in enumerate(first[part.name]):
                axes = panels[f"{part.name} {k}"]
                for e in _one_of_each(runs.shown):
                    values = desired[e.label][part.name][label]
                    axes.plot(runs.times(e), values, label="desired", **_reference())
                for e in runs.shown:
                    values = shown[e.label][part.name][label]
                    axes.plot(runs.times(e), values, label=e.label, **line_style(e.look))
                layout.name_scale(axes, label)
            if signal := errors.get(part.name):
                axes = panels[f"{part.name} error"]
                for e in runs.shown:
                    values = runs.errors(signal, e, degrees=self.degrees, run=self.run)
                    axes.plot(runs.times(e), values, label=e.label, **line_style(e.look))
                axes.set_ylim(bottom=0)
                words = runs.error_label(signal, degrees=self.degrees)
                layout.name_scale(axes, words.replace("attitude error", "error"))
            if len(parts) > 1:
                top, room = panels[mosaic[0][parts.index(part)]], WIDTHS[width] / len(parts)
                layout.add_title(top, part_name(part.name), room)
        self._clip(runs, panels)
        for axes in panels.values():
            open_frame(axes)
        handles: dict[str, Artist] = {
            e.title: Line2D([], [], **line_style(e.look)) for e in runs.shown
        }
        handles["reference"] = Line2D([], [], **_reference())
        layout.add_legend(drawing, list(handles.values()), list(handles))
        runs.remarks.append(f"Run {self.run}.")
        return drawing

    def _components(
        self,
        runs: ShownRuns,
        G: MatrixLieGroup,
        parts: Iterable[Part],
        ensemble: Ensemble,
        near: Mapping[str, Mapping[str, Array]] | None = None,
    ) -> dict[str, dict[str, Array]]:
        """Return curves ``(samples,)`` by part and label: of a run, or else of the reference."""
        of_run = near is not None
        poses = (
            runs.of_run("pose", ensemble, self.run) if of_run else runs.desired("pose", ensemble)
        )
        found: dict[str, dict[str, Array]] = {}
        for part in parts:
            if not part.turns:
                values, _ = part_curves(G, part, "pose", poses, degrees=False)
                unit, factor = runs.results[0].shown_in("", part.pose_unit)
                named = [quantity(name, unit) for name in _coordinates(G, part)]
            else:
                words, values = self._angles(G, part, poses)
                unit, factor = runs.results[0].shown_in("", "deg" if self.degrees else "rad")
                factor *= np.degrees(1.0) if self.degrees else 1.0
                named = [in_words(each, unit) for each in words]
                if near is not None:
                    other = np.stack([near[part.name][name] / factor for name in named], axis=-1)
                    turns = np.nanmedian(other - values, axis=0) / (2 * np.pi)
                    values = values + 2 * np.pi * np.round(turns)
            found[part.name] = dict(zip(named, factor * values.T, strict=True))
        return found

    def _angles(self, G: MatrixLieGroup, part: Part, poses: Array) -> tuple[list[str], Array]:
        """Return names and continuous values ``(samples, angles)`` of a rotation, rad."""
        R = poses[(..., *part.entries)]
        if R.shape[-1] == 2:
            return ["heading"], continuous(np.arctan2(R[:, 1, 0], R[:, 0, 0])[:, None])
        if self.angles == "rotvec":
            values, _ = part_curves(G, part, "pose", poses, degrees=False)
            return [f"rotation, ${axis}$" for axis in _AXES], values
        roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
        pitch = -np.arcsin(np.clip(R[:, 2, 0], -1, 1))
        yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0])
        return ["roll", "pitch", "yaw"], continuous(np.stack([roll, pitch, yaw], axis=-1))

    def _clip(self, runs: ShownRuns, panels: Mapping[str, Axes]) -> None:
        """Scale panels to the laws that stay near the reference, and say which do not."""
        errors = [panels[name] for name in panels if name.endswith(" error")]
        curves: list[dict[str, Array]] = [
            {str(x.get_label()): np.asarray(x.get_ydata(), float) for x in axes.lines}
            for axes in errors
        ]
        away = {label for of in curves for label in diverging(of)}
        for axes in panels.values() if away else ():
            kept = [x.get_ydata() for x in axes.lines if x.get_label() not in away]
            low, high = (float(end(np.asarray(kept))) for end in (np.nanmin, np.nanmax))
            beyond = 0.2 * (high - low)
            axes.set_ylim(0 if axes in errors else low - beyond, high + beyond)
        if away:
            titles = ", ".join(e.title for e in runs.shown if e.label in away)
            runs.remarks.append(f"Cut off, since it leaves the reference: {titles}.")


def continuous(angles: Array) -> Array:
    """Return angles ``(samples, k)``, rad, without jumps by whole turns; NaN at other jumps."""
    joined = np.unwrap(angles, axis=0)
    jumps = abs(np.diff(joined, axis=0, prepend=joined[:1])) > _STEP
    return np.where(jumps, np.nan, joined)


def _coordinates(G: MatrixLieGroup, part: Part) -> list[str]:
    """Return the symbols of the coordinates of a vector: ``x``, or ``v_{x}`` beside others."""
    names = [axis[1:] for axis in G.axis_names[part.axes]]
    alone = sum(not each.turns for each in G.parts) == 1
    if alone and all(name in _AXES for name in names):
        return names
    return [component(symbols(G, part)[0], name) for name in names]
