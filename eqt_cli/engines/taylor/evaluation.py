"""Evaluates compiled expressions of the state at every sample of every run."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array

AT_ONCE = 4096
"""Samples that are evaluated together: their numbers fit the cache of a core."""


@dataclass(frozen=True)
class CompiledFunction:
    """Arrays by name, as one compiled function of the flat state.

    Attributes
    ----------
    function
        Returns every entry of every array, ``(entries, evaluations)``.
    shapes
        The shape of each array at one sample, in the order of the entries.
    lanes
        heyoka evaluates that many samples as one and a remainder in another way, with other
        rounding. So there is none: a result does not depend on its neighbours.
    """

    function: Any
    shapes: dict[str, tuple[int, ...]]
    lanes: int

    def at_samples(
        self, times: Array, states: Array, parameters: Array, held: Array
    ) -> dict[str, Array]:
        """The arrays at every sample, ``(runs, samples, …)`` each.

        Parameters
        ----------
        times : (samples,)
        states : (runs, samples, n)
        parameters : (runs, p)
            Of the loop, in the order in which they are traced.
        held : (samples, h)
            What the loop holds at these times.
        """
        runs, samples = states.shape[:2]
        flat = states.reshape(runs * samples, -1)
        found = {name: np.empty((len(flat), *shape)) for name, shape in self.shapes.items()}
        columns = {name: values.reshape(len(flat), -1) for name, values in found.items()}
        numbers = np.arange(len(flat) + -len(flat) % self.lanes).clip(max=len(flat) - 1)
        for start in range(0, len(numbers), AT_ONCE):
            run, sample = np.divmod(numbers[start : start + AT_ONCE], samples)
            rows = np.concatenate([parameters[run], held[sample]], axis=1)
            entries = self.function(
                np.ascontiguousarray(flat[numbers[start : start + AT_ONCE]].T),
                pars=np.ascontiguousarray(rows[:, : self.function.nparams].T),
                time=times[sample],
            )
            stop, first = min(start + AT_ONCE, len(flat)), 0
            for values in columns.values():
                last = first + values.shape[1]
                values[start:stop] = entries[first:last, : stop - start].T
                first = last
        return {
            name: values.reshape(runs, samples, *self.shapes[name])
            for name, values in found.items()
        }


def compiled_function(
    heyoka: ModuleType, variables: list[Any], arrays: Mapping[str, Array]
) -> CompiledFunction:
    """Compile arrays of expressions or numbers, each with a leading axis of one run."""
    shapes = {name: np.shape(values)[1:] for name, values in arrays.items()}
    entries = [
        entry if isinstance(entry, heyoka.expression) else heyoka.expression(float(entry))
        for values in arrays.values()
        for entry in np.asarray(values, dtype=object).reshape(-1)
    ]
    function = _compiled(heyoka, pickle.dumps((entries, variables)))
    # As for integrators: every thread needs its own.
    return CompiledFunction(copy.deepcopy(function), shapes, heyoka.recommended_simd_size())


@lru_cache(maxsize=32)
def _compiled(heyoka: ModuleType, expressions: bytes) -> Any:
    """Compile entries and variables, or find them among those compiled before."""
    return heyoka.cfunc(*pickle.loads(expressions))
