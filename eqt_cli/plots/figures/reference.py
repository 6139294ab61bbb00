"""The figure of what is to be followed: pose, velocity and torque of the reference over time."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.plots.base import OfReference
from eqt_cli.plots.drawing.labels import component, part_name, quantity
from eqt_cli.plots.drawing.layout import add_legend, add_title, name_scale, sheet
from eqt_cli.plots.drawing.style import WIDTHS, Width, line_style
from eqt_cli.plots.shown.reference import ShownReference


@dataclass(frozen=True)
class ReferenceOverTime(OfReference):
    """Pose, velocity and torque of the reference, a column per part; it needs no run.

    A rotation is drawn as its vector, axis times angle, without jumps by whole turns.

    Attributes
    ----------
    degrees
        Angles and rates of rotations in degrees.
    """

    name: ClassVar[str] = "reference"

    degrees: bool = False

    def compose(self, shown: ShownReference, width: Width) -> Drawing:
        """Three rows; the coordinates of a part share a panel."""
        parts = shown.group.parts
        rows = [[f"{row} {part.name}" for part in parts] for row in ("pose", "velocity", "torque")]
        span = float(shown.times[0]), float(shown.times[-1])
        drawing, panels = sheet(width, rows, span, "s")
        for place, part in enumerate(parts):
            turns = self.degrees and part.turns
            values, symbol, unit = pose_coordinates(shown.group, part, shown.pose)
            velocity, force = _symbols(part) if len(parts) > 1 else ("V_d", r"\tau_d")
            panes = (
                (symbol, values, unit),
                (velocity, shown.velocity[:, part.axes], part.velocity_unit),
                (force, shown.torque[:, part.axes], part.force_unit),
            )
            for row, (name, coordinates, in_unit) in zip(rows, panes, strict=True):
                axes = panels[row[place]]
                if turns and in_unit.startswith("rad"):
                    coordinates, in_unit = np.degrees(coordinates), in_unit.replace("rad", "deg")
                for k, axis in enumerate(shown.group.axis_names[part.axes]):
                    axes.plot(shown.times, coordinates[:, k], label=axis, **line_style(k))
                name_scale(axes, quantity(name, in_unit))
            if len(parts) > 1:
                add_title(panels[rows[0][place]], part_name(part.name), WIDTHS[width] / len(parts))
        self._add_legend(drawing, shown.group)
        return drawing

    def _add_legend(self, drawing: Drawing, group: MatrixLieGroup) -> None:
        names = [group.axis_names[part.axes] for part in group.parts]
        most = max(map(len, names))
        labels = [
            ", ".join(f"${component('', axes[k]).lstrip('_')}$" for axes in names if k < len(axes))
            for k in range(most)
        ]
        add_legend(drawing, [Line2D([], [], **line_style(k)) for k in range(most)], labels)


def _symbols(part: Part) -> tuple[str, str]:
    """Of the velocity and the force in a part of several."""
    if part.turns:
        return r"\omega_d", r"\tau_d"
    return ("v_d", "f_d") if part.pose_unit == "m" else ("V_d", r"\tau_d")


def pose_coordinates(G: MatrixLieGroup, part: Part, pose: Array) -> tuple[Array, str, str]:
    """A part of some poses ``(n, d, d)`` as curves ``(n, coordinates)``, their symbol and unit."""
    block = pose[(..., *part.entries)].reshape(len(pose), -1)
    if block.shape[1] == len(G.axis_names[part.axes]):
        return block, "x_d" if part.pose_unit == "m" else "Q_d", part.pose_unit
    with np.errstate(all="ignore"):
        logarithm = np.full((len(pose), G.dimension), np.nan)
        real = np.isfinite(pose).all(axis=(1, 2))
        logarithm[real] = G.log(pose[real])
    turns = logarithm[:, part.axes]
    if not part.turns:
        return turns, r"\log Q_d", ""
    return without_jumps(turns), r"\log R_d", "rad"


def without_jumps(vectors: Array) -> Array:
    """Rotation vectors ``(n, k)`` with whole turns about their axes added, so that none jumps."""
    found = vectors.copy()
    for now, before in zip(found[1:], found[:-1], strict=True):
        angle = np.linalg.norm(now)
        axis = now / angle if angle > 0 else before / max(np.linalg.norm(before), 1.0)
        turns = np.round((before @ axis - angle) / (2 * np.pi))
        if np.isfinite(turns):
            now += 2 * np.pi * turns * axis
    return found
