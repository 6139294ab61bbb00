"""A run as a moving picture (GIF): bodies against the reference, error and torque as they go."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from eqt_cli.core.arrays import Array
from eqt_cli.core.version import __version__
from eqt_cli.plots.animation.motion import Motion, motion
from eqt_cli.plots.animation.scene import block, flat, tips
from eqt_cli.plots.drawing.labels import quantity, signal_label
from eqt_cli.plots.drawing.layout import freeze, name_scale
from eqt_cli.plots.drawing.scales import scale_norm
from eqt_cli.plots.drawing.style import house_style, line_style
from eqt_cli.results.result import Result

DOTS_PER_INCH = 110
COLOURS = 160
"""Of the palette that all pictures share, so that nothing flickers."""

_PAPER = 245
_NAMES = "xyz"
_MARGIN = 1.3
"""in lengths of an axis, beyond all places: the axes, their names and half a letter."""
_REFERENCE = "0.35"


def gif(
    results: Result,
    run: int,
    controllers: Sequence[str] = (),
    *,
    seconds: float = 8.0,
    rate: float = 12.5,
    progress: Callable[[float], None] = lambda pictures: None,
) -> bytes:
    """A run as an animated GIF that repeats for ever.

    Parameters
    ----------
    run, controllers
        As in `motion`.
    seconds
        How long it lasts, whatever the length of the run.
    rate
        Pictures per second; GIF rounds their time to hundredths of a second.
    progress
        Called after each picture with the number of pictures.

    Raises
    ------
    EqtError
        If the run cannot be shown; see `motion`.
    """
    shown = motion(results, run, controllers)
    count = max(2, round(seconds * rate))
    samples = np.linspace(0, len(shown.times) - 1, count).round().astype(int)
    with house_style():
        stage = _Stage(shown)
        pictures = []
        for sample in samples:
            pictures.append(stage.picture(int(sample)))
            progress(1)
    return _encoded(pictures, 1000 / rate)


def _encoded(pictures: Sequence[Image.Image], milliseconds: float) -> bytes:
    """All pictures in one palette, which is that of the middle one."""
    palette = pictures[len(pictures) // 2].quantize(COLOURS, method=Image.Quantize.MEDIANCUT)
    colours = np.array(palette.getpalette()).reshape(-1, 3)
    colours[colours.min(axis=1) >= _PAPER] = 255  # paper is white, and not nearly so
    palette.putpalette(colours.ravel().tolist())
    reduced = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    buffer = BytesIO()
    reduced[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=reduced[1:],
        duration=max(20, 10 * round(milliseconds / 10)),
        loop=0,
        optimize=True,
        comment=f"eqt {__version__}".encode(),
    )
    return buffer.getvalue()


class _Stage:
    """The figure whose artists move from picture to picture."""

    def __init__(self, shown: Motion) -> None:
        self.motion = shown
        count = len(shown.ensembles)
        drawing = Figure(figsize=(7.16, 1.9 + 7.16 / max(count, 3)))
        self.canvas = cast(Any, FigureCanvasAgg(drawing))  # whose methods have no types
        drawing.set_dpi(DOTS_PER_INCH)
        ratios = [7.16 / max(count, 3), 1.9]
        upper, lower = np.ravel(np.asarray(drawing.subfigures(2, 1, height_ratios=ratios)))
        bodies = upper.subplots(1, count, squeeze=False)[0]
        panels = lower.subplots(1, len(shown.norms))
        self.bodies = [_Body(axes, shown, index) for index, axes in enumerate(bodies)]
        self.curves = [
            _Curves(axes, shown, name) for axes, name in zip(panels, shown.norms, strict=True)
        ]
        self.clock = upper.suptitle(self._time(0), fontsize="medium")
        self.canvas.draw()
        freeze(drawing)

    def _time(self, sample: int) -> str:
        return f"run {self.motion.run},  $t$ = {self.motion.times[sample]:.1f} s"

    def picture(self, sample: int) -> Image.Image:
        """The picture at a sample."""
        for body in self.bodies:
            body.show(sample)
        for curves in self.curves:
            curves.show(sample)
        self.clock.set_text(self._time(sample))
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3].copy())


class _Body:
    """A body and the reference, seen from a fixed place."""

    def __init__(self, axes: Axes, shown: Motion, index: int) -> None:
        self.motion, self.index, self.length = shown, index, shown.length
        ensemble = shown.ensembles[index]
        self.colour = line_style(ensemble.look)["color"]
        low, high = flat(shown.places).min(axis=0), flat(shown.places).max(axis=0)
        middle, reach = (low + high) / 2, float((high - low).max() / 2) + _MARGIN * shown.length
        axes.set_xlim(middle[0] - reach, middle[0] + reach)
        axes.set_ylim(middle[1] - reach, middle[1] + reach)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(ensemble.title, color=self.colour, parse_math=False)
        if shown.has_translation:
            axes.plot(*flat(shown.reference.position).T, color=_REFERENCE, linewidth=0.5)
        (self.trail,) = axes.plot([], [], color=self.colour, linewidth=0.9)
        self.faces = PolyCollection([], edgecolor=self.colour, linewidth=0.7, zorder=2)
        axes.add_collection(self.faces)
        dashed = {"linestyle": (0, (3, 1.5)), "linewidth": 1.0}
        self.reference = _Axes(axes, 3, color=_REFERENCE, **dashed)
        self.frame = _Axes(axes, 4, color=self.colour, linestyle="-", linewidth=1.8)
        gone: dict[str, Any] = {"ha": "center", "va": "bottom", "transform": axes.transAxes}
        self.gone = axes.text(0.5, 0, "run failed", color=self.colour, fontsize="small", **gone)

    def show(self, sample: int) -> None:
        body, reference = self.motion.body, self.motion.reference
        place = reference.position[sample]
        self.reference.put(place, tips(reference.rotation[sample], place, self.length))
        rotation, place = body.rotation[self.index, sample], body.position[self.index, sample]
        if self.motion.has_translation:
            self.trail.set_data(*flat(body.position[self.index, : sample + 1]).T)
        there = bool(np.isfinite(rotation).all() and np.isfinite(place).all())
        self.faces.set_visible(there)
        self.frame.hide(not there)
        self.gone.set_visible(not there)
        if there:
            seen = block(rotation, place, self.length)
            self.faces.set_verts([face.outline for face in seen])
            self.faces.set_facecolor([_shaded(self.colour, face.light) for face in seen])
            self.frame.put(place, tips(rotation, place, self.length))


class _Axes:
    """The three axes of a frame, with their names."""

    def __init__(self, axes: Axes, order: int, **look: Any) -> None:
        self.lines = [axes.plot([], [], zorder=order, **look)[0] for _ in _NAMES]
        text: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": "small"}
        self.names = [axes.text(0, 0, f"${n}$", color=look["color"], **text) for n in _NAMES]

    def put(self, origin: Array, ends: Array) -> None:
        start = flat(origin)
        for line, name, end in zip(self.lines, self.names, ends, strict=True):
            line.set_data([start[0], end[0]], [start[1], end[1]])
            name.set_position(start + 1.12 * (end - start))

    def hide(self, hidden: bool) -> None:
        for artist in (*self.lines, *self.names):
            artist.set_visible(not hidden)


class _Curves:
    """Curves that grow, over what they will be."""

    def __init__(self, axes: Axes, shown: Motion, name: str) -> None:
        self.times, self.values = shown.times, shown.norms[name]
        looks = [line_style(ensemble.look) for ensemble in shown.ensembles]
        for look, curve in zip(looks, self.values, strict=True):
            axes.plot(self.times, curve, color=(look["color"], 0.25), linewidth=0.6)
        self.lines = [axes.plot([], [], **look)[0] for look in looks]
        self.now = axes.axvline(self.times[0], color="0.5", linewidth=0.6)
        axes.set_xlim(self.times[0], self.times[-1])
        scale_norm(axes, log=False)
        axes.set_xlabel(quantity("t", "s"))
        name_scale(axes, signal_label(shown.ensembles[0].results, name))

    def show(self, sample: int) -> None:
        for line, curve in zip(self.lines, self.values, strict=True):
            line.set_data(self.times[: sample + 1], curve[: sample + 1])
        self.now.set_xdata([self.times[sample]] * 2)


def _shaded(colour: str, light: float) -> tuple[float, float, float]:
    """A face's colour: the body's own in the shade, and nearly white in full light."""
    share = 0.35 + 0.5 * light
    red, green, blue = (channel + (1 - channel) * share for channel in to_rgb(colour))
    return red, green, blue
