"""Numbers that follow from the samples of a run: sums, extremes, when something held last.

Formulas of metrics are written with them. They come from arrays of all samples here; a program that
is given one sample after the other has them as well. A sum goes from sample to sample, in their
order, so that both round alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array

Cut = Callable[[Array, Array], tuple[Array, Array]]
"""Samples within a window, of times ``(samples,)`` and values ``(runs, samples, …)``."""


class OverTime(ABC):
    """The samples of runs, and what numbers can be made of values at them.

    Values are ``(..., samples)``, or what stands for one sample of them.

    Attributes
    ----------
    times : (samples,)
        Of the samples, s.
    """

    def __init__(self, times: Array) -> None:
        self.times = times

    @property
    def duration(self) -> float:
        """From the first sample to the last, s."""
        return float(self.times[-1] - self.times[0])

    def integral(self, values: Any) -> Any:
        """∫x dt, by the trapezoidal rule."""
        return self.weighted(trapezoidal_weights(self.times), values)

    def mean(self, values: Any) -> Any:
        """The mean over time, by the trapezoidal rule."""
        return self.integral(values) / self.duration

    def closing_mean(self, values: Any, share: float) -> Any:
        """The mean over the last part of the time, by the trapezoidal rule."""
        late = self.times >= self.times[-1] - share * self.duration
        times, weights = self.times[late], np.zeros(len(self.times))
        weights[late] = trapezoidal_weights(times)
        return self.weighted(weights, values) / float(times[-1] - times[0])

    def simpson(self, values: Any) -> Any:
        """∫x dt, by Simpson's rule."""
        return self.weighted(simpson_weights(self.times), values)

    @property
    @abstractmethod
    def time(self) -> Any:
        """The time of a sample, s."""

    @abstractmethod
    def within(self, cut: Cut, columns: Sequence[Any]) -> tuple[Self, list[Any]]:
        """The samples in a window, and values at these."""

    @abstractmethod
    def weighted(self, weights: Array, values: Any) -> Any:
        """Σ w x over the samples, in their order; those without weight are not looked at."""

    @abstractmethod
    def largest(self, values: Any) -> Any:
        """The largest value; NaN if one is."""

    @abstractmethod
    def smallest(self, values: Any) -> Any:
        """The smallest value; NaN if one is."""

    @abstractmethod
    def initial(self, values: Any) -> Any:
        """The first value, which can be computed with at any sample."""

    @abstractmethod
    def final(self, values: Any) -> Any:
        """The last value."""

    @abstractmethod
    def before(self, values: Any) -> Any:
        """At each sample the value at the one before it, at the first its own."""

    @abstractmethod
    def latest(self, values: Any, condition: Any) -> Any:
        """The value at the last sample at which a condition of `less` holds; 0 where none does."""


class Samples(OverTime):
    """All samples in arrays."""

    @property
    def time(self) -> Array:
        return self.times

    def within(self, cut: Cut, columns: Sequence[Array]) -> tuple[Samples, list[Array]]:
        found = [cut(self.times, values) for values in columns]
        return Samples(found[0][0]), [values for _, values in found]

    def weighted(self, weights: Array, values: Array) -> Array:
        some = np.flatnonzero(weights)
        if not some.size:
            return np.zeros(values.shape[:-1])
        # Not by `sum`, which adds in an order of its own.
        products = weights[some] * (values if some.size == len(weights) else values[..., some])
        found: Array = np.cumsum(products, axis=-1, out=products)[..., -1]
        return found

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
    """Of each sample in an integral by the trapezoidal rule, s."""
    halves = np.diff(times) / 2
    return np.append(halves, 0.0) + np.append(0.0, halves)


def simpson_weights(times: Array) -> Array:
    """Of each sample in an integral by Simpson's rule, s, as SciPy's `simpson` has them.

    A parabola through three samples gives each pair of intervals; of an odd number of intervals,
    the last one is that of the parabola through the last three samples.
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
