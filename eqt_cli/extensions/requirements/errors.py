"""Errors over time: what may lie between samples, shares of time, and exposures."""

from __future__ import annotations

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.results.result import Result

MORE = 4 / 3
"""Times by which the curvature between samples is taken to be larger than they tell; of a sine that
is sampled four times a period, it is."""


def between_samples(x: Array) -> Array:
    """Return by how much a signal may leave the line between two samples, ``(runs, n - 1)``.

    A curve is at most h²/8 max |x″| away from the line over a time h, and three samples tell x″;
    the larger one at both ends counts.
    """
    bends = MORE * np.abs(np.diff(x, n=2, axis=1)) / 8
    if not bends.shape[1]:
        return np.full_like(x[:, 1:], np.inf)
    bends = np.pad(np.where(np.isfinite(bends), bends, np.inf), ((0, 0), (1, 1)), mode="edge")
    return np.maximum(bends[:, 1:], bends[:, :-1])


def share_within(x: Array, limit: float, more: Array, *, upper: bool) -> Array:
    """Return the share of the time in which a signal keeps a bound, ``(runs,)``, by lines.

    Parameters
    ----------
    more : (runs, n - 1)
        What is taken from the bound between two samples.
    upper
        Whether it is an upper bound.
    """
    sign = 1.0 if upper else -1.0
    low, high = (sign * x[:, :-1], sign * x[:, 1:])
    low, high = np.minimum(low, high), np.maximum(low, high)
    room = sign * limit - more
    with np.errstate(invalid="ignore", divide="ignore"):
        part = np.where(high > low, (room - low) / (high - low), np.where(low <= room, 1.0, 0.0))
    part = np.where(np.isinf(high), 0.0, part)
    return np.clip(np.nan_to_num(part), 0, 1).mean(axis=1)


def samples_of(exposure: float, times: Array) -> int:
    """Return how many samples after its first one an exposure takes, at least as long as it is."""
    return int(np.ceil(exposure / (times[1] - times[0]) - 1e-6))


def largest_changes(result: Result, row: int, length: int) -> Array:
    """Return the largest angle from the mean error over the exposure that ends at a sample, deg.

    The error is the vector of the rotation Q_dᵀ Q; ECSS-E-ST-60-10C calls the largest distance from
    its mean over an exposure the relative performance error. Samples before the first whole
    exposure have the value of this one. ``(runs, times)``

    Parameters
    ----------
    length
        The number of samples of an exposure after its first one.
    """
    from scipy.spatial.transform import Rotation

    poses, desired = result.read("pose", controller=row), result.read("desired_pose")
    turned = np.swapaxes(desired[..., :3, :3], -1, -2) @ poses[..., :3, :3]
    exists = np.isfinite(turned).all(axis=(-1, -2))  # failed runs hold NaN
    vectors = np.full((*exists.shape, 3), np.nan)
    if exists.any():
        vectors[exists] = Rotation.from_matrix(turned[exists]).as_rotvec(degrees=True)
    largest = np.zeros(turned.shape[:2])
    shown = np.lib.stride_tricks.sliding_window_view(vectors, length + 1, axis=1)
    for start in range(shown.shape[1]):
        window = shown[:, start]  # (runs, 3, length + 1)
        away = window - window.mean(axis=-1, keepdims=True)
        largest[:, start + length] = np.linalg.norm(away, axis=1).max(axis=-1)
    largest[:, :length] = largest[:, length, None]
    return largest
