"""Animation of a run (GIF): bodies against the reference, and growing error and torque curves."""

from collections.abc import Sequence
from io import BytesIO
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from eqt_cli.core.arrays import Array
from eqt_cli.core.reporting import reporter, step
from eqt_cli.core.version import __version__
from eqt_cli.plots.animation.scene import (
    AXES,
    INERTIAL,
    Motion,
    Scene,
    block,
    flat,
    motion,
    scene_of,
    tips,
)
from eqt_cli.plots.drawing.cells import scale_norm
from eqt_cli.plots.drawing.labels import quantity, signal_label
from eqt_cli.plots.drawing.layout import freeze, name_scale
from eqt_cli.plots.drawing.style import house_style, ink, line_style
from eqt_cli.results.result import Result

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
    """Return a run as an animated GIF that repeats for ever.

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
    with house_style(), step("pictures drawn", count):
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
    each = max(20, 10 * round(milliseconds / 10))
    buffer = BytesIO()
    reduced[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=reduced[1:],
        duration=[each] * (len(reduced) - 1) + [each + _PAUSE],
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
        places = left.subplots(rows, columns, squeeze=False).ravel()
        for empty in places[count:]:
            empty.set_axis_off()
        panels = right.subplots(len(self.motion.norms), 1, sharex=True)
        self.bodies = [_Body(axes, scene, k) for k, axes in enumerate(places[:count])]
        self.curves = [
            _Curves(axes, self.motion, name)
            for axes, name in zip(panels, self.motion.norms, strict=True)
        ]
        panels[-1].set_xlabel(quantity("t", "s"))
        self.clock = left.suptitle(self._time(0), fontsize="medium")
        self.canvas.draw()
        freeze(drawing)

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
    """Body and target above the ground, in a panel that follows both."""

    def __init__(self, axes: Axes, scene: Scene, index: int) -> None:
        self.axes, self.scene, self.index, self.motion = axes, scene, index, scene.motion
        ensemble = self.motion.ensembles[index]
        self.colour = ensemble.look.colour
        axes.set_aspect("equal")
        axes.set(xticks=[], yticks=[])
        axes.grid(visible=False)
        axes.set_title(ensemble.title, color=self.colour, parse_math=False)
        ground: dict[str, Any] = {"color": ink(_GROUND), "linewidth": 0.5, "zorder": 0}
        axes.add_collection(LineCollection(list(flat(scene.ground)), **ground), autolim=False)
        if self.motion.has_translation:
            path: dict[str, Any] = {"color": ink(_GHOST), "linewidth": 0.5, "zorder": 1}
            axes.plot(*flat(self.motion.reference.position).T, **path)
        (self.trail,) = axes.plot([], [], color=self.colour, linewidth=1.0, zorder=1.5)
        self.ghost = _BodyBlock(axes, ink(_GHOST), 2, [ink(_GHOST)] * 3, linestyle=(0, (3, 1.5)))
        self.body = _BodyBlock(axes, self.colour, 4, list(AXES.values()), linewidth=1.8)
        rotors: dict[str, Any] = {"marker": "o", "markevery": 3, "markersize": 4, "linewidth": 2}
        (self.rotors,) = axes.plot([], [], color=ink(), zorder=5, **rotors)
        (self.arms,) = axes.plot([], [], color=self.colour, linewidth=0.8, zorder=3.5)
        _draw_inertial(axes)
        gone: dict[str, Any] = {"ha": "center", "va": "bottom", "transform": axes.transAxes}
        self.gone = axes.text(0.5, 0.02, "run failed", color=self.colour, fontsize="small", **gone)

    def show(self, sample: int) -> None:
        body, target, length = self.motion.body, self.motion.reference, self.scene.length
        reach = self.scene.reach[sample]
        across, up = flat(self.scene.centre[self.index, sample])
        self.axes.set_xlim(across - reach, across + reach)
        self.axes.set_ylim(up - reach, up + reach)
        self.ghost.show(target.rotation[sample], target.position[sample], length)
        rotation, place = body.rotation[self.index, sample], body.position[self.index, sample]
        self.trail.set_data(*flat(self.scene.trail(self.index, sample)).T)
        there = bool(np.isfinite(rotation).all() and np.isfinite(place).all())
        self.body.hide(not there)
        self.gone.set_visible(not there)
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
        self, axes: Axes, colour: str, order: int, colours: Sequence[str], **look: Any
    ) -> None:
        self.colour = colour
        self.faces = PolyCollection([], edgecolor=colour, linewidth=0.6, zorder=order)
        axes.add_collection(self.faces, autolim=False)
        line: dict[str, Any] = {"zorder": order + 0.5, "linewidth": 1.0} | look
        text: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": "small"}
        text |= {"clip_on": True, "zorder": order + 0.5}
        self.lines = [axes.plot([], [], color=each, **line)[0] for each in colours]
        self.names = [
            axes.text(0, 0, f"${name}$", color=each, **text)
            for name, each in zip(AXES, colours, strict=True)
        ]

    def show(self, rotation: Array, place: Array, length: float) -> None:
        """Move the block to a place and an orientation."""
        seen = block(rotation, place, length)
        self.faces.set_verts([outline for outline, _ in seen])
        self.faces.set_facecolor([(*_shaded(self.colour, light), 0.75) for _, light in seen])
        start = flat(place)
        ends = tips(rotation, place, length)
        for line, name, end in zip(self.lines, self.names, ends, strict=True):
            line.set_data([start[0], end[0]], [start[1], end[1]])
            name.set_position(start + 1.14 * (end - start))

    def hide(self, hidden: bool) -> None:
        """Hide the block, or show it again."""
        for artist in (self.faces, *self.lines, *self.names):
            artist.set_visible(not hidden)


def _draw_inertial(axes: Axes) -> None:
    """Draw the directions of the inertial frame in a corner."""
    corner, length = np.array([0.12, 0.11]), 0.09
    for name, end in zip(INERTIAL, flat(np.eye(3)), strict=True):
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


def _shaded(colour: str, light: float) -> tuple[float, float, float]:
    """Return the colour of a face: near the body's in the shade, nearly white in full light."""
    share = 0.35 + 0.5 * light
    red, green, blue = (channel + (1 - channel) * share for channel in to_rgb(colour))
    return red, green, blue
