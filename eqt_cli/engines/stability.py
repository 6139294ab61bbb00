"""The number of steps that stability alone demands of an explicit method."""

import numpy as np

from eqt_cli.core.arrays import Array

REACH, RESOLUTION = 40.0, 0.01
"""Length and spacing of the points on a ray at which the stability function is evaluated."""


def runge_kutta(A: Array, b: Array) -> Array:
    """Return the coefficients of R(z) = 1 + z bᵀ(1 − zA)⁻¹1, explicit A, in rising powers."""
    stages = len(b)
    square, powers = np.zeros((stages, stages)), [np.ones(stages)]
    square[: A.shape[0], : A.shape[1]] = A[:stages, :stages]
    for _ in range(stages - 1):
        powers.append(square @ powers[-1])
    return np.array([1.0, *(b @ power for power in powers)])


def steps(coefficients: Array, rates: Array, duration: float) -> float:
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


def _inverse_step(coefficients: Array, rates: Array) -> float:
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
