"""The base class of integrators, and their walk through the spans of a problem, group by group.

The walk evaluates sampled laws, fills in the samples, and records runs that fail.
It knows no engine.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, norm
from eqt_cli.engines.problem import Problem, Progress, Solution, Span, Status
from eqt_cli.vehicle.sensors.channels import Errors

NO_LONGER_FINITE = "the state or its derivative is no longer finite"


@dataclass(frozen=True)
class Failure:
    """The reason why a run ends before its horizon.

    Attributes
    ----------
    t
        Its time, s; NaN if only the last sample before it is known.
    """

    status: Status = Status.NON_FINITE
    reason: str = NO_LONGER_FINITE
    t: float = np.nan


@dataclass(frozen=True)
class SpanResult:
    """The results of some runs in a span.

    Attributes
    ----------
    states : (runs, n)
        States at its stop. A run whose state is not finite there has failed.
    samples : (runs, later, n)
        States at its sample times after its start; NaN from where a run failed.
    steps : (runs,)
        Work, as the engine counts it.
    failed
        The runs that end, by their index here, and why; None for a run that others may have
        stopped. It is integrated once more, alone.
    """

    states: Array
    samples: Array
    steps: Array | int
    failed: Mapping[int, Failure | None] = field(default_factory=dict)


class Integrator(ABC):
    """Integrates runs of a problem from span to span; it may keep data, such as step sizes.

    The walk calls `begin` for some runs, and then in every span `hold`, `at_instant` where a
    sampled law is evaluated at its start, and `advance`.

    Attributes
    ----------
    problem
        All runs.
    runs : (runs,)
        The current runs.
    loop
        Their closed loop, with their own parameters.
    vector_field
        Time derivatives of states ``(runs, n)`` at a time t of the current span.
    samples : (runs, samples, n) or None
        The samples of the current runs, to be filled in, if these runs are neighbours.
    reached
        May be called with a time that the runs have reached, to show progress.
    """

    runs: Array
    loop: ClosedLoop
    vector_field: Callable[[float, Array], Array]
    samples: Array | None
    reached: Callable[[float], None]

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def begin(self, runs: Array) -> None:
        """Begin these runs, at their initial states."""
        self.loop = self.problem.select(runs).batched_loop()

    def at_instant(self, t: float, states: Array, errors: Errors | None) -> Array:
        """Return the states after a control instant, with these measurement errors."""
        return self.loop.after_instant(t, states, errors)

    def hold(self, span: Span) -> None:
        """Set the numbers that the loop holds in a span."""
        loop = self.loop.holding(span.start)
        self.vector_field = lambda t, states: loop.vector_field(span.inside(t), states)

    def room(self, span: Span) -> Array:
        """Return an array for the samples of a span; what is written there need not be copied."""
        if self.samples is None:
            return np.empty((len(self.runs), span.later, self.problem.loop.moving_length))
        return self.samples[:, span.first : span.first + span.later]

    @abstractmethod
    def advance(self, span: Span, states: Array) -> SpanResult:
        """Integrate from the states at the start of a span, ``(runs, n)``, to its stop.

        Steps are chosen by the tolerance: no step ends at a sample for its sake. A run does not
        depend on its neighbours.
        """


INDEFINITE = (
    Status.ESTIMATE_LOST,
    "the covariance of the estimate is no longer positive definite; give the estimator larger "
    "deviations, or measurements more often",
)
"""Status and reason of a run whose covariance is no longer positive definite."""

MOST_TURNS = 100.0
"""Turns of a body within a control period beyond which no law can act on it."""

GROWN = 100.0
"""How many times as fast it must turn as it did at the start, and as the reference does."""

SUSPECT = 200
"""Steps in a control period beyond which it is asked how fast a body turns."""

DIVERGED = (
    Status.DIVERGED,
    f"the body turns more than {MOST_TURNS:g} times within a control period, so the loop diverges; "
    "shorten control.period, or lower the gains",
)
"""Status and reason of such a run, whose steps would become as many as its turns."""

REPORTED = 0.02
"""Smallest fraction of the horizon between two reports of progress."""

REPORT_EVERY = 0.2
"""Longest time between two reports of progress while a vector field is evaluated in Python, s."""


def walked(
    integrator: Integrator, groups: Sequence[Array], progress: Progress, threads: int
) -> Solution:
    """Return the solution of all groups of runs, by at most this number of threads."""
    solution = Solution.empty(integrator.problem)
    left, lock = iter(groups), threading.Lock()

    def report(runs: float) -> None:
        with lock:
            progress(runs)

    def work() -> None:
        mine = copy(integrator)  # for this thread
        with np.errstate(all="ignore"):  # a state that is not finite ends its run
            while True:
                with lock:
                    runs = next(left, None)
                if runs is None:
                    return
                _walk(mine, solution, runs, report)

    threads = min(threads, len(groups))
    if threads == 1:
        work()
        return solution
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(work) for _ in range(threads)]
        try:
            for future in futures:
                future.result()
        except BaseException:
            with lock:
                list(left)  # no further group is begun; current ones end
            raise
    return solution


def _walk(integrator: Integrator, solution: Solution, runs: Array, progress: Progress) -> None:
    """Fill in the solution of a group of runs."""
    problem, going = integrator.problem, np.ones(len(runs), dtype=bool)
    failed: dict[int, tuple[Span, Failure | None]] = {}
    steps: Any = 0
    states, solution.steps[runs] = problem.states[runs], 0
    neighbours = slice(int(runs[0]), int(runs[0]) + len(runs))
    together = bool((np.diff(runs) == 1).all())
    room = together and problem.loop.moving_length == states.shape[1]
    integrator.runs, integrator.samples = runs, solution.states[neighbours] if room else None
    integrator.reached = reached = _Reached(problem, len(runs), progress)
    integrator.begin(runs)
    for span in problem.spans:
        integrator.hold(span)
        states, ending = _at_instant(integrator, span, states, steps)
        if span.sampled_start:
            solution.states[runs, span.first - 1] = states
        if ending:
            failed = {place: (span, why) for place, why in ending.items()} | failed
            going[list(ending)] = False
            states = np.where(going[:, None], states, problem.states[runs])  # where steps are long
        result = _advanced(integrator, span, states, solution.states)
        states, steps = result.states, result.steps
        solution.steps[runs] += np.where(going, result.steps, 0) if failed else result.steps
        ended: dict[int, Failure | None] = dict(result.failed)
        if not np.isfinite(states).all():
            lost = np.flatnonzero(~np.isfinite(states).all(axis=1)).tolist()
            ended = {**dict.fromkeys(lost, Failure()), **ended}
        for place, failure in ended.items():
            failed.setdefault(place, (span, failure))
            going[place] = False
        if len(failed) == len(runs):
            break
        reached(span.stop)
    for place, (span, failure) in failed.items():
        if failure is None and len(runs) > 1:
            _walk(integrator, solution, runs[[place]], lambda runs: progress(0.0))
        else:
            _note(solution, problem, runs[place], span, failure or Failure())
    reached.finish()


def _at_instant(
    integrator: Integrator, span: Span, states: Array, steps: Any
) -> tuple[Array, dict[int, Failure]]:
    """Return the states after a control instant, if a span begins with one, and what ends there.

    Parameters
    ----------
    steps
        Those of the last control period.
    """
    if span.tick is None:
        return states, {}
    problem = integrator.problem
    errors = problem.errors_at(span.tick, integrator.runs)
    states, lost = integrator.at_instant(span.start, states, errors), {}
    if np.max(steps) > SUSPECT:
        lost = dict.fromkeys(np.flatnonzero(_diverged(integrator, span, states)).tolist(), DIVERGED)
    lost |= dict.fromkeys(np.flatnonzero(problem.loop.estimate_lost(states)).tolist(), INDEFINITE)
    return states, {place: Failure(*why, span.start) for place, why in lost.items()}


def _diverged(integrator: Integrator, span: Span, states: Array) -> Array:
    """Return which of the current runs turn too fast for their law, at a control instant."""
    problem = integrator.problem.select(integrator.runs)
    loop = problem.batched_loop()
    now = loop.tracking(span.start, states)
    start = loop.tracking(float(problem.times[0]), problem.states)
    turning = np.zeros(loop.group.dimension)
    for part in loop.group.parts:
        turning[part.axes] = part.turns
    rate, first, desired = (norm(turning * V) for V in (now.V, start.V, now.Vd))
    assert loop.vehicle.control is not None
    turns = loop.vehicle.control.period * rate / (2 * np.pi)
    return (turns > MOST_TURNS) & (rate > GROWN * np.maximum(first, desired))


def _advanced(integrator: Integrator, span: Span, states: Array, kept: Array) -> SpanResult:
    """Advance some runs through a span and store the samples; return whole states."""
    moving = integrator.problem.loop.moving_length
    later = slice(span.first, span.first + span.later)
    result, runs = integrator.advance(span, states[:, :moving]), integrator.runs
    if span.later and result.samples.base is not kept:
        kept[runs, later, :moving] = result.samples
    if moving == states.shape[1]:
        return result
    kept[runs, later, moving:] = states[:, None, moving:]
    return replace(result, states=np.concatenate([result.states, states[:, moving:]], axis=1))


def _note(solution: Solution, problem: Problem, run: int, span: Span, failure: Failure) -> None:
    """Note how a run has failed in a span, and erase its later samples."""
    states = solution.states[run]
    states[span.first + span.later :] = np.nan
    states[problem.times > failure.t] = np.nan
    lost = np.logical_or.accumulate(~np.isfinite(states).all(axis=1))
    states[lost] = np.nan
    at = f"t = {failure.t:.6g} s"
    if np.isnan(failure.t):
        known = problem.times[~lost]
        at = f"after t = {known[-1] if len(known) else problem.times[0]:.6g} s"
    law = problem.loop.controller if failure.status is Status.NON_FINITE else None
    reason = "; ".join(filter(None, [failure.reason, law.undefined if law else ""]))
    solution.status[run] = failure.status
    solution.messages[run] = f"{at}: {reason}"


class _Reached:
    """Reports the progress of some runs by the time they have reached."""

    def __init__(self, problem: Problem, runs: int, progress: Progress) -> None:
        self._start, self._end = problem.times[[0, -1]].tolist()
        self._runs, self._progress = runs, progress
        self._reported, self._due = 0.0, time.monotonic() + REPORT_EVERY

    def __call__(self, t: float) -> None:
        fraction = (t - self._start) / (self._end - self._start)
        if fraction - self._reported > REPORTED or time.monotonic() > self._due:
            self._report(max(fraction, self._reported))

    def finish(self) -> None:
        if self._reported < 1.0:
            self._report(1.0)

    def _report(self, fraction: float) -> None:
        self._progress((fraction - self._reported) * self._runs)
        self._reported, self._due = fraction, time.monotonic() + REPORT_EVERY
