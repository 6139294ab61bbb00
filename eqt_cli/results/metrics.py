"""One number per run from its signals; it knows neither files nor controllers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array

EARLY_WINDOW = 5.0
"""The paper's "first 5 seconds of the response", s (§7)."""


@dataclass(frozen=True)
class Metric:
    """A quantity per run.

    Attributes
    ----------
    name
        Its name in a result file.
    units
        In terms of the unit of the signal: ``{}`` stands for it.
    signal
        The signal whose unit it takes.
    of
        ``(times, signals, threshold) -> (runs,)``; signals are ``(runs, samples)``.
    """

    name: str
    long_name: str
    signal: str
    units: str
    of: Callable[[Array, Mapping[str, Array], float], Array]


def early(times: Array) -> Array:
    """Which samples lie in the first 5 s (all of them on a shorter horizon)."""
    within: Array = times - times[0] <= EARLY_WINDOW * (1 + 1e-12)
    return within


def time_mean(times: Array, values: Array) -> Array:
    """The mean over time of ``(…, samples)``, by the trapezoidal rule."""
    mean: Array = np.trapezoid(values, times, axis=-1) / (times[-1] - times[0])
    return mean


def effort(times: Array, torque_norm: Array) -> Array:
    """∫‖τ‖² dt, by Simpson's rule on the samples."""
    from scipy.integrate import simpson  # slow to import, and what reads results does without

    integral: Array = simpson(torque_norm**2, x=times, axis=-1)
    return integral


def settling_time(times: Array, error: Array, threshold: float) -> Array:
    """The last time the error comes down through the threshold; NaN if it ends above it.

    The crossing is interpolated linearly between samples. A run that is never above settles at 0.
    """
    above = error > threshold
    last = error.shape[-1] - 1 - above[..., ::-1].argmax(axis=-1)
    after = np.minimum(last + 1, error.shape[-1] - 1)
    e0 = np.take_along_axis(error, last[..., None], axis=-1)[..., 0]
    e1 = np.take_along_axis(error, after[..., None], axis=-1)[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = (e0 - threshold) / (e0 - e1)
    crossing = times[last] + fraction * (times[after] - times[last])
    settled = np.where(above.any(axis=-1), crossing, 0.0)
    settled[above[..., -1] | ~np.isfinite(error).all(axis=-1)] = np.nan
    return settled


ENERGY_SCALE = 1.0
"""J; errors of L are relative to L(0), but never to less than this."""


def energy_residual(lyapunov: Array, balance: Array) -> Array:
    """max |L + W − L(0)| / max(L(0), 1 J), from L and L + W, ``(runs, samples) -> (runs,)``."""
    initial = lyapunov[:, :1]
    residual: Array = np.abs(balance - initial).max(axis=-1)
    return residual / np.maximum(initial[:, 0], ENERGY_SCALE)


def unit_in(pattern: str, unit: str) -> str:
    """The unit of what is computed from a signal: ``({})^2 s`` of N m is (N m)^2 s, of N N^2 s.

    Parameters
    ----------
    pattern
        With ``{}`` for the signal's unit, if it depends on it.
    unit
        The signal's; ``mixed`` gives ``mixed``, and 1 is left out of squares.
    """
    if unit == "mixed" and "{}" in pattern:
        return unit
    if unit == "1":
        pattern = pattern.removeprefix("({})^2 ")
    return (pattern.replace("({})", "{}") if unit.isalpha() else pattern).format(unit)


METRICS = (
    Metric(
        "effort",
        "control effort, integral of ||tau||^2",
        "torque_norm",
        "({})^2 s",
        lambda t, s, _: effort(t, s["torque_norm"]),
    ),
    Metric(
        "peak_torque",
        "largest ||tau|| at the samples",
        "torque_norm",
        "{}",
        lambda t, s, _: s["torque_norm"].max(axis=-1),
    ),
    Metric(
        "early_torque",
        "mean ||tau|| over the first 5 s",
        "torque_norm",
        "{}",
        lambda t, s, _: time_mean(t[early(t)], s["torque_norm"][..., early(t)]),
    ),
    Metric(
        "mean_pose_error",
        "mean ||I - Q_E||_F over the horizon",
        "pose_error",
        "{}",
        lambda t, s, _: time_mean(t, s["pose_error"]),
    ),
    Metric(
        "final_pose_error",
        "||I - Q_E||_F at the end",
        "pose_error",
        "{}",
        lambda t, s, _: s["pose_error"][..., -1],
    ),
    Metric(
        "final_velocity_error",
        "||V - Vd|| at the end",
        "velocity_error",
        "{}",
        lambda t, s, _: s["velocity_error"][..., -1],
    ),
    Metric(
        "settling_time",
        "last time ||I - Q_E||_F leaves the settling threshold",
        "pose_error",
        "s",
        lambda t, s, threshold: settling_time(t, s["pose_error"], threshold),
    ),
)
