"""Numbers of a run, computed by a program that takes its samples one after the other.

The program's memory, an input and an output, holds the required data of earlier samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array, less, where
from eqt_cli.core.errors import TraceError
from eqt_cli.core.over_time import Cut, SampledRuns


class Memory:
    """Memory of a program from sample to sample, and the numbers that belong to each sample.

    Parameters
    ----------
    given
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

    def __init__(self, given: Array, at_sample: Array, ended: bool = False) -> None:
        self._given, self._at_sample, self._ended = given, at_sample, ended
        self.after: list[Any] = []
        self.starts: list[float] = []
        self.columns: list[Array] = []

    def keep(self, start: float, following: Callable[[Any], Any]) -> Any:
        """Return a number that is updated from itself and the sample; an array with one run."""
        before = self._given[len(self.after)]
        after = before if self._ended else np.asarray(following(np.array([before]))).item()
        self.starts.append(start)
        self.after.append(after)
        return np.array([after])

    def column(self, values: Array) -> Any:
        """Return the symbol of a number that belongs to each sample."""
        for place, known in enumerate(self.columns):
            if np.array_equal(known, values):
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
        has_weight = less(0.0, self._column((weights != 0).astype(float)))
        return self._memory.keep(
            0.0, lambda total: where(has_weight, total + weight * values, total)
        )

    def largest(self, values: Any) -> Any:
        self._all_inside()

        def larger(found: Any) -> Any:
            # No comparison with NaN holds, so that NaN persists.
            return where(less(found, np.inf), where(less(values, found), found, values), found)

        return self._memory.keep(-np.inf, larger)

    def smallest(self, values: Any) -> Any:
        return -self.largest(-values)

    def initial(self, values: Any) -> Any:
        self._all_inside()
        first = less(0.0, self._column(np.arange(len(self.times)) == 0))
        return self._memory.keep(0.0, lambda found: where(first, values, found))

    def final(self, values: Any) -> Any:
        self._all_inside()
        return self._memory.keep(0.0, lambda found: values)

    def before(self, values: Any) -> Any:
        self._all_inside()
        first = less(0.0, self._column(np.arange(len(self.times)) == 0))
        earlier: list[Any] = []

        def itself(found: Any) -> Any:
            earlier.append(where(first, values, found))
            return values

        kept = self._memory.keep(0.0, itself)
        return earlier[0] if earlier else kept

    def latest(self, values: Any, condition: Any) -> Any:
        self._all_inside()
        return self._memory.keep(0.0, lambda found: where(condition, values, found))

    def _column(self, values: Array) -> Any:
        whole = np.zeros(len(self._inside))
        whole[self._inside] = values
        return self._memory.column(whole)

    def _all_inside(self) -> None:
        if not self._inside.all():
            raise TraceError("only sums are taken over a window")
