"""The motion of one run, and its scene for both the GIF and the page; it draws nothing.

Bodies with coloured axes, the ghost of the target, trails, a ground grid and an inertial frame,
seen by a camera that follows body and target.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eqt_cli.config.source import source_of
from eqt_cli.core.arrays import Array
from eqt_cli.groups import Part, group_named
from eqt_cli.plots.drawing.style import house_style
from eqt_cli.plots.shown.controllers import Chosen, Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns
from eqt_cli.results.result import Result

MOST_CONTROLLERS = 6
"""Most bodies that are shown side by side."""


class BodyPath(NamedTuple):
    """Orientation and position over time.

    Attributes
    ----------
    rotation : (..., samples, 3, 3)
        Body to inertial frame; a planar motion turns about z; identity without rotations.
    position : (..., samples, 3)
        Inertial frame, m; zero on a group without translations.
    """

    rotation: Array
    position: Array


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
    has_translation
        Whether bodies move as well as turn.
    thrusts : (controllers, samples, thrusters, 2, 3)
        A line from each thruster along its thrust, in the body frame; the largest coordinate of a
        place and the largest thrust are 1.
    norms : dict of str to (controllers, samples)
        Norms of pose error and torque by name, per part where rotation and translation have
        different units.
    """

    run: int
    times: Array
    ensembles: Sequence[Ensemble]
    body: BodyPath
    reference: BodyPath
    has_translation: bool
    thrusts: Array
    norms: dict[str, Array]

    @property
    def extent(self) -> float:
        """Largest distance of a position from the midpoint of all, m; 0 where nothing moves."""
        middle = (self.places.min(axis=0) + self.places.max(axis=0)) / 2
        return float(np.linalg.norm(self.places - middle, axis=-1).max())

    @property
    def places(self) -> Array:
        """All positions of bodies and reference, ``(places, 3)``, m."""
        bodies = self.body.position.reshape(-1, 3)
        places = np.concatenate([bodies, self.reference.position])
        return places[np.isfinite(places).all(axis=-1)]


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
    parts = group_named(results.group_name).parts
    turning = next((part for part in parts if part.turns), None)
    moving = next((part for part in parts if part.pose_unit == "m"), None)
    if turning is None and moving is None:
        raise results.error(
            f"a pose of {results.group_name} is neither a rotation nor a place in metres, so no "
            "body can be shown; `eqt plot --figure runs` draws its runs"
        )
    ends = [f"_{part.name}" for part in (turning, moving) if part is not None]
    ends = [end for end in ends if results.has(f"pose_error{end}")] or [""]
    norms = [norm + end for norm in ("pose_error", "torque_norm") for end in ends]
    return Motion(
        run=run,
        times=results.times,
        ensembles=ensembles,
        body=_course(results.trajectory("pose", run)[shown], turning, moving),
        reference=_course(results["desired_pose"], turning, moving),
        has_translation=moving is not None,
        thrusts=_thrusts(results, run, shown),
        norms={name: results.trajectory(name, run)[shown] for name in norms},
    )


def _thrusts(results: Result, run: int, shown: list[int]) -> Array:
    actuators = source_of(results).data["actuators"] if results.has("thrust") else ()
    rows = [each["thrusters"] for each in actuators if each.get("thrusters")]
    if not rows:
        return np.empty((len(shown), len(results.times), 0, 2, 3))
    thrust = results.trajectory("thrust", run)[shown][..., None]
    at, along = (np.array([[*each[key], 0.0][:3] for each in rows[0]]) for key in ("at", "along"))
    at, thrust = (each / (np.nanmax(np.abs(each)) or 1.0) for each in (at, thrust))
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    return np.stack(np.broadcast_arrays(at, at + thrust * along), axis=-2)


def _course(poses: Array, turning: Part | None, moving: Part | None) -> BodyPath:
    rotation = np.broadcast_to(np.eye(3), (*poses.shape[:-2], 3, 3)).copy()
    position = np.zeros((*poses.shape[:-2], 3))
    if turning is not None:
        block = poses[(..., *turning.entries)]
        size = block.shape[-1]
        rotation[..., :size, :size] = block
    if moving is not None:
        column = poses[(..., *moving.entries)][..., 0]
        position[..., : column.shape[-1]] = column[..., :3]
    return BodyPath(rotation, position)


AXES = {"x": "#c1272d", "y": "#2e8b57", "z": "#1f5fbf"}
"""Axes of the body with their colours."""

INERTIAL = "XYZ"
"""Names of the inertial axes."""

TRAIL = 4.0
"""Duration of the trail of a body, s."""

_CLOSE, _AROUND = 1.75, 0.75
"""Reach of a camera: in lengths of a body's axes where body and target agree; and what is added, as
a share of the distance between them."""
_CALM = 1.0
"""Window over which the camera's distance and place are averaged, s."""
_BELOW = 1.5
"""Depth of the ground below the lowest position, in lengths of an axis."""
_SIGHTS = 3.0
"""Extent of the grid beyond all positions, in largest reaches of the camera."""
_MOST_LINES = 60
"""Most lines of the grid in each direction, approximately."""

HALF_SIZES = (0.62, 0.36, 0.13)
"""Half sizes of the block that stands for the body, in lengths of its axes."""

ELEVATION, AZIMUTH = np.deg2rad(22.0), np.deg2rad(35.0)

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF_SIZES
"""Corners of the block in its own frame, ``(8, 3)``."""
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Corners of each face of the block, as indices into `CORNERS`, in order around the face."""

_NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], float)
_LIGHT = np.array([0.35, 0.25, 0.9]) / np.linalg.norm([0.35, 0.25, 0.9])


def camera() -> Array:
    """Return the camera's axes as rows: right, up, and towards the eye, ``(3, 3)``."""
    level = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
    towards = np.cos(ELEVATION) * level + [0.0, 0.0, np.sin(ELEVATION)]
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def tips(rotation: Array, position: Array, length: float) -> Array:
    """Return the tips of the axes of a frame in the plane of the picture, ``(3, 2)``."""
    return flat(position + length * rotation.T)


def flat(position: Array) -> Array:
    """Project positions onto the plane of the picture, ``(..., 2)``."""
    return (position @ camera().T)[..., :2]


def block(rotation: Array, position: Array, length: float) -> list[tuple[Array, float]]:
    """Return the visible faces; a block is convex, so they do not hide each other.

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
    centre : (controllers, samples, 3)
        Point that each camera looks at, m: the midpoint of body and target.
    reach : (samples,)
        Distance that all cameras see from there, m.
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
    reach: Array
    ground: Array
    trails: Array

    def trail(self, index: int, sample: int) -> Array:
        """Return the trail of a body at a sample, ``(any, 3)``, m."""
        first = int(np.searchsorted(self.motion.times, self.motion.times[sample] - TRAIL))
        return np.asarray(self.trails[index, first : sample + 1])


def scene_of(motion: Motion) -> Scene:
    """Return the scene of a motion, the same for every file format."""
    body, target = motion.body.position, motion.reference.position
    apart = np.linalg.norm(body - target, axis=-1)
    apart = np.where(np.isfinite(apart), apart, 0.0).max(axis=0)
    length = _length(motion, apart)
    middle = (np.where(np.isfinite(body), body, target) + target) / 2
    steps = max(1, round(_CALM / max(float(np.mean(np.diff(motion.times))), 1e-9)))
    centre = np.stack([_calm(each, steps) for each in middle])
    reach = _CLOSE * length + _AROUND * _calm(apart[:, None], steps)[:, 0]
    return Scene(
        motion=motion,
        columns=int(np.ceil(np.sqrt(len(motion.ensembles)))),
        length=length,
        centre=centre,
        reach=reach,
        ground=_grid(motion, length, float(reach.max())),
        trails=body if motion.has_translation else body + motion.body.rotation[..., 0] * length,
    )


def _length(motion: Motion, apart: Array) -> float:
    """Return a length of axes visible beside the paths and the distances to the target, m."""
    if not motion.has_translation:
        return 1.0
    return float(max(0.3 * apart.max(), 0.12 * motion.extent)) or 1.0


def _calm(values: Array, steps: int) -> Array:
    """Return the running mean over `steps` samples, ``(samples, k)``."""
    before, after = (steps - 1) // 2, steps // 2
    padded = np.pad(values, ((before, after), (0, 0)), mode="edge")
    sums = np.cumsum(np.insert(padded, 0, 0.0, axis=0), axis=0)
    return np.asarray((sums[steps:] - sums[:-steps]) / steps)


def _grid(motion: Motion, length: float, reach: float) -> Array:
    """Return grid lines at round distances on the ground, below all bodies, ``(lines, 2, 3)``."""
    places = motion.places if motion.has_translation else np.zeros((1, 3))
    low, high = places.min(axis=0) - _SIGHTS * reach, places.max(axis=0) + _SIGHTS * reach
    height = places[:, 2].min() - _BELOW * length
    size = max(length, float((high - low)[:2].max()) / _MOST_LINES)
    step = 10.0 ** np.floor(np.log10(size))
    step *= next(k for k in (1, 2, 5, 10) if k * step >= size * (1 - 1e-9))
    marks = [step * np.arange(np.floor(low[k] / step), np.ceil(high[k] / step) + 1) for k in (0, 1)]
    (x, y), ends = marks, [(each[0], each[-1]) for each in marks]
    along = [[(a, ends[1][0], height), (a, ends[1][1], height)] for a in x]
    across = [[(ends[0][0], b, height), (ends[0][1], b, height)] for b in y]
    return np.array(along + across)
