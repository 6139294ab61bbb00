"""Lambert's azimuthal equal-area projection of the unit sphere onto the unit disc."""

import numpy as np

from eqt_cli.core.arrays import Array

_NEAR_RIM = -np.cos(np.pi / 4)
"""The cosine of 135°: farther out, a path may pass the point opposite the centre."""


_FINER = 16
"""Into how many a step near the rim is divided."""


def radius(angle: Array | float) -> Array:
    """How far a point at this angle from the centre is from the middle of the disc: sin(θ/2)."""
    return np.sin(np.asarray(angle) / 2)


def project(points: Array, centre: int) -> tuple[Array, Array]:
    """Across and up, of unit vectors ``(..., 3)``.

    The eye is outside, at the tip of the axis of that number: the next axis points right, the one
    after it up. The rim is the point opposite the centre; that point itself is drawn to the right.
    """
    across, up = points[..., (centre + 1) % 3], points[..., (centre + 2) % 3]
    cosine, length = points[..., centre], np.hypot(across, up)
    there = length > 0
    # One number in two forms, each of which keeps its digits in its own half of the sphere.
    near = 1 / np.sqrt(2 * (1 + np.maximum(cosine, 0)))
    far = np.sqrt(np.maximum(1 - cosine, 0) / 2) / np.where(there, length, 1)
    scale = np.where(cosine >= 0, near, far)
    opposite = (cosine < 0) & ~there
    return np.where(opposite, 1, across) * scale, up * scale


def path(points: Array, centre: int) -> tuple[Array, Array]:
    """As `project`, of a path ``(samples, 3)``; more finely towards the rim.

    There a small step on the sphere may go far around the disc, so that it is drawn as the great
    circle it is nearly. There is a gap where a path passes opposite the centre: it leaves the disc
    at one side and comes back at the other.
    """
    outside = points[:, centre] < _NEAR_RIM
    points = _refined(points, outside[1:] | outside[:-1])
    x, y = project(points, centre)
    outside = points[:, centre] < _NEAR_RIM
    opposed = x[1:] * x[:-1] + y[1:] * y[:-1] < 0
    gaps = np.flatnonzero(opposed & outside[1:] & outside[:-1]) + 1
    return np.insert(x, gaps, np.nan), np.insert(y, gaps, np.nan)


def _refined(points: Array, steps: Array) -> Array:
    """The path with some of its steps divided into `_FINER`."""
    share = np.arange(1, _FINER)[:, None] / _FINER
    pieces = [points[:1]]
    for start, end, fine in zip(points, points[1:], steps, strict=False):
        if fine:
            between = (1 - share) * start + share * end
            lengths = np.linalg.norm(between, axis=1, keepdims=True)
            pieces.append(between / np.where(lengths > 0, lengths, 1))
        pieces.append(end[None])
    return np.concatenate(pieces)
