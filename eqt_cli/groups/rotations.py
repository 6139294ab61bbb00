"""Rotations: functions of their angle that are smooth at 0, and matrices of other forms.

The former are for floats and symbols. Each is a power series in a small quantity, of a function
whose nearest singularity is removed first, so that few terms suffice. The latter, of quaternions
(x, y, z, w), rotation vectors and Euler angles, have the operations of SciPy's `Rotation`, in its
order, and give its bits (tests/groups/test_quaternions.py). To import that module takes longer
than NumPy and h5py.
"""

import math
from functools import reduce
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array, cos, norm, sin, smooth_less, sqrt, where

FARTHEST = 2 * math.sqrt(2)
"""‖I − R‖_F of a half-turn, in the plane and in space."""

SINE_TERMS = 12
COTANGENT_TERMS = 14
STUMPFF_TERMS = 9
"""Numbers of terms; the truncation error is below a tenth of the last place of a double."""

SMALL_SQUARE = 1.0
"""θ² up to which `stumpff` is a series, beyond which differences lose two digits at the most."""


def distance_of_turn(angle: float) -> float:
    """Return ‖I − R‖_F = 2√2 sin(θ/2) of a rotation by an angle, rad."""
    return FARTHEST * math.sin(angle / 2)


def turn_of_distance(distance: Array) -> Array:
    """Return the angle, rad, of rotations with these ‖I − R‖_F; inverts `distance_of_turn`."""
    return 2 * np.arcsin(np.minimum(distance / FARTHEST, 1.0))


def ratio_to_sine(c: Any) -> Any:
    """x / sin x of x = arccos c, for c from 0 to 1.

    The series is evaluated at x/4, in s = sin²(x/8) up to sin²(π/16), and the angle is doubled
    twice by 2x / sin 2x = (x / sin x) / cos x.
    """
    half = sqrt((1 + c) / 2)
    quarter = sqrt((1 + half) / 2)
    return _series(_OVER_SINE, (1 - quarter) / 2) / (half * quarter)


def inverse_jacobian_terms(square: Any) -> tuple[Any, Any]:
    """ψ = (1 − (θ/2) cot(θ/2)) / θ² and its derivative by θ², from θ² ≤ π².

    With x = θ/2, (1 − x cot x)/x² = 2/(π² − x²) + a series that converges for x < 2π.
    """
    v = square / 4
    pole = 1 / (math.pi**2 - v)
    value = 2 * pole + _series(_COTANGENT, v)
    slope = 2 * pole * pole + _series([n * d for n, d in enumerate(_COTANGENT)][1:], v)
    return value / 4, slope / 16


def stumpff(square: Any) -> tuple[Any, ...]:
    """c_0 … c_5 of θ², with c_k = 1/k! − θ²/(k + 2)! + …: c_0 = cos θ, c_1 = sin θ / θ.

    From c_2 = (1 − c_0)/θ² on each is (1/k! − c_k)/θ² of an earlier one, and a series where θ is
    small. They are the coefficients of the exponential of a turn, and of its integral.
    """
    small = smooth_less(square, SMALL_SQUARE)
    far = where(small, SMALL_SQUARE, square)
    angle = sqrt(far)
    terms = [cos(angle), sin(angle) / angle]
    for k in range(4):
        terms.append((1 / math.factorial(k) - terms[k]) / far)
    near = where(small, square, SMALL_SQUARE)
    return tuple(where(small, _series(_STUMPFF[k], near), closed) for k, closed in enumerate(terms))


def _over_sine() -> list[float]:
    """Return the coefficients of x / sin x in powers of sin²(x/2): ₂F₁(1, 1; 3/2; s)."""
    terms = [1.0]
    for n in range(1, SINE_TERMS):
        terms.append(terms[-1] * 2 * n / (2 * n + 1))
    return terms


def _cotangent() -> list[float]:
    """Return the coefficients of (1 − x cot x)/x² − 2/(π² − x²) in powers of x².

    By the differential equation of the cotangent, the coefficients d of 1 − x cot x in x² satisfy
    (2n + 1) d_n = d_1 d_{n−1} + … + d_{n−1} d_1.
    """
    d = [1 / 3]
    for n in range(2, COTANGENT_TERMS + 1):
        d.append(sum(a * b for a, b in zip(d, d[::-1], strict=True)) / (2 * n + 1))
    return [term - 2 / math.pi ** (2 * n) for n, term in enumerate(d, start=1)]


def _series(coefficients: list[float], x: Any) -> Any:
    """Return Σ c_n xⁿ, three terms at a time, because short chains make compiled code fast."""
    square = x * x
    cube, total = square * x, 0.0
    for start in reversed(range(0, len(coefficients), 3)):
        three = [*coefficients[start : start + 3], 0.0, 0.0][:3]
        total = total * cube + (three[0] + three[1] * x + three[2] * square)
    return total


_OVER_SINE, _COTANGENT = _over_sine(), _cotangent()
_STUMPFF = [[(-1) ** n / math.factorial(2 * n + k) for n in range(STUMPFF_TERMS)] for k in range(6)]


# Rotations of space -------------------------------------------------------------------------------


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
        return _quaternion_product(q, turn) if sequence.isupper() else _quaternion_product(turn, q)

    half = np.asarray(angles) / 2
    turns = np.zeros((len(sequence), *half.shape[:-1], 4))
    for index, letter in enumerate(sequence.lower()):
        turns[index, ..., "xyz".index(letter)] = np.sin(half[..., index])
        turns[index, ..., 3] = np.cos(half[..., index])
    return rotation_of_quaternion(reduce(joined, turns))


def _quaternion_product(p: Array, q: Array) -> Array:
    vector = p[..., 3:] * q[..., :3] + q[..., 3:] * p[..., :3] + np.cross(p[..., :3], q[..., :3])
    scalar = p[..., 3] * q[..., 3]
    for k in range(3):
        scalar = scalar - p[..., k] * q[..., k]
    return np.concatenate([vector, scalar[..., None]], axis=-1)
