"""The base class of engines: each integrates runs through a span; the walk is shared."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.over_time import SampledRuns
from eqt_cli.core.registry import Component
from eqt_cli.engines.problem import Problem, Progress, Solution
from eqt_cli.engines.walk import Integrator, walked

REHEARSED = 1e-9
"""Fraction of the horizon that a rehearsal covers: one step or two of an engine."""

SampledFunction = Callable[..., dict[str, Array]]
"""A function of a loop, a time and rows of numbers, the first a flat state, to arrays by name.

It is written in operations that laws may use; equal functions give the same arrays.
"""

Reduction = Callable[[SampledRuns, Mapping[str, Any]], Mapping[str, Any]]
"""A function of a run's samples and the arrays of a `SampledFunction` to numbers by name.

Equal reductions give the same numbers.
"""


@dataclass(frozen=True)
class Measured:
    """A solution, with numbers and arrays that follow from it.

    Attributes
    ----------
    solution
        The solution; its states may be left out if they are not asked for.
    numbers : (runs,) each
        Numbers of each run, by name.
    arrays : (runs, samples, …) each
        Requested arrays, by name.
    """

    solution: Solution
    numbers: dict[str, Array]
    arrays: dict[str, Array]


@dataclass(frozen=True)
class Engine(Component):
    """An integrator: a frozen dataclass whose fields are its keys in `solver`."""

    estimates_errors: ClassVar[bool] = False
    """Whether a second, tighter solve is cheap enough to estimate every run's error by default."""
    threads: ClassVar[bool] = False
    """Whether it computes outside Python, so that threads of one process use several cores."""
    as_fast_in_threads: ClassVar[int] = 1
    """Largest number of threads as fast as that many processes, which take a second to start."""
    calls_laws: ClassVar[bool] = True
    """Whether it calls a law as Python, at any time, rather than compile it."""
    part_runs: ClassVar[int] = 50
    """Approximate number of runs in a part: enough to outweigh a file, few enough to lose."""
    counted: ClassVar[str] = "steps"
    """The unit of work that its solutions count."""
    rtol: float
    """The accuracy that the results are judged by."""

    @classmethod
    def unavailable(cls) -> str | None:
        """Return why it cannot be used on this machine, and the remedy; None if it can."""
        return None

    @abstractmethod
    def integrator(self, problem: Problem) -> Integrator:
        """Return the integrator of a problem's runs, span by span."""

    @final
    def solve(
        self, problem: Problem, workers: int = 1, progress: Progress = lambda runs: None
    ) -> Solution:
        """Integrate every run; a run that fails gets a status and harms no other.

        `workers` bounds the threads of an engine that can use several; it never changes a result.
        `progress` is called with the number of further runs done, in fractions. What it raises ends
        the solve.
        """
        threads = workers if self.threads else 1
        groups = self.groups(problem, threads)
        return walked(self.integrator(problem), groups, progress, threads)

    def groups(self, problem: Problem, threads: int) -> list[Array]:
        """Return the groups of runs integrated at a time; they never change a result."""
        return [np.arange(problem.runs)]

    def rehearse(self, problem: Problem) -> None:
        """Raise what `solve` would raise at its start, at little cost; no result is kept."""
        start, stop = problem.times[[0, -1]]
        little = np.array([start, start + REHEARSED * (stop - start)])
        self.solve(replace(problem, times=little))

    def blocks(self, problem: Problem, threads: int = 1) -> list[Array]:
        """Return the runs best solved and evaluated together; they never change a result."""
        return [np.arange(problem.runs)]

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array]:
        """Evaluate a function of loop, time and rows of numbers, at every sample of every run.

        Parameters
        ----------
        rows : (runs, samples, n) each
            Flat states, and further rows that the function takes; (samples, n) if runs share them.

        Returns
        -------
        dict
            Arrays by name, ``(runs, samples, …)`` each.
        """
        return function(problem.batched_loop(extra_axes=1), problem.times, *rows)

    def measured(
        self,
        function: SampledFunction,
        reduction: Reduction,
        problem: Problem,
        rows: Sequence[Array],
        kept: Sequence[str] | None,
        workers: int = 1,
        progress: Progress = lambda runs: None,
    ) -> Measured:
        """Solve, and compute numbers of each run from arrays at every sample.

        Parameters
        ----------
        rows : (runs, samples, n) or (samples, n) each
            Rows that the function takes after the states.
        kept
            The arrays to return; None for all of them, and the states.
        """
        solution = self.solve(problem, workers, progress)
        with np.errstate(all="ignore"):  # runs that failed are NaN, or large
            found = self.evaluate(function, problem, solution.states, *rows)
            numbers = dict(reduction(SampledRuns(problem.times), found))
        return Measured(solution, numbers, found)

    def work_for_stability(self, rates: Array, duration: float) -> float:
        """Return the work, as `counted`, at which no decaying error grows; 0 if there is no limit.

        Parameters
        ----------
        rates : (instants, n)
            The eigenvalues of the linearised loop at instants spread over the duration, 1/s.
        """
        return 0.0

    @abstractmethod
    def tightened(self, factor: float) -> Engine:
        """Return the engine with its tolerances multiplied by `factor` < 1."""

    def provenance(self) -> dict[str, str]:
        """Return the tools of this machine that it uses, by name; no result depends on them."""
        return {}

    def runs_at_once(self, most: int) -> int:
        """Return the number of runs for one `solve`, near `most`; it must not change results."""
        return max(1, most)

    def check(self, problems: Problems) -> None:
        """Note problems of its options."""
