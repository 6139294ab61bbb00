"""What an engine is given and what it returns; it knows no group and no controller."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.core.component import Component
from eqt_cli.core.problems import Problems

ROUNDING = 1e-12
"""Relative: what times that are meant to be equal, as 3·0.1 and 0.3, may differ by."""

REHEARSED = 1e-9
"""Of the horizon: an engine goes so far in one step or two."""


class Status(IntEnum):
    """How one run ended; 0 is the only good end."""

    OK = 0
    SOLVER_FAILED = 1
    NON_FINITE = 2
    STEP_LIMIT = 3
    ACCURACY = 4
    WORKER_LOST = 5


@dataclass(frozen=True)
class Span:
    """From one instant at which the vector field changes to the next.

    Attributes
    ----------
    start, stop
        Its ends, s.
    changes
        Whether the field changes at `start`, and at `stop`.
    grid
        Both ends, and the sample times between them.
    wanted
        Which entries of `grid` are sample times of this span.
    tick
        k, where a sampled law is evaluated for the k-th time at `start`; else None.
    """

    start: float
    stop: float
    changes: tuple[bool, bool]
    grid: Array
    wanted: Array
    tick: int | None = None

    @cached_property
    def samples(self) -> int:
        """How many sample times it has."""
        return int(np.count_nonzero(self.wanted))

    @cached_property
    def later(self) -> int:
        """How many of them are behind its start."""
        return self.samples - int(self.wanted[0])


@dataclass(frozen=True)
class Problem:
    """Many runs of one closed loop, from their own initial states, on a common time grid.

    Attributes
    ----------
    loop
        The structure, with the parameters that all runs share.
    states : (runs, n)
        Initial flat states.
    times : (samples,)
        Where the solution is wanted, s; the first is the initial time.
    varying
        Parameters that differ from run to run, by name, ``(runs, …)``.
    errors
        Those of the measured pose and velocity at every control instant, ``(runs, instants, d, d)``
        and ``(runs, instants, m)``; None where the law is told the truth.
    """

    loop: ClosedLoop
    states: Array
    times: Array
    varying: Mapping[str, Array] = field(default_factory=dict)
    errors: tuple[Array, Array] | None = None

    @property
    def runs(self) -> int:
        """The number of runs."""
        return len(self.states)

    @cached_property
    def spans(self) -> list[Span]:
        """The horizon, cut at the instants that are known in advance."""
        return self.spans_between(self.loop.instants)

    def spans_between(self, instants: Array) -> list[Span]:
        """The horizon, cut at these instants and where a sampled law is evaluated."""
        start, stop = float(self.times[0]), float(self.times[-1])
        ticks = self._control_instants(start, stop)
        known = _nearest(instants, np.array([*self.times, *ticks]))
        inner = np.unique([t for t in (*known, *ticks) if start < t < stop])
        ends = np.array([start, *inner, stop])
        # A sample at an instant is of the span behind it, and the last one of the last.
        first = np.append(np.searchsorted(self.times, ends[:-1]), len(self.times))
        found = []
        for index, (one, other) in enumerate(pairwise(ends.tolist())):
            inside = self.times[first[index] : first[index + 1]]
            parts = [one], inside[inside > one], [other] if other not in inside[-1:] else []
            grid = np.concatenate(parts)
            wanted = np.isin(grid, inside)
            found.append(
                Span(one, other, (one != start, other != stop), grid, wanted, ticks.get(one))
            )
        return found

    @property
    def control_instants(self) -> int:
        """How many control instants there are."""
        return len(self._control_instants(float(self.times[0]), float(self.times[-1])))

    def _control_instants(self, start: float, stop: float) -> dict[float, int]:
        """The instants t = k·period from the start to before the end, and their k."""
        control = self.loop.vehicle.control
        if control is None:
            return {}
        numbers = np.arange(np.ceil(start / control.period), np.ceil(stop / control.period) + 1)
        times = _nearest(numbers * control.period, self.times)
        found = zip(times.tolist(), numbers.astype(int).tolist(), strict=True)
        return {t: k for t, k in found if start <= t < stop}

    def select(self, runs: slice | Array) -> Problem:
        """The same problem for some of its runs."""
        varying = {name: values[runs] for name, values in self.varying.items()}
        errors = None if self.errors is None else (self.errors[0][runs], self.errors[1][runs])
        return Problem(self.loop, self.states[runs], self.times, varying, errors)

    def errors_at(self, tick: int, runs: slice | Array = slice(None)) -> tuple[Array, Array] | None:
        """The errors of measurement at a control instant, in these runs."""
        if self.errors is None:
            return None
        pose, velocity = self.errors
        return pose[runs, tick], velocity[runs, tick]

    @staticmethod
    def joined(problems: Sequence[Problem]) -> Problem:
        """The runs of several problems as one; their loops have the same structure and times."""
        first = problems[0]
        parameters = [
            {
                name: problem.varying.get(name, np.broadcast_to(shared, (runs, *shared.shape)))
                for name, shared in problem.loop.parameters.items()
            }
            for problem in problems
            for runs in [problem.runs]
        ]
        varying = {name: np.concatenate([p[name] for p in parameters]) for name in parameters[0]}
        states = np.concatenate([problem.states for problem in problems])
        pairs = [problem.errors for problem in problems if problem.errors is not None]
        errors: Any = tuple(map(np.concatenate, zip(*pairs, strict=True))) or None
        return Problem(first.loop, states, first.times, varying, errors)

    def batched_loop(self, extra_axes: int = 0) -> ClosedLoop:
        """The loop with its varying parameters along a leading run axis.

        `extra_axes` axes are inserted behind it, for states ``(runs, samples, n)``.
        """
        if not self.varying:
            return self.loop
        expanded = {
            name: values.reshape(self.runs, *(1,) * extra_axes, *values.shape[1:])
            for name, values in self.varying.items()
        }
        return self.loop.with_parameters(self.loop.parameters | expanded)


def _nearest(instants: Array, times: Array) -> Array:
    """The instants, those that are one of some times but for rounding as that time."""
    if not len(instants):
        return instants
    ordered = np.sort(times)
    above = np.clip(np.searchsorted(ordered, instants), 1, len(ordered) - 1)
    low, high = ordered[above - 1], ordered[above]
    nearest = np.where(instants - low < high - instants, low, high)
    near = np.abs(nearest - instants) <= ROUNDING * np.maximum(1.0, np.abs(instants))
    return np.where(near, nearest, instants)


@dataclass(frozen=True)
class Solution:
    """What became of every run of a problem.

    Attributes
    ----------
    states : (runs, samples, n)
        Flat states at the sample times; NaN from where a run failed.
    status : (runs,)
        `Status` of each run.
    steps : (runs,)
        What the engine counts as its work.
    messages
        Why a run failed; empty where it did not.
    """

    states: Array
    status: Array
    steps: Array
    messages: list[str]

    @staticmethod
    def empty(problem: Problem) -> Solution:
        """A solution to be filled in, run by run."""
        solution = Solution.unfilled(problem)
        solution.states[:] = np.nan
        return solution

    @staticmethod
    def unfilled(problem: Problem) -> Solution:
        """Like `empty`, for an engine that writes every sample: memory is first touched then."""
        runs, n = problem.states.shape
        states = np.empty((runs, len(problem.times), n))
        steps = np.zeros(runs, dtype=np.int64)
        return Solution(states, np.zeros(runs, dtype=np.int32), steps, [""] * runs)

    def place(self, runs: slice, part: Solution) -> None:
        """Fill in the solution of some of the runs."""
        self.states[runs] = part.states
        self.status[runs] = part.status
        self.steps[runs] = part.steps
        self.messages[runs] = part.messages


Progress = Callable[[float], None]
"""Called now and then with the number of runs done since the last call, in fractions of a run."""


SampledFunction = Callable[..., dict[str, Array]]
"""Arrays by name, of a loop, a time and rows of numbers, the first of which is a flat state.

It is written in operations that laws may use; equal functions give the same arrays.
"""


@dataclass(frozen=True)
class Engine(Component):
    """An integrator: a frozen dataclass whose fields are its keys in `solver`."""

    estimates_errors: ClassVar[bool] = False
    """Whether a second, tighter solve is cheap enough to estimate every run's error by default."""
    threads: ClassVar[bool] = False
    """Whether it computes outside Python, so that threads of one process use several cores."""
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
    def solve(self, problem: Problem, progress: Progress, workers: int = 1) -> Solution:
        """Integrate every run; a run that fails gets a status and harms no other.

        `workers` bounds the threads of an engine that can use several; it never changes a result.
        """

    def rehearse(self, problem: Problem) -> None:
        """Raise what `solve` would raise at its start, at little cost; nothing is kept of it."""
        start, stop = problem.times[[0, -1]]
        little = np.array([start, start + REHEARSED * (stop - start)])
        self.solve(replace(problem, times=little), lambda runs: None)

    def blocks(self, problem: Problem) -> list[Array]:
        """The runs that are best solved and evaluated together; it never changes a result."""
        return [np.arange(problem.runs)]

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array]:
        """Arrays that follow from loop, time and rows of numbers, at every sample of every run.

        Parameters
        ----------
        rows : (runs, samples, n) each
            Flat states, and whatever else the function takes.

        Returns
        -------
        dict
            ``(runs, samples, …)`` each, by name.
        """
        return function(problem.batched_loop(extra_axes=1), problem.times, *rows)

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

    def sized(self, runs: int, state_length: int) -> Engine:
        """The engine for work of this size; settings that parts must agree on are fixed here."""
        return self

    def runs_at_once(self, most: int) -> int:
        """How many runs to give to one `solve`, near `most`; it must not change the results."""
        return max(1, most)

    def check(self, problems: Problems) -> None:
        """Note what is wrong with its options."""
