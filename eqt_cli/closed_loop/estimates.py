"""The estimate that a law is given, and its quality, at the last control instant.

Every function reads the estimator's states, which are among those of the vehicle, and returns NaN
where there is no estimator, as at some points of a sweep.
"""

from collections.abc import Mapping

import numpy as np

from eqt_cli.core.arrays import Array, less, sqrt, stack, where
from eqt_cli.mechanics.tracking import Tracking
from eqt_cli.vehicle.estimators.base import pivots, symmetric
from eqt_cli.vehicle.vehicle import estimator_states


def kept(s: Tracking, name: str, like: Array) -> Array:
    """Return the estimator state of this name; NaN in the shape of `like` if there is none."""
    states: Mapping[str, Array] = estimator_states(s.vehicle)
    return states[name] if name in states else np.nan + 0.0 * like


def pose(s: Tracking) -> Array:
    """Return the estimated pose Q̂."""
    return s.G.unpack(kept(s, "pose", s.G.pack(s.Q)))


def error(s: Tracking) -> Array:
    """Return the estimation error (ε, b̃) = (log(Q̂⁻¹Q), b − b̂), ``(..., 2m)``."""
    return kept(s, "error", np.concatenate([s.P, s.P], axis=-1))


def of_pose(s: Tracking) -> Array:
    """Return the error ε of the estimated pose."""
    return error(s)[..., : s.G.dimension]


def of_bias(s: Tracking) -> Array:
    """Return the error b̃ of the estimated bias."""
    return error(s)[..., s.G.dimension :]


def difference(s: Tracking) -> Array:
    """Return I − Q̂⁻¹Q."""
    return s.G.identity - s.G.exp(of_pose(s))


def deviations(s: Tracking) -> Array:
    """Return the standard deviations, the roots of the diagonal of Σ, ``(..., 2m)``."""
    n = 2 * s.G.dimension
    rows, columns = np.triu_indices(n)
    entries = _covariance(s)[..., np.flatnonzero(rows == columns)]
    return sqrt(where(less(0.0, entries), entries, 0.0))


def consistency(s: Tracking) -> tuple[Array, Array]:
    """Return (ε, b̃)ᵀ Σ⁻¹ (ε, b̃) and the number of its degrees of freedom, ``(...)`` each."""
    d, y = pivots(symmetric(_covariance(s), 2 * s.G.dimension), error(s))
    square = freedom = 0.0 * d[0]
    for pivot, value in zip(d, y, strict=True):
        counts = less(0.0, pivot)
        square = square + where(counts, value * value / where(counts, pivot, 1.0), 0.0)
        freedom = freedom + where(counts, 1.0, 0.0)
    return square, freedom


def innovations(s: Tracking) -> tuple[Array, Array, Array]:
    """Return the number, mean square and lag-one correlation of the innovations."""
    sums = kept(s, "innovations", stack([s.P[..., 0]] * 3))
    count, squares, products = (sums[..., k] for k in range(3))
    some = less(0.5, count)
    mean = where(some, squares / where(some, count, 1.0), np.nan)
    known = less(0.0, squares)
    return count, mean, where(known, products / where(known, squares, 1.0), np.nan)


def _covariance(s: Tracking) -> Array:
    """Return the entries of the covariance Σ on and above its diagonal."""
    n = 2 * s.G.dimension
    return kept(s, "covariance", stack([s.P[..., 0]] * (n * (n + 1) // 2)))
