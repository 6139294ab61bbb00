"""Rotations of space from quaternions (x, y, z, w), rotation vectors and Euler angles.

The operations are those of `scipy.spatial.transform.Rotation`, in its order, and give its bits
(tests/groups/test_quaternions.py). To import that module takes longer than NumPy and h5py.
"""

from functools import reduce

import numpy as np

from eqt_cli.core.arrays import Array, norm

SMALL_ANGLE = 1e-3
"""Angle, rad, up to which sin(θ/2)/θ is a series; the truncation error is below a last place."""


def rotation_of_quaternion(q: Array) -> Array:
    """Return the rotation of a unit quaternion, ``(..., 4) -> (..., 3, 3)``."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    rows = (
        (x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), -x * x - y * y + z * z + w * w),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_of_vector(turn: Array) -> Array:
    """Return exp of a rotation vector, rad, ``(..., 3) -> (..., 3, 3)``."""
    angle = norm(turn)[..., None]
    small = 0.5 - angle**2 / 48 + angle**4 / 3840
    with np.errstate(invalid="ignore"):
        scale = np.where(angle <= SMALL_ANGLE, small, np.sin(angle / 2) / angle)
    return rotation_of_quaternion(np.concatenate([turn * scale, np.cos(angle / 2)], -1))


def rotation_of_euler(sequence: str, angles: Array) -> Array:
    """Return the product of turns by these angles, rad, ``(..., n) -> (..., 3, 3)``.

    The axes of upper-case letters turn with the body, those of lower-case letters stay.
    """

    def joined(q: Array, turn: Array) -> Array:
        return _product(q, turn) if sequence.isupper() else _product(turn, q)

    half = np.asarray(angles) / 2
    turns = np.zeros((len(sequence), *half.shape[:-1], 4))
    for index, letter in enumerate(sequence.lower()):
        turns[index, ..., "xyz".index(letter)] = np.sin(half[..., index])
        turns[index, ..., 3] = np.cos(half[..., index])
    return rotation_of_quaternion(reduce(joined, turns))


def _product(p: Array, q: Array) -> Array:
    vector = p[..., 3:] * q[..., :3] + q[..., 3:] * p[..., :3] + np.cross(p[..., :3], q[..., :3])
    scalar = p[..., 3] * q[..., 3]
    for k in range(3):
        scalar = scalar - p[..., k] * q[..., k]
    return np.concatenate([vector, scalar[..., None]], axis=-1)
