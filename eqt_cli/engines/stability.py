"""The number of steps that stability alone demands of an explicit method."""

from collections.abc import Sequence
from math import factorial

import numpy as np

from eqt_cli.core.arrays import Array

_TAYLOR = tuple(1 / factorial(power) for power in range(9))
_LAST = 2.6916922001691e-6, 2.3413451082098e-7, 1.4947364854592e-8, 3.6133245781282e-10

FUNCTIONS = {"RK23": _TAYLOR[:4], "RK45": (*_TAYLOR[:6], 1 / 600), "DOP853": _TAYLOR + _LAST}
"""R(z) = 1 + z bᵀ(1 − zA)⁻¹1 of the tableau A, b, in rising powers up to the number of stages."""

REACH, RESOLUTION = 40.0, 0.01
"""Length and spacing of the points on a ray at which the stability function is evaluated."""


def steps(coefficients: Sequence[float], rates: Array, duration: float) -> float:
    """Return the number of steps at which no decaying solution of y' = λy grows.

    Parameters
    ----------
    coefficients
        Stability function R(z), in rising powers: a step multiplies y by R(hλ).
    rates : (instants, n)
        The eigenvalues λ at instants spread evenly over the duration, 1/s.

    Returns
    -------
    float
        The mean over instants of max |λ| / r, times the duration, where r is the first distance
        from 0 along the direction of λ at which |R| exceeds 1.
    """
    decaying = np.where(rates.real < 0, rates, 0.0)
    fastest = [_inverse_step(coefficients, at_once) for at_once in decaying]
    return float(duration * np.mean(fastest))


def _inverse_step(coefficients: Sequence[float], rates: Array) -> float:
    """Return 1/h of the longest stable step h, 1/s."""
    sizes = np.abs(rates)
    large = rates[sizes > sizes.max() / 10]  # r is 2 to 7 in all directions but along the axis
    if not len(large):
        return 0.0
    distances = np.arange(RESOLUTION, REACH, RESOLUTION)
    z = distances[:, None] * large / np.abs(large)
    grows = np.abs(np.polynomial.polynomial.polyval(z, coefficients)) > 1 + 1e-9
    first = np.where(grows.any(axis=0), grows.argmax(axis=0), len(distances) - 1)
    return float((np.abs(large) / distances[first]).max())
