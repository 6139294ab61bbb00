"""Engines, the initial value problems they solve, and the walk through the horizon."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, Protocol, final, runtime_checkable

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, distinct, norm
from eqt_cli.base.errors import EqtError, Problems
from eqt_cli.base.option_types import CountOrNone, Positive
from eqt_cli.base.registry import Component, Keys, Registry
from eqt_cli.base.stored import Status
from eqt_cli.components.laws import OuterLoop, RunsCode
from eqt_cli.components.sensors import Errors
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.leaves import leaves, with_leaves
from eqt_cli.numbers.running import SampledRuns

# How an engine computes ---------------------------------------------------------------------------


HURRIED: ContextVar[bool] = ContextVar("hurried", default=False)
"""Whether what is computed is so little that compiled code is used a few times only."""


@contextmanager
def hurried(wanted: bool = True) -> Iterator[None]:
    """Compile in half of the time code that takes 1.6 times as long; its numbers are the same."""
    token = HURRIED.set(wanted or HURRIED.get())
    try:
        yield
    finally:
        HURRIED.reset(token)


# The input and output of an engine; it knows no group and no controller ---------------------------


ROUNDING = 1e-12
"""Relative difference of times that are meant to be equal, such as 3·0.1 and 0.3."""


@dataclass(frozen=True)
class Span:
    """The time from one instant at which the vector field changes to the next.

    Attributes
    ----------
    start, stop
        Its ends, s.
    within
        Both ends, s; if the field changes at an end, the nearest time inside the span.
    grid
        Both ends, and the sample times between them.
    first
        Index of the first sample time of this span after `start`.
    later
        Number of its samples after `start`; their times are ``grid[1 : 1 + later]``.
    sampled_start
        Whether `start` is a sample time, too.
    tick
        Number k of the tick of a sampled loop at `start`; None if there is none.
    longest
        No step is longer, s.
    """

    start: float
    stop: float
    within: tuple[float, float]
    grid: Array
    first: int
    later: int
    sampled_start: bool
    tick: int | None = None
    longest: float = np.inf

    def inside(self, t: float) -> float:
        """Return t; at an end where the field changes, the nearest time inside the span."""
        return min(max(t, self.within[0]), self.within[1])

    def until(self, t: float) -> Span:
        """Return the span cut at its last sample that is not after t."""
        samples = int(np.searchsorted(self.grid[1 : 1 + self.later], t, side="right"))
        stop, within = float(self.grid[samples]), (self.within[0], float(self.grid[samples]))
        return replace(self, stop=stop, within=within, grid=self.grid[: 1 + samples], later=samples)


class ErrorsOfRuns(Protocol):
    """Sensor errors of many runs, ``(draws, instants, …)``: `Errors`, or what draws them."""

    def of(self, places: Array, /) -> Errors:
        """Return those of some draws."""


@dataclass(frozen=True)
class Problem:
    """Many runs of one closed loop, from their own initial states, on a common time grid.

    Attributes
    ----------
    loop
        The structure, with the numbers that all runs share.
    states : (runs, n)
        Initial flat states.
    times : (samples,)
        Sample times of the solution, s; the first is the initial time.
    varying
        Leaves of the loop that differ from run to run, by path, ``(runs, …)``.
    errors
        Sensor errors at every control instant, ``(draws, instants, …)``; None if the law is given
        the true state.
    draws : (runs,)
        Row of `errors` of each run; None: its own number.
    halved
        Whether no step is longer than half its span: where spans bound the steps of a solve,
        those of a tighter one would be the same.
    """

    loop: ClosedLoop
    states: Array
    times: Array
    varying: Arrays = field(default_factory=dict)
    errors: ErrorsOfRuns | None = None
    halved: bool = False
    draws: Array | None = None

    @property
    def runs(self) -> int:
        """The number of runs."""
        return len(self.states)

    @cached_property
    def spans(self) -> list[Span]:
        """The horizon, cut at the instants that are known in advance, and at control instants."""
        return self.spans_with(np.empty(0))

    def spans_with(self, times: Array) -> list[Span]:
        """Return the spans, cut at more times, too."""
        instants, control = self.loop.instants(float(self.times[-1])), self.loop.vehicle.control
        tick, instants = None if control is None else control.tick, distinct([*instants, *times])
        return _spans(self.times.tobytes(), instants.tobytes(), tick, self.halved)

    @cached_property
    def control_instants(self) -> int:
        """The number of ticks, at which law, sensors and actuators may act."""
        control = self.loop.vehicle.control
        return 0 if control is None else len(_control_instants(self.times, control.tick))

    def select(self, runs: slice | Array) -> Problem:
        """Return the problem for some of its runs."""
        varying = {name: values[runs] for name, values in self.varying.items()}
        return replace(self, states=self.states[runs], varying=varying, draws=self.rows[runs])

    @property
    def rows(self) -> Array:
        """Row of `errors` of each run."""
        return np.arange(self.runs) if self.draws is None else self.draws

    def drawn(self, runs: slice | Array = slice(None)) -> Errors | None:
        """Return the sensor errors of some runs, as drawn, ``(runs, ticks, …)``; None if true."""
        return None if self.errors is None else self.errors.of(self.rows[runs])

    @property
    def begun(self) -> tuple[ClosedLoop, Array]:
        """The loop at the start of the runs, and their states after a sampled law has acted."""
        loop, states, t = self.batched_loop(), self.states, float(self.times[0])
        if loop.vehicle.control is not None:
            drawn, errors = self.drawn(), None
            if drawn is not None:
                errors = drawn.measured(loop.group, slice(None), 0)
            states = loop.after_instant(t, states, errors)
        return loop.holding(t), states

    @staticmethod
    def joined(problems: Sequence[Problem]) -> Problem:
        """Join the runs of several problems, whose loops have the same structure and times."""
        first, varying = problems[0], dict[str, Array]()
        numbers = [problem.leaves_of_runs() for problem in problems]
        for name, shared in leaves(first.loop).items():
            rows = np.concatenate([leaves_of_runs[name] for leaves_of_runs in numbers])
            if (rows != shared).any():
                varying[name] = rows
        states = np.concatenate([problem.states for problem in problems])
        drawn = [errors for problem in problems if (errors := problem.drawn()) is not None]
        errors = Errors(*map(np.concatenate, zip(*drawn, strict=True))) if drawn else None
        return Problem(first.loop, states, first.times, varying, errors)

    def leaves_of_runs(self) -> dict[str, Array]:
        """Return every leaf of the loop by path, a row for each run, ``(runs, …)``."""
        return {
            path: self.varying.get(path, np.broadcast_to(shared, (self.runs, *shared.shape)))
            for path, shared in leaves(self.loop).items()
        }

    def batched_loop(self, extra_axes: int = 0) -> ClosedLoop:
        """Return the loop with its varying leaves along a leading run axis.

        `extra_axes` axes are inserted after it, for states ``(runs, samples, n)``.
        """
        if not self.varying:
            return self.loop
        expanded = {
            name: values.reshape(self.runs, *(1,) * extra_axes, *values.shape[1:])
            for name, values in self.varying.items()
        }
        return with_leaves(self.loop, expanded)


@lru_cache(maxsize=8)
def _spans(times: bytes, instants: bytes, tick: float | None, halved: bool) -> list[Span]:
    """Return the spans between ticks and instants, for sample times; see `Problem.spans`."""
    samples, moments = np.frombuffer(times), np.frombuffer(instants)
    start, stop = float(samples[0]), float(samples[-1])
    ticks = {} if tick is None else _control_instants(samples, tick)
    near = moments[(start - 1.0 < moments) & (moments < stop + 1.0)]  # of perhaps a long recording
    moments, earliest, latest = together(near, np.array([*samples, *ticks]))
    changes = {t: ends for t, *ends in np.transpose([moments, earliest, latest]).tolist()}
    inner = distinct([t for t in (*moments, *ticks) if start < t < stop])
    ends = np.array([start, *inner, stop])
    # A sample at an instant belongs to the span after it; the last one to the last span.
    first = np.append(np.searchsorted(samples, ends[:-1]), len(samples))
    spans = []
    for index, (one, other) in enumerate(pairwise(ends.tolist())):
        inside = samples[first[index] : first[index + 1]]
        later = inside[inside > one]
        grid = np.concatenate([[one], later, [other] if other not in later[-1:] else []])
        last, first_next = changes.get(one, (one, one))[1], changes.get(other, (other, other))[0]
        within = (
            one if one == start >= last else float(np.nextafter(max(one, last), np.inf)),
            other
            if other == stop <= first_next
            else float(np.nextafter(min(other, first_next), -np.inf)),
        )
        at, sampled = int(first[index + 1]) - len(later), len(later) < len(inside)
        longest = (other - one) / 2 if halved else np.inf
        spans.append(
            Span(one, other, within, grid, at, len(later), sampled, ticks.get(one), longest)
        )
    return spans


def _control_instants(samples: Array, tick: float) -> dict[float, int]:
    """Return the ticks t = k·tick, from the start to before the end, with their k."""
    start, stop = float(samples[0]), float(samples[-1])
    numbers = np.arange(np.ceil(start / tick), np.ceil(stop / tick) + 1)
    times = _nearest(numbers * tick, samples)
    ticks = zip(times.tolist(), numbers.astype(int).tolist(), strict=True)
    return {t: k for t, k in ticks if start <= t < stop}


def together(instants: Array, times: Array) -> tuple[Array, Array, Array]:
    """Return an instant for all that are equal but for rounding, and the first and last of them.

    It is the one of `times` that they equal but for rounding, or else the middle.
    """
    ordered = distinct(instants)
    begins = np.diff(ordered, prepend=-np.inf) > ROUNDING * np.maximum(1.0, np.abs(ordered))
    starts = np.flatnonzero(begins)
    earliest, latest = (
        ordered[starts],
        ordered[np.append(starts[1:], len(ordered))[: len(starts)] - 1],
    )
    middle = earliest + (latest - earliest) / 2
    merged, which = np.unique(_nearest(middle, times), return_inverse=True)
    least, most = np.full((2, len(merged)), np.inf) * [[1.0], [-1.0]]
    np.minimum.at(least, which, earliest)
    np.maximum.at(most, which, latest)
    return merged, least, most


def _nearest(instants: Array, times: Array) -> Array:
    """Return the instants, replacing those that equal one of `times` but for rounding by it."""
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
    """The results of all runs of a problem.

    Attributes
    ----------
    states : (runs, samples, n)
        Flat states at the sample times; NaN from where a run failed.
    status : (runs,)
        `Status` of each run.
    steps : (runs,)
        Work, as the engine counts it.
    messages
        Why a run failed; empty if it did not.
    numbers : (runs,) each
        Numbers of each run that follow from its states, by name, if it was measured.
    arrays : (runs, samples, …) each
        Requested arrays of a measured solution, by name; then its states may be left out.
    """

    states: Array
    status: Array
    steps: Array
    messages: list[str]
    numbers: dict[str, Array] = field(default_factory=dict)
    arrays: dict[str, Array] = field(default_factory=dict)


Progress = Callable[[float], None]
"""A callback with the number of runs done since its last call, in fractions of a run."""


# The base class of integrators, and their walk through the spans of a problem, group by group -----
#
# The walk evaluates sampled laws, fills in the samples, and records runs that fail.
# It knows no engine.


ERRORS_AT_ONCE = 2**14
"""Number of instants of runs whose sensor errors are computed at once; they fit a cache."""

NO_LONGER_FINITE = "the state or its derivative is no longer finite"
NOT_FINITE = "the command is not finite"


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
    drawn
        Sensor errors of the current runs, ``(runs, ticks, …)``; None if their law knows the truth.
    ahead, errors
        Control instants whose sensor errors are at hand, and these, ``(ticks, runs, …)``.
    runs : (runs,)
        The current runs.
    loop
        Their closed loop, with their own parameters.
    vector_field
        Time derivatives of states ``(runs, n)`` at a time t of the current span.
    samples : (runs, samples, n) or None
        Whole states at the samples of the current runs, to be filled in, if these are neighbours.
    reached
        May be called with a time that the runs have reached, to show progress.
    ends_stopped
        Whether `advance` ends unfinished runs once ``stop[0]`` is not 0, also in a long call of C.
    stop
        `STOP`, or None.
    """

    runs: Array
    drawn: Errors | None
    ahead: range
    errors: Errors
    loop: ClosedLoop
    vector_field: Callable[[float, Array], Array]
    samples: Array | None
    reached: Callable[[float], None]
    ends_stopped: ClassVar[bool] = False

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.stop = STOP.get()

    def begin(self, runs: Array) -> None:
        """Begin these runs, at their initial states."""
        self.loop = self.problem.select(runs).batched_loop()

    def at_instant(self, t: float, states: Array, errors: Errors | None) -> Array:
        """Return the states after a control instant, with these measurement errors."""
        return self.loop.after_instant(t, states, errors)

    def errors_at(self, tick: int) -> Errors | None:
        """Return the sensor errors at a control instant, computed for many of them at once."""
        if self.drawn is None:
            return None
        if tick not in self.ahead:
            stop = tick + max(1, ERRORS_AT_ONCE // len(self.runs))
            self.ahead = range(tick, min(stop, self.problem.control_instants))
            parts = (part[:, tick:stop].swapaxes(0, 1).copy() for part in self.drawn.of_runs)
            self.errors = self.measured(Errors(*parts))
        return self.errors.of(tick - self.ahead.start)

    def measured(self, drawn: Errors) -> Errors:
        """Return sensor errors as `at_instant` needs them: with E."""
        return drawn.measured(self.problem.loop.group)

    def hold(self, span: Span) -> None:
        """Set the numbers that the loop holds in a span."""
        loop = self.loop.holding(span.start)
        self.vector_field = lambda t, states: loop.vector_field(span.inside(t), states)

    def room(self, span: Span) -> Array:
        """Return an array for the samples of a span, into which an engine may write directly."""
        length = self.problem.loop.moving_length
        if self.samples is None or length < self.samples.shape[-1]:
            return np.empty((len(self.runs), span.later, length))
        return self.samples[:, span.first : span.first + span.later]

    def leave(self, places: list[int]) -> None:  # noqa: B027  # most need not do anything
        """Leave some of the current runs, by their index here, where they have ended."""

    @property
    def spans(self) -> list[Span]:
        """The spans of the current runs."""
        return self.problem.spans

    def walk_ahead(self, place: int, states: Array) -> tuple[int, Array, Array | int, Array | int]:
        """Walk from the span at a place up to one in which something happens besides motion.

        Samples are stored. By default it stays where it is.

        Returns
        -------
        place
            That of the next span.
        states : (runs, n)
            Whole states at its start.
        steps, last : (runs,)
            The work of each run in all these spans, and in the last one.
        """
        return place, states, 0, 0

    @abstractmethod
    def advance(self, span: Span, states: Array) -> SpanResult:
        """Integrate from the states at the start of a span, ``(runs, n)``, to its stop.

        Steps are chosen by the tolerance, up to ``span.longest``: no step ends at a sample for its
        sake. A run does not depend on its neighbours.
        """


INDEFINITE = (
    Status.ESTIMATE_LOST,
    "the covariance of the estimate is no longer positive definite; give the estimator larger "
    "deviations, or measurements more often",
)
"""Status and reason of a run whose covariance is no longer positive definite."""

MOST_TURNS = 0.5
"""Turns within a control period beyond which two measurements do not say how a body has turned.

Steps of an integrator need no such rule: at the loosest tolerance they turn by less, at 1e-9 by 0.3
rad, of a body that spins freely.
"""

AHEAD = 20_000.0
"""How many times more it must turn after the first period, of which nothing was integrated yet."""

GROWN = 10.0
"""How many times as fast it must turn as it did at the start, and as the reference does."""

SUSPECT = 200
"""Steps in a control period beyond which it is asked how fast a body turns."""

DIVERGED = (
    Status.DIVERGED,
    "the body turns by more than half a turn within a control period, and no law can follow; "
    "shorten control.period, lower the gains, or look for the force that turns it",
)
"""Status and reason of such a run."""

REPORTED = 0.02
"""Smallest fraction of the horizon between two reports of progress."""

REPORT_EVERY = 0.2
"""Longest time between two reports of progress while a vector field is evaluated in Python, s."""


class Stopped(Exception):
    """Runs were stopped by `STOP` and are not finished."""


STOP: ContextVar[Array | None] = ContextVar("STOP", default=None)
"""An integer, ``(1,)``, that stops runs once it is not 0; set where several threads or processes
compute. Without it, an exception in this thread stops them."""


def walked(
    integrator: Integrator, groups: Sequence[Array], progress: Progress, threads: int
) -> Solution:
    """Return the solution of all groups of runs, by at most this number of threads.

    Raises
    ------
    Stopped
        If they are stopped and the integrator does not end them itself.
    """
    problem, lock = integrator.problem, threading.Lock()
    runs, n = problem.states.shape
    states = np.empty((runs, len(problem.times), n))  # whose memory is touched where it is filled
    status, steps = np.zeros(runs, dtype=np.int32), np.zeros(runs, dtype=np.int64)
    solution = Solution(states, status, steps, [""] * runs)

    def report(runs: float) -> None:
        if stop[0]:
            if not integrator.ends_stopped:
                raise Stopped
            return
        with lock:
            progress(runs)

    def walk(group: Array) -> None:
        with np.errstate(all="ignore"):  # a state that is not finite ends its run
            _walk(copy(integrator), solution, group, report)

    threads, waits = min(threads, len(groups)), integrator.stop is None and integrator.ends_stopped
    stop = integrator.stop = np.zeros(1, np.int64) if integrator.stop is None else integrator.stop
    if threads == 1 and not waits:
        for group in groups:
            walk(group)
        return solution
    contexts = [copy_context() for _ in groups]
    with ThreadPoolExecutor(threads) as pool:  # for a thread in C handles no signals
        try:
            # After an error, no further group starts.
            for _ in pool.map(lambda context, group: context.run(walk, group), contexts, groups):
                pass
        except BaseException:
            stop[:] = 1
            raise
    return solution


def lost_calls(problem: Problem, t: float) -> dict[int, Failure | None]:
    """Return the runs that end because a call of their code was lost in this thread since asked.

    None for one that only shared a process with another.
    """
    lost: Mapping[int, str] = getattr(problem.loop.controller, "lost_calls", dict)()
    return {
        run: Failure(Status.NO_ANSWER, words, t) if words else None for run, words in lost.items()
    }


Failures = dict[int, tuple[Span, Failure | None]]
"""Times and reasons of failed runs of a group; None for runs that others may have stopped."""


def _walk(integrator: Integrator, solution: Solution, runs: Array, progress: Progress) -> None:
    """Fill in the solution of a group of runs."""
    problem, going = integrator.problem, np.ones(len(runs), dtype=bool)
    integrator.ahead, integrator.drawn = range(0), problem.drawn(runs)
    failed: Failures = {}
    steps: Any = 0
    states, solution.steps[runs] = problem.states[runs], 0
    neighbours = slice(int(runs[0]), int(runs[0]) + len(runs))
    together = bool((np.diff(runs) == 1).all())
    integrator.runs, integrator.samples = runs, solution.states[neighbours] if together else None
    integrator.reached = reached = _Reached(problem, len(runs), progress)
    integrator.begin(runs)
    place, spans = 0, integrator.spans
    lost_calls(problem, 0.0)  # of earlier work of this thread
    while place < len(spans):
        states = _without_ended(problem, states, going)
        if place and np.max(steps) <= SUSPECT:
            after, states, work, steps = integrator.walk_ahead(place, states)
            solution.steps[runs] += np.where(going, work, 0)
            if after > place:
                reached(spans[after - 1].stop)
            place = after
        if place == len(spans):
            break
        span, place = spans[place], place + 1
        integrator.hold(span)
        states, ending = _at_instant(integrator, span, states, steps)
        if span.sampled_start:
            solution.states[runs, span.first - 1] = states
        if ending:
            failed = {run: (span, why) for run, why in ending.items()} | failed
            going[list(ending)] = False
            integrator.leave(list(ending))
        states = np.where(going[:, None], states, problem.states[runs])  # where steps are long
        result = _advanced(integrator, span, states, solution.states)
        states, steps = result.states, result.steps
        solution.steps[runs] += np.where(going, result.steps, 0) if failed else result.steps
        ended: dict[int, Failure | None] = dict(result.failed)
        if not np.isfinite(states).all():
            lost = np.flatnonzero(~np.isfinite(states).all(axis=1)).tolist()
            ended = {**dict.fromkeys(lost, Failure()), **ended}
        for run, failure in ended.items():
            failed.setdefault(run, (span, failure))
            going[run] = False
        integrator.leave(list(ended))
        if len(failed) == len(runs):
            break
        reached(span.stop)
    _end(integrator, solution, runs, failed, progress)
    reached.finish()


def _without_ended(problem: Problem, states: Array, going: Array) -> Array:
    """Return states that make code not be called for runs that have ended: NaN."""
    if going.all() or not isinstance(problem.loop.controller, RunsCode):
        return states
    return np.where(going[:, None], states, np.nan)


def _end(
    integrator: Integrator, solution: Solution, runs: Array, failed: Failures, progress: Progress
) -> None:
    """Note the runs that have failed, or integrate once more those that others may have stopped."""
    for place, (span, failure) in failed.items():
        if failure is None and len(runs) > 1:
            _walk(integrator, solution, runs[[place]], lambda runs: progress(0.0))
        else:
            _note(solution, integrator.problem, runs[place], span, failure or Failure())


def _at_instant(
    integrator: Integrator, span: Span, states: Array, steps: Any
) -> tuple[Array, dict[int, Failure | None]]:
    """Return the states after a control instant, if a span begins with one, and what ends there.

    Parameters
    ----------
    steps
        Those of the last control period.
    """
    if span.tick is None:
        return states, {}
    problem = integrator.problem
    states = integrator.at_instant(span.start, states, integrator.errors_at(span.tick))
    gone = ~np.isfinite(states).all(axis=1)
    lost = dict.fromkeys(np.flatnonzero(gone).tolist(), (Status.NON_FINITE, NOT_FINITE))
    if np.max(steps) > SUSPECT or not span.tick:
        gone = _diverged(integrator, span, states)
        lost |= dict.fromkeys(np.flatnonzero(gone).tolist(), DIVERGED)
    if (at := problem.loop.lost_at) is not None:
        lost |= dict.fromkeys(np.flatnonzero(states[:, at]).tolist(), INDEFINITE)
    failures: dict[int, Failure | None]
    failures = {place: Failure(*why, span.start) for place, why in lost.items()}
    return states, failures | lost_calls(problem, span.start)


def _diverged(integrator: Integrator, span: Span, states: Array) -> Array:
    """Return which of the current runs turn too fast for their law, at a control instant.

    At the first one, those that its command will have accelerated to a hundred times that.
    """
    problem = integrator.problem.select(integrator.runs)
    loop = problem.batched_loop()
    now = loop.tracking(span.start, states)
    V = now.V
    if not span.tick:
        change = loop.layout.split(loop.vector_field(span.start, states))["momentum"]
        V = now.inertia.velocity(now.P + loop.period * change) / AHEAD
    start = loop.tracking(float(problem.times[0]), problem.states)
    return _turns_too_fast(loop, V, start.V, now.Vd)


def _turns_too_fast(loop: ClosedLoop, V: Array, *others: Array) -> Array:
    """Return whether a velocity is too fast for a sampled law, and for one grown from others."""
    turning = np.zeros(loop.group.dimension)
    for part in loop.group.parts:
        turning[part.axes] = part.turns
    rate = norm(turning * V)
    fast = loop.period * rate > MOST_TURNS * 2 * np.pi
    return np.logical_and.reduce([fast, *(rate > GROWN * norm(turning * U) for U in others)])


def _find_diverged(problem: Problem, solution: Solution) -> None:
    """Note runs that turn too fast for their sampled law at a sample."""
    loop, times = problem.batched_loop(extra_axes=1), problem.times
    P = loop.layout.split(solution.states)["momentum"]
    fast = _turns_too_fast(loop, loop.inertia.at(times).velocity(P)).any(axis=1)
    for run in np.flatnonzero(fast):
        loop = problem.select(np.array([run])).batched_loop(extra_axes=1)
        s = loop.tracking(times, solution.states[[run]])
        gone = np.flatnonzero(_turns_too_fast(loop, s.V, s.V[:, :1], s.Vd)[0])
        if len(gone):
            failure = Failure(*DIVERGED, times[gone[0]])
            _note(solution, problem, int(run), problem.spans[-1], failure)


def _advanced(integrator: Integrator, span: Span, states: Array, stored: Array) -> SpanResult:
    """Advance some runs through a span and store the samples; return whole states."""
    moving = integrator.problem.loop.moving_length
    later = slice(span.first, span.first + span.later)
    result, runs = integrator.advance(span, states[:, :moving]), integrator.runs
    shapes: list[tuple[str, tuple[int, ...]]] = [("states", (len(states), moving))]
    shapes += [("samples", (len(states), span.later, moving))] if span.later else []
    for name, shape in shapes:
        if (got := np.shape(getattr(result, name))) != shape:
            who = type(integrator).__qualname__
            raise EqtError(f"{who}: advance returned {name} of shape {got}; expected {shape}")
    if span.later and result.samples.base is not stored:
        stored[runs, later, :moving] = result.samples
    if moving == states.shape[1]:
        return result
    stored[runs, later, moving:] = states[:, None, moving:]
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
        times = problem.times[~lost]
        at = f"after t = {times[-1] if len(times) else problem.times[0]:.6g} s"
    law = problem.loop.controller.formula if failure.status is Status.NON_FINITE else None
    undefined = law.undefined if isinstance(law, OuterLoop) else ""
    reason = "; ".join(filter(None, [failure.reason, undefined]))
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


# The base class of engines: each integrates runs through a span; the walk is shared ---------------


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


class Work(NamedTuple):
    """The work for a run, in the unit that an engine counts and `max_steps` limits."""

    amount: float = 0.0
    unit: str = "steps"


class Query(NamedTuple):
    """What is asked of every run: numbers, by a function of its samples and a reduction.

    Attributes
    ----------
    rows : (runs, samples, n) or (samples, n) each
        Rows that the function takes after the states.
    returned
        The arrays to return; None for all of them, and the states.
    """

    function: SampledFunction
    reduction: Reduction
    rows: Sequence[Array]
    returned: Sequence[str] | None = ()


@dataclass(frozen=True)
class Engine(Component):
    """An integrator: a frozen dataclass whose fields are its keys in `solver`.

    One in compiled code is `Compiled`, too. One whose runs share the steps of their block says in
    `runs_per_block` how many these are, so that parts have whole blocks.
    """

    rtol: float
    """The accuracy that the results are judged by."""

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
        threads = workers if isinstance(self, Compiled) else 1
        groups = self.groups(problem, threads)
        if most := getattr(problem.loop.controller, "in_order", 0):
            groups = [part for x in groups for part in np.array_split(x, -(-len(x) // most))]
        solution = walked(self.integrator(problem), groups, progress, threads)
        if problem.loop.vehicle.control is not None:
            _find_diverged(problem, solution)
        return solution

    def groups(self, problem: Problem, threads: int) -> list[Array]:
        """Return the groups of runs integrated at a time; they never change a result."""
        return [np.arange(problem.runs)]

    def rehearse(self, problem: Problem) -> None:
        """Raise what `solve` would raise at its start, at little cost; no result is kept."""
        start, stop = problem.times[[0, -1]]
        self.solve(replace(problem, times=np.array([start, start + REHEARSED * (stop - start)])))

    @abstractmethod
    def tightened(self, factor: float) -> Engine:
        """Return the engine with its tolerances multiplied by `factor` < 1."""

    def work_for_stability(self, rates: Array, duration: float) -> Work:
        """Return the work from which decaying errors stop growing; 0: no limit.

        Parameters
        ----------
        rates : (instants, n)
            The eigenvalues of the linearised loop at instants spread over the duration, 1/s.
        """
        return Work()

    def check(self, problems: Problems) -> None:
        """Note problems of its options."""


@runtime_checkable
class Compiled(Protocol):
    """An engine that computes outside Python, so that threads of one process use several cores.

    It compiles a law rather than call it as Python, and a second, tighter solve of each run is so
    cheap that errors are estimated by default.
    """

    @classmethod
    def unavailable(cls) -> str | None:
        """Return why it cannot be used on this machine, and the remedy; None if it can."""

    def provenance(self) -> dict[str, str]:
        """Return the tools of this machine that it uses, by name; no result depends on them."""

    def blocks(self, problem: Problem, threads: int = 1) -> list[Array]:
        """Return the runs best solved and evaluated together; they never change a result."""

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array] | None:
        """Do as `evaluate` below, by compiled code; None if the function cannot be compiled."""

    def measure(
        self, problem: Problem, query: Query, workers: int, progress: Progress
    ) -> Solution | None:
        """Do as `measure` below, while it solves; None if that cannot be done."""


def evaluate(
    engine: Engine, function: SampledFunction, problem: Problem, *rows: Array
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
    arrays = engine.evaluate(function, problem, *rows) if isinstance(engine, Compiled) else None
    if arrays is None:
        return function(problem.batched_loop(extra_axes=1), problem.times, *rows)
    return arrays


def measure(
    engine: Engine,
    problem: Problem,
    query: Query,
    workers: int = 1,
    progress: Progress = lambda runs: None,
) -> Solution:
    """Solve, and compute numbers of each run from arrays at every sample."""
    if isinstance(engine, Compiled) and (
        solution := engine.measure(problem, query, workers, progress)
    ):
        return solution
    solution = engine.solve(problem, workers, progress)
    with np.errstate(all="ignore"):  # runs that failed are NaN, or large
        arrays = evaluate(engine, query.function, problem, solution.states, *query.rows)
        numbers = dict(query.reduction(SampledRuns(problem.times), arrays))
    if query.returned is not None:  # the others take several times the memory of the states
        arrays = {name: arrays[name] for name in query.returned}
        solution = replace(solution, states=solution.states[:, :0].copy())
    return replace(solution, numbers=numbers, arrays=arrays)


engines = Registry("engine", "engines", Engine, ("engines.solve_ivp", "engines.native"))


@dataclass(frozen=True)
class SolverChecks(Keys):
    """The keys of `solver` that do not belong to an engine.

    Attributes
    ----------
    max_error
        Runs whose error estimate exceeds it count as failed.
    error_estimate
        Solve every run a second time at a tenth of the tolerance, a twentieth of sampled loops,
        and compare. Default: where the engine makes that cheap.
    cross_check
        How many runs per law are redone by another engine and compared.
    """

    max_error: Positive | None = None
    error_estimate: bool | None = None
    cross_check: CountOrNone = 3
