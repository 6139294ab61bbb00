"""Figure of directions on the sphere, in Lambert's azimuthal equal-area projection."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Circle

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.mechanics.tracking import pose_error
from eqt_cli.plots.base import OfFirstRuns
from eqt_cli.plots.drawing import layout
from eqt_cli.plots.drawing.curves import draw_density, draw_paths, path_legend
from eqt_cli.plots.drawing.labels import free_text
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink, size_of_type
from eqt_cli.plots.shown.trajectories import ShownRuns

_NEAR_RIM = -np.cos(np.pi / 4)
"""Cosine of 135°: farther out, a path may pass the point opposite the centre."""


_FINER = 16
"""Number of parts into which a step near the rim is divided."""


def radius_of(angle: Array | float) -> Array:
    """Return the radius in the disc of a point at angle θ from the centre: sin(θ/2)."""
    return np.sin(np.asarray(angle) / 2)


def project(points: Array, centre: int) -> tuple[Array, Array]:
    """Return horizontal and vertical coordinates of unit vectors ``(..., 3)``.

    The eye is outside, at the tip of axis number `centre`: the next axis points right, the one
    after it up. The rim is the point opposite the centre; that point itself is drawn to the right.
    """
    across, up = points[..., (centre + 1) % 3], points[..., (centre + 2) % 3]
    cosine, length = points[..., centre], np.hypot(across, up)
    there = length > 0
    # Two forms of one number, each accurate in its own half of the sphere.
    near = 1 / np.sqrt(2 * (1 + np.maximum(cosine, 0)))
    far = np.sqrt(np.maximum(1 - cosine, 0) / 2) / np.where(there, length, 1)
    scale = np.where(cosine >= 0, near, far)
    opposite = (cosine < 0) & ~there
    return np.where(opposite, 1, across) * scale, up * scale


def path(points: Array, centre: int) -> tuple[Array, Array]:
    """Project a path ``(samples, 3)`` as `project` does, refined towards the rim.

    There a small step on the sphere may go far around the disc, so it is drawn as a great circle.
    A path has a gap where it passes opposite the centre: it leaves the disc at one side and comes
    back at the other.
    """
    outside = points[:, centre] < _NEAR_RIM
    points = _refined(points, outside[1:] | outside[:-1])
    x, y = project(points, centre)
    outside = points[:, centre] < _NEAR_RIM
    opposed = x[1:] * x[:-1] + y[1:] * y[:-1] < 0
    gaps = np.flatnonzero(opposed & outside[1:] & outside[:-1]) + 1
    return np.insert(x, gaps, np.nan), np.insert(y, gaps, np.nan)


def _refined(points: Array, steps: Array) -> Array:
    """Return the path with the flagged steps divided into `_FINER` parts."""
    share = np.arange(1, _FINER)[:, None] / _FINER
    pieces = [points[:1]]
    for start, end, fine in zip(points, points[1:], steps, strict=False):
        if fine:
            between = (1 - share) * start + share * end
            lengths = np.linalg.norm(between, axis=1, keepdims=True)
            pieces.append(between / np.where(lengths > 0, lengths, 1))
        pieces.append(end[None])
    return np.concatenate(pieces)


_COLUMNS: dict[Width, int] = {"column": 2, "page": 4, "slide": 4}
_AXES = "xyz"
_BESIDE = 0.1
"""Width of a panel's place that a disc leaves free, in."""
_ABOVE = 0.05
"""Height for the title of a panel, in."""
_LIMIT = 1.2
"""Extent of the panel in radii of the disc, for the names around it; more below, for the scale."""
_BELOW = 1.33
_CIRCLES = (0, 45, 90, 135, 180)
"""Angles of the circles from the centre, deg."""
_RAYS = 45
"""Angle between the lines from the centre, deg."""
_NUMBERED = (0, 45, 90, 180)
"""Circles, and the centre, that are numbered on the scale below the disc, deg."""
_SPARSE, _ROOM = (0, 180), 1.6
"""Numbered circles on discs with less room, deg, and this room, in."""
_SCALE, _TICK = -1.12, 0.05
"""Height of the scale below the disc and length of its ticks, in radii."""
_CELLS = np.linspace(-1, 1, 49), np.linspace(-1, 1, 49)
"""Edges of the cells in which passing runs are counted."""
_GRID_SHARE = 0.3
"""Share of ink in the grid."""
_SMALL = 0.75
"""Type size of the numbers over the usual."""


@dataclass(frozen=True)
class Sphere(OfFirstRuns):
    """Attitude errors on the sphere: the paths of a body axis as the error R_E = R R_dᵀ turns it.

    Shading shows where all runs pass, in cells of equal area; darker shading: more runs pass there.

    The whole sphere is one disc, in Lambert's azimuthal equal-area projection: the centre is no
    error, the circles are tilts of the axis by 45°, 90° and 135°, and the rim is the half-turn
    about any axis normal to it. A rotation about the axis itself does not show.

    Attributes
    ----------
    axis
        The body axis.
    """

    name: ClassVar[str] = "sphere"

    axis: Literal["x", "y", "z"] = "z"

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a disc per law, or a column of discs per rotation of the group."""
        shown, centre = runs.shown, _AXES.index(self.axis)
        group, parts = self._rotations(runs)
        suffixes = [f"_{part.name}" for part in parts] if len(parts) > 1 else [""]
        places = layout.panels_by_controller([e.label for e in shown], suffixes, _COLUMNS[width])
        room = WIDTHS[width] / max(len(places[0]), 2)
        drawing, panels = layout.blank_sheet(width, places, room + _ABOVE)
        for ensemble in shown:
            poses, desired = runs.values("pose", ensemble), runs.desired("pose", ensemble)
            errors = pose_error(group, poses, desired)
            for part, suffix in zip(parts, suffixes, strict=True):
                axes = panels[layout.panel(ensemble.label, suffix)]
                points = errors[(..., *part.entries)][..., centre]
                _draw_grid(axes, centre, _NUMBERED if room >= _ROOM else _SPARSE)
                paths = [path(run, centre) for run in points[: self.runs]]
                if self.density:
                    every = [project(run, centre) for run in points]
                    draw_density(axes, every, _CELLS, ensemble.look)
                numbers = runs.numbers(ensemble, self.runs)
                draw_paths(axes, dict(zip(numbers, paths, strict=True)), ensemble)
                layout.add_title(axes, layout.panel_title(ensemble.title, suffix), room - _BESIDE)
        handles = path_legend(shown, self.runs, density=self.density)
        layout.add_legend(drawing, list(handles.values()), list(handles))
        runs.remarks.append(f"Paths of the axis $e_{self.axis}$ under the error $R_\\mathrm{{E}}$.")
        return drawing

    def _rotations(self, runs: ShownRuns) -> tuple[MatrixLieGroup, list[Part]]:
        """Return the group, and the spatial rotations among its parts."""
        if runs.group is None:
            name = runs.results[0].group_name
            raise runs.error(f"does not know group '{name}', which a plugin of the result defines")
        turning = [part for part in runs.group.parts if part.turns]
        rotations = [part for part in turning if part.entries[0].stop - part.entries[0].start == 3]
        if not rotations:
            has = "turns in a plane only" if turning else "has none"
            raise runs.error(
                f"shows rotations in space, and {runs.group.name} {has}; "
                "figure 'runs' shows its errors over time"
            )
        return runs.group, rotations


def _draw_grid(axes: Axes, centre: int, numbered: Sequence[int]) -> None:
    """Draw circles, rays and their labels."""
    grid: dict[str, Any] = {"color": ink(_GRID_SHARE), "linewidth": 0.4, "zorder": 0.5}
    small = _SMALL * size_of_type("font.size")
    ticks = [[(0.0, _SCALE), (1.0, _SCALE)]]
    for angle in _CIRCLES:
        radius = float(radius_of(np.deg2rad(angle)))
        edge = {"color": ink(), "linewidth": 0.6} if angle == _CIRCLES[-1] else grid
        axes.add_patch(Circle((0, 0), radius, fill=False, **edge))
        if angle in numbered:
            ticks.append([(radius, _SCALE), (radius, _SCALE - _TICK)])
            text = free_text(f"{angle}°", 9)
            axes.text(radius, _SCALE - 2 * _TICK, text, fontsize=small, ha="center", va="top")
    axes.add_collection(LineCollection(ticks, color=ink(), linewidth=0.5, clip_on=False))
    angles = np.deg2rad(np.arange(0, 360, _RAYS))
    rays = [[(0.0, 0.0), (np.cos(angle), np.sin(angle))] for angle in angles]
    axes.add_collection(LineCollection(rays, **grid))
    right, up = (rf"$e_{_AXES[(centre + k) % 3]}$" for k in (1, 2))
    axes.text(1.04, 0, right, ha="left", va="center", fontsize="small")
    axes.text(0, 1.04, up, ha="center", va="bottom", fontsize="small")
    axes.set_xlabel(right)  # hidden, but names the numbers behind the figure
    axes.set_ylabel(up)
    axes.set_xlim(-_LIMIT, _LIMIT)
    axes.set_ylim(-_BELOW, _LIMIT)
    axes.set_aspect("equal")
    axes.set_axis_off()
