"""Evaluation of compiled programs of the state at every sample of every run."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.engines.taylor.compiling import once
from eqt_cli.engines.taylor.expressions import Expressions
from eqt_cli.engines.taylor.library import heyoka_module
from eqt_cli.program import Program

AT_ONCE = 1024
"""Number of samples evaluated together: their hundred numbers each fit the cache of a core."""


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
        Number of samples that heyoka evaluates as one. It would round a remainder differently, so
        there is none, and a result does not depend on its neighbours.
    """

    function: Any
    shapes: dict[str, tuple[int, ...]]
    lanes: int

    def at_samples(
        self, times: Array, rows: Sequence[Array], parameters: Array, held: Array
    ) -> dict[str, Array]:
        """Return the arrays at every sample, ``(runs, samples, …)`` each.

        Parameters
        ----------
        times : (samples,)
            Sample times, s.
        rows : (runs, samples, n) each
            The numbers that the function takes, in its order.
        parameters : (runs, p)
            Parameters of the loop, in the order in which they are traced.
        held : (samples, h)
            Numbers that the loop holds at these times.
        """
        runs, samples = rows[0].shape[:2]
        count = runs * samples
        given = [row.reshape(count, -1) for row in rows]
        lengths = np.cumsum([values.shape[1] for values in given])
        entering = np.empty((lengths[-1], AT_ONCE))
        places = np.split(entering, lengths[:-1])
        found = {name: np.empty((count, *shape)) for name, shape in self.shapes.items()}
        columns = [values.reshape(count, -1) for values in found.values()]
        varying = np.flatnonzero((parameters != parameters[0]).any(axis=0))
        numbers = np.repeat(np.append(parameters[0], held[0])[:, None], AT_ONCE, axis=1)
        for start in range(0, count, AT_ONCE):
            stop = min(start + AT_ONCE, count)
            at = np.arange(start, stop + (start - stop) % self.lanes).clip(max=count - 1)
            run, sample = np.divmod(at, samples)
            numbers[varying, : len(at)] = parameters[run[:, None], varying].T
            numbers[parameters.shape[1] :, : len(at)] = held[sample].T
            for place, values in zip(places, given, strict=True):
                place[:, : stop - start] = values[start:stop].T
                place[:, stop - start : len(at)] = values[-1:].T
            entries = self.function(
                np.ascontiguousarray(entering[:, : len(at)]),
                pars=np.ascontiguousarray(numbers[: self.function.nparams, : len(at)]),
                time=times[sample],
            )
            first = 0
            for values in columns:
                last = first + values.shape[1]
                values[start:stop] = entries[first:last, : stop - start].T
                first = last
        return {
            name: values.reshape(runs, samples, *self.shapes[name])
            for name, values in found.items()
        }


@lru_cache(maxsize=64)
def compiled_function(program: Program, thread: int) -> CompiledFunction:
    """Return a program as compiled function; every thread needs its own, as for integrators."""
    function = copy.deepcopy(once(_compiled, program))
    shapes = {output.name: output.shape for output in program.outputs}
    return CompiledFunction(function, shapes, heyoka_module().recommended_simd_size())


@lru_cache(maxsize=32)
def _compiled(program: Program) -> Any:
    """Compile a program; the last ones are kept."""
    expressions = Expressions.of(program)
    return heyoka_module().cfunc(expressions.outputs, expressions.state)
