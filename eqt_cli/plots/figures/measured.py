"""Figure of a recording beside a run: pose, error, velocity and wrench over time."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.plots.base import OfMeasured, Panelled
from eqt_cli.plots.drawing.coordinates import axis_labels, pose_coordinates, symbols
from eqt_cli.plots.drawing.labels import in_words, part_name, quantity
from eqt_cli.plots.drawing.layout import add_legend, add_title, name_scale, sheet
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink, line_style
from eqt_cli.plots.shown.measured import ShownMeasured

_MEASURED: dict[str, Any] = {"linewidth": 2.4, "zorder": 1.5, "solid_capstyle": "butt"}
_SIMULATED = 0.8
"""Line width of the run, pt; the wider recording is visible on both sides."""
_PALE = 0.35
"""Share of the colour in a measured curve."""


@dataclass(frozen=True)
class Measured(Panelled, OfMeasured):
    """A recording beside a run: pose, error, velocity and wrench, a column per part.

    It shows one controller: the first, unless another is chosen. The error is log Q_d⁻¹Q, from the
    reference in the body frame. The clock of the recording is aligned with that of the run, and
    its gaps stay empty.

    Attributes
    ----------
    degrees
        Angles and rates of rotations in degrees.
    """

    name: ClassVar[str] = "measured"

    degrees: bool = False

    def compose(self, shown: ShownMeasured, width: Width) -> Drawing:
        """Draw a row for each quantity; the coordinates of a part share a panel."""
        parts = shown.group.parts
        wanted = self.picked([name for name, *_ in shown.curves])
        curves = [row for row in shown.curves if row[0] in wanted]
        places = [[f"{name} {part.name}" for part in parts] for name, *_ in curves]
        times = curves[0][2][0]
        drawing, panels = sheet(width, places, (float(times[0]), float(times[-1])), shown.unit)
        for row, (name, measured, (t, run)) in zip(places, curves, strict=True):
            for panel, part in zip(row, parts, strict=True):
                axes = panels[panel]
                values, label = self._coordinates(shown, name, part, run)
                self._draw(axes, "simulated", shown.group, part, (t, values))
                near = np.stack([np.interp(measured[0], t, one) for one in values.T], axis=-1)
                seen, _ = self._coordinates(shown, name, part, measured[1], near)
                gaps = shown.pair.recording.gaps + 1
                behind = np.insert(measured[0], gaps, np.nan), np.insert(seen, gaps, np.nan, axis=0)
                self._draw(axes, "measured", shown.group, part, behind)
                name_scale(axes, label)
        for panel, part in zip(places[0], parts, strict=True) if len(parts) > 1 else ():
            add_title(panels[panel], part_name(part.name), WIDTHS[width] / len(parts))
        names = axis_labels(shown.group)
        lines = [Line2D([], [], **_thin(k)) for k in range(len(names))]
        grey = Line2D([], [], color=_pale(ink()), **_MEASURED)
        add_legend(drawing, [*lines, grey], [*names, "measured"])
        return drawing

    def _coordinates(
        self, shown: ShownMeasured, name: str, part: Part, values: Array, near: Array | None = None
    ) -> tuple[Array, str]:
        """Return the curves of a part and their label; poses are unwrapped to match `near`."""
        _, velocity, force = symbols(shown.group, part)
        degrees = self.degrees and part.turns
        if name == "pose":
            near = np.radians(near) if degrees and near is not None else near
            found, symbol, unit = pose_coordinates(shown.group, part, values, near=near)
        else:
            found = values[:, part.axes]
            symbol, unit = {
                "error": ("", "rad" if part.turns else part.pose_unit),
                "velocity": (velocity, part.velocity_unit),
                "wrench": (force, part.force_unit),
            }[name]
        if degrees and unit.startswith("rad"):
            found, unit = np.degrees(found), unit.replace("rad", "deg")
        return found, quantity(symbol, unit) if symbol else in_words(name, unit)

    def _draw(
        self, axes: Axes, kind: str, G: MatrixLieGroup, part: Part, curve: tuple[Array, Array]
    ) -> None:
        for k, axis in enumerate(G.axis_names[part.axes]):
            style = _thin(k)
            if kind == "measured":
                style = {"color": _pale(style["color"]), **_MEASURED}
            axes.plot(curve[0], curve[1][:, k], label=f"{kind} {axis}", **style)


def _thin(k: int) -> dict[str, Any]:
    return {"linewidth": _SIMULATED, **line_style(k)}


def _pale(colour: str) -> str:
    """Return a tint of a colour on the paper."""
    both = zip(to_rgb(colour), to_rgb(ink(0)), strict=True)
    red, green, blue = (_PALE * own + (1 - _PALE) * paper for own, paper in both)
    return to_hex((red, green, blue))
