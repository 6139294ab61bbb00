"""Integration of runs through a span by compiled DOP853; each run has its own steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.engines.native import library
from eqt_cli.engines.native.library import Advance, Measuring, Rows
from eqt_cli.engines.problem import Problem, Span, Status
from eqt_cli.engines.traced_loop import (
    InstantPrograms,
    LoopPrograms,
    RunningPrograms,
    held_rows,
    parameter_rows,
)
from eqt_cli.engines.walk import Failure, Integrator, SpanResult
from eqt_cli.mechanics.law_input import LawInput
from eqt_cli.program import Program
from eqt_cli.vehicle.sensors.channels import Errors

SPANS_AT_ONCE = 256
"""Number of spans whose held numbers are read together, which takes little longer than for one."""


class Lanes(Integrator):
    """Integrates a group of runs, as many side by side as there are lanes.

    Parameters
    ----------
    law
        The programs of the loop.
    settings
        ``rtol`` and ``atol``, the tolerances of a step, and ``most_steps``, of a run.
    advance
        What integrates the field of the loop: the CPU or a device.
    """

    def __init__(
        self, problem: Problem, law: LoopPrograms, settings: Mapping[str, float], advance: Advance
    ) -> None:
        super().__init__(problem)
        self._law, self._advance = law, advance
        self._compiled: dict[int, library.Evaluation] = {}
        self._settings = settings
        self._all_parameters = parameter_rows(problem)
        self._span_starts = np.array([span.start for span in problem.spans])
        self._held_from: dict[float, Array] = {}

    def begin(self, runs: Array) -> None:
        """Begin these runs with no step taken, and the length of the first one unknown."""
        if self._law.around_code is not None:
            super().begin(runs)
        count = len(runs)
        self._parameters = self._all_parameters[runs]
        self._steps, self._times = np.zeros(count), np.zeros(count)
        self._counts, self._ends = np.zeros((2, count), dtype=np.int64)

    def hold(self, span: Span) -> None:
        """Set the held numbers, which all runs share."""
        if span.start not in self._held_from:
            first = np.searchsorted(self._span_starts, span.start)
            starts = self._span_starts[first : first + SPANS_AT_ONCE]
            rows = held_rows(self.problem.loop, starts)
            self._held_from = dict(zip(starts.tolist(), rows, strict=True))
        self._held = self._held_from[span.start]

    def at_instant(self, t: float, states: Array, errors: Errors | None) -> Array:
        """Return the states after an instant, by compiled code.

        A user's own law and a solver of the vehicle are called between two programs.
        """
        runs = len(states)
        given = [
            Rows(states, by_run=True),
            Rows(np.array([t])),
            Rows(self._parameters, by_run=True),
            Rows(self._held),
        ]
        parts = errors.of_runs if errors else ()
        measured = [Rows(part.reshape(runs, -1), by_run=True) for part in parts]
        around, program = self._law.around_code, self._law.after_instant
        if around is not None:
            torque, memory, states = self._answer(t, states, around, [*given, *measured])
            given[0] = Rows(states, by_run=True)  # with the held measurements
            given += [Rows(torque, by_run=True), Rows(memory, by_run=True)]
            if self.loop.vehicle.solves:
                given.append(Rows(self.loop.solution(states, torque), by_run=True))
            program = around.answered
        else:
            given += measured
        assert program is not None
        return self._evaluated(program, runs, given)["state"]

    def _answer(
        self, t: float, states: Array, around: InstantPrograms, given: list[Rows]
    ) -> tuple[Array, Array, Array]:
        """Return the commanded torque, the law's memory and the measured states, a row per run."""
        runs, none = len(states), np.empty((len(states), 0))
        if self._law.asked is not None:
            found = self._evaluated(self._law.asked, runs, given)
            return found["torque"], found.get("memory", none), found.get("state", states)
        found = self._evaluated(around.told, runs, given)
        states = found.pop("state", states)
        told = LawInput(**found)._replace(t=t)
        torque, memory = self.loop.asked(told, states)
        return torque, np.concatenate([none, *memory.values()], axis=1), states

    def advance(self, span: Span, states: Array) -> SpanResult:
        """Integrate the runs that have not failed, leaving the others as they are."""
        was, before, samples = self._ends.copy(), self._counts.copy(), self.room(span)
        ended = self._advanced(span, states, span.grid[1 : 1 + span.later], samples)
        failed: dict[int, Failure | None] = {}
        if self._ends.any():
            for run in np.flatnonzero(self._ends):
                known = 0 if was[run] else np.searchsorted(span.grid[1:], self._times[run], "right")
                samples[run, known:] = np.nan
                failed[int(run)] = self._failure(run)
        return SpanResult(ended, samples, self._counts - before, failed)

    def _advanced(
        self,
        span: Span,
        states: Array,
        times: Array,
        samples: Array,
        measuring: Measuring | None = None,
    ) -> Array:
        """Return the states at the end of a span; those at sample times are stored or measured."""
        ended = np.array(states, order="C")
        self._advance(
            measuring,
            runs=len(states),
            later=len(times),
            to_next_run=samples.strides[0] // samples.itemsize,
            start=span.start,
            stop=span.stop,
            first_inside=span.within[0],
            last_inside=span.within[1],
            grid=np.array(times),
            held=self._held,
            parameters=self._parameters,
            states=ended,
            samples=samples,
            steps=self._steps,
            counts=self._counts,
            ends=self._ends,
            times=self._times,
            **self._settings,
        )
        return ended

    def _evaluated(self, program: Program, runs: int, given: list[Rows]) -> dict[str, Array]:
        """Return the arrays of a program for these runs at one time, ``(runs, …)`` each."""
        if id(program) not in self._compiled:  # hashing all its operations takes long
            lengths = tuple(each.length for each in given)
            self._compiled[id(program)] = library.evaluation(program, lengths)
        found = self._compiled[id(program)](runs, 1, given)
        return {name: values[:, 0] for name, values in found.items()}

    def _failure(self, run: Any) -> Failure:
        """Return how and when a run has ended."""
        end, t = self._ends[run], float(self._times[run])
        if end == library.STEP_LIMIT:
            reason = f"step limit: {self._settings['most_steps']} steps (solver.max_steps)"
            return Failure(Status.STEP_LIMIT, reason, t)
        if end == library.NOT_FINITE:
            return Failure(t=t)
        reason = "the law switches back and forth without end; smooth it, as with tanh"
        if end == library.STEP_TOO_SHORT:
            reason = "no step is short enough: the state has no bound, or the law is singular"
        return Failure(Status.SOLVER_FAILED, reason, t)


class MeasuringLanes(Lanes):
    """Integrates runs through the one span of a problem and measures them on the way.

    Parameters
    ----------
    problem
        Problem with the first and the last sample time only.
    advance
        What integrates the field, and measures by a program that looks at each sample.
    measures
        The programs that measure.
    times
        All sample times, s.
    rows
        Inputs besides the states, including time, held numbers and columns.

    Attributes
    ----------
    memory : (runs, memory)
        Memory of the program that looks at samples, after the last one.
    kept : (runs, samples, kept)
        Numbers that it keeps of each sample.
    """

    def __init__(
        self,
        problem: Problem,
        law: LoopPrograms,
        settings: Mapping[str, float],
        advance: Advance,
        measures: RunningPrograms,
        times: Array,
        rows: Sequence[Rows],
    ) -> None:
        super().__init__(problem, law, settings, advance)
        self._sample_times, self._rows, self._starts = times, rows, measures.starts
        self.memory = np.empty((problem.runs, len(measures.starts)))
        kept = sum(math.prod(shape) for _, shape in measures.kept)
        self.kept = np.empty((problem.runs, len(times), kept))

    def advance(self, span: Span, states: Array) -> SpanResult:
        """Integrate and measure these runs, which are neighbours."""
        here = slice(int(self.runs[0]), int(self.runs[0]) + len(self.runs))
        rows = [row.of(here) for row in self._rows]
        measuring = Measuring(rows, self._starts, self.memory[here], self.kept[here])
        ended = self._advanced(span, states, self._sample_times[1:], self.kept, measuring)
        failed = {int(run): self._failure(run) for run in np.flatnonzero(self._ends)}
        return SpanResult(ended, ended[:, None], self._counts, failed)
