"""Lambert's azimuthal equal-area projection of the unit sphere onto the unit disc."""

import numpy as np

from eqt_cli.core.arrays import Array

_NEAR_RIM = -np.cos(np.pi / 4)
"""Cosine of 135°: farther out, a path may pass the point opposite the centre."""


_FINER = 16
"""Number of parts into which a step near the rim is divided."""


def radius(angle: Array | float) -> Array:
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
