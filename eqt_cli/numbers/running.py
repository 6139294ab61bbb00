"""Functions of a whole trajectory, evaluated sample by sample on the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Self

import numpy as np

from eqt_cli.base.arrays import Array, less, where
from eqt_cli.base.errors import TraceError

# Operations on the samples of a run: integrals, extremes, the last time of a condition ------------
#
# Formulas of metrics are written with them. Here they act on arrays of all samples; a traced
# program, which gets one sample after the other, has the same operations. Sums go from sample to
# sample in order, so that both round alike.


ROUNDING = 1e-6
"""Share of a period by which an instant may differ from a sample that it equals."""

MOST_RUNNING = 512
"""Most numbers that a reduction may keep from sample to sample."""

Cut = Callable[[Array, Array], tuple[Array, Array]]
"""Cuts times ``(samples,)`` and values ``(runs, samples, …)`` to a window."""


class SampledRuns:
    """The samples of runs, and the operations on values at them, ``(..., samples)``.

    In a traced program, a class derived from it has the same operations on symbols of one sample.

    Attributes
    ----------
    times : (samples,)
        Times of the samples, s.
    holds
        Signals that are held between two changes, with the time from one to the next, s.
    hold
        This time of the values here; 0 for values that are not held.
    """

    hold = 0.0

    def __init__(self, times: Array, holds: Mapping[str, float] | None = None) -> None:
        self.times, self.holds = times, holds or {}

    @property
    def duration(self) -> float:
        """Time from the first sample to the last, s."""
        return float(self.times[-1] - self.times[0])

    def integral(self, values: Any) -> Any:
        """Return ∫x dt, by the trapezoidal rule, or of held values as `held_weights`."""
        return self.weighted(self._weights(self.times), values)

    def mean(self, values: Any) -> Any:
        """Return the mean over time, by the trapezoidal rule."""
        return self.integral(values) / self.duration

    def closing_mean(self, values: Any, share: float) -> Any:
        """Return the mean over the last share of the time, by the trapezoidal rule."""
        late = self.times >= self.times[-1] - share * self.duration
        times, weights = self.times[late], np.zeros(len(self.times))
        weights[late] = self._weights(times)
        return self.weighted(weights, values) / float(times[-1] - times[0])

    def simpson(self, values: Any) -> Any:
        """Return ∫x dt, by Simpson's rule, or of held values as `held_weights`."""
        return self.weighted((self._weights if self.hold else simpson_weights)(self.times), values)

    def _weights(self, times: Array) -> Array:
        return held_weights(times, self.hold) if self.hold else trapezoidal_weights(times)

    @property
    def time(self) -> Array:
        """The time of a sample, s."""
        return self.times

    def of_times(self, function: Callable[[Array], Array]) -> Any:
        """Return the values of a function of the times ``(samples,)`` at the samples."""
        return function(self.times)

    def within(self, cut: Cut, columns: Sequence[Array]) -> tuple[Self, list[Array]]:
        """Return the samples in a window, and values at them."""
        cuts = [cut(self.times, values) for values in columns]
        return type(self)(cuts[0][0]), [values for _, values in cuts]

    def weighted(self, weights: Array, values: Array) -> Array:
        """Return Σ w x over the samples in order; samples of weight 0 are skipped."""
        used = np.flatnonzero(weights)
        if not used.size:
            return np.zeros(values.shape[:-1])
        # `sum` would add in another order.
        products = weights[used] * (values if used.size == len(weights) else values[..., used])
        return np.cumsum(products, axis=-1, out=products)[..., -1]

    def largest(self, values: Array) -> Any:
        """Return the largest value; NaN if any value is NaN."""
        return values.max(axis=-1)

    def smallest(self, values: Array) -> Any:
        """Return the smallest value; NaN if any value is NaN."""
        return values.min(axis=-1)

    def initial(self, values: Array) -> Array:
        """Return the first value, for computations at any sample."""
        return values[..., :1]

    def final(self, values: Array) -> Array:
        """Return the last value."""
        return values[..., -1]

    def before(self, values: Array) -> Array:
        """Return at each sample the previous value, at the first sample its own."""
        return np.concatenate([values[..., :1], values[..., :-1]], axis=-1)

    def latest(self, values: Array, condition: Array) -> Array:
        """Return the value at the last sample where a condition of `less` holds; 0 if none does."""
        last = condition.shape[-1] - 1 - condition[..., ::-1].argmax(axis=-1)
        chosen = np.take_along_axis(values, last[..., None], axis=-1)[..., 0]
        return np.where(condition.any(axis=-1), chosen, 0.0)


def trapezoidal_weights(times: Array) -> Array:
    """Return the weights of samples in an integral by the trapezoidal rule, s."""
    halves = np.diff(times) / 2
    return np.append(halves, 0.0) + np.append(0.0, halves)


def changes_missed(times: Array, hold: float) -> Array:
    """Return how many multiples of `hold` lie between each two neighbouring samples."""
    ends = times / hold
    return np.ceil(ends[1:] - ROUNDING) - np.floor(ends[:-1] + ROUNDING) - 1


def held_weights(times: Array, hold: float) -> Array:
    """Return the weights of samples in an integral of a value that changes at multiples of `hold`.

    Where it changes at samples only, each value counts until the next sample, which is exact.
    Where samples are multiples of `hold` that skip others, trapezoids connect values that each
    begin at their sample; so the sum over all multiples is half of `hold` ahead at both ends. Other
    samples see the held value at any phase, and trapezoids are right in the mean.
    """
    steps, weights = np.diff(times), trapezoidal_weights(times)
    if not changes_missed(times, hold).any():
        return np.append(steps, 0.0)
    if np.abs(times / hold - np.round(times / hold)).max() < ROUNDING:
        weights[[0, -1]] += [hold / 2, -hold / 2]
    return weights


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
    weights[1 : 2 * pairs : 2] += (a + b) * (a + b) * (a + b) / (6 * a * b)
    weights[2 : 2 * pairs + 1 : 2] += (a + b) / 6 * (2 - a / b)
    if len(steps) % 2:
        a, b = steps[-2:]
        weights[-3:] += [
            -(b * b * b) / (6 * a * (a + b)),
            b * (b + 3 * a) / (6 * a),
            b * (2 * b + 3 * a) / (6 * (a + b)),
        ]
    return weights


def goes_by_samples(of: Callable[..., Any], shapes: Mapping[str, tuple[int, ...]]) -> bool:
    """Whether a formula gives the same sample by sample as of all samples, for random values.

    Parameters
    ----------
    of
        ``(over, signals) -> number``.
    shapes
        The shape of each signal at a sample.
    """
    random, times = np.random.default_rng(0), np.linspace(0.0, 1.0, 6)
    signals = {name: random.normal(size=(1, len(times), *shapes[name])) for name in shapes}
    whole = of(SampledRuns(times), signals)

    def after(k: int, before: Array, columns: Array, ended: bool = False) -> tuple[Any, Memory]:
        memory = Memory(before, columns, ended)
        at_sample = {name: values[:, k] for name, values in signals.items()}
        return of(Running(times, memory), at_sample), memory

    _, memory = after(0, np.zeros(MOST_RUNNING), np.zeros(MOST_RUNNING))
    columns, state = np.reshape(memory.columns, (-1, len(times))), np.array(memory.starts)
    for k in range(len(times)):
        state = np.array(after(k, state, columns[:, k])[1].after)
    number, _ = after(2, state, columns[:, 2], ended=True)
    return np.shape(number) == (1,) and bool(np.allclose(number, whole, rtol=1e-9, equal_nan=True))


def mixes_runs(of: Callable[..., Any], times: Array, shapes: Sequence[tuple[int, ...]]) -> bool:
    """Whether the number of a run depends on the others, for random values that it can take."""
    random, over = np.random.default_rng(0), SampledRuns(times)
    values = [random.normal(size=(3, len(times), *shape)) for shape in shapes]
    with suppress(Exception):
        together = of(over, *values)
        try:
            alone = [of(over, *(value[k : k + 1] for value in values)) for k in range(3)]
        except Exception:  # what three runs have and one has not is another run
            return True
        return not np.allclose(np.concatenate(alone), together, rtol=1e-9, equal_nan=True)
    return False


# Numbers of a run, computed by a program that takes its samples one after the other ---------------
#
# The program's memory, an input and an output, holds the required data of earlier samples.


class Memory:
    """Memory of a program from sample to sample, and the numbers that belong to each sample.

    Parameters
    ----------
    before
        Symbols of the memory before a sample.
    at_sample
        Symbols of numbers that follow from the sample times alone.
    ended
        Whether the memory is that after the last sample, so that nothing is added to it.

    Attributes
    ----------
    after
        Symbols of the memory after the sample.
    starts
        Values of the memory before the first sample.
    columns : (samples,) each
        The numbers that belong to the samples.
    """

    def __init__(self, before: Array, at_sample: Array, ended: bool = False) -> None:
        self._before, self._at_sample, self._ended = before, at_sample, ended
        self.after: list[Any] = []
        self.starts: list[float] = []
        self.columns: list[Array] = []

    def keep(self, start: float, following: Callable[[Any], Any]) -> Any:
        """Return a number that is updated from itself and the sample; an array with one run."""
        before = self._before[len(self.after)]
        after = before if self._ended else np.asarray(following(np.array([before]))).item()
        self.starts.append(start)
        self.after.append(after)
        return np.array([after])

    def column(self, values: Array) -> Any:
        """Return the symbol of a number that belongs to each sample."""
        for place, other in enumerate(self.columns):
            if np.array_equal(other, values):
                return self._at_sample[place]
        self.columns.append(np.asarray(values, dtype=float))
        return self._at_sample[len(self.columns) - 1]


class Running(SampledRuns):
    """The current sample, with a memory of earlier ones.

    Parameters
    ----------
    inside
        Flags of the samples considered, among those of the memory; all by default.
    """

    def __init__(self, times: Array, memory: Memory, inside: Array | None = None) -> None:
        super().__init__(times)
        self._memory = memory
        self._inside = np.ones(len(times), dtype=bool) if inside is None else inside

    @property
    def time(self) -> Any:
        return self._column(self.times)

    def of_times(self, function: Callable[[Array], Array]) -> Any:
        return self._column(function(self.times))

    def within(self, cut: Cut, columns: Sequence[Any]) -> tuple[Running, list[Any]]:
        times, _ = cut(self.times, np.zeros((1, len(self.times))))
        inside = np.isin(self.times, times)
        if inside.sum() < len(times):
            raise TraceError("a window ends between two samples")
        return Running(times, self._memory, inside), list(columns)

    def weighted(self, weights: Array, values: Any) -> Any:
        weight = self._column(weights)
        if self._inside.all() and weights.all():
            return self._memory.keep(0.0, lambda total: total + weight * values)
        counts = less(0.0, self._column((weights != 0).astype(float)))
        return self._memory.keep(0.0, lambda total: where(counts, total + weight * values, total))

    def largest(self, values: Any) -> Any:
        def larger(before: Any) -> Any:
            # No comparison with NaN holds, so that NaN persists.
            return where(less(before, np.inf), where(less(values, before), before, values), before)

        return self._keep(-np.inf, larger)

    def smallest(self, values: Any) -> Any:
        return -self.largest(-values)

    def initial(self, values: Any) -> Any:
        first = less(0.0, self._column(np.arange(len(self.times)) == 0))
        return self._memory.keep(0.0, lambda before: where(first, values, before))

    def final(self, values: Any) -> Any:
        return self._keep(0.0, lambda before: values)

    def before(self, values: Any) -> Any:
        first = less(0.0, self._column(np.arange(len(self.times)) == 0))
        earlier: list[Any] = []

        def itself(previous: Any) -> Any:
            earlier.append(where(first, values, previous))
            return values

        latest = self._keep(0.0, itself)
        return earlier[0] if earlier else latest

    def latest(self, values: Any, condition: Any) -> Any:
        return self._keep(0.0, lambda before: where(condition, values, before))

    def _column(self, values: Array) -> Any:
        whole = np.zeros(len(self._inside))
        whole[self._inside] = values
        return self._memory.column(whole)

    def _keep(self, start: float, following: Callable[[Any], Any]) -> Any:
        """Return a number that is updated at the samples considered."""
        if self._inside.all():
            return self._memory.keep(start, following)
        counts = less(0.0, self._memory.column(self._inside.astype(float)))
        return self._memory.keep(start, lambda before: where(counts, following(before), before))
