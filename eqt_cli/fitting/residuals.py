"""What is left of the errors of a prediction: linearised, and tested for what noise does not do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from eqt_cli.analysis.comparison.intervals import Resampling, intervals_of_means
from eqt_cli.core.arrays import Array
from eqt_cli.fitting.prediction import PredictionErrors, Windows

DELAY = "delay"
"""The key of the time by which the wrench is recorded late, s."""

DISTINCT = 1e-3
"""Smallest singular value of the derivatives, scaled to length 1 for each number, at which the
recording distinguishes the numbers."""

CORRELATED = 3.0
"""Correlation from row to row, in standard deviations of that of white noise, that is told."""

APART = 2.0
"""Distance of a delay from 0, in half-widths of its 95 % interval, that is told."""

MOST_OF = 0.5
"""Share of the squared errors above the noise that a delay explains where a model is not fitted."""


class Linear(NamedTuple):
    """The errors of a window, linearised about some numbers, in units of the noise.

    Attributes
    ----------
    residuals : (n,)
        Its errors that remain for the best first state.
    derivatives : (n, p)
        Their derivatives by the numbers.
    state : (2m,)
        The correction of the first state.
    """

    residuals: Array
    derivatives: Array
    state: Array


def linear(found: PredictionErrors, noise: Array) -> Linear:
    """Return the errors of the measured coordinates, in units of the noise, without first state."""
    measured = np.isfinite(noise)

    def weighted(values: Array) -> Array:
        return (values[:, measured] / noise[measured, None]).reshape(-1, values.shape[-1])

    r, by_state, by_number = map(
        weighted, (found.values[..., None], found.by_state, found.by_number)
    )
    basis, R = np.linalg.qr(by_state)
    return Linear(
        (r - basis @ (basis.T @ r))[:, 0],
        by_number - basis @ (basis.T @ by_number),
        -np.linalg.lstsq(R, basis.T @ r)[0][:, 0],
    )


def intervals(found: Sequence[Linear]) -> Array:
    """Return the ends of 95 % intervals relative to the fitted numbers, ``(2, p)``.

    The mean of the jackknife's pseudo-values is resampled. They follow from the numbers without
    each window, to first order θ + (A − A_w)⁻¹ b_w with A_w = J_wᵀJ_w and b_w = J_wᵀr_w.
    """
    squares = [one.derivatives.T @ one.derivatives for one in found]
    pulls = [one.derivatives.T @ one.residuals for one in found]
    others, total = len(found) - 1, sum(squares)
    values = [
        -others * np.linalg.solve(total - square, pull)
        for square, pull in zip(squares, pulls, strict=True)
    ]
    mean = intervals_of_means(np.array(values), Resampling())
    return np.stack([mean.low - mean.mean, mean.high - mean.mean])


def correlated(found: Sequence[Linear], windows: Windows) -> Iterator[str]:
    """Say of which parts the errors are correlated from row to row, which white noise is not.

    The correlation of n white errors at a lag of one row has the standard deviation 1/√n; the
    correction of the first state makes it smaller.
    """
    measured = np.flatnonzero(np.isfinite(windows.noise))
    rows = [one.residuals.reshape(-1, len(measured)) for one in found]
    said = []
    for name, _, axes in windows.parts:
        columns = (axes.start <= measured) & (measured < axes.stop)
        some = [each[:, columns] for each in rows]
        pairs = sum(float((each[1:] * each[:-1]).sum()) for each in some)
        lag = pairs / (sum(float((each**2).sum()) for each in some) or 1.0)
        count = min(sum(map(len, some)), len(windows.recording.times)) * int(columns.sum())
        if lag > CORRELATED / np.sqrt(count):
            said.append(f"{name} ({lag:.2f})")
    if said:
        yield (
            f"The errors are correlated from row to row: {', '.join(said)}. Such errors come from "
            "the model, from slow errors of the sensors or from a wrench at another time; `noise` "
            "counts only what is independent from row to row."
        )


def delayed(found: Sequence[Linear], fitted: bool) -> Iterator[str]:
    """Say by which delay of the wrench the errors would be smaller.

    Parameters
    ----------
    found
        The last derivative of each window is that by the delay.
    fitted
        Whether the other numbers are the best ones. If not, a wrong number may look like a delay,
        so that the delay must explain most of the errors.
    """
    if len(found) < 2:  # an interval needs windows to compare
        return
    derivatives = np.concatenate([one.derivatives for one in found])
    residuals = np.concatenate([one.residuals for one in found])
    lengths = np.linalg.norm(derivatives, axis=0)
    if not lengths.all() or np.linalg.svd(derivatives / lengths, compute_uv=False)[-1] < DISTINCT:
        return
    delay = -np.linalg.lstsq(derivatives, residuals)[0]
    left = residuals + derivatives @ delay
    best = [one._replace(residuals=one.residuals + one.derivatives @ delay) for one in found]
    low, high = delay[-1] + intervals(best)[:, -1]
    by_noise = len(residuals) - sum(len(one.state) for one in found)
    explains = residuals @ residuals - left @ left > MOST_OF * (residuals @ residuals - by_noise)
    apart = APART * max(high - delay[-1], delay[-1] - low) < abs(delay[-1])
    if apart and (fitted or explains):
        side = "later" if delay[-1] > 0 else "earlier"
        low, high = sorted(np.abs([low, high]))
        yield (
            f"The errors are smaller with the wrench of {abs(delay[-1]):.2g} s {side} (95 % "
            f"interval [{low:.2g}, {high:.2g}]): it was recorded with another delay than the "
            f"motion, or acts with one. Fit it: --over …,{DELAY}."
        )
