"""Gains that follow from an inertia and a bandwidth, and matrices as YAML."""

from collections.abc import Sequence
from typing import Any

import numpy as np

SPREAD = 0.98
"""Largest stiffness about a principal axis relative to the sum of the others, for K > 0."""


def attitude_gains(J: Any, poles: float) -> tuple[Any, Any]:
    """Return weights K and damping K_d by which small errors of an attitude have both poles at −ω.

    They obey J ε̈ + K_d ε̇ + k ε = 0 with k = J ω² and K_d = 2 J ω. The weights K of the navigation
    function give the stiffness tr(K) I − K, so that K = tr(k)/2 I − k; in a plane, where both turn
    the same axis, K_i = k/2. About an axis whose moment is that of the others together, or more, k
    and with it both poles are smaller.

    Parameters
    ----------
    J : (3, 3), or (1, 1) in a plane
        kg m².
    poles
        ω, rad/s.
    """
    moments, axes = np.linalg.eigh(J)
    stiffness = moments * poles**2
    if len(J) == 1:
        return np.diag([stiffness[0] / 2] * 2), 2 * J * poles
    stiffness[-1] = min(stiffness[-1], SPREAD * stiffness[:-1].sum())
    weights, damping = stiffness.sum() / 2 - stiffness, 2 * np.sqrt(moments * stiffness)
    return axes * weights @ axes.T, axes * damping @ axes.T


def block(matrix: Any, diagonal: Sequence[float]) -> Any:
    """Return a matrix with more numbers on its diagonal."""
    size = len(matrix)
    whole = np.diag([*np.diag(matrix), *diagonal])
    whole[:size, :size] = matrix
    return whole


NEGLIGIBLE = 1e-3
"""Numbers off the diagonal, relative to the largest, that a written matrix leaves out."""


def written(value: Any) -> str:
    """Return a number, a list or a symmetric matrix as YAML, to four digits."""
    numbers = np.asarray(value, dtype=float)
    if numbers.ndim == 2:
        small = NEGLIGIBLE * np.abs(numbers).max()
        off = np.abs(numbers - np.diag(np.diag(numbers))).max(initial=0.0)
        numbers = np.diag(numbers) if off <= small else (numbers + numbers.T) / 2
    if numbers.ndim == 0:
        return f"{numbers:.4g}"
    return f"[{', '.join(map(written, numbers))}]"
