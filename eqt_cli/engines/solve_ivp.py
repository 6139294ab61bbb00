"""The default engine: SciPy's `solve_ivp` on blocks of runs that share their steps.

A block is one large system, so that NumPy's cost per call is shared by its runs. SciPy's error
norm is a root mean square over all entries; the tolerances are therefore divided by √block, which
keeps the error of the worst run of a block below its error alone.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.leaves import with_leaves
from eqt_cli.core.option_types import Count, Positive, Scale
from eqt_cli.engines import stability
from eqt_cli.engines.base import Engine
from eqt_cli.engines.problem import Problem, Span, Status
from eqt_cli.engines.recorded_field import COMPARED, WORTH_RECORDING, RecordedField
from eqt_cli.engines.walk import Failure, Integrator, SpanResult

EXPLICIT_BLOCK = 100
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
        SciPy's name of the integration method.
    rtol, atol
        Relative and absolute tolerance of a single run.
    block
        Runs per call of `solve_ivp`. Default: 100 for explicit methods, 1 for implicit ones, whose
        Jacobians grow with the block.
    max_steps
        Most evaluations of the vector field that a block may take.
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
        return self.block or (EXPLICIT_BLOCK if self.method in stability.FUNCTIONS else 1)

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
        if self.method not in stability.FUNCTIONS:
            return 0.0
        function = stability.FUNCTIONS[self.method]
        return (len(function) - 1) * stability.steps(function, rates, duration)

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
        """Evaluate the vector field at the start until it is recorded; SciPy is not needed."""
        blocks = self.integrator(problem)
        blocks.begin(np.arange(problem.runs))
        blocks.rehearse()

    @property
    def solver(self) -> Callable[..., Any]:
        """The function that solves a span."""
        from scipy.integrate import solve_ivp  # slow to import; readers of results do without

        return solve_ivp


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
        loop = self.loop.holding(float(self.problem.times[0]))
        return RecordedField(lambda held: with_leaves(loop, held).vector_field)

    def rehearse(self) -> None:
        """Evaluate the field at the start of the runs until its recording is repeated."""
        problem, loop, t = self.problem, self.loop, float(self.problem.times[0])
        states = problem.states
        if loop.vehicle.control is not None:
            states = loop.after_instant(t, states, problem.errors_at(0))
        self._field.hold(loop.holding(t).held_leaves)
        for _ in range(WORTH_RECORDING + COMPARED + 1):
            self._field(t, states[:, : problem.loop.moving_length])

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
        first_step = min(GROWTH * self._longest_step, length) or None
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
                    rtol=max(engine.rtol / tighter, SMALLEST_RTOL),
                    atol=engine.atol / tighter,
                    **_jacobian_options(engine.method, *shape),
                )
            except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
                raise self._failed(str(error)) from error
        if result.status != 0:
            raise self._failed(result.message)
        at_grid = result.y if interpolated_at is not None else result.y[:, [0, -1]]
        found = at_grid.T.reshape(-1, *shape).swapaxes(0, 1)
        return found[:, 1 : 1 + span.later], found[:, -1]

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

        ones = np.ones((n, n))
        return {"jac_sparsity": scipy.sparse.block_diag([ones] * runs, format="csc")}
    if method == "LSODA":
        return {"lband": n - 1, "uband": n - 1}
    return {}
