"""Figure of attitude errors as paths on the sphere, in an equal-area projection."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Circle

from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.mechanics.tracking import pose_error
from eqt_cli.plots.base import OfFirstRuns
from eqt_cli.plots.drawing import sphere_projection
from eqt_cli.plots.drawing.curves import draw_density, draw_paths, path_legend
from eqt_cli.plots.drawing.labels import free_text
from eqt_cli.plots.drawing.layout import (
    add_legend,
    add_title,
    blank_sheet,
    panel,
    panel_title,
    panels_by_controller,
)
from eqt_cli.plots.drawing.style import WIDTHS, Width, ink, size_of_type
from eqt_cli.plots.shown.trajectories import ShownRuns

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
        """Draw a disc per controller, or a column of discs per rotation of the group."""
        shown, centre = runs.shown, _AXES.index(self.axis)
        group, parts = self._rotations(runs)
        suffixes = [f"_{part.name}" for part in parts] if len(parts) > 1 else [""]
        places = panels_by_controller([e.label for e in shown], suffixes, _COLUMNS[width])
        room = WIDTHS[width] / max(len(places[0]), 2)
        drawing, panels = blank_sheet(width, places, room + _ABOVE)
        for ensemble in shown:
            poses, desired = runs.values("pose", ensemble), runs.desired("pose", ensemble)
            errors = pose_error(group, poses, desired)
            for part, suffix in zip(parts, suffixes, strict=True):
                axes = panels[panel(ensemble.label, suffix)]
                points = errors[(..., *part.entries)][..., centre]
                _draw_grid(axes, centre, _NUMBERED if room >= _ROOM else _SPARSE)
                paths = [sphere_projection.path(run, centre) for run in points[: self.runs]]
                if self.density:
                    every = [sphere_projection.project(run, centre) for run in points]
                    draw_density(axes, every, _CELLS, ensemble.look)
                numbers = runs.numbers(ensemble, self.runs)
                draw_paths(axes, dict(zip(numbers, paths, strict=True)), ensemble)
                add_title(axes, panel_title(ensemble.title, suffix), room - _BESIDE)
        handles = path_legend(shown, self.runs, density=self.density)
        add_legend(drawing, list(handles.values()), list(handles))
        runs.remarks.append(f"Paths of the body axis $e_{self.axis}$ under the error $R_E$.")
        return drawing

    def _rotations(self, runs: ShownRuns) -> tuple[MatrixLieGroup, list[Part]]:
        """Return the group, and the spatial rotations among its parts."""
        if runs.group is None:
            name = runs.results[0].group_name
            raise runs.error(f"does not know group '{name}', which a plugin of the result defines")
        turning = [part for part in runs.group.parts if part.turns]
        found = [part for part in turning if part.entries[0].stop - part.entries[0].start == 3]
        if not found:
            has = "turns in a plane only" if turning else "has none"
            raise runs.error(
                f"shows rotations in space, and {runs.group.name} {has}; "
                "figure 'runs' shows its errors over time"
            )
        return runs.group, found


def _draw_grid(axes: Axes, centre: int, numbered: Sequence[int]) -> None:
    """Draw circles, rays and their labels."""
    grid: dict[str, Any] = {"color": ink(_GRID_SHARE), "linewidth": 0.4, "zorder": 0.5}
    small = _SMALL * size_of_type("font.size")
    ticks = [[(0.0, _SCALE), (1.0, _SCALE)]]
    for angle in _CIRCLES:
        radius = float(sphere_projection.radius(np.deg2rad(angle)))
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
