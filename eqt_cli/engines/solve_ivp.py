"""SciPy's integrators on the traced vector field, and DOP853 in Python for one long solution."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from math import factorial
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Count, Positive, Scale
from eqt_cli.base.stored import Status
from eqt_cli.components.vehicle_parts import presences
from eqt_cli.engines.engine import (
    Engine,
    Failure,
    Integrator,
    Problem,
    Span,
    SpanResult,
    Work,
    lost_calls,
)
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.leaves import leaves, with_leaves
from eqt_cli.numbers.program import ArrayProgram, Program, traced

# DOP853 in Python, for one long solution: SciPy takes longer to import than this to follow it -----


SAFETY, SHRINK, GROW = 0.9, 0.2, 10.0
"""Of the step that the estimate allows; bounds on the ratio of two steps."""

_TERM = re.compile(r"ADD\(([-.\de]+), (\d+)\)")


@cache
def coefficients() -> dict[str, Array]:
    """Return the weights of the slopes, a row for each sum, and ``c``, the times of the stages.

    They are those of the C header, which names the source.
    """
    text = (Path(__file__).parent / "c" / "dop853.h").read_text(encoding="utf-8")
    by_name: dict[str, Array] = {"c": np.zeros(16)}
    by_name["c"][12] = 1.0
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


Field = Callable[[float, Array], Array]
"""A time and a flat state to its rates."""


def solve(
    field: Field,
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
    tableau, (t, stop), y, f = coefficients(), horizon, start, field(horizon[0], start)
    stretches = [start[:, None]]
    times = t_eval[1:] if t_eval is not None else np.array([stop])
    scale = atol + rtol * np.abs(y)
    h = first_step or min(stop - t, 0.01 * _rms(y / scale) / max(_rms(f / scale), 1e-5) + 1e-6)
    while t < stop:
        h = min(h, stop - t)
        if t + h == t:
            return SimpleNamespace(status=-1, message="the step size is too small")
        slopes, after = _step(field, t, y, f, h)
        scale = atol + rtol * np.maximum(np.abs(y), np.abs(after))
        fifth, third = (_rms((tableau[f"ERROR_{n}"][0] @ slopes) / scale) for n in (5, 3))
        error = h * fifth**2 / np.sqrt(fifth**2 + 0.01 * third**2) if fifth else 0.0
        if not error < 1:
            h *= max(SHRINK, SAFETY * error ** (-1 / 8)) if np.isfinite(error) else SHRINK
            continue
        end = stop if stop - t <= h else t + h
        slopes[12] = f_after = field(end, after)
        events(end, after)
        inside = times[(times > t) & (times <= end)]
        if inside[:-1].size or (inside != end).any():
            for stage, row in enumerate(tableau["DENSE_STAGES"], start=13):
                slopes[stage] = field(t + tableau["c"][stage] * h, y + h * (row @ slopes))
            if _errs_between(slopes, h, scale):
                stretches.append(_states_at(inside, field, t, y, f))
            else:
                stretches.append(_interpolated((inside - t) / h, slopes, h, y, after))
        elif inside.size:
            stretches.append(after[:, None])
        t, y, f = end, after, f_after
        h *= min(GROW, SAFETY * error ** (-1 / 8)) if error else GROW
    return SimpleNamespace(status=0, y=np.concatenate(stretches, axis=1))


def _step(field: Field, t: float, y: Array, f: Array, h: float) -> tuple[Array, Array]:
    """Return the slopes of a step, a row for each stage, and the state behind it."""
    tableau, slopes = coefficients(), np.zeros((16, len(y)))
    slopes[0] = f
    for stage, row in enumerate(tableau["STAGES"], start=1):
        slopes[stage] = field(t + tableau["c"][stage] * h, y + h * (row @ slopes))
    return slopes, y + h * (tableau["STEP"][0] @ slopes)


def _states_at(times: Array, field: Field, t: float, y: Array, f: Array) -> Array:
    """Return the states behind steps of their own that end at some times, a column each."""
    return np.transpose([_step(field, t, y, f, time - t)[1] for time in times.tolist()])


def _interpolated(x: Array, slopes: Array, h: float, y: Array, after: Array) -> Array:
    """Return the states at some shares of a step by its dense output, a column each."""
    change, tableau = after - y, coefficients()
    parts = [change, h * slopes[0] - change, 2 * change - h * (slopes[12] + slopes[0])]
    parts += [h * (tableau[f"DENSE_{n}"][0] @ slopes) for n in (3, 4, 5, 6)]
    within = np.zeros((len(y), 1))
    for index, part in enumerate(reversed(parts)):
        within = (within + part[:, None]) * (x if index % 2 == 0 else 1 - x)
    return y[:, None] + within


def _errs_between(slopes: Array, h: float, scale: Array) -> bool:
    """Whether the dense output of a step errs by more than 20 tolerances."""
    return _rms(h * (coefficients()["DENSE_ERROR"][0] @ slopes) / scale) > 1


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
    return float(duration * np.mean([_inverse_step(coefficients, at_once) for at_once in decaying]))


def _inverse_step(coefficients: Sequence[float], rates: Array) -> float:
    """Return 1/h of the longest stable step h, 1/s."""
    sizes = np.abs(rates)
    large = rates[sizes > sizes.max() / 10]  # r is 2 to 7 in all directions but along the axis
    if not len(large):
        return 0.0
    distances = np.arange(RESOLUTION, REACH, RESOLUTION)
    for few in (len(distances) // 5, len(distances)):  # those beyond are seldom reached
        z = distances[:few, None] * large / np.abs(large)
        grows = np.abs(np.polyval(coefficients[::-1], z)) > 1 + 1e-9
        if grows.any(axis=0).all():
            break
    first = np.where(grows.any(axis=0), grows.argmax(axis=0), len(distances) - 1)
    return float((np.abs(large) / distances[first]).max())


# The vector field of a block of runs, as a program once it is evaluated often ---------------------
#
# A program makes one NumPy call per operation, on the numbers of all runs, without the Python code
# of laws and groups around them. A law that cannot be traced, because it branches on a number, is
# evaluated as it is written.


WORTH_TRACING = 20
"""Evaluations before the field is traced, which takes as long as 4 to 25 of them."""

COMPARED = 2
"""Number of later evaluations in which the program is compared with the field."""

ROUNDING = 1e-10
"""Allowed difference of the two, which round differently, relative to the largest entry."""

MOST_OPERATIONS = 3000
"""Operations of a program, of 0.3 µs each, above which large matrices are faster as written."""


@lru_cache(maxsize=64)
def _traced(loop: ClosedLoop, varying: tuple[str, ...]) -> Program | None:
    """Trace the field of a loop; None if it does what programs cannot, or too much.

    Inputs are ``time``, ``state``, the varying numbers and the held ones, by their paths. All other
    numbers are constants of the program, which is shorter with them.
    """
    loop = loop.holding(0.0)
    numbers = leaves(loop)
    lengths = {path: numbers[path].size for path in (*varying, *loop.held_leaves)}

    def field(inputs: Arrays) -> Arrays:
        # A law is promised a leading run axis; here it has one entry.
        values = {
            path: inputs.get(path, number).reshape(1, *number.shape)
            for path, number in numbers.items()
        }
        rates = with_leaves(loop, values).vector_field(inputs["time"][0], inputs["state"][None])
        return {"rates": rates[0]}

    try:
        program = traced(field, {"time": 1, "state": loop.moving_length, **lengths})
    except Exception:  # a law may do anything with symbols
        return None
    return program if program.operations <= MOST_OPERATIONS else None


class TracedField:
    """The vector field of some runs, which is traced when it is evaluated often.

    It is traced after a fixed number of evaluations, so that equal problems have equal solutions.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._loop = problem, problem.batched_loop()
        self._evaluations = 0
        self._program: ArrayProgram | None = None

    def hold(self, t: float) -> None:
        """Hold the numbers from time t to the next instant."""
        self._held = self._loop.holding(t)
        self._write(self._held.held_leaves)

    def __call__(self, t: float, states: Array) -> Array:
        """Return the time derivatives of flat states, ``(runs, n)``."""
        self._evaluations += 1
        behind = self._evaluations - WORTH_TRACING
        if self._program is not None and behind > COMPARED:
            return self._evaluated(self._program, t, states)
        rates = self._held.vector_field(t, states)
        if behind == 0:
            problem = self._problem
            program = _traced(problem.loop, tuple(problem.varying))
            if program is not None:
                self._program = ArrayProgram(program, problem.runs)
                self._write({**problem.varying, **self._held.held_leaves})
        elif self._program is not None:
            scale = np.abs(rates[np.isfinite(rates)]).max(initial=0.0)
            by_program = self._evaluated(self._program, t, states)
            if not np.allclose(by_program, rates, rtol=0.0, atol=ROUNDING * scale, equal_nan=True):
                self._program = None  # the field depends on more than it is given
        return rates

    def _write(self, numbers: Arrays) -> None:
        """Write numbers, shared or with a leading axis of runs, to the program."""
        if self._program is not None:
            for path, number in numbers.items():
                rows = self._program.inputs[path]
                rows[...] = number.reshape(-1, len(rows)).T

    @staticmethod
    def _evaluated(program: ArrayProgram, t: float, states: Array) -> Array:
        program.inputs["time"][...] = t
        program.inputs["state"][...] = states.T
        return program()["rates"].T.copy()


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
        return replace(self, rtol=max(self.rtol * factor, SMALLEST_RTOL), atol=self.atol * factor)

    def work_for_stability(self, rates: Array, duration: float) -> Work:
        """Return evaluations, as many per step as stages, for an explicit method; else 0."""
        if self.method not in FUNCTIONS:
            return Work()
        function = FUNCTIONS[self.method]
        return Work((len(function) - 1) * steps(function, rates, duration), "evaluations")

    def integrator(self, problem: Problem) -> Blocks:
        """Return the integrator of blocks, whose runs share their steps."""
        return Blocks(problem, self)

    def groups(self, problem: Problem, threads: int) -> list[Array]:
        """Return the blocks, in the order of the runs."""
        size, runs = self.runs_per_block, np.arange(problem.runs)
        return [runs[start : start + size] for start in range(0, problem.runs, size)]

    def rehearse(self, problem: Problem) -> None:
        """Evaluate the field at the start until its program is; SciPy is not needed."""
        (_, states), start = problem.begun, float(problem.times[0])
        field = TracedField(problem)
        field.hold(start)
        for _ in range(WORTH_TRACING + COMPARED + 1):
            field(start, states[:, : problem.loop.moving_length])

    @property
    def solver(self) -> Callable[..., Any]:
        """The function that solves a span."""
        from scipy.integrate import solve_ivp  # slow to import; readers of results do without

        return partial(solve_ivp, method=_dop853() if self.method == "DOP853" else self.method)


@cache
def _dop853() -> Any:
    """Return SciPy's DOP853 with steps that end at samples where its dense output errs."""
    from scipy.integrate import DOP853

    class Dop853(DOP853):  # type: ignore[misc]
        def _dense_output_impl(self) -> Any:
            dense, slopes = super()._dense_output_impl(), self.K_extended
            t, y = self.t_old, self.y_old
            scale = self.atol + self.rtol * np.maximum(np.abs(y), np.abs(self.y))
            if not _errs_between(slopes, self.h_previous, scale):
                return dense
            return partial(_states_at, field=self.fun, t=t, y=y, f=slopes[0].copy())

    return Dop853


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
        self._field = TracedField(self.problem.select(runs))

    @property
    def spans(self) -> list[Span]:
        """The spans, cut where what acts for a stretch of time changes in any of these runs."""
        vehicle = self.problem.select(self.runs).batched_loop().vehicle
        acting = presences([*vehicle.forces, *vehicle.actuators])
        return self.problem.spans_with(np.concatenate([np.empty(0), *(x.of_runs for x in acting)]))

    def hold(self, span: Span) -> None:
        """Set the held numbers of the field."""
        self._field.hold(span.start)

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
        solved = span.until(self._accepted)
        self._longest_step, self._field = longest, TracedField(self.problem.select(self.runs))
        self.hold(span)
        if solved.later:
            with suppress(_Failed):
                samples[:, : solved.later], _ = self._integrated(solved, states, math.inf)
        return SpanResult(ends, samples, steps, {0: failure})

    def _integrated(self, span: Span, states: Array, limit: float) -> tuple[Array, Array]:
        """Return the states at the samples after the start, and at the stop."""
        engine, shape, times = self._engine, states.shape, span.grid
        # A span ends with a step, so without samples inside it nothing has to be interpolated.
        interpolated_at = times if len(times) > 2 else None
        self._accepted, self._non_finite_at = span.start, math.nan

        def field(t: float, y: Array) -> Array:
            if self._evaluations >= limit:
                reason = f"step limit: {limit} evaluations (solver.max_steps)"
                raise _Failed(Failure(Status.STEP_LIMIT, reason, self._accepted))
            self._evaluations += 1
            self.reached(t)
            derivative: Array = self._field(span.inside(t), y.reshape(shape)).ravel()
            if not np.isfinite(derivative).all():
                self._non_finite_at = t
                for failure in lost_calls(self.problem, t).values():
                    raise _Failed(failure or Failure(t=t))
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

    def _failed(self, reason: str) -> _Failed:
        if not math.isnan(self._non_finite_at):
            return _Failed(Failure(t=self._non_finite_at))
        return _Failed(Failure(Status.SOLVER_FAILED, reason.rstrip("."), self._accepted))


def _jacobian_options(method: str, runs: int, n: int) -> dict[str, Any]:
    """Return options by which implicit methods know that the runs of a block are independent."""
    if runs > 1 and method in ("Radau", "BDF"):
        import scipy.sparse

        ones = scipy.sparse.coo_array(np.ones((n, n)))
        return {"jac_sparsity": scipy.sparse.block_diag([ones] * runs, format="csc")}
    return {"lband": n - 1, "uband": n - 1} if runs > 1 and method == "LSODA" else {}
