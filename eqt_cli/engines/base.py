"""What an engine is: it says how runs are integrated through a span; the walk is shared."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.component import Component
from eqt_cli.core.over_time import OverTime, Samples
from eqt_cli.core.problems import Problems
from eqt_cli.engines.integrator import Integrator
from eqt_cli.engines.problem import Problem, Progress, Solution, Span
from eqt_cli.engines.walk import walked

REHEARSED = 1e-9
"""Of the horizon: an engine goes so far in one step or two."""

SampledFunction = Callable[..., dict[str, Array]]
"""Arrays by name, of a loop, a time and rows of numbers, the first of which is a flat state.

It is written in operations that laws may use; equal functions give the same arrays.
"""

Reduction = Callable[[OverTime, Mapping[str, Any]], Mapping[str, Any]]
"""Numbers of a run by name, from its samples and the arrays of a `SampledFunction`.

Equal ones give the same numbers.
"""


@dataclass(frozen=True)
class Measured:
    """A solution, and what has been measured of it.

    Attributes
    ----------
    solution
        Its states may be left out where they are not asked for.
    numbers : (runs,) each
        By name.
    arrays : (runs, samples, …) each
        Those that are asked for, by name.
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
    """Up to how many threads are as fast as so many processes, which take a second to start."""
    calls_laws: ClassVar[bool] = True
    """Whether it calls a law as it is, at any time, rather than compile it."""
    cross_check_rank: ClassVar[int | None] = None
    """Of engines that can redo the runs of another, the lowest does; None if it does not."""
    part_runs: ClassVar[int] = 50
    """About how many runs make a part: enough to outweigh a file, few enough to lose."""
    counted: ClassVar[str] = "steps"
    """What its solutions count as its work."""
    rtol: float
    """The accuracy that the results are judged by."""

    @classmethod
    def unavailable(cls) -> str | None:
        """Why it cannot be used on this machine and how to change that; None where it can."""
        return None

    @abstractmethod
    def integrator(self, problem: Problem) -> Integrator:
        """What integrates runs of a problem through one span after the other."""

    @final
    def solve(
        self, problem: Problem, workers: int = 1, progress: Progress = lambda runs: None
    ) -> Solution:
        """Integrate every run; a run that fails gets a status and harms no other.

        `workers` bounds the threads of an engine that can use several; it never changes a result.
        `progress` is called with how many more runs are done, in fractions.
        """
        threads = workers if self.threads else 1
        spans = self.spans(problem)
        groups = self.groups(problem, spans, threads)
        return walked(self.integrator(problem), spans, groups, progress, threads)

    def spans(self, problem: Problem) -> list[Span]:
        """The horizon, cut wherever all runs have to end a step."""
        return problem.spans

    def groups(self, problem: Problem, spans: list[Span], threads: int) -> list[Array]:
        """The runs that an integrator has in hand at a time; it never changes a result."""
        return [np.arange(problem.runs)]

    def rehearse(self, problem: Problem) -> None:
        """Raise what `solve` would raise at its start, at little cost; nothing is kept of it."""
        start, stop = problem.times[[0, -1]]
        little = np.array([start, start + REHEARSED * (stop - start)])
        self.solve(replace(problem, times=little))

    def blocks(self, problem: Problem, threads: int = 1) -> list[Array]:
        """The runs that threads best solve and evaluate together; it never changes a result."""
        return [np.arange(problem.runs)]

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array]:
        """Arrays that follow from loop, time and rows of numbers, at every sample of every run.

        Parameters
        ----------
        rows : (runs, samples, n) each
            Flat states, and whatever else the function takes; (samples, n) where all runs share it.

        Returns
        -------
        dict
            ``(runs, samples, …)`` each, by name.
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
        """The solution, with numbers of each run that follow from arrays at every sample.

        Parameters
        ----------
        rows : (runs, samples, n) or (samples, n) each
            What the function takes behind the states.
        kept
            The arrays that are returned; None for all of them, and the states.
        """
        solution = self.solve(problem, workers, progress)
        with np.errstate(all="ignore"):  # runs that failed are NaN, or large
            found = self.evaluate(function, problem, solution.states, *rows)
            numbers = dict(reduction(Samples(problem.times), found))
        return Measured(solution, numbers, found)

    def work_for_stability(self, rates: Array, duration: float) -> float:
        """What it takes of `counted` so that no decaying error grows; 0 where it has no such limit.

        Parameters
        ----------
        rates : (instants, n)
            The eigenvalues of the linearised loop at instants spread over the duration, 1/s.
        """
        return 0.0

    @abstractmethod
    def tightened(self, factor: float) -> Engine:
        """The same engine with its tolerances multiplied by `factor` < 1."""

    def provenance(self) -> dict[str, str]:
        """What it uses of this machine, by name, such as a compiler; it affects no result."""
        return {}

    def sized(self, runs: int, state_length: int) -> Engine:
        """The engine for work of this size; settings that parts must agree on are fixed here."""
        return self

    def runs_at_once(self, most: int) -> int:
        """How many runs to give to one `solve`, near `most`; it must not change the results."""
        return max(1, most)

    def check(self, problems: Problems) -> None:
        """Note what is wrong with its options."""
