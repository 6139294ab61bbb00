"""What the moving picture of a run shows, for the GIF and the page alike; it draws nothing.

Bodies with coloured axes, the ghost of the target, trails, a ground grid and an inertial frame,
seen by a camera that follows body and target.
"""

from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.plots.animation.motion import Motion

AXES = {"x": "#c1272d", "y": "#2e8b57", "z": "#1f5fbf"}
"""The body's axes, with their colours."""

INERTIAL = "XYZ"
"""The names of the inertial axes."""

TRAIL = 4.0
"""s, of the past that the trail of a body shows."""

_CLOSE, _AROUND = 1.75, 0.75
"""How far a camera sees: in lengths of a body's axes where body and target agree; and the share of
the distance between them that it sees beyond the middle."""
_CALM = 1.0
"""s, over which the camera's distance and place are averaged."""
_BELOW = 1.5
"""Of the length of an axis: how far the ground is below the lowest place."""
_SIGHTS = 3.0
"""How far the grid reaches beyond all places, in sights of the camera."""
_MOST_LINES = 60
"""Of the grid, in each direction."""

HALF_SIZES = (0.62, 0.36, 0.13)
"""Of the block that stands for the body, in lengths of a frame's axes."""

ELEVATION, AZIMUTH = np.deg2rad(22.0), np.deg2rad(35.0)

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF_SIZES
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Corners of the faces of the block, by position in `CORNERS`, counted around each."""

_NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], float)
_LIGHT = np.array([0.35, 0.25, 0.9]) / np.linalg.norm([0.35, 0.25, 0.9])


@dataclass(frozen=True)
class Face:
    """A visible face of the block.

    Attributes
    ----------
    outline : (4, 2)
        In the plane of the picture.
    light
        From 0, in the shade, to 1.
    """

    outline: Array
    light: float


def camera() -> Array:
    """Rows: right, up, and towards the eye, (3, 3)."""
    level = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
    towards = np.cos(ELEVATION) * level + [0.0, 0.0, np.sin(ELEVATION)]
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def corners() -> Array:
    """Corners of the block in its own frame, (8, 3)."""
    return _CORNERS.copy()


def tips(rotation: Array, position: Array, length: float) -> Array:
    """The ends of the three axes of a frame, in the plane of the picture, (3, 2)."""
    return flat(position + length * rotation.T)


def flat(position: Array) -> Array:
    """A place in the plane of the picture, (..., 2)."""
    return (position @ camera().T)[..., :2]


def block(rotation: Array, position: Array, length: float) -> list[Face]:
    """The faces that the eye sees; a block is convex, so they do not hide each other."""
    placed = position + length * _CORNERS @ rotation.T
    seen = []
    for face, normal in zip(FACES, _NORMALS, strict=True):
        turned = rotation @ normal
        if turned @ camera()[2] > 0:
            seen.append(Face(flat(placed[list(face)]), float((1 + turned @ _LIGHT) / 2)))
    return seen


@dataclass(frozen=True)
class Scene:
    """A run in space, seen from a direction that a viewer may change.

    Attributes
    ----------
    motion
        What moves.
    columns
        Bodies side by side.
    length
        Of a body's axes, m.
    centre : (controllers, samples, 3)
        Where each camera looks, m: the middle between body and target.
    reach : (samples,)
        How far all cameras see from there, m.
    ground : (lines, 2, 3)
        The ends of the lines of the grid, m.
    trails : (controllers, samples, 3)
        What leaves the trails, m: the bodies' places, or the tips of their x axes where they only
        turn.
    """

    motion: Motion
    columns: int
    length: float
    centre: Array
    reach: Array
    ground: Array
    trails: Array

    def trail(self, index: int, sample: int) -> Array:
        """The trail of a body at a sample, ``(any, 3)``."""
        first = int(np.searchsorted(self.motion.times, self.motion.times[sample] - TRAIL))
        return np.asarray(self.trails[index, first : sample + 1])


def scene_of(motion: Motion) -> Scene:
    """The scene of a motion; one for every file format."""
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
    """What is seen beside the paths, and beside the distances between bodies and target."""
    if not motion.has_translation:
        return 1.0
    return float(max(0.3 * apart.max(), 0.12 * motion.extent)) or 1.0


def _calm(values: Array, steps: int) -> Array:
    """A running mean over so many samples, ``(samples, k)``."""
    before, after = (steps - 1) // 2, steps // 2
    padded = np.pad(values, ((before, after), (0, 0)), mode="edge")
    sums = np.cumsum(np.insert(padded, 0, 0.0, axis=0), axis=0)
    return np.asarray((sums[steps:] - sums[:-steps]) / steps)


def _grid(motion: Motion, length: float, reach: float) -> Array:
    """Lines of round distances on the ground, below all bodies."""
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
