"""Runs as moving pictures: the scene, and a GIF of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import reporter, step
from eqt_cli.base.version import __version__
from eqt_cli.components.groups import Part, group_named, moving_parts
from eqt_cli.figures.cells import scale_norm
from eqt_cli.figures.figure import ShownRuns
from eqt_cli.figures.labels import quantity, signal_label
from eqt_cli.figures.layout import freeze, name_scale
from eqt_cli.figures.shapes import CORNERS, FACES, BodyPath, camera, course, discs, rotors, upright
from eqt_cli.figures.shown import Chosen, Ensemble
from eqt_cli.figures.style import house_style, ink, line_style, mixed
from eqt_cli.results.result import Result

# The motion of one run, and its scene for GIFs and live pages; it draws nothing -------------------
#
# Bodies with their axes, the ghost of the target, paths, a ground grid and an inertial frame, as a
# camera that stands still sees them. It shows whole paths; a body that leaves them is not followed.


MOST_CONTROLLERS = 6
"""Most bodies that are shown side by side."""


@dataclass(frozen=True)
class Motion:
    """One run of some controllers.

    Attributes
    ----------
    run
        Number of the run.
    times : (samples,)
        Sample times, s.
    ensembles
        The controllers, in the order of curves and bodies.
    body, reference
        Courses of the bodies, with a leading controller axis, and of the reference.
    frame : (3, 3)
        What `shapes.upright` turned them by.
    has_translation
        Whether bodies move as well as turn.
    thrusts : (controllers, samples, thrusters, 2, 3)
        A line from each thruster along its thrust, in the body frame; the largest coordinate of a
        place and the largest thrust are 1.
    rotors : (rotors, 2, 3)
        Place and direction of the rotors of a multirotor, as `shapes.rotors` gives them.
    norms : dict of str to (controllers, samples)
        Norms of pose error and torque by name, per part where rotation and translation have
        different units.
    """

    run: int
    times: Array
    ensembles: Sequence[Ensemble]
    body: BodyPath
    reference: BodyPath
    frame: Array
    has_translation: bool
    thrusts: Array
    rotors: Array
    norms: dict[str, Array]

    @property
    def worst(self) -> int:
        """The sample with the largest first error of all controllers."""
        first, *_ = self.norms.values()
        errors = np.where(np.isfinite(first), first, -np.inf).max(axis=0)
        return int(errors.argmax())


def motion(results: Result, run: int, controllers: Sequence[str] = ()) -> Motion:
    """Return the motion of one run of a result.

    Parameters
    ----------
    run
        Number of the run, as in the coordinate ``run``.
    controllers
        Labels of the controllers; the first `MOST_CONTROLLERS` if empty.

    Raises
    ------
    EqtError
        If the run is not stored, there is no such controller, or the group is not known here or
        moves no body.
    """
    with house_style():
        source = ShownRuns([results], "animation", Chosen(controllers))
    ensembles = source.ensembles if controllers else source.ensembles[:MOST_CONTROLLERS]
    shown = [ensemble.controller for ensemble in ensembles]
    turning, moving = moving_parts(group_named(results.group_name))
    if turning is None and moving is None:
        raise results.error(
            f"a pose of {results.group_name} is neither a rotation nor a place in metres, so no "
            "body can be shown; `eqt plot --figure runs` draws its runs"
        )
    ends = [f"_{part.name}" for part in (turning, moving) if part is not None]
    ends = [end for end in ends if results.has(f"pose_error{end}")] or [""]
    errors = [source.drawn_signal(f"pose_error{end}") for end in ends]
    torques = [f"torque_norm{end}" for end in ends]
    turned, frame = rotors(results), upright(results)
    return Motion(
        run=run,
        times=results.times,
        ensembles=ensembles,
        body=course(results.trajectory("pose", run)[shown], turning, moving, frame),
        reference=course(results["desired_pose"], turning, moving, frame),
        frame=frame,
        has_translation=moving is not None,
        thrusts=_thrusts(results, run, shown, turned, moving),
        rotors=turned,
        norms={name: results.trajectory(name, run)[shown] for name in (*errors, *torques)},
    )


def _thrusts(
    results: Result, run: int, shown: list[int], turned: Array, moving: Part | None
) -> Array:
    thrusters = results.described.thrusters if results.has("thrust") else []
    if thrusters:
        thrust = results.trajectory("thrust", run)[shown][..., None]
        at, along = np.array(thrusters).swapaxes(0, 1)
    elif len(turned) and moving is not None:  # of which the sum is known
        at, along = turned.swapaxes(0, 1)
        force = results.trajectory("torque", run)[shown][..., moving.axes] @ along[0]
        thrust = np.repeat(force[..., None, None], len(at), axis=-2)
    else:
        return np.empty((len(shown), len(results.times), 0, 2, 3))
    at, thrust = (vectors / (np.nanmax(np.abs(vectors)) or 1.0) for vectors in (at, thrust))
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    return np.stack(np.broadcast_arrays(at, at + thrust * along), axis=-2)


AXES = {"x": "#3a3a3a", "y": "#c2185b", "z": "#8a8a8a"}
"""Axes of the body with their colours, which are of no law."""

INERTIAL = "XYZ"
"""Names of the inertial axes."""

TRAIL = 4.0
"""Duration of the trail of a body, s."""

_CLOSE, _WHOLE, _FAR = 1.75, 1.15, 2.5
"""Reach of the camera: in lengths of the axes of a body that only turns, and in extents of the
paths; and the extents beyond which a body goes away, of which the camera takes no notice."""
_BODY = 0.2
"""Length of a body's axes, in extents of the paths."""
_BELOW = 1.5
"""Depth of the ground below the lowest position, in lengths of an axis."""
_SIGHTS = 3.0
"""Extent of the grid, in reaches of the camera."""

_NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], float)
_LIGHT = np.array([0.35, 0.25, 0.9]) / np.linalg.norm([0.35, 0.25, 0.9])


def tips(rotation: Array, position: Array, length: float) -> Array:
    """Return the tips of the axes of a frame in the plane of the picture, ``(3, 2)``."""
    return flat(position + length * rotation.T)


def flat(position: Array) -> Array:
    """Project positions onto the plane of the picture, ``(..., 2)``."""
    return (position @ camera().T)[..., :2]


def box(rotation: Array, position: Array, length: float) -> list[tuple[Array, float]]:
    """Return the visible faces; a box is convex, so they do not hide each other.

    Each has its corners in the plane of the picture, ``(4, 2)``, m, and its brightness from 0, in
    the shade, to 1.
    """
    placed = position + length * CORNERS @ rotation.T
    seen = []
    for face, normal in zip(FACES, _NORMALS, strict=True):
        turned = rotation @ normal
        if turned @ camera()[2] > 0:
            seen.append((flat(placed[list(face)]), float((1 + turned @ _LIGHT) / 2)))
    return seen


def multirotor(
    shape: Sequence[Array], rotation: Array, position: Array, length: float
) -> list[tuple[Array, float]]:
    """Return arms and discs of a multirotor as `box` does, the farthest from the eye first."""
    placed = [position + length * polygon @ rotation.T for polygon in shape]
    placed.sort(key=lambda polygon: polygon.mean(axis=0) @ camera()[2])
    return [(flat(polygon), 0.5) for polygon in placed]


@dataclass(frozen=True)
class Scene:
    """Run in space, seen from a direction that a viewer may change.

    Attributes
    ----------
    motion
        Motion of bodies and reference.
    columns
        Number of bodies side by side.
    length
        Length of a body's axes, m.
    centre : (3,)
        Point that the camera looks at, m: the middle of the paths.
    reach
        Distance that it sees from there, m.
    ground : (lines, 2, 3)
        Ends of the lines of the grid, m.
    trails : (controllers, samples, 3)
        Points that leave the trails, m: positions of the bodies, or the tips of their x axes where
        they only turn.
    """

    motion: Motion
    columns: int
    length: float
    centre: Array
    reach: float
    ground: Array
    trails: Array

    def trail(self, index: int, sample: int) -> Array:
        """Return the trail of a body at a sample, ``(any, 3)``, m."""
        first = int(np.searchsorted(self.motion.times, self.motion.times[sample] - TRAIL))
        return np.asarray(self.trails[index, first : sample + 1])


def scene_of(motion: Motion) -> Scene:
    """Return the scene of a motion, the same for every file format."""
    body, target = motion.body.position, motion.reference.position
    seen = [np.concatenate([target, places]) @ camera().T for places in body]
    ends = np.stack([np.nanmin(seen, axis=1), np.nanmax(seen, axis=1)], axis=1)
    extents = np.ptp(ends[..., :2], axis=1).max(axis=-1) / 2
    extent = float(np.median(extents))
    stays = extents <= _FAR * extent
    length = _BODY * extent or 1.0
    centre = ends[stays].mean(axis=(0, 1)) @ camera()
    reach = _WHOLE * extent + length if extent else _CLOSE * length
    lowest = min(float(np.nanmin(position[..., 2])) for position in (body[stays], target))
    marks = length * np.arange(-np.ceil(_SIGHTS * reach / length), _SIGHTS * reach / length + 1)
    lines = np.array([[(at, marks[0], 0.0), (at, marks[-1], 0.0)] for at in marks])
    ground = np.concatenate([lines, lines[..., [1, 0, 2]]])
    return Scene(
        motion=motion,
        columns=int(np.ceil(np.sqrt(len(motion.ensembles)))),
        length=length,
        centre=centre,
        reach=reach,
        ground=ground + np.array([centre[0], centre[1], lowest - _BELOW * length]),
        trails=body if motion.has_translation else body + motion.body.rotation[..., 0] * length,
    )


# Animation of a run (GIF): bodies against the reference, and growing error and torque curves ------


DOTS_PER_INCH = 130
"""Resolution at which the smallest type, of 6.7 pt, is 12 pixels high."""
COLOURS = 160
"""Size of the palette that all pictures share, so that nothing flickers."""

_PAPER = 245
_PAUSE = 1500
"""Additional duration of the last picture, ms."""

_WIDTH, _BODIES, _LOWEST, _PANEL = 6.1, 3.7, 2.2, 0.7
"""Widths of the picture and of its bodies, and least heights of it and of a panel, in."""
_GROUND, _GHOST = 0.16, 0.45
"""Shares of ink of the grid and of the target."""


def gif(
    results: Result,
    run: int,
    controllers: Sequence[str] = (),
    *,
    seconds: float = 8.0,
    rate: float = 12.5,
) -> bytes:
    """Return a run as an animated GIF that repeats for ever, from its largest error.

    Parameters
    ----------
    run, controllers
        See `motion`.
    seconds
        Duration of the animation, s, whatever the length of the run.
    rate
        Pictures per second; GIF rounds their duration to hundredths of a second.

    Raises
    ------
    EqtError
        If the run cannot be shown; see `motion`.
    """
    shown = motion(results, run, controllers)
    count = max(2, round(seconds * rate))
    samples = np.linspace(0, len(shown.times) - 1, count).round().astype(int)
    if shown.worst:  # what a page shows of a picture that does not move
        samples = np.insert(samples, 0, shown.worst)
    with house_style(), step("pictures drawn", len(samples)):
        stage = _Stage(scene_of(shown), float(np.ptp(shown.times)) / (count / rate))
        pictures = []
        for sample in samples:
            pictures.append(stage.picture(int(sample)))
            reporter().advance(1)
    return _encoded(pictures, 1000 / rate)


def _encoded(pictures: Sequence[Image.Image], milliseconds: float) -> bytes:
    """Encode all pictures with the palette of the middle one."""
    palette = pictures[len(pictures) // 2].quantize(COLOURS, method=Image.Quantize.MEDIANCUT)
    colours = np.array(palette.getpalette()).reshape(-1, 3)
    colours[colours.min(axis=1) >= _PAPER] = 255  # make the paper exactly white
    palette.putpalette(colours.ravel().tolist())
    reduced = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    duration = max(20, 10 * round(milliseconds / 10))
    buffer = BytesIO()
    reduced[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=reduced[1:],
        duration=[duration] * (len(reduced) - 1) + [duration + _PAUSE],
        loop=0,
        optimize=True,
        comment=f"eqt {__version__}".encode(),
    )
    return buffer.getvalue()


class _Stage:
    """Figure whose artists move from picture to picture: bodies left, curves right."""

    def __init__(self, scene: Scene, speed: float) -> None:
        self.motion, self.speed = scene.motion, speed
        count, columns = len(self.motion.ensembles), scene.columns
        rows = -(-count // columns)
        side = _BODIES / max(columns, 2)
        height = max(side * rows, _LOWEST, _PANEL * len(self.motion.norms))
        drawing = Figure(figsize=(_WIDTH, height), dpi=DOTS_PER_INCH)
        self.canvas = cast(Any, FigureCanvasAgg(drawing))  # whose methods have no types
        shares = [_BODIES, _WIDTH - _BODIES]
        left, right = np.ravel(np.asarray(drawing.subfigures(1, 2, width_ratios=shares)))
        # The last row is as wide as the others.
        rest = count - columns * (rows - 1)
        wide = columns * rest
        mosaic = [
            [k * columns + int(j * number / wide) for j in range(wide)]
            for k, number in enumerate([columns] * (rows - 1) + [rest])
        ]
        places = list(left.subplot_mosaic(cast(Any, mosaic)).values())
        panels = right.subplots(len(self.motion.norms), 1, sharex=True)
        self.bodies = [_Body(axes, scene, k) for k, axes in enumerate(places)]
        self.curves = [
            _Curves(axes, self.motion, name)
            for axes, name in zip(panels, self.motion.norms, strict=True)
        ]
        panels[-1].set_xlabel(quantity("t", "s"))
        self.clock = left.suptitle(self._time(0), fontsize="medium")
        self.canvas.draw()
        freeze(drawing)
        for body in self.bodies:
            body.measure()

    def _time(self, sample: int) -> str:
        now = f"$t$ = {self.motion.times[sample]:.1f} s"
        return f"run {self.motion.run},  {now},  {self.speed:.2g} times as fast.  Grey: reference"

    def picture(self, sample: int) -> Image.Image:
        """Return the picture at a sample."""
        for body in self.bodies:
            body.show(sample)
        for curves in self.curves:
            curves.show(sample)
        self.clock.set_text(self._time(sample))
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3].copy())


class _Body:
    """Body and target above the ground, in a panel of their own."""

    def __init__(self, axes: Axes, scene: Scene, index: int) -> None:
        self.axes, self.scene, self.index, self.motion = axes, scene, index, scene.motion
        ensemble = self.motion.ensembles[index]
        self.colour = ensemble.look.colour
        axes.set(xticks=[], yticks=[])
        axes.grid(visible=False)
        name: dict[str, Any] = {"color": self.colour, "fontsize": "medium", "zorder": 6}
        self.name = axes.text(
            0, 0, ensemble.title, ha="center", va="bottom", parse_math=False, **name
        )
        ground: dict[str, Any] = {"color": ink(_GROUND), "linewidth": 0.5, "zorder": 0}
        axes.add_collection(LineCollection(list(flat(scene.ground)), **ground), autolim=False)
        if self.motion.has_translation:
            path: dict[str, Any] = {"color": ink(_GHOST), "linewidth": 0.5, "zorder": 1}
            axes.plot(*flat(self.motion.reference.position).T, **path)
            course = flat(self.motion.body.position[index]).T
            axes.plot(*course, **path | {"color": mixed(self.colour, ink(0), 0.4)})
        (self.trail,) = axes.plot([], [], color=self.colour, linewidth=1.0, zorder=1.5)
        shape = list(discs(self.motion.rotors))
        grey = [ink(_GHOST)] * 3
        self.ghost = _BodyBlock(axes, shape, ink(_GHOST), 2, grey, linestyle=(0, (3, 1.5)))
        self.body = _BodyBlock(axes, shape, self.colour, 4, list(AXES.values()), linewidth=1.4)
        rotors: dict[str, Any] = {"marker": "o", "markevery": 3, "markersize": 2, "linewidth": 1.4}
        (self.rotors,) = axes.plot([], [], color=ink(), zorder=5, **rotors)
        (self.arms,) = axes.plot([], [], color=self.colour, linewidth=0.8, zorder=3.5)
        _draw_inertial(axes, self.motion.frame)
        gone: dict[str, Any] = {"ha": "center", "va": "bottom", "transform": axes.transAxes}
        self.gone = axes.text(0.5, 0.02, "run failed", color=self.colour, fontsize="small", **gone)

    def measure(self) -> None:
        """Show what the camera sees; both scales are equal."""
        panel = self.axes.get_window_extent()
        shorter = min(panel.width, panel.height)
        wide, high = (self.scene.reach * side / shorter for side in (panel.width, panel.height))
        across, up = flat(self.scene.centre)
        self.axes.set_xlim(across - wide, across + wide)
        self.axes.set_ylim(up - high, up + high)

    def show(self, sample: int) -> None:
        body, target, length = self.motion.body, self.motion.reference, self.scene.length
        self.ghost.show(target.rotation[sample], target.position[sample], length)
        rotation, place = body.rotation[self.index, sample], body.position[self.index, sample]
        self.trail.set_data(*flat(self.scene.trail(self.index, sample)).T)
        there = bool(np.isfinite(rotation).all() and np.isfinite(place).all())
        self.body.hide(not there)
        self.gone.set_visible(not there)
        self.name.set_visible(there)
        across, up = flat(place).tolist()
        low, high = np.transpose([self.axes.get_xlim(), self.axes.get_ylim()])
        above = across, up + 1.25 * length  # at the edge, where the body has left the picture
        self.name.set_position(np.clip(above, low + 2 * length, high - 2 * length))
        lines = flat(place + length * self.motion.thrusts[self.index, sample] @ rotation.T)
        arms = np.stack([lines[:, 0], np.broadcast_to(flat(place), lines[:, 0].shape)], axis=1)
        for drawn, ends in ((self.rotors, lines), (self.arms, arms)):
            apart = np.pad(ends, ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)  # not drawn
            drawn.set_data(*apart.reshape(-1, 2).T)
        if there:
            self.body.show(rotation, place, length)


class _BodyBlock:
    """Block with its three axes and their names."""

    def __init__(
        self, axes: Axes, shape: list[Array], colour: str, order: int, hues: list[str], **look: Any
    ) -> None:
        self.colour, self.shape = colour, shape
        self.faces = PolyCollection([], edgecolor=colour, linewidth=0.6, zorder=order)
        axes.add_collection(self.faces, autolim=False)
        line: dict[str, Any] = {"zorder": order + 0.5, "linewidth": 1.0} | look
        text: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": "small"}
        text |= {"clip_on": True, "zorder": order + 0.5}
        self.lines = [axes.plot([], [], color=hue, **line)[0] for hue in hues]
        self.names = [
            axes.text(0, 0, f"${name}$", color=hue, **text)
            for name, hue in zip(AXES, hues, strict=True)
        ]

    def show(self, rotation: Array, place: Array, length: float) -> None:
        """Move the box to a place and an orientation."""
        shape, at = self.shape, (rotation, place, length)
        seen = multirotor(shape, *at) if shape else box(*at)
        self.faces.set_verts([outline for outline, _ in seen])
        # Near the colour of the body in the shade, nearly white in full light.
        shade = np.array(to_rgb(self.colour))
        shares = [0.35 + 0.5 * light for _, light in seen]
        self.faces.set_facecolor([(*(shade + (1 - shade) * share), 0.75) for share in shares])
        start = flat(place)
        ends = tips(rotation, place, length)
        for line, name, end in zip(self.lines, self.names, ends, strict=True):
            line.set_data([start[0], end[0]], [start[1], end[1]])
            name.set_position(start + 1.14 * (end - start))

    def hide(self, hidden: bool) -> None:
        """Hide the box, or show it again."""
        for artist in (self.faces, *self.lines, *self.names):
            artist.set_visible(not hidden)


def _draw_inertial(axes: Axes, frame: Array) -> None:
    """Draw the directions of the inertial frame in a corner."""
    corner, length = np.array([0.12, 0.11]), 0.09
    for name, end in zip(INERTIAL, flat(frame.T), strict=True):
        to = corner + length * end
        look: dict[str, Any] = {"color": ink(), "transform": axes.transAxes}
        axes.plot(*zip(corner, to, strict=True), linewidth=0.8, zorder=6, **look)
        x, y = corner + 1.45 * length * end
        text: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": "small", "zorder": 6}
        axes.text(x, y, f"${name}$", **text, **look)


class _Curves:
    """Curves that grow over pale copies of the whole curves."""

    def __init__(self, axes: Axes, shown: Motion, name: str) -> None:
        self.times, self.values = shown.times, shown.norms[name]
        looks = [line_style(ensemble.look) for ensemble in shown.ensembles]
        for look, curve in zip(looks, self.values, strict=True):
            axes.plot(self.times, curve, color=(look["color"], 0.25), linewidth=0.6)
        self.lines = [axes.plot([], [], **look)[0] for look in looks]
        self.now = axes.axvline(self.times[0], color="0.5", linewidth=0.6)
        axes.set_xlim(self.times[0], self.times[-1])
        scale_norm(axes, log=False)
        name_scale(axes, signal_label(shown.ensembles[0].results, name))

    def show(self, sample: int) -> None:
        for line, curve in zip(self.lines, self.values, strict=True):
            line.set_data(self.times[: sample + 1], curve[: sample + 1])
        self.now.set_xdata([self.times[sample]] * 2)
