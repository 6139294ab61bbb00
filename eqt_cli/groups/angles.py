"""Functions of a rotation angle without a singularity at 0, on floats and on symbols.

Each is a short series at a fraction of the angle, and doubles that angle up to the whole. It knows
no group and no pose.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array, sqrt

FARTHEST = 2 * math.sqrt(2)
"""‖I − R‖_F of a half-turn, in the plane and in space."""

HALVINGS = 4
"""So many halvings leave at most π/32, whose series end soon."""

_ARCSINE = (1.0, 1 / 6, 3 / 40, 5 / 112, 35 / 1152, 63 / 2816, 231 / 13312)
"""Of arcsin(√s) / √s in s ≤ sin²(π/32); what is left out is below 1e-16."""

_COTANGENT = (1 / 3, 1 / 45, 2 / 945, 1 / 4725, 2 / 93555, 1382 / 638512875)
"""Of (1 − x cot x) / x² in x² ≤ (π/32)²; what is left out is below 1e-17."""


def distance_of_turn(angle: float) -> float:
    """‖I − R‖_F = 2√2 sin(θ/2) of a rotation by an angle, rad."""
    return FARTHEST * math.sin(angle / 2)


def turn_of_distance(distance: Array) -> Array:
    """The angle, rad, of rotations with these ‖I − R‖_F; undoes `distance_of_turn`."""
    angle: Array = 2 * np.arcsin(np.minimum(distance / FARTHEST, 1.0))
    return angle


def ratio_to_sine(c: Any) -> Any:
    """x / sin x of x = arccos c, for c from 0 to 1."""
    cosines: Any = 1.0
    for _ in range(HALVINGS):
        s, c = (1 - c) / 2, sqrt((1 + c) / 2)  # s is sin² of the halved angle
        cosines = cosines * c
    return _series(_ARCSINE, s) / cosines


def inverse_jacobian_terms(square: Any) -> tuple[Any, Any]:
    """ψ = (1 − (θ/2) cot(θ/2)) / θ² and its derivative by θ², from θ² ≤ π².

    With x = θ/2 halved to the ends of the series, D(x) = (1 − x cot x)/x² doubles its angle by
    D(2x) = (D + T)/4 with T = tan x / x = 1/(1 − x² D).
    """
    v = square / 4 / 4**HALVINGS
    D = _series(_COTANGENT, v)
    slope = _series(tuple(n * d for n, d in enumerate(_COTANGENT))[1:], v)
    for _ in range(HALVINGS):
        T = 1 / (1 - v * D)
        D, slope, v = (D + T) / 4, (slope + T * (T - D) / 2) / 16, 4 * v
    return D / 4, slope / 16


def _series(coefficients: tuple[float, ...], x: Any) -> Any:
    total: Any = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total
