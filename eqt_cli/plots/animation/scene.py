"""A body and its frames seen from a fixed place, as flat shapes; it knows no time and no result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array

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
    towards = np.array(
        [
            np.cos(ELEVATION) * np.cos(AZIMUTH),
            np.cos(ELEVATION) * np.sin(AZIMUTH),
            np.sin(ELEVATION),
        ]
    )
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def corners() -> Array:
    """Corners of the block in its own frame, (8, 3)."""
    return _CORNERS.copy()


def tips(rotation: Array, position: Array, length: float) -> Array:
    """The ends of the three axes of a frame, in the plane of the picture, (3, 2)."""
    ends = position + length * rotation.T
    return (ends @ camera().T)[:, :2]


def flat(position: Array) -> Array:
    """A place in the plane of the picture, (..., 2)."""
    return (position @ camera().T)[..., :2]


def block(rotation: Array, position: Array, length: float) -> list[Face]:
    """The faces that the eye sees; a block is convex, so they do not hide each other."""
    placed = position + length * _CORNERS @ rotation.T
    view = camera()
    seen = []
    for face, normal in zip(FACES, _NORMALS, strict=True):
        turned = rotation @ normal
        if turned @ view[2] > 0:
            outline = (placed[list(face)] @ view.T)[:, :2]
            seen.append(Face(outline, float((1 + turned @ _LIGHT) / 2)))
    return seen
