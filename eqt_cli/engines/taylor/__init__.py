"""heyoka's batch Taylor integrator, compiled from the same laws that run on arrays.

The closed loop's vector field is traced once; its program is compiled once for all runs of a
structure. heyoka itself keeps compiled code on disk.
"""

from __future__ import annotations

import dataclasses
import threading
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from eqt_cli.core.arrays import Array, norm
from eqt_cli.core.option_types import Count, Positive, Scale
from eqt_cli.core.problems import Problems
from eqt_cli.engines import stability
from eqt_cli.engines.base import Engine, SampledFunction
from eqt_cli.engines.problem import Problem, Span
from eqt_cli.engines.taylor.compiling import once
from eqt_cli.engines.taylor.evaluation import compiled_function
from eqt_cli.engines.taylor.integrator import Batches, compiled
from eqt_cli.engines.taylor.knots import passes_knots, spans_of
from eqt_cli.engines.taylor.library import heyoka_module, missing
from eqt_cli.engines.traced_loop import (
    OneLoop,
    held_rows,
    parameter_rows,
    programs,
    sampled,
    trace,
)

EPSILON = float(np.finfo(float).eps)
SMALLEST_TOL = 10 * EPSILON
"""Smallest `tol`: a tenth of it, for the error estimate, can still be met in doubles."""

FULL_CODE_RUNS = 500
FULL_CODE_STATES = 30
MUCH_WORK_RUNS = 10_000
"""Full (not compact) code runs twice as fast and takes 1 s to compile for 25 states, 3.5 s for 37,
7 s for 49: worth it for 500 runs of a small system, or for 10,000 of any (benchmarks/)."""

BLOCK_BYTES = 4 * 2**20
"""Size of the states of a block; half or twice as much took a tenth longer. With all that follows
from them they fit a cache of some 10 MiB."""


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
    calls_laws: ClassVar[bool] = False
    cross_check_rank: ClassVar[int | None] = 2
    part_runs: ClassVar[int] = 500

    tol: Positive | None = None
    rtol: Annotated[Positive, Scale("relative tolerance")] = 1e-9
    max_steps: Count = 100_000
    code: Literal["auto", "full", "compact"] = "auto"

    @classmethod
    def unavailable(cls) -> str | None:
        """Return how to install heyoka; None if it is installed."""
        return missing()

    @property
    def step_tolerance(self) -> float:
        """The tolerance of a step: `tol`, or its default."""
        return self.rtol / 10 if self.tol is None else self.tol

    def check(self, problems: Problems) -> None:
        """Note a tolerance that doubles cannot meet, or that is not below 1."""
        if self.tol is None:
            key, value, smallest = "rtol", self.rtol, 10 * SMALLEST_TOL
        else:
            key, value, smallest = "tol", self.tol, SMALLEST_TOL
        if not smallest <= value < 1:
            problems.at(key).add(f"expected a number from {smallest:.3g} to 1, got {value:g}")

    def tightened(self, factor: float) -> Taylor:
        """Return the engine with its step tolerance times `factor`."""
        tol = max(self.step_tolerance * factor, EPSILON)
        return dataclasses.replace(self, tol=tol)

    def work_for_stability(self, rates: Array, duration: float) -> float:
        """Return steps, each a Taylor polynomial of heyoka's order, −½ ln(tol) + 1."""
        order = max(2, int(np.ceil(1 - np.log(self.step_tolerance) / 2)))
        return stability.steps(stability.taylor(order), rates, duration)

    def sized(self, runs: int, state_length: int) -> Taylor:
        """Return the engine with `code` set by the size of the whole work, alike for all parts."""
        if self.code != "auto":
            return self
        small = state_length <= FULL_CODE_STATES and runs >= FULL_CODE_RUNS
        full = small or runs >= MUCH_WORK_RUNS
        return dataclasses.replace(self, code="full" if full else "compact")

    def integrator(self, problem: Problem) -> Batches:
        """Return the integrator of batches of SIMD lanes.

        A lane's steps depend on its own run only, so results do not depend on the neighbours, the
        order or the number of threads.
        """
        law, knotted = programs(OneLoop(problem.loop)), passes_knots(problem.loop)
        code = once(compiled, law, knotted, self.step_tolerance, self.code != "full")
        return Batches(problem, code, self.max_steps)

    def spans(self, problem: Problem) -> list[Span]:
        """Return the horizon, cut at all instants but the knots that batches pass."""
        return spans_of(problem)

    def groups(self, problem: Problem, spans: list[Span], threads: int) -> list[Array]:
        """Return batches, or a thread's share of the runs if there are several spans.

        A sampled law is then evaluated for all runs of the share at once.
        """
        lanes, runs = heyoka_module().recommended_simd_size(), _by_speed(problem)
        batches = -(-problem.runs // lanes)
        size = lanes if len(spans) == 1 else lanes * -(-batches // threads)
        return [runs[start : start + size] for start in range(0, problem.runs, size)]

    def rehearse(self, problem: Problem) -> None:
        """Trace the law, which may fail, without compiling it, which takes seconds."""
        trace(problem.loop)

    def blocks(self, problem: Problem, threads: int = 1) -> list[Array]:
        """Return blocks of runs of similar numbers of steps that fit a cache with their results.

        All runs are one block if the work is small, the horizon has several spans, or there are
        several threads.
        """
        if self.code != "full" or len(spans_of(problem)) > 1 or threads > 1:
            return super().blocks(problem)
        lanes = heyoka_module().recommended_simd_size()
        fitting = BLOCK_BYTES // (8 * len(problem.times) * problem.loop.state_length)
        size = lanes * max(1, fitting // lanes)
        runs = _by_speed(problem)
        return [np.sort(runs[start : start + size]) for start in range(0, problem.runs, size)]

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array]:
        """Evaluate by compiled code if the work is large, by `sized`; else on arrays."""
        program = None
        if self.code == "full":
            lengths = tuple(row.shape[-1] for row in rows)
            program = sampled(function, OneLoop(problem.loop), lengths)
        if program is None:
            return super().evaluate(function, problem, *rows)
        found = compiled_function(program, threading.get_ident())
        held = held_rows(problem.loop, problem.times)
        every = [np.broadcast_to(row, (problem.runs, *row.shape[-2:])) for row in rows]
        return found.at_samples(problem.times, every, parameter_rows(problem), held)


def _by_speed(problem: Problem) -> Array:
    """Return the runs ordered such that neighbours take about the same number of steps.

    A batch ends with its slowest run; the faster a motion begins, the more steps it takes.
    """
    return np.argsort(norm(problem.states), kind="stable")
