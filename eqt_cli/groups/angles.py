"""Functions of a rotation angle without a singularity at 0, on floats and on symbols.

Each is a power series in a quantity so small that few terms suffice, of a function whose nearest
singularity was taken out before. It knows no group and no pose.
"""

import math
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array, sqrt

FARTHEST = 2 * math.sqrt(2)
"""‖I − R‖_F of a half-turn, in the plane and in space."""

SINE_TERMS = 12
COTANGENT_TERMS = 14
"""So many that what is left out is below a tenth of the last place of a double."""


def distance_of_turn(angle: float) -> float:
    """‖I − R‖_F = 2√2 sin(θ/2) of a rotation by an angle, rad."""
    return FARTHEST * math.sin(angle / 2)


def turn_of_distance(distance: Array) -> Array:
    """The angle, rad, of rotations with these ‖I − R‖_F; undoes `distance_of_turn`."""
    return 2 * np.arcsin(np.minimum(distance / FARTHEST, 1.0))


def ratio_to_sine(c: Any) -> Any:
    """x / sin x of x = arccos c, for c from 0 to 1.

    At a quarter of the angle, in s = sin²(x/8) up to sin²(π/16), and doubled twice from there by
    2x / sin 2x = (x / sin x) / cos x.
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


def _over_sine() -> list[float]:
    """The coefficients of x / sin x in powers of sin²(x/2): ₂F₁(1, 1; 3/2; s)."""
    terms = [1.0]
    for n in range(1, SINE_TERMS):
        terms.append(terms[-1] * 2 * n / (2 * n + 1))
    return terms


def _cotangent() -> list[float]:
    """Those of (1 − x cot x)/x² − 2/(π² − x²) in powers of x².

    By the differential equation of the cotangent, the coefficients d of 1 − x cot x in x² satisfy
    (2n + 1) d_n = d_1 d_{n−1} + … + d_{n−1} d_1.
    """
    d = [1 / 3]
    for n in range(2, COTANGENT_TERMS + 1):
        d.append(sum(a * b for a, b in zip(d, d[::-1], strict=True)) / (2 * n + 1))
    return [term - 2 / math.pi ** (2 * n) for n, term in enumerate(d, start=1)]


def _series(coefficients: list[float], x: Any) -> Any:
    """Σ c_n xⁿ by threes: short chains of products, on which the time of compiled code depends."""
    square = x * x
    cube, total = square * x, 0.0
    for start in reversed(range(0, len(coefficients), 3)):
        three = [*coefficients[start : start + 3], 0.0, 0.0][:3]
        total = total * cube + (three[0] + three[1] * x + three[2] * square)
    return total


_OVER_SINE, _COTANGENT = _over_sine(), _cotangent()
