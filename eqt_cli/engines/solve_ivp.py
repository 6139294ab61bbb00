"""The default engine: SciPy's `solve_ivp` on blocks of runs that share their steps.

A block is one large system, so that NumPy's cost per call is shared by its runs. SciPy's error
norm is a root mean square over all entries; the tolerances are therefore divided by √block, which
keeps the error of the worst run of a block under what it would be alone.
"""

from __future__ import annotations

import dataclasses
import warnings
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import Count, Positive
from eqt_cli.core.problems import Problems
from eqt_cli.engines import stability
from eqt_cli.engines.base import Engine, Problem, Progress, Solution, Span, Status
from eqt_cli.engines.recorded_field import RecordedField

EXPLICIT = ("DOP853", "RK45", "RK23")
EXPLICIT_BLOCK = 100
REHEARSED_EVALUATIONS = 200
"""Of a block, or of a run of it, before a configuration is run."""

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
    cross_check_rank: ClassVar[int | None] = 1
    counted: ClassVar[str] = "evaluations"

    method: Literal["DOP853", "RK45", "RK23", "Radau", "BDF", "LSODA"] = "DOP853"
    rtol: Positive = 1e-9
    atol: Positive = 1e-12
    block: Count | None = None
    max_steps: Count = 1_000_000

    @property
    def runs_per_block(self) -> int:
        """The nominal block: `block`, or the method's default."""
        return self.block or (EXPLICIT_BLOCK if self.method in EXPLICIT else 1)

    def check(self, problems: Problems) -> None:
        """A relative tolerance that SciPy cannot work with, or that asks for nothing."""
        if not SMALLEST_RTOL <= self.rtol < 1:
            limits = f"expected a number from {SMALLEST_RTOL:.3g} (SciPy's smallest) to 1"
            problems.at("rtol").add(f"{limits}, got {self.rtol:g}")

    def tightened(self, factor: float) -> SolveIvp:
        """Both tolerances times `factor`."""
        rtol = max(self.rtol * factor, SMALLEST_RTOL)
        return dataclasses.replace(self, rtol=rtol, atol=self.atol * factor)

    def work_for_stability(self, rates: Array, duration: float) -> float:
        """Evaluations: as many a step as the method has stages, if it is explicit."""
        if self.method not in EXPLICIT:
            return 0.0
        import scipy.integrate

        method = getattr(scipy.integrate, self.method)
        function = stability.runge_kutta(method.A, method.B)
        return int(method.n_stages) * stability.steps(function, rates, duration)

    def runs_at_once(self, most: int) -> int:
        """Whole blocks, so that the same runs share a block whatever the memory."""
        return max(1, most // self.runs_per_block) * self.runs_per_block

    def solve(self, problem: Problem, progress: Progress, workers: int = 1) -> Solution:
        """Integrate block by block; a block that fails is redone run by run."""
        solution = Solution.empty(problem)
        block = self.runs_per_block
        for start in range(0, problem.runs, block):
            runs = slice(start, min(start + block, problem.runs))
            part = self._solve_block(problem.select(runs), progress)
            if part is None:
                for run in range(runs.start, runs.stop):
                    one = slice(run, run + 1)
                    alone = self._solve_block(problem.select(one), lambda runs: None)
                    assert alone is not None  # a single run always has an outcome
                    solution.place(one, alone)
            else:
                solution.place(runs, part)
        return solution

    def rehearse(self, problem: Problem) -> None:
        """As any engine, but by a few steps: a motion that is too fast for them is no error."""
        brief = dataclasses.replace(self, max_steps=min(self.max_steps, REHEARSED_EVALUATIONS))
        Engine.rehearse(brief, problem)

    def _solve_block(self, block: Problem, progress: Progress) -> Solution | None:
        """The block's solution, or None where any of its runs fails in a block of several."""
        count = _Reporter(block, progress)
        solution = Solution.empty(block)
        try:
            solution.states[:] = self._integrate(block, count)
        except _Failed as failure:
            if block.runs > 1:
                return None
            known = self._until(block, failure.accepted)
            solution.states[:, : known.shape[1]] = known
            solution.status[:] = failure.status
            solution.messages[:] = [str(failure)]
        finally:
            count.finish()
        solution.steps[:] = count.evaluations
        return solution

    def _until(self, run: Problem, accepted: float) -> Array:
        """The samples of a run before it failed, which solve_ivp does not give up with it."""
        known = int(np.searchsorted(run.times, accepted, side="right"))
        shorter = dataclasses.replace(run, times=run.times[:known])
        # Its last step is cut to end at a sample, which may cost evaluations beyond the limit.
        patient = dataclasses.replace(self, max_steps=2 * self.max_steps)
        if known > 1:
            with suppress(_Failed):
                return patient._integrate(shorter, _Reporter(shorter, lambda runs: None))
        return run.states[:, None]

    def _integrate(self, block: Problem, count: _Reporter) -> Array:
        whole = block.batched_loop()
        state, found = block.states, []
        field = RecordedField(lambda held: whole.holding(held).vector_field)
        for span in block.spans:
            if span.tick is not None:
                with np.errstate(all="ignore"):  # a state that is not finite is found below
                    state = whole.after_instant(span.start, state, block.errors_at(span.tick))
            field.hold(whole.held(span.start))
            states = self._integrate_span(field, state, span, count)
            state = states[:, -1]
            found.append(states[:, span.wanted])
        return np.concatenate(found, axis=1) if len(found) > 1 else found[0]

    def _integrate_span(
        self, derivatives: RecordedField, state: Array, span: Span, count: _Reporter
    ) -> Array:
        from scipy.integrate import solve_ivp  # slow to import; readers of results do without

        shape, times = state.shape, span.grid
        # A span ends with a step, so without samples inside it nothing has to be interpolated.
        interpolated_at = times if len(times) > 2 else None
        # Where the field changes at an end, its value there may be that of the other side.
        first, last = (
            np.nextafter(end, towards) if changes else end
            for end, towards, changes in zip(
                (span.start, span.stop), (span.stop, span.start), span.changes, strict=True
            )
        )

        def field(t: float, y: Array) -> Array:
            count(t, self.max_steps)
            derivative: Array = derivatives(min(max(t, first), last), y.reshape(shape)).ravel()
            if not np.isfinite(derivative).all():
                count.non_finite_at = t
            return derivative

        def accepted(t: float, y: Array) -> float:
            # An event that never happens: solve_ivp looks at it at the end of every step.
            if not np.isfinite(y).all():
                count.non_finite_at = count.non_finite_at or t
                raise count.failure("")
            count.accept(t)
            return 1.0

        tighter = np.sqrt(self.runs_per_block)
        start, length = state.ravel(), float(times[-1] - times[0])
        first_step = min(GROWTH * count.longest_step, length) or None
        count.longest_step = 0.0
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # what they say is in the outcome
            # SciPy's step-size search does not end on a derivative that is not finite.
            if not np.isfinite(field(float(times[0]), start)).all():
                start_time = float(times[0])
                reason = "the vector field is not finite"
                raise _Failed(Status.NON_FINITE, start_time, reason, start_time)
            try:
                result = solve_ivp(
                    field,
                    (float(times[0]), float(times[-1])),
                    start,
                    method=self.method,
                    t_eval=interpolated_at,
                    events=accepted,
                    first_step=first_step,
                    rtol=max(self.rtol / tighter, SMALLEST_RTOL),
                    atol=self.atol / tighter,
                    **_jacobian_options(self.method, *shape),
                )
            except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
                raise count.failure(str(error)) from error
        if result.status != 0:
            raise count.failure(result.message)
        states = result.y if interpolated_at is not None else result.y[:, [0, -1]]
        return states.T.reshape(-1, *shape).swapaxes(0, 1)


class _Failed(Exception):
    """Why a block could not be integrated to its end, and the last time it reached."""

    def __init__(self, status: Status, t: float, reason: str, accepted: float) -> None:
        super().__init__(f"t = {t:.6g} s: {reason}")
        self.status, self.accepted = status, accepted


class _Reporter:
    """Counts evaluations of one block, and reports its progress by the time it has reached."""

    def __init__(self, block: Problem, progress: Progress) -> None:
        self.evaluations = 0
        self.non_finite_at: float | None = None
        self._progress, self._runs = progress, block.runs
        self._start, self._end = float(block.times[0]), float(block.times[-1])
        self._reported = 0.0
        self._reached = self._accepted = self._start
        self.longest_step = 0.0

    def __call__(self, t: float, limit: int) -> None:
        if self.evaluations >= limit:
            reason = f"step limit: {limit} evaluations (solver.max_steps)"
            raise self._failed(Status.STEP_LIMIT, self._accepted, reason)
        self.evaluations += 1
        self._reached = max(self._reached, t)
        fraction = (self._reached - self._start) / (self._end - self._start)
        if fraction - self._reported > 0.02:
            self._report(fraction)

    def accept(self, t: float) -> None:
        self.longest_step = max(self.longest_step, t - self._accepted)
        self._accepted = t
        self.non_finite_at = None  # a trial step that was refused is no failure

    def finish(self) -> None:
        self._report(1.0)

    def failure(self, reason: str) -> _Failed:
        if self.non_finite_at is not None:
            reason = "the state or its derivative is no longer finite"
            return self._failed(Status.NON_FINITE, self.non_finite_at, reason)
        return self._failed(Status.SOLVER_FAILED, self._accepted, reason.rstrip("."))

    def _failed(self, status: Status, t: float, reason: str) -> _Failed:
        return _Failed(status, t, reason, self._accepted)

    def _report(self, fraction: float) -> None:
        self._progress((fraction - self._reported) * self._runs)
        self._reported = fraction


def _jacobian_options(method: str, runs: int, n: int) -> dict[str, Any]:
    """The runs of a block do not act on each other, which implicit methods can use."""
    if runs == 1:
        return {}
    if method in ("Radau", "BDF"):
        import scipy.sparse

        ones = np.ones((n, n))
        return {"jac_sparsity": scipy.sparse.block_diag([ones] * runs, format="csc")}
    if method == "LSODA":
        return {"lband": n - 1, "uband": n - 1}
    return {}
