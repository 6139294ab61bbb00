"""Python's calls of compiled loops: arrays in, arrays out, through ctypes.

A call releases the interpreter's lock, so that threads integrate side by side.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.engines.native import compiler, source
from eqt_cli.program import Program

THROUGH, STEP_LIMIT, NOT_FINITE, STEP_TOO_SHORT, SWITCHING = range(5)
"""Outcomes of a run, as in advance.h."""

Advance = Callable[..., None]
"""Integrates runs through a span, given `Measuring` and the members of ``eqt_span``."""

Evaluation = Callable[[int, int, Sequence["Rows"]], dict[str, Array]]
"""Gives a program's arrays, ``(runs, samples, …)`` each, by name.

It takes the numbers of runs and of samples, and the program's inputs, a stretch after the other.
"""

_INTEGERS = ("runs", "later", "most_steps", "to_next_run")
SPAN_NUMBERS = ("start", "stop", "first_inside", "last_inside", "rtol", "atol")
_ARRAYS = ("grid", "held", "parameters", "states", "samples", "steps", "counts", "ends", "times")


class _Span(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int64) for name in _INTEGERS),
        *((name, ctypes.c_double) for name in SPAN_NUMBERS),
        *((name, ctypes.c_void_p) for name in _ARRAYS),
        ("measuring", ctypes.c_void_p),
    ]


class _Source(ctypes.Structure):
    _fields_ = [
        ("from", ctypes.c_void_p),
        ("to_next_run", ctypes.c_int64),
        ("to_next_sample", ctypes.c_int64),
    ]


class _Evaluations(ctypes.Structure):
    _fields_ = [
        ("runs", ctypes.c_int64),
        ("samples", ctypes.c_int64),
        ("sources", ctypes.POINTER(_Source)),
        ("found", ctypes.POINTER(ctypes.c_void_p)),
    ]


class _Measuring(ctypes.Structure):
    _fields_ = [
        ("sources", ctypes.POINTER(_Source)),
        *((name, ctypes.c_void_p) for name in ("starts", "memory", "kept")),
    ]


@lru_cache(maxsize=32)
def integration(field: Program, at_samples: source.SampleProgram | None = None) -> Advance:
    """Return ``eqt_advance`` of a field, which takes the members of ``eqt_span``.

    Arrays are C-contiguous.
    """
    text = source.integration(field, compiler.compiler().lanes, at_samples)
    function = compiler.library(text).eqt_advance

    def advance(measuring: Measuring | None, **values: Any) -> None:
        measured = None if measuring is None else measuring.as_c()  # it must live during the call
        span = _Span(
            measuring=None if measured is None else ctypes.addressof(measured),
            **{name: values[name] for name in (*_INTEGERS, *SPAN_NUMBERS)},
            **{name: values[name].ctypes.data for name in _ARRAYS},
        )
        function(ctypes.byref(span))

    return advance


@dataclass(frozen=True)
class Rows:
    """Numbers that a program takes, and along which axes they vary.

    Attributes
    ----------
    values
        ``(n,)``, preceded by the axes, runs and samples, along which they vary.
    by_run, by_sample
        Whether they vary along this axis.
    """

    values: Array
    by_run: bool = False
    by_sample: bool = False

    @property
    def length(self) -> int:
        """The length n of a row."""
        return int(self.values.shape[-1])

    def of(self, runs: slice) -> Rows:
        """Return the rows of some runs."""
        return Rows(self.values[runs], True, self.by_sample) if self.by_run else self


@dataclass(frozen=True)
class Measuring:
    """The data of a program that looks at runs sample by sample.

    Attributes
    ----------
    rows
        Its inputs besides the states, one stretch after the other.
    starts
        Its memory before the first sample.
    memory : (runs, memory)
        Its memory after the last sample, to be filled in.
    kept : (runs, samples, kept)
        Numbers that it keeps of each sample, to be filled in.
    """

    rows: Sequence[Rows]
    starts: Array
    memory: Array
    kept: Array

    def as_c(self) -> _Measuring:
        """Return it as measure.h takes it, valid as long as this object lives."""
        samples = self.kept.shape[1]
        sources = _sources(self.rows, [rows.values for rows in self.rows], samples)
        places = (each.ctypes.data for each in (self.starts, self.memory, self.kept))
        return _Measuring(sources, *places)


def _sources(given: Sequence[Rows], arrays: Sequence[Array], samples: int) -> Any:
    """Return where the numbers of some rows lie in memory."""
    found = (_Source * len(given))()
    for place, (rows, array) in enumerate(zip(given, arrays, strict=True)):
        along = rows.length if rows.by_sample else 0
        per_run = (samples if rows.by_sample else 1) * rows.length if rows.by_run else 0
        found[place] = _Source(array.ctypes.data, per_run, along)
    return found


@lru_cache(maxsize=64)
def evaluation(program: Program, stretches: tuple[int, ...]) -> Evaluation:
    """Compile a program whose inputs are cut into stretches of these lengths."""
    text = source.evaluation(program, stretches, compiler.compiler().lanes)
    function = compiler.library(text).eqt_evaluate

    def evaluated(runs: int, samples: int, given: Sequence[Rows]) -> dict[str, Array]:
        arrays = [np.ascontiguousarray(rows.values, dtype=float) for rows in given]
        sources = _sources(given, arrays, samples)
        found = {each.name: np.empty((runs, samples, *each.shape)) for each in program.outputs}
        places = (ctypes.c_void_p * len(found))(*(array.ctypes.data for array in found.values()))
        function(ctypes.byref(_Evaluations(runs, samples, sources, places)))
        return found

    return evaluated
