"""Calls a closed loop with symbols, so that what comes back can be compiled.

Everything that may differ from run to run is a parameter ``heyoka.par[k]``, so that one compilation
serves all runs of a structure.
"""

from __future__ import annotations

import pickle
import traceback
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import TraceError
from eqt_cli.engines.base import SampledFunction
from eqt_cli.engines.problem import Problem
from eqt_cli.engines.taylor.evaluation import CompiledFunction, compiled_function
from eqt_cli.engines.taylor.knots import passes_knots
from eqt_cli.engines.taylor.library import heyoka_module
from eqt_cli.engines.taylor.switching import AtOnce, Comparisons, recording


@dataclass(frozen=True, eq=False)
class Traced:
    """A closed loop as heyoka expressions; equal ones compile to the same code.

    Attributes
    ----------
    variables, derivative
        The flat state and its time derivative.
    compared
        The pairs (a, b) that the law compares.
    margins
        Their events (see `switching`).
    steady
        Whether the side of each comparison changes at its events only.
    own_parameters
        The number of parameters of the law itself, with the time of the next knot.
    after_instant
        The state after a control instant; empty where the law is not sampled.
    knot
        Index of the parameter that is the time of the next knot; None where none is passed.
    """

    variables: tuple[Any, ...]
    derivative: tuple[Any, ...]
    compared: tuple[tuple[Any, Any], ...]
    margins: tuple[Any, ...]
    steady: tuple[bool, ...]
    own_parameters: int
    after_instant: tuple[Any, ...] = ()
    knot: int | None = None

    @cached_property
    def _bytes(self) -> bytes:
        # heyoka compares expressions as trees, which are long where parts are used many times.
        law = self.variables, self.derivative, self.compared, self.margins, self.after_instant
        return pickle.dumps((law, self.knot))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Traced) and self._bytes == other._bytes

    def __hash__(self) -> int:
        return hash(self._bytes)


@dataclass(frozen=True, eq=False)
class OneLoop:
    """A loop that is equal to itself only; what is traced of it once is not traced again."""

    loop: ClosedLoop

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OneLoop) and self.loop is other.loop

    def __hash__(self) -> int:
        return id(self.loop)


@lru_cache(maxsize=64)
def traced(one: OneLoop) -> Traced:
    """`trace` of the loop, which is done once."""
    return trace(one.loop)


def trace(loop: ClosedLoop) -> Traced:
    """The closed loop as expressions.

    Raises
    ------
    TraceError
        If a component does what expressions cannot; it names component, operation and way out.
    """
    heyoka = heyoka_module()
    variables = _symbols(loop.state_length)
    parameters = sum(value.size for value in _numbers(loop).values())
    knot = parameters if passes_knots(loop) else None
    parameters += knot is not None
    comparisons = Comparisons(heyoka, parameters)
    token = recording.set(comparisons)
    try:
        # A law is promised a leading run axis; here it has one entry.
        symbolic = _symbolic(loop)
        (derivative,) = symbolic.vector_field(heyoka.time, variables[None])
        after: Array = np.empty(0, dtype=object)
        if loop.vehicle.control is not None:
            recording.set(AtOnce(heyoka))
            errors = _error_symbols(loop, parameters)
            (after,) = symbolic.after_instant(heyoka.time, variables[None], errors)
    except Exception as error:
        raise TraceError(_explain(error, loop)) from error
    finally:
        recording.reset(token)
    # Entries that are the same in every run come back as plain numbers.
    symbol = heyoka.expression
    rows, later = (
        [entry if isinstance(entry, symbol) else symbol(float(entry)) for entry in entries]
        for entries in (derivative, after)
    )
    compared, margins = tuple(comparisons.pairs), tuple(comparisons.margins())
    steady = tuple(comparisons.steady())
    return Traced(
        tuple(variables), tuple(rows), compared, margins, steady, parameters, tuple(later), knot
    )


@lru_cache(maxsize=64)
def compiled_samples(
    function: SampledFunction, one: OneLoop, lengths: tuple[int, ...], thread: int
) -> CompiledFunction | None:
    """A function of the loop, compiled for a thread; None where it does what expressions cannot.

    Unlike a law, what is measured of one need not be compiled: an actuator may say by NumPy alone
    where it is at its limit, and a law what its Lyapunov function is.
    """
    heyoka = heyoka_module()
    variables = _symbols(sum(lengths))
    rows = np.split(variables[None], np.cumsum(lengths)[:-1], axis=1)
    token = recording.set(AtOnce(heyoka))
    try:
        arrays = function(_symbolic(one.loop), heyoka.time, *rows)
    except Exception:
        return None
    finally:
        recording.reset(token)
    return compiled_function(heyoka, list(variables), arrays)


def _symbols(count: int) -> Array:
    """Symbols for the entries of flat states, or of other rows of numbers."""
    names = [f"y{index:04d}" for index in range(count)]
    return np.array(heyoka_module().make_vars(*names), dtype=object)


def _symbolic(loop: ClosedLoop) -> ClosedLoop:
    """The loop with `heyoka.par[k]` for every number that may vary, in the order of the rows."""
    heyoka, index, symbols = heyoka_module(), 0, {}
    for name, value in _numbers(loop).items():
        entries = [heyoka.par[index + k] for k in range(value.size)]
        symbols[name] = np.array(entries, dtype=object).reshape(1, *value.shape)
        index += value.size
    own = {name: symbols[name] for name in loop.parameters}
    held = {name: symbol for name, symbol in symbols.items() if name not in own}
    return loop.with_parameters(own).holding(held)


def _numbers(loop: ClosedLoop) -> dict[str, Array]:
    """Every number of the loop that is no part of its structure: parameters, and what it holds."""
    held = {name: np.asarray(value) for name, value in loop.held(0.0).items()}
    return loop.parameters | held


def _error_symbols(loop: ClosedLoop, first: int) -> tuple[Array, Array] | None:
    """The errors of measurement at an instant, as the parameters from the first on."""
    if not loop.vehicle.measures:
        return None
    d, m = loop.group.size, loop.group.dimension
    symbols = np.array([heyoka_module().par[first + k] for k in range(d * d + m)], dtype=object)
    return symbols[: d * d].reshape(1, d, d), symbols[d * d :].reshape(1, m)


def parameter_rows(problem: Problem) -> Array:
    """Every run's parameters in a row, in the order in which they are traced."""
    columns = []
    for name, shared in problem.loop.parameters.items():
        values = problem.varying.get(name)
        if values is None:
            values = np.broadcast_to(shared, (problem.runs, *shared.shape))
        columns.append(values.reshape(problem.runs, -1))
    return np.concatenate(columns, axis=1)


def _explain(error: Exception, loop: ClosedLoop) -> str:
    """Which component did what, from the frames of the traceback that run in one."""
    places = _places(error.__traceback__, loop) or {"the closed loop": ""}
    (owner, place), *callers = reversed(places.items())
    called = "".join(f", called by {name} at {where}" for name, where in callers)
    return (
        f"{owner} cannot be compiled: {type(error).__name__}: {error}"
        f"{place and ' at ' + place}{called}; write it with operators, @ and the functions of "
        "eqt_cli.core.arrays, or use `engine: solve_ivp`"
    )


def _places(trace: TracebackType | None, loop: ClosedLoop) -> dict[str, str]:
    """The components in the traceback, the innermost last, and how far each has come."""
    components = {
        id(component): f"{kind} '{component.name}'"
        for kind, component in (
            ("controller", loop.controller),
            ("reference", loop.reference),
            ("group", loop.group),
        )
    }
    places: dict[str, str] = {}
    for frame, line in traceback.walk_tb(trace):
        itself = frame.f_locals.get("self")
        # The traced controller is a copy with symbols in place of its numbers.
        is_controller = type(itself) is type(loop.controller)
        name = components.get(id(loop.controller if is_controller else itself))
        if name:
            summary = traceback.FrameSummary(frame.f_code.co_filename, line, frame.f_code.co_name)
            places[name] = f"{Path(frame.f_code.co_filename).name}:{line}: {summary.line}"
    return places
