"""The input and output of an engine; it knows no group and no controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from itertools import pairwise

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.core.leaves import leaves, with_leaves
from eqt_cli.vehicle.sensors.channels import Errors

ROUNDING = 1e-12
"""Relative difference of times that are meant to be equal, such as 3·0.1 and 0.3."""


class Status(IntEnum):
    """Outcome of a run; only 0 is success."""

    OK = 0
    SOLVER_FAILED = 1
    NON_FINITE = 2
    STEP_LIMIT = 3
    ACCURACY = 4
    WORKER_LOST = 5
    ESTIMATE_LOST = 6
    DIVERGED = 7


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
    """

    start: float
    stop: float
    within: tuple[float, float]
    grid: Array
    first: int
    later: int
    sampled_start: bool
    tick: int | None = None

    def inside(self, t: float) -> float:
        """Return t; at an end where the field changes, the nearest time inside the span."""
        return min(max(t, self.within[0]), self.within[1])

    def until(self, t: float) -> Span:
        """Return the span cut at its last sample that is not after t."""
        known = int(np.searchsorted(self.grid[1 : 1 + self.later], t, side="right"))
        stop, within = float(self.grid[known]), (self.within[0], float(self.grid[known]))
        return replace(self, stop=stop, within=within, grid=self.grid[: 1 + known], later=known)


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
        Sensor errors at every control instant, ``(runs, instants, …)``; None if the law is given
        the true state.
    """

    loop: ClosedLoop
    states: Array
    times: Array
    varying: Mapping[str, Array] = field(default_factory=dict)
    errors: Errors | None = None

    @property
    def runs(self) -> int:
        """The number of runs."""
        return len(self.states)

    @cached_property
    def spans(self) -> list[Span]:
        """The horizon, cut at the instants that are known in advance, and at control instants."""
        start, stop = float(self.times[0]), float(self.times[-1])
        instants = self.loop.instants(stop)
        ticks = self._control_instants(start, stop)
        within_it = instants[(start < instants) & (instants < stop)]  # of perhaps a long recording
        known = _nearest(within_it, np.array([*self.times, *ticks]))
        inner = np.unique([t for t in (*known, *ticks) if start < t < stop])
        ends = np.array([start, *inner, stop])
        # A sample at an instant belongs to the span after it; the last one to the last span.
        first = np.append(np.searchsorted(self.times, ends[:-1]), len(self.times))
        spans = []
        for index, (one, other) in enumerate(pairwise(ends.tolist())):
            inside = self.times[first[index] : first[index + 1]]
            later = inside[inside > one]
            grid = np.concatenate([[one], later, [other] if other not in later[-1:] else []])
            within = (
                one if one == start else float(np.nextafter(one, other)),
                other if other == stop else float(np.nextafter(other, one)),
            )
            at, sampled = int(first[index + 1]) - len(later), len(later) < len(inside)
            spans.append(Span(one, other, within, grid, at, len(later), sampled, ticks.get(one)))
        return spans

    @property
    def control_instants(self) -> int:
        """The number of ticks, at which law, sensors and actuators may act."""
        return len(self._control_instants(float(self.times[0]), float(self.times[-1])))

    def _control_instants(self, start: float, stop: float) -> dict[float, int]:
        """Return the ticks t = k·tick, from the start to before the end, with their k."""
        control = self.loop.vehicle.control
        if control is None:
            return {}
        numbers = np.arange(np.ceil(start / control.tick), np.ceil(stop / control.tick) + 1)
        times = _nearest(numbers * control.tick, self.times)
        ticks = zip(times.tolist(), numbers.astype(int).tolist(), strict=True)
        return {t: k for t, k in ticks if start <= t < stop}

    def select(self, runs: slice | Array) -> Problem:
        """Return the problem for some of its runs."""
        varying = {name: values[runs] for name, values in self.varying.items()}
        errors = None if self.errors is None else self.errors.of(runs)
        return Problem(self.loop, self.states[runs], self.times, varying, errors)

    def errors_at(self, tick: int, runs: slice | Array = slice(None)) -> Errors | None:
        """Return the sensor errors at a control instant, in these runs."""
        return None if self.errors is None else self.errors.of(runs, tick)

    @staticmethod
    def joined(problems: Sequence[Problem]) -> Problem:
        """Join the runs of several problems, whose loops have the same structure and times."""
        first = problems[0]
        parameters = [
            {
                name: problem.varying.get(name, np.broadcast_to(shared, (runs, *shared.shape)))
                for name, shared in leaves(problem.loop).items()
            }
            for problem in problems
            for runs in [problem.runs]
        ]
        varying = {name: np.concatenate([p[name] for p in parameters]) for name in parameters[0]}
        states = np.concatenate([problem.states for problem in problems])
        known = [problem.errors for problem in problems if problem.errors is not None]
        errors = Errors(*map(np.concatenate, zip(*known, strict=True))) if known else None
        return Problem(first.loop, states, first.times, varying, errors)

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
    """

    states: Array
    status: Array
    steps: Array
    messages: list[str]

    @staticmethod
    def empty(problem: Problem) -> Solution:
        """Return a solution to be filled in; its memory is first touched then."""
        runs, n = problem.states.shape
        states = np.empty((runs, len(problem.times), n))
        steps = np.zeros(runs, dtype=np.int64)
        return Solution(states, np.zeros(runs, dtype=np.int32), steps, [""] * runs)


Progress = Callable[[float], None]
"""A callback with the number of runs done since its last call, in fractions of a run."""
