"""Bodies in space: where they are over time, their outlines, and the eye that sees them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.components.groups import Part
from eqt_cli.results.result import Result


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


def upright(result: Result) -> Array:
    """Return what turns the axes of space so that the last one points up, ``(3, 3)``."""
    return np.diag([1.0, -1.0, -1.0]) if result.described.down else np.eye(3)


def course(
    poses: Array, turning: Part | None, moving: Part | None, frame: Array | None = None
) -> BodyPath:
    """Return orientations and positions of poses ``(..., d, d)``, in a frame turned from space."""
    rotation = np.broadcast_to(np.eye(3), (*poses.shape[:-2], 3, 3)).copy()
    position = np.zeros((*poses.shape[:-2], 3))
    if turning is not None:
        entries = poses[(..., *turning.entries)]
        size = entries.shape[-1]
        rotation[..., :size, :size] = entries
    if moving is not None:
        column = poses[(..., *moving.entries)][..., 0]
        position[..., : column.shape[-1]] = column[..., :3]
    if frame is None:
        return BodyPath(rotation, position)
    return BodyPath(frame @ rotation, position @ frame.T)


ELEVATION, AZIMUTH = np.deg2rad(22.0), np.deg2rad(35.0)
"""Direction of the eye, which sees bodies obliquely from above, rad."""


def camera(elevation: float = ELEVATION, azimuth: float = AZIMUTH) -> Array:
    """Return the camera's axes as rows: right, up, and towards the eye, ``(3, 3)``."""
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    towards = np.cos(elevation) * level + [0.0, 0.0, np.sin(elevation)]
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


HALF_SIZES = (0.62, 0.36, 0.13)
"""Half sizes of the box that stands for the body, in lengths of its axes."""

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF_SIZES
"""Corners of the box in its own frame, ``(8, 3)``."""
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Corners of each face of the box, as indices into `CORNERS`, in order around the face."""

_ROTOR, _ROUND = 0.42, 24
"""Radius of a rotor's disc, in lengths of an arm, and corners of its outline."""


def rotors(result: Result) -> Array:
    """Return place and direction of each rotor in the body, ``(rotors, 2, 3)``; none of a box.

    The farthest is at distance 1. A vehicle that pushes along one axis only, and whose rotors are
    not known, has four of them.
    """
    mounts = np.array(result.described.thrusters, float).reshape(-1, 2, 3)
    if not len(mounts) and result.has("attitude_command_error"):
        corners = [(x, y, 0) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
        mounts = np.array([(corner, (0, 0, 1)) for corner in corners], float)
    along = mounts[:, 1] / np.linalg.norm(mounts[:, 1:], axis=-1).reshape(-1, 1)
    if len(mounts) < 3 or abs(along @ along[0]).min() < 0.99:  # thrusters that push in several ways
        return np.empty((0, 2, 3))
    return np.stack([mounts[:, 0] / np.linalg.norm(mounts[:, 0], axis=-1).max(), along], axis=1)


def outline(result: Result) -> list[Array]:
    """Return a body as polygons in its own frame, ``(corners, 3)``: a multirotor or a box."""
    return list(discs(rotors(result))) or [CORNERS[list(face)] for face in FACES]


def discs(of: Array) -> Iterator[Array]:
    """Yield arm and disc of each rotor, ``(corners, 3)``."""
    angles = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)[:, None]
    for place, along in of:
        first = np.cross(along, np.eye(3)[abs(along).argmin()])
        first /= np.linalg.norm(first)
        yield np.array([np.zeros(3), place])
        ring = np.cos(angles) * first + np.sin(angles) * np.cross(along, first)
        yield place + _ROTOR * ring
