"""heyoka's batch Taylor integrator, compiled from the very laws that run on arrays.

The closed loop's vector field is traced once; the program that comes back is compiled, once for all
runs of a structure. Compiled code is kept on disk by heyoka itself.
"""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from eqt_cli.core.arrays import Array, norm
from eqt_cli.core.option_types import Count, Positive
from eqt_cli.core.problems import Problems
from eqt_cli.engines import stability
from eqt_cli.engines.base import (
    Engine,
    Problem,
    Progress,
    SampledFunction,
    Solution,
    Status,
)
from eqt_cli.engines.taylor.compiling import once
from eqt_cli.engines.taylor.evaluation import compiled_function
from eqt_cli.engines.taylor.integrator import BatchIntegrator, compiled, own
from eqt_cli.engines.taylor.knots import Course, following, held_rows, passes_knots, spans_of
from eqt_cli.engines.taylor.library import heyoka_module, missing
from eqt_cli.engines.traced_loop import OneLoop, parameter_rows, programs, sampled, trace

EPSILON = float(np.finfo(float).eps)
SMALLEST_TOL = 10 * EPSILON
"""A tenth of it, for the error estimate, is still a tolerance that doubles can meet."""

FULL_CODE_RUNS = 500
FULL_CODE_STATES = 30
MUCH_WORK_RUNS = 10_000
"""Full (not compact) code runs twice as fast and takes 1 s to compile for 25 states, 3.5 s for 37,
7 s for 49: worth it for 500 runs of a small system, or for 10,000 of any (benchmarks/)."""

BLOCK_BYTES = 4 * 2**20
"""Size of the states of a block: measured, half or twice as much takes a tenth longer. With all
that follows from them they fit a cache of some 10 MiB."""


@dataclass(frozen=True)
class Taylor(Engine):
    """heyoka's adaptive Taylor method, compiled: thousands of times a plain solve_ivp loop.

    Attributes
    ----------
    tol
        Tolerance of a step. Default: rtol / 10.
    rtol
        The accuracy that the results are judged by.
    max_steps
        Most steps that a run may take.
    code
        Generated code: ``full`` runs twice as fast as ``compact`` and takes longer to compile.
    """

    name: ClassVar[str] = "taylor"
    estimates_errors: ClassVar[bool] = True
    threads: ClassVar[bool] = True
    cross_check_rank: ClassVar[int | None] = 2
    part_runs: ClassVar[int] = 500

    tol: Positive | None = None
    rtol: Positive = 1e-9
    max_steps: Count = 100_000
    code: Literal["auto", "full", "compact"] = "auto"

    @classmethod
    def unavailable(cls) -> str | None:
        """Where heyoka is not installed: how to get it."""
        return missing()

    @property
    def step_tolerance(self) -> float:
        """`tol`, or its default."""
        return self.rtol / 10 if self.tol is None else self.tol

    def check(self, problems: Problems) -> None:
        """A tolerance that doubles cannot meet, or that asks for nothing."""
        if self.tol is None:
            key, value, smallest = "rtol", self.rtol, 10 * SMALLEST_TOL
        else:
            key, value, smallest = "tol", self.tol, SMALLEST_TOL
        if not smallest <= value < 1:
            problems.at(key).add(f"expected a number from {smallest:.3g} to 1, got {value:g}")

    def tightened(self, factor: float) -> Taylor:
        """The step tolerance times `factor`."""
        tol = max(self.step_tolerance * factor, EPSILON)
        return dataclasses.replace(self, tol=tol)

    def work_for_stability(self, rates: Array, duration: float) -> float:
        """Steps: a step is a Taylor polynomial of heyoka's order, −½ ln(tol) + 1."""
        order = max(2, int(np.ceil(1 - np.log(self.step_tolerance) / 2)))
        return stability.steps(stability.taylor(order), rates, duration)

    def sized(self, runs: int, state_length: int) -> Taylor:
        """With `code` decided by the size of the whole work, so that no part decides otherwise."""
        if self.code != "auto":
            return self
        small = state_length <= FULL_CODE_STATES and runs >= FULL_CODE_RUNS
        full = small or runs >= MUCH_WORK_RUNS
        return dataclasses.replace(self, code="full" if full else "compact")

    def solve(self, problem: Problem, progress: Progress, workers: int = 1) -> Solution:
        """Integrate in batches of SIMD lanes; each worker thread owns an integrator.

        A lane's steps depend on its own run only, so the results do not depend on the neighbours,
        the order or the number of threads.
        """
        law, knotted = programs(OneLoop(problem.loop)), passes_knots(problem.loop)
        shared = once(compiled, law, knotted, self.step_tolerance, self.code != "full")
        parameters = parameter_rows(problem)
        solution = Solution.unfilled(problem)
        lanes = shared.lanes
        course = Course.of(problem)
        groups = iter(_groups(problem, course, lanes, workers))
        lock = threading.Lock()

        def report(runs: float) -> None:
            with lock:
                progress(runs)

        def work() -> None:
            integrator = own(shared, threading.get_ident())
            while True:
                with lock:
                    runs = next(groups, None)
                if runs is None:
                    return
                self._solve_group(integrator, problem, course, parameters, runs, solution, report)

        if workers == 1:
            work()
        else:
            _in_threads(work, min(workers, -(-problem.runs // lanes)), groups, lock)
        return solution

    def rehearse(self, problem: Problem) -> None:
        """Trace the law, which is what can fail, without compiling it, which takes seconds."""
        trace(problem.loop)

    def blocks(self, problem: Problem) -> list[Array]:
        """Runs of about the same number of steps, and as many as fit a cache with all they give.

        Of a work that is not large, or a law that waits for instants, all runs at once.
        """
        if self.code != "full" or len(spans_of(problem)) > 1:
            return super().blocks(problem)
        lanes = heyoka_module().recommended_simd_size()
        fitting = BLOCK_BYTES // (8 * len(problem.times) * problem.loop.state_length)
        size = lanes * max(1, fitting // lanes)
        runs = _by_speed(problem)
        return [np.sort(runs[start : start + size]) for start in range(0, problem.runs, size)]

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array]:
        """Compiled as the law is where the work is large, by `sized`; else on arrays."""
        program = None
        if self.code == "full":
            lengths = tuple(row.shape[-1] for row in rows)
            program = sampled(function, OneLoop(problem.loop), lengths)
        if program is None:
            return super().evaluate(function, problem, *rows)
        found = compiled_function(program, threading.get_ident())
        held = held_rows(problem.loop, problem.times)
        return found.at_samples(problem.times, rows, parameter_rows(problem), held)

    def _solve_group(
        self,
        integrator: BatchIntegrator,
        problem: Problem,
        course: Course,
        parameters: Array,
        runs: Array,
        solution: Solution,
        progress: Progress,
    ) -> None:
        """Integrate runs from one known instant to the next, all of them before any goes on.

        So a sampled law is evaluated for all at once. As many runs as there are lanes make a
        batch; the last run fills the lanes that are left over.
        """
        lanes, count = integrator.lanes, len(runs)
        padded = np.append(runs, np.full(-count % lanes, runs[-1]))
        states, own = problem.states[padded].T, parameters[padded].T
        steps, first = np.zeros(len(padded), dtype=int), 0
        going = [slice(start, start + lanes) for start in range(0, len(padded), lanes)]
        failed, success = [], heyoka_module().taylor_outcome.time_limit
        following.set(course)
        for span in course.spans:
            numbers = _with_same(own, course.rows[span.start])
            if span.tick is not None:
                errors = problem.errors_at(span.tick, padded)
                states = integrator.at_instant(span.start, states, numbers, errors)
            samples = slice(first, first + span.samples)
            first = samples.stop
            if span.wanted[0] and not span.later:
                solution.states[runs, samples.start] = states[:, :count].T
            for batch in list(going):
                rows, left = runs[batch], self.max_steps - int(steps[batch].max())
                ends, states[:, batch], found = integrator.go(
                    span, states[:, batch], numbers[:, batch], left
                )
                if span.later:
                    solution.states[rows, samples] = found[:, :, : len(rows)].transpose(2, 0, 1)
                steps[batch] += [end[3] for end in ends]
                bad = next((end[0] for end in ends if end[0] != success), None)
                if span is course.spans[-1] and not np.isfinite(states[:, batch]).all():
                    bad = bad or success
                if bad is None:
                    continue
                if count == 1:
                    solution.states[runs, first:] = np.nan
                    solution.steps[runs] = steps[:1]
                    self._note_failure(integrator, problem, solution, int(runs[0]), bad)
                    return
                going.remove(batch)
                failed.append(batch)
            progress(count / len(course.spans))
        solution.steps[runs] = steps[:count]
        # heyoka stops all lanes when one fails; alone, each run ends in its own way.
        for run in np.concatenate([runs[batch] for batch in failed]) if failed else ():
            alone = np.array([run])
            self._solve_group(
                integrator, problem, course, parameters, alone, solution, lambda runs: None
            )

    def _note_failure(
        self, integrator: BatchIntegrator, problem: Problem, solution: Solution, run: int, end: Any
    ) -> None:
        """Say how the run in all lanes has ended, and when."""
        outcomes, times = heyoka_module().taylor_outcome, problem.times
        states = solution.states[run]
        t = integrator.heyoka.time[0]
        states[0] = problem.states[run]  # heyoka has no samples of a first step that failed
        if end == outcomes.cb_stop:
            t -= integrator.heyoka.last_h[0]  # the last step went wrong
            states[times > t] = np.nan
        at = f"t = {t:.6g} s"
        if np.isnan(t):
            at = f"after t = {times[np.isfinite(states).all(axis=1)][-1]:.6g} s"
        if end == outcomes.step_limit:
            status = Status.STEP_LIMIT
            reason = f"step limit: {self.max_steps} steps (solver.max_steps)"
        elif end == outcomes.cb_stop:
            status = Status.SOLVER_FAILED
            reason = "a comparison in the law has no finite series here; try engine solve_ivp"
        elif end in (outcomes.err_nf_state, outcomes.time_limit):
            status = Status.NON_FINITE
            reason = "the state or its derivative is no longer finite"
        else:
            status = Status.SOLVER_FAILED
            reason = "the law switches back and forth without end; smooth it, as with tanh"
        solution.status[run] = status
        solution.messages[run] = f"{at}: {reason}"


def _by_speed(problem: Problem) -> Array:
    """The runs in an order in which neighbours take about the same number of steps.

    A batch ends with the slowest of its runs; the faster a motion begins, the more steps it takes.
    """
    return np.argsort(norm(problem.states), kind="stable")


def _groups(problem: Problem, course: Course, lanes: int, threads: int) -> list[Array]:
    """The runs that go together: a batch, or a thread's share where the law waits for instants."""
    runs = _by_speed(problem)
    batches = -(-problem.runs // lanes)
    size = lanes if len(course.spans) == 1 else lanes * -(-batches // threads)
    return [runs[start : start + size] for start in range(0, problem.runs, size)]


def _with_same(values: Array, same: Array) -> Array:
    """Rows of numbers of every run, and behind them those that are the same in all."""
    if not len(same):
        return values
    return np.concatenate([values, np.repeat(same[:, None], values.shape[1], axis=1)])


def _in_threads(work: Any, threads: int, groups: Iterator[Array], lock: threading.Lock) -> None:
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(work) for _ in range(threads)]
        try:
            for future in futures:
                future.result()
        except BaseException:
            with lock:
                for _ in groups:  # nothing further is begun; what is under way ends
                    pass
            raise
