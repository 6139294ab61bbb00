"""SciPy's integrators on the recorded vector field, and DOP853 in Python for one long solution."""

from __future__ import annotations

import math
import operator
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib.resources import files
from math import factorial
from types import SimpleNamespace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Count, Positive, Scale
from eqt_cli.engines.engine import Engine, Failure, Integrator, Problem, Span, SpanResult, Status
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.leaves import with_leaves

# DOP853 in Python, for one long solution: SciPy takes longer to import than this to follow it -----


SAFETY, SHRINK, GROW = 0.9, 0.2, 10.0
"""Of the step that the estimate allows; bounds on the ratio of two steps."""

_TERM = re.compile(r"ADD\(([-.\de]+), (\d+)\)")


@cache
def _coefficients() -> dict[str, Array]:
    """Return the weights of the slopes, a row for each sum, and ``c``, the times of the stages.

    They are those of the C header, which names the source.
    """
    text = files("eqt_cli.engines").joinpath("c/dop853.h").read_text(encoding="utf-8")
    by_name: dict[str, Array] = {"c": np.zeros(16)}
    for block in text.split("#define EQT_")[2:-1]:
        rows = block.split("STAGE(")[1:] or [block]
        weights = np.zeros((len(rows), 16))
        for row, words in zip(weights, rows, strict=True):
            for value, place in _TERM.findall(words):
                row[int(place)] = float(value)
            if len(rows) > 1:
                number, time = words.split(", ")[:2]
                by_name["c"][int(number)] = float(time)
        by_name[block.split()[0].partition("(")[0]] = weights
    return by_name


def solve(
    field: Callable[[float, Array], Array],
    horizon: tuple[float, float],
    start: Array,
    *,
    t_eval: Array | None,
    events: Callable[[float, Array], float],
    first_step: float | None,
    rtol: float,
    atol: float,
    **others: Any,
) -> Any:
    """Solve as `scipy.integrate.solve_ivp` does; parameters and result have its names."""
    known, (t, stop), y, f = _coefficients(), horizon, start, field(horizon[0], start)
    stretches = [start[:, None]]
    times = t_eval[1:] if t_eval is not None else np.array([stop])
    scale = atol + rtol * np.abs(y)
    h = first_step or min(stop - t, 0.01 * _rms(y / scale) / max(_rms(f / scale), 1e-5) + 1e-6)
    while t < stop:
        h = min(h, stop - t)
        if t + h == t:
            return SimpleNamespace(status=-1, message="the step size is too small")
        slopes = np.zeros((16, len(y)))
        slopes[0] = f
        for stage, row in enumerate(known["STAGES"], start=1):
            slopes[stage] = field(t + known["c"][stage] * h, y + h * (row @ slopes))
        after = y + h * (known["STEP"][0] @ slopes)
        scale = atol + rtol * np.maximum(np.abs(y), np.abs(after))
        fifth, third = (_rms((known[f"ERROR_{n}"][0] @ slopes) / scale) for n in (5, 3))
        error = h * fifth**2 / np.sqrt(fifth**2 + 0.01 * third**2) if fifth else 0.0
        if not error < 1:
            h *= max(SHRINK, SAFETY * error ** (-1 / 8)) if np.isfinite(error) else SHRINK
            continue
        end = stop if stop - t <= h else t + h
        slopes[12] = f_after = field(end, after)
        events(end, after)
        inside = times[(times > t) & (times <= end)]
        if inside[:-1].size or (inside != end).any():
            for stage, row in enumerate(known["DENSE_STAGES"], start=13):
                slopes[stage] = field(t + known["c"][stage] * h, y + h * (row @ slopes))
            change = after - y
            parts = [change, h * f - change, 2 * change - h * (f + f_after)]
            parts += [h * (known[f"DENSE_{n}"][0] @ slopes) for n in (3, 4, 5, 6)]
            x = ((inside - t) / h)[None]
            within = np.zeros((len(y), 1))
            for index, part in enumerate(reversed(parts)):
                within = (within + part[:, None]) * (x if index % 2 == 0 else 1 - x)
            stretches.append(y[:, None] + within)
        elif inside.size:
            stretches.append(after[:, None])
        t, y, f = end, after, f_after
        h *= min(GROW, SAFETY * error ** (-1 / 8)) if error else GROW
    return SimpleNamespace(status=0, y=np.concatenate(stretches, axis=1))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


# The number of steps that stability alone demands of an explicit method ---------------------------


_TAYLOR = tuple(1 / factorial(power) for power in range(9))
_LAST = 2.6916922001691e-6, 2.3413451082098e-7, 1.4947364854592e-8, 3.6133245781282e-10

FUNCTIONS = {"RK23": _TAYLOR[:4], "RK45": (*_TAYLOR[:6], 1 / 600), "DOP853": _TAYLOR + _LAST}
"""R(z) = 1 + z bᵀ(1 − zA)⁻¹1 of the tableau A, b, in rising powers up to the number of stages."""

REACH, RESOLUTION = 40.0, 0.01
"""Length and spacing of the points on a ray at which the stability function is evaluated."""


def steps(coefficients: Sequence[float], rates: Array, duration: float) -> float:
    """Return the number of steps at which no decaying solution of y' = λy grows.

    Parameters
    ----------
    coefficients
        Stability function R(z), in rising powers: a step multiplies y by R(hλ).
    rates : (instants, n)
        The eigenvalues λ at instants spread evenly over the duration, 1/s.

    Returns
    -------
    float
        The mean over instants of max |λ| / r, times the duration, where r is the first distance
        from 0 along the direction of λ at which |R| exceeds 1.
    """
    decaying = np.where(rates.real < 0, rates, 0.0)
    fastest = [_inverse_step(coefficients, at_once) for at_once in decaying]
    return float(duration * np.mean(fastest))


def _inverse_step(coefficients: Sequence[float], rates: Array) -> float:
    """Return 1/h of the longest stable step h, 1/s."""
    sizes = np.abs(rates)
    large = rates[sizes > sizes.max() / 10]  # r is 2 to 7 in all directions but along the axis
    if not len(large):
        return 0.0
    distances = np.arange(RESOLUTION, REACH, RESOLUTION)
    z = distances[:, None] * large / np.abs(large)
    grows = np.abs(np.polynomial.polynomial.polyval(z, coefficients)) > 1 + 1e-9
    first = np.where(grows.any(axis=0), grows.argmax(axis=0), len(distances) - 1)
    return float((np.abs(large) / distances[first]).max())


# A vector field as the NumPy calls that it makes, which are recorded once and then repeated -------
#
# The laws are evaluated once on `Recorded` arrays, which note every NumPy call made with them. From
# then on only these calls are made, on existing arrays, without the Python code around them. A law
# that cannot be recorded, because it branches on a number, is evaluated as it is written. It knows
# no group and no law.


Field = Callable[[float, Array], Array]
"""A function of a time and flat states ``(runs, n)`` to their time derivatives."""

Held = Mapping[str, Array]
"""Numbers that a field holds between two known instants, by name."""

WORTH_RECORDING = 40
"""Evaluations before the field is recorded, which takes as long as about ten of them."""

COMPARED = 2
"""Number of later evaluations in which the recording is compared with the field."""

ROUNDING = 1e-10
"""Allowed difference of the two, which round differently, relative to the largest entry."""


class RecordedField:
    """A vector field of states of one shape, recorded when it is evaluated often.

    It is recorded after a fixed number of evaluations, so that equal problems have equal solutions.

    Parameters
    ----------
    fields
        Returns the field for the numbers that it holds between two known instants.
    """

    def __init__(self, fields: Callable[[Held], Field]) -> None:
        self._fields = fields
        self._evaluations = 0
        self._recording: RecordedCalls | None = None
        self.hold({})

    def hold(self, held: Held) -> None:
        """Hold other numbers from now on, with the same names and shapes."""
        self._held, self._field = held, self._fields(held)

    def __call__(self, t: float, states: Array) -> Array:
        self._evaluations += 1
        behind = self._evaluations - WORTH_RECORDING
        if self._recording is not None and behind > COMPARED:
            return self._recording.repeat(t, states, *self._held.values())
        rates = self._field(t, states)
        if behind == 0:
            self._recording = self._recorded(t, states)
        elif self._recording is not None:
            repeated = self._recording.repeat(t, states, *self._held.values())
            if not _agree(repeated, rates):  # the field depends on more than it is given
                self._recording = None
        return rates

    def _recorded(self, t: float, states: Array) -> RecordedCalls | None:
        def field(t: Any, states: Any, *numbers: Any) -> Any:
            return self._fields(dict(zip(self._held, numbers, strict=True)))(t, states)

        try:
            return RecordedCalls(field, t, states, *self._held.values())
        except Exception:  # a law may do anything with a stand-in for an array: not recorded then
            return None


def _agree(one: Array, other: Array) -> bool:
    scale = np.abs(other[np.isfinite(other)]).max(initial=0.0)
    return np.allclose(one, other, rtol=0.0, atol=ROUNDING * scale, equal_nan=True)


class NotRecordable(Exception):
    """An operation that depends on more than shapes, so that it cannot be repeated."""


class RecordedCalls:
    """The recorded calls, in order, and the arrays that they read and write.

    All arrays have the runs along their last axis in memory, so that a call processes one entry of
    all runs at once.
    """

    def __init__(self, field: Callable[..., Any], t: float, states: Array, *held: Array) -> None:
        self.calls: list[Callable[[], Any]] = []
        self._runs = len(states)
        self._known: dict[Any, tuple[Recorded, Any]] = {}
        self._inputs = [self._stored(values) for values in (t, states, *held)]
        rates = field(*(Recorded(self, values) for values in self._inputs))
        if not isinstance(rates, Recorded) or rates.shape != states.shape:
            raise NotRecordable
        self._rates: Array = rates.value
        self._known.clear()

    def repeat(self, t: float, states: Array, *held: Array) -> Array:
        """Evaluate the field at another time, states and held numbers of the same shapes."""
        for place, values in zip(self._inputs, (t, states, *held), strict=True):
            place[...] = values
        for call in self.calls:
            call()
        return self._rates.copy(order="C")

    def _stored(self, values: Any) -> Array:
        """Return a new array with these values."""
        values = np.asarray(values)
        array = self.empty(values.shape, values.dtype)
        array[...] = values
        return array

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Array:
        """Return an array with the runs along its last axis in memory."""
        if np.dtype(dtype).hasobject:
            raise NotRecordable
        if len(shape) > 1 and shape[0] == self._runs:
            return np.moveaxis(np.empty((*shape[1:], shape[0]), dtype), -1, 0)
        return np.empty(shape, dtype)

    def call(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> Recorded:
        """Record a function that takes `out`; equal calls are made only once."""
        values = [_value(argument) for argument in arguments]
        key = function, *map(_identity, arguments), repr(options)
        if key not in self._known:
            out = self._stored(function(*values, **options))
            result = self._note(out, partial(function, *values, **options, out=out))
            self._known[key] = result, values  # while they live, no other array has their identity
            return result
        result, _ = self._known[key]
        result.memory.shared = True
        return result

    def copied(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> Recorded:
        """Record any other function of arrays, whose result is copied."""
        values = [_value(argument) for argument in arguments]
        out = self._stored(function(*values, **options))
        return self._note(out, lambda: np.copyto(out, function(*values, **options)))

    def blank(self, shape: tuple[int, ...], dtype: Any, zeros: bool) -> Recorded:
        """Return an array for a law to write into, with zeros if it may not fill all of it."""
        out = self.empty(shape, dtype)
        return self._note(out, partial(out.fill, 0)) if zeros else Recorded(self, out)

    def _note(self, out: Array, call: Callable[[], Any]) -> Recorded:
        call()
        self.calls.append(call)
        return Recorded(self, out)


class _Memory:
    """The shared state of arrays that are views of each other."""

    def __init__(self) -> None:
        self.version = 0
        self.shared = False


class Recorded(NDArrayOperatorsMixin):
    """A stand-in for an array while a field is recorded; its numbers cannot be read."""

    def __init__(
        self, recording: RecordedCalls, value: Array, memory: _Memory | None = None
    ) -> None:
        self.recording, self.value, self.memory = recording, value, memory or _Memory()
        self.shape, self.ndim = value.shape, value.ndim
        self.size, self.dtype = value.size, value.dtype

    @property
    def T(self) -> Recorded:
        return self._view(self.value.T)

    def _view(self, value: Array) -> Recorded:
        return Recorded(self.recording, value, self.memory)

    def __len__(self) -> int:
        return len(self.value)

    def __getitem__(self, index: Any) -> Recorded:
        return self._selected(lambda array: array[_known_index(index)])

    def __setitem__(self, index: Any, values: Any) -> None:
        if self.memory.shared:
            raise NotRecordable
        self.memory.version += 1
        assign = partial(operator.setitem, self.value, _known_index(index), _value(values))
        assign()
        self.recording.calls.append(assign)

    def reshape(self, *shape: Any) -> Recorded:
        return self._selected(lambda array: array.reshape(*shape))

    def _selected(self, select: Callable[[Array], Array]) -> Recorded:
        """Return a view of selected entries, or a recorded copy if NumPy has no view."""
        selected = np.asarray(select(self.value))
        if np.may_share_memory(selected, self.value):
            return self._view(selected)
        return self.recording.copied(select, self)

    def swapaxes(self, one: int, other: int) -> Recorded:
        return self._view(self.value.swapaxes(one, other))

    def transpose(self, axes: tuple[int, ...]) -> Recorded:
        return self._view(self.value.transpose(axes))

    def copy(self) -> Recorded:
        return self.recording.copied(lambda array: array, self)

    def sum(self, axis: Any = None) -> Recorded:
        return self.recording.call(np.add.reduce, self, axis=axis)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            raise NotRecordable
        if ufunc is np.matmul:
            return _product(self.recording, *inputs)
        return self.recording.call(ufunc, *inputs)

    def __array_function__(self, function: Any, types: Any, inputs: Any, options: Any) -> Any:
        if function in (np.empty_like, np.zeros_like, np.ones_like):
            made = function(*map(_value, inputs), **options)
            if function is np.ones_like:
                return made
            return self.recording.blank(made.shape, made.dtype, function is np.zeros_like)
        if function is np.broadcast_to:
            return self._selected(lambda array: np.broadcast_to(array, *inputs[1:], **options))
        if function is np.result_type:
            return np.result_type(*(getattr(each, "dtype", each) for each in inputs))
        if function not in COPIED:
            raise NotRecordable
        return self.recording.copied(function, *inputs, **options)

    def __array__(self, *_: Any, **__: Any) -> Array:
        raise NotRecordable

    def __bool__(self) -> bool:
        raise NotRecordable


COPIED = {np.where, np.concatenate, np.linalg.inv, np.linalg.solve}
"""Functions whose results depend on values only, and that take no `out`."""


def _product(recording: RecordedCalls, a: Any, b: Any) -> Any:
    """Return a @ b by the function that is fastest with the runs along the last axis in memory."""
    if a.ndim == b.ndim == 2:
        return recording.call(np.matmul, b.T, a.T).T
    if a.ndim > 2 and b.ndim == 2 and not isinstance(b, Recorded):
        runs_last, runs_first = (*range(1, a.ndim), 0), (a.ndim - 1, *range(a.ndim - 1))
        return recording.call(np.matmul, b.T, a.transpose(runs_last)).transpose(runs_first)
    if a.ndim == 1 or b.ndim == 1:
        return recording.call(np.matmul, a, b)
    return recording.call(_stacked_product, a, b)


_stacked_product = partial(np.einsum, "...ij,...jk->...ik")


def _value(argument: Any) -> Any:
    """Return the array that an argument stands for."""
    if isinstance(argument, Recorded):
        return argument.value
    if isinstance(argument, list | tuple):
        return type(argument)(map(_value, argument))
    return argument


def _known_index(index: Any) -> Any:
    """Return an index that is the same at every repetition."""
    if any(isinstance(part, Recorded) for part in (index if isinstance(index, tuple) else [index])):
        raise NotRecordable
    return index


def _identity(argument: Any) -> Any:
    """Return a key, equal for arguments with equal values at every repetition."""
    version: Any = None
    if isinstance(argument, Recorded):
        version, argument = (id(argument.memory), argument.memory.version), argument.value
    if isinstance(argument, np.ndarray):
        return argument.ctypes.data, argument.shape, argument.strides, argument.dtype.str, version
    return type(argument), repr(argument)  # 0.0 and -0.0 are equal but not identical


# The default engine: SciPy's `solve_ivp` on blocks of runs that share their steps -----------------
#
# A block is one large system, so that NumPy's cost per call is shared by its runs. SciPy's error
# norm is a root mean square over all entries; the tolerances are therefore divided by √block, which
# keeps the error of the worst run of a block below its error alone.


EXPLICIT_BLOCK = 200
GROWTH = 1.5
"""After a known instant, the first step is this many times the longest step of the span before it.
SciPy's own guess costs an evaluation and is often half as long; with 1, steps could not grow."""

SMALLEST_RTOL = 100 * np.finfo(float).eps
"""SciPy raises a smaller `rtol` to this value; below it a tighter solve would be no tighter."""


@dataclass(frozen=True)
class SolveIvp(Engine):
    """SciPy's solve_ivp on vectorised blocks of runs, with any of its methods.

    Attributes
    ----------
    method
        SciPy's integration method.
    rtol, atol
        Relative and absolute tolerance of a single run.
    block
        Runs per call of `solve_ivp`. Default: 200 for explicit methods, 1 for implicit ones, whose
        Jacobians grow with the block.
    max_steps
        Most evaluations of the vector field for a block.
    """

    name: ClassVar[str] = "solve_ivp"
    counted: ClassVar[str] = "evaluations"

    method: Literal["DOP853", "RK45", "RK23", "Radau", "BDF", "LSODA"] = "DOP853"
    rtol: Annotated[Positive, Scale("relative tolerance")] = 1e-9
    atol: Annotated[Positive, Scale("absolute tolerance")] = 1e-12
    block: Count | None = None
    max_steps: Count = 1_000_000

    @property
    def runs_per_block(self) -> int:
        """The nominal block: `block`, or the method's default."""
        return self.block or (EXPLICIT_BLOCK if self.method in FUNCTIONS else 1)

    def check(self, problems: Problems) -> None:
        """Note a relative tolerance too small for SciPy, or not below 1."""
        if not SMALLEST_RTOL <= self.rtol < 1:
            limits = f"expected a number from {SMALLEST_RTOL:.3g} (SciPy's smallest) to 1"
            problems.at("rtol").add(f"{limits}, got {self.rtol:g}")

    def tightened(self, factor: float) -> SolveIvp:
        """Return the engine with both tolerances times `factor`."""
        rtol = max(self.rtol * factor, SMALLEST_RTOL)
        return replace(self, rtol=rtol, atol=self.atol * factor)

    def work_for_stability(self, rates: Array, duration: float) -> float:
        """Return evaluations, as many per step as stages, for an explicit method; else 0."""
        if self.method not in FUNCTIONS:
            return 0.0
        function = FUNCTIONS[self.method]
        return (len(function) - 1) * steps(function, rates, duration)

    def runs_at_once(self, most: int) -> int:
        """Return a number of whole blocks, so that blocks do not depend on the memory."""
        return max(1, most // self.runs_per_block) * self.runs_per_block

    def integrator(self, problem: Problem) -> Blocks:
        """Return the integrator of blocks, whose runs share their steps."""
        return Blocks(problem, self)

    def groups(self, problem: Problem, threads: int) -> list[Array]:
        """Return the blocks, in the order of the runs."""
        size, runs = self.runs_per_block, np.arange(problem.runs)
        return [runs[start : start + size] for start in range(0, problem.runs, size)]

    def rehearse(self, problem: Problem) -> None:
        """Evaluate the field at the start until its recording is repeated; SciPy is not needed."""
        loop, states = problem.begun
        field = _recorded(loop)
        field.hold(loop.held_leaves)
        for _ in range(WORTH_RECORDING + COMPARED + 1):
            field(float(problem.times[0]), states[:, : problem.loop.moving_length])

    @property
    def solver(self) -> Callable[..., Any]:
        """The function that solves a span."""
        from scipy.integrate import solve_ivp  # slow to import; readers of results do without

        return solve_ivp


def _recorded(loop: ClosedLoop) -> RecordedField:
    return RecordedField(lambda held: with_leaves(loop, held).vector_field)


class _Failed(Exception):
    """A block was not integrated to the end of a span; its argument is the `Failure`."""


class Blocks(Integrator):
    """Integrates a block as one system; if that fails, each of its runs is integrated alone."""

    def __init__(self, problem: Problem, engine: SolveIvp) -> None:
        super().__init__(problem)
        self._engine = engine

    def begin(self, runs: Array) -> None:
        """Begin these runs with no evaluation counted."""
        super().begin(runs)
        self._evaluations, self._longest_step = 0, 0.0
        self._field = self._new_field()

    def _new_field(self) -> RecordedField:
        return _recorded(self.loop.holding(float(self.problem.times[0])))

    def hold(self, span: Span) -> None:
        """Set the held numbers in the recorded field."""
        self._field.hold(self.loop.holding(span.start).held_leaves)

    def advance(self, span: Span, states: Array) -> SpanResult:
        """Integrate by one call of solve_ivp.

        If a single run fails, a second call gives its samples before the failure.
        """
        before, longest = self._evaluations, self._longest_step
        try:
            later, end = self._integrated(span, states, self._engine.max_steps)
            return SpanResult(end, later, self._evaluations - before)
        except _Failed as failed:
            steps, failure = self._evaluations - before, failed.args[0]
        runs, n = states.shape
        samples, ends = np.full((runs, span.later, n), np.nan), np.full(states.shape, np.nan)
        if runs > 1:
            return SpanResult(ends, samples, steps, dict.fromkeys(range(runs)))
        # The last step is cut to end at a sample, which may cost evaluations beyond the limit.
        known = span.until(self._accepted)
        self._longest_step, self._field = longest, self._new_field()
        self.hold(span)
        if known.later:
            with suppress(_Failed):
                samples[:, : known.later], _ = self._integrated(known, states, math.inf)
        return SpanResult(ends, samples, steps, {0: failure})

    def _integrated(self, span: Span, states: Array, limit: float) -> tuple[Array, Array]:
        """Return the states at the samples after the start, and at the stop."""
        engine, shape, times = self._engine, states.shape, span.grid
        # A span ends with a step, so without samples inside it nothing has to be interpolated.
        interpolated_at = times if len(times) > 2 else None
        self._accepted, self._non_finite_at = span.start, math.nan

        def field(t: float, y: Array) -> Array:
            self._count(t, limit)
            derivative: Array = self._field(span.inside(t), y.reshape(shape)).ravel()
            if not np.isfinite(derivative).all():
                self._non_finite_at = t
            return derivative

        def accepted(t: float, y: Array) -> float:
            # An event that never occurs: solve_ivp evaluates it at the end of every step.
            if not np.isfinite(y).all():
                self._non_finite_at = t if math.isnan(self._non_finite_at) else self._non_finite_at
                raise self._failed("")
            self._longest_step = max(self._longest_step, t - self._accepted)
            self._accepted = t
            self._non_finite_at = math.nan  # a rejected trial step is no failure
            return 1.0

        tighter = np.sqrt(engine.runs_per_block)
        start, length = states.ravel(), span.stop - span.start
        first_step = min(GROWTH * self._longest_step, length, span.longest) or None
        self._longest_step = 0.0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the outcome tells the same
            # SciPy's step-size search does not end on a derivative that is not finite.
            if not np.isfinite(field(span.start, start)).all():
                reason = "the vector field is not finite"
                raise _Failed(Failure(Status.NON_FINITE, reason, span.start))
            try:
                result = engine.solver(
                    field,
                    (span.start, span.stop),
                    start,
                    method=engine.method,
                    t_eval=interpolated_at,
                    events=accepted,
                    first_step=first_step,
                    max_step=span.longest,
                    rtol=max(engine.rtol / tighter, SMALLEST_RTOL),
                    atol=engine.atol / tighter,
                    **_jacobian_options(engine.method, *shape),
                )
            except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
                raise self._failed(str(error)) from error
        if result.status != 0:
            raise self._failed(result.message)
        at_grid = result.y if interpolated_at is not None else result.y[:, [0, -1]]
        states_at = at_grid.T.reshape(-1, *shape).swapaxes(0, 1)
        return states_at[:, 1 : 1 + span.later], states_at[:, -1]

    def _count(self, t: float, limit: float) -> None:
        if self._evaluations >= limit:
            reason = f"step limit: {limit} evaluations (solver.max_steps)"
            raise _Failed(Failure(Status.STEP_LIMIT, reason, self._accepted))
        self._evaluations += 1
        self.reached(t)

    def _failed(self, reason: str) -> _Failed:
        if not math.isnan(self._non_finite_at):
            return _Failed(Failure(t=self._non_finite_at))
        return _Failed(Failure(Status.SOLVER_FAILED, reason.rstrip("."), self._accepted))


def _jacobian_options(method: str, runs: int, n: int) -> dict[str, Any]:
    """Return options by which implicit methods know that the runs of a block are independent."""
    if runs == 1:
        return {}
    if method in ("Radau", "BDF"):
        import scipy.sparse

        ones = scipy.sparse.coo_array(np.ones((n, n)))
        return {"jac_sparsity": scipy.sparse.block_diag([ones] * runs, format="csc")}
    if method == "LSODA":
        return {"lband": n - 1, "uband": n - 1}
    return {}
