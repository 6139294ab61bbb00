"""Operations on the samples of a run: integrals, extremes, the last time of a condition.

Formulas of metrics are written with them. Here they act on arrays of all samples; a traced program,
which gets one sample after the other, has the same operations. Sums go from sample to sample in
order, so that both round alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array

Cut = Callable[[Array, Array], tuple[Array, Array]]
"""Cuts times ``(samples,)`` and values ``(runs, samples, …)`` to a window."""


class SampledRuns(ABC):
    """The samples of runs, and the operations on values at them.

    Values are arrays ``(..., samples)``, or a symbol for one sample.

    Attributes
    ----------
    times : (samples,)
        Times of the samples, s.
    """

    def __init__(self, times: Array) -> None:
        self.times = times

    @property
    def duration(self) -> float:
        """Time from the first sample to the last, s."""
        return float(self.times[-1] - self.times[0])

    def integral(self, values: Any) -> Any:
        """Return ∫x dt, by the trapezoidal rule."""
        return self.weighted(trapezoidal_weights(self.times), values)

    def mean(self, values: Any) -> Any:
        """Return the mean over time, by the trapezoidal rule."""
        return self.integral(values) / self.duration

    def closing_mean(self, values: Any, share: float) -> Any:
        """Return the mean over the last share of the time, by the trapezoidal rule."""
        late = self.times >= self.times[-1] - share * self.duration
        times, weights = self.times[late], np.zeros(len(self.times))
        weights[late] = trapezoidal_weights(times)
        return self.weighted(weights, values) / float(times[-1] - times[0])

    def simpson(self, values: Any) -> Any:
        """Return ∫x dt, by Simpson's rule."""
        return self.weighted(simpson_weights(self.times), values)

    @property
    @abstractmethod
    def time(self) -> Any:
        """The time of a sample, s."""

    @abstractmethod
    def within(self, cut: Cut, columns: Sequence[Any]) -> tuple[Self, list[Any]]:
        """Return the samples in a window, and values at them."""

    @abstractmethod
    def weighted(self, weights: Array, values: Any) -> Any:
        """Return Σ w x over the samples in order; samples of weight 0 are skipped."""

    @abstractmethod
    def largest(self, values: Any) -> Any:
        """Return the largest value; NaN if any value is NaN."""

    @abstractmethod
    def smallest(self, values: Any) -> Any:
        """Return the smallest value; NaN if any value is NaN."""

    @abstractmethod
    def initial(self, values: Any) -> Any:
        """Return the first value, for computations at any sample."""

    @abstractmethod
    def final(self, values: Any) -> Any:
        """Return the last value."""

    @abstractmethod
    def before(self, values: Any) -> Any:
        """Return at each sample the previous value, at the first sample its own."""

    @abstractmethod
    def latest(self, values: Any, condition: Any) -> Any:
        """Return the value at the last sample where a condition of `less` holds; 0 if none does."""


class Samples(SampledRuns):
    """All samples in arrays."""

    @property
    def time(self) -> Array:
        return self.times

    def within(self, cut: Cut, columns: Sequence[Array]) -> tuple[Samples, list[Array]]:
        found = [cut(self.times, values) for values in columns]
        return Samples(found[0][0]), [values for _, values in found]

    def weighted(self, weights: Array, values: Array) -> Array:
        used = np.flatnonzero(weights)
        if not used.size:
            return np.zeros(values.shape[:-1])
        # `sum` would add in another order.
        products = weights[used] * (values if used.size == len(weights) else values[..., used])
        return np.cumsum(products, axis=-1, out=products)[..., -1]

    def largest(self, values: Array) -> Any:
        return values.max(axis=-1)

    def smallest(self, values: Array) -> Any:
        return values.min(axis=-1)

    def initial(self, values: Array) -> Array:
        return values[..., :1]

    def final(self, values: Array) -> Array:
        return values[..., -1]

    def before(self, values: Array) -> Array:
        return np.concatenate([values[..., :1], values[..., :-1]], axis=-1)

    def latest(self, values: Array, condition: Array) -> Array:
        last = condition.shape[-1] - 1 - condition[..., ::-1].argmax(axis=-1)
        found = np.take_along_axis(values, last[..., None], axis=-1)[..., 0]
        return np.where(condition.any(axis=-1), found, 0.0)


def trapezoidal_weights(times: Array) -> Array:
    """Return the weights of samples in an integral by the trapezoidal rule, s."""
    halves = np.diff(times) / 2
    return np.append(halves, 0.0) + np.append(0.0, halves)


def simpson_weights(times: Array) -> Array:
    """Return the weights of samples in an integral by Simpson's rule, s, as in SciPy's `simpson`.

    A parabola through three samples covers each pair of intervals. If the number of intervals is
    odd, the last one is covered by the parabola through the last three samples.
    """
    steps, weights = np.diff(times), np.zeros(len(times))
    if len(steps) < 2:
        return trapezoidal_weights(times)
    pairs = len(steps) // 2
    a, b = steps[: 2 * pairs : 2], steps[1 : 2 * pairs : 2]
    weights[: 2 * pairs : 2] += (a + b) / 6 * (2 - b / a)
    weights[1 : 2 * pairs : 2] += (a + b) ** 3 / (6 * a * b)
    weights[2 : 2 * pairs + 1 : 2] += (a + b) / 6 * (2 - a / b)
    if len(steps) % 2:
        a, b = steps[-2:]
        weights[-3:] += [
            -(b**3) / (6 * a * (a + b)),
            b * (b + 3 * a) / (6 * a),
            b * (2 * b + 3 * a) / (6 * (a + b)),
        ]
    return weights
