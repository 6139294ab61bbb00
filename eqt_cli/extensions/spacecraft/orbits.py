"""Where a satellite is on an ellipse: Kepler's equation, solved by Newton's method.

Source: Danby, Fundamentals of Celestial Mechanics (1988), chapter 6; Battin, An Introduction to the
Mathematics and Methods of Astrodynamics (1999), section 4.3.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, apply, cos, sin, sqrt, stack
from eqt_cli.base.errors import Problems
from eqt_cli.numbers.rounded import rounded

LONGEST, STEPS = 0.97, 6
"""Largest eccentricity, and steps of Newton after which E is as exact as rounding lets it be."""


def check_eccentricity(eccentricity: float, problems: Problems) -> None:
    """Note what is no eccentricity of an ellipse, or one beyond what Newton's steps serve."""
    if not 0 <= eccentricity <= LONGEST:
        problems.add(f"expected a number from 0 to {LONGEST}, got {eccentricity:g}")


@lru_cache(maxsize=64)  # runs whose other numbers are drawn have the same
def ellipse(eccentricity: float, anomaly: float) -> Array:
    """Return e, √(1 − e²), M₀, cos ν₀ and sin ν₀ of the true anomaly ν₀ at t = 0."""

    def numbers(shape: Array) -> Array:
        e, nu = shape[..., 0], shape[..., 1]
        c, s, across = cos(nu), sin(nu), sqrt(1 - e * e)
        E = 2 * apply("atan", across * s / ((1 + e) * (1 + c)))
        return stack([e, across, E - e * sin(E), c, s])

    return rounded(numbers, np.array([eccentricity, anomaly]))


def place_on(ellipse: Array, turned: Any) -> tuple[Any, Any, Any]:
    """Return cosine and sine of the angle since t = 0, ν − ν₀, and a/r.

    Parameters
    ----------
    ellipse
        As `ellipse` returns it.
    turned
        n t, rad, with the mean motion n.
    """
    e, across, M0, c0, s0 = (ellipse[..., k] for k in range(5))
    M = M0 + turned
    x = e * sin(M) / sqrt(1 - 2 * e * cos(M) + e * e)  # E − M, to the second order in e
    for _ in range(STEPS):
        x = x - (x - e * sin(M + x)) / (1 - e * cos(M + x))
    near = 1 / (1 - e * cos(M + x))
    c, s = near * (cos(M + x) - e), near * across * sin(M + x)
    return c * c0 + s * s0, s * c0 - c * s0, near
