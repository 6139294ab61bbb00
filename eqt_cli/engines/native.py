"""DOP853 in C, compiled on this machine from the same laws that run on arrays.

The closed loop is traced once; its program is emitted as C, and templates in `c` integrate and
evaluate it. Each run has its own steps. All operations are fixed by IEEE 754, so that a run has the
same bits whatever its neighbours, its thread and the compiler.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, Problems
from eqt_cli.base.option_types import Count, Positive, Scale
from eqt_cli.base.registry import of_extension
from eqt_cli.components.mechanics import LawInput
from eqt_cli.components.sensors import Errors
from eqt_cli.engines import compiler, library
from eqt_cli.engines.engine import (
    Engine,
    Failure,
    Integrator,
    Measured,
    Problem,
    Progress,
    Reduction,
    SampledFunction,
    Span,
    SpanResult,
    Status,
    walked,
)
from eqt_cli.engines.library import Advance, Measuring, Rows, SampleProgram
from eqt_cli.engines.solve_ivp import FUNCTIONS, SolveIvp, steps
from eqt_cli.engines.traced_loop import (
    InstantPrograms,
    LoopKey,
    LoopPrograms,
    RunningPrograms,
    held_rows,
    parameter_rows,
    programs,
    running,
    sampled,
    trace,
)
from eqt_cli.numbers.program import Program

# Integration of runs through a span by compiled DOP853; each run has its own steps ----------------


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


# The engine ---------------------------------------------------------------------------------------


CPU = "cpu"
"""The device by default: the processors of this machine, by the C compiler."""

STEP_SHARE = 1 / 30
"""The tolerance of a step, as a fraction of the accuracy that the results are judged by."""

SMALLEST_RTOL = 1000 * float(np.finfo(float).eps)
"""Smallest `rtol`: of a hundredth of it, the fraction for a step is still above rounding."""

WORTH_COMPILING = 200
"""Number of samples or spans from which a few runs as Python take longer than to compile a law."""

BLOCK_BYTES = 16 * 2**20

GROUP_RUNS = 256
"""Number of runs that a thread integrates at a time: their states and samples fit its cache."""


def _device(text: str) -> Any:
    """Return the device of an option, with `integration` as in `library`; None for the CPU."""
    return None if text == CPU else of_extension("devices.chosen")(text)


@dataclass(frozen=True)
class Native(Engine):
    """DOP853 in C, compiled on this machine, in operations that IEEE 754 fixes to the bit.

    Attributes
    ----------
    rtol, atol
        Relative and absolute accuracy that the results are judged by; a step keeps its error below
        a thirtieth of it.
    max_steps
        Most steps that a run may take.
    device
        Where runs are integrated: ``cpu``, ``opencl`` or ``opencl:NUMBER``. It changes no bit.
    """

    name: ClassVar[str] = "native"
    estimates_errors: ClassVar[bool] = True
    threads: ClassVar[bool] = True
    as_fast_in_threads: ClassVar[int] = 2  # measured on two cores
    calls_laws: ClassVar[bool] = False
    part_runs: ClassVar[int] = 2500

    rtol: Annotated[Positive, Scale("relative tolerance")] = 1e-9
    atol: Annotated[Positive, Scale("absolute tolerance")] = 1e-9
    max_steps: Count = 1_000_000
    device: str = CPU

    @classmethod
    def unavailable(cls) -> str | None:
        """Return how to get a compiler; None if there is one."""
        return compiler.missing()

    def check(self, problems: Problems) -> None:
        """Note a tolerance that doubles cannot meet, or that is not below 1."""
        if not SMALLEST_RTOL <= self.rtol < 1:
            limits = f"expected a number from {SMALLEST_RTOL:.3g} to 1"
            problems.at("rtol").add(f"{limits}, got {self.rtol:g}")
        with problems.catching("device"):
            _device(self.device)

    def tightened(self, factor: float) -> Native:
        """Return the engine with both tolerances times `factor`."""
        return replace(self, rtol=self.rtol * factor, atol=self.atol * factor)

    def work_for_stability(self, rates: Array, duration: float) -> float:
        """Return steps of DOP853."""
        return steps(FUNCTIONS["DOP853"], rates, duration)

    def provenance(self) -> dict[str, str]:
        """Return the compiler, if there is one: shards are packed without."""
        with suppress(EqtError):
            found = compiler.compiler()
            tools = {"compiler": found.described, "lanes": str(found.lanes)}
            if device := _device(self.device):
                tools["device"] = device.tested
            return tools
        return {}

    def integrator(self, problem: Problem) -> Lanes:
        """Return the integrator of lanes, whose steps depend on their own run only."""
        law = programs(LoopKey(problem.loop))
        return Lanes(problem, law, self._settings, self._integration(law.field))

    def _integration(
        self, field: Program, at_samples: SampleProgram | None = None
    ) -> library.Advance:
        """Return what integrates a field, on the CPU or the device."""
        device = _device(self.device)
        return (device or library).integration(field, at_samples)

    @property
    def _settings(self) -> dict[str, float]:
        """The tolerances of a step, and the most steps."""
        rtol, atol = self.rtol * STEP_SHARE, self.atol * STEP_SHARE
        return {"rtol": rtol, "atol": atol, "most_steps": self.max_steps}

    def groups(self, problem: Problem, threads: int) -> list[Array]:
        """Return groups of a few runs, equally many per thread; one each with several spans."""
        if self.device != CPU:
            return super().groups(problem, threads)
        of_thread = -(-problem.runs // threads)
        turns = max(1, -(-of_thread // GROUP_RUNS)) if len(problem.spans) == 1 else 1
        size = max(1, -(-problem.runs // (turns * threads)))
        runs = np.arange(problem.runs)
        return [runs[start : start + size] for start in range(0, problem.runs, size)]

    def rehearse(self, problem: Problem) -> None:
        """Trace the law, which may fail, without compiling it."""
        trace(problem.loop)

    def blocks(self, problem: Problem, threads: int = 1) -> list[Array]:
        """Return blocks of as many runs per thread as fit a cache with their results.

        All runs are one block if the horizon has several spans.
        """
        runs = np.arange(problem.runs)
        if len(problem.spans) > 1 or self.device != CPU:
            return [runs]
        fitting = BLOCK_BYTES // (8 * len(problem.times) * problem.loop.state_length)
        size = max(1, fitting) * threads
        return [runs[start : start + size] for start in range(0, problem.runs, size)]

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array]:
        """Evaluate by compiled code, if the function can be compiled; else on arrays."""
        loop, times = problem.loop, problem.times
        program = sampled(function, LoopKey(loop), tuple(row.shape[-1] for row in rows))
        if program is None:
            return super().evaluate(function, problem, *rows)
        given = [
            *(Rows(row, by_run=row.ndim == 3, by_sample=True) for row in rows),
            Rows(times[:, None], by_sample=True),
            Rows(parameter_rows(problem), by_run=True),
            Rows(held_rows(loop, times), by_sample=True),
        ]
        evaluated = library.evaluation(program, tuple(each.length for each in given))
        return evaluated(problem.runs, len(times), given)

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
        """Solve and measure sample by sample on the way, if not all arrays are asked for.

        Runs with several spans or a sampled law, and functions that cannot be compiled, are
        measured from stored states.
        """
        times, one = problem.times, LoopKey(problem.loop)
        lengths = (problem.loop.state_length, *(row.shape[-1] for row in rows))
        found = None
        if kept is not None and len(problem.spans) == 1 and problem.loop.vehicle.control is None:
            grid = tuple(times.tolist())
            found = running(function, reduction, one, lengths, tuple(kept), grid)
        if found is None:
            return super().measured(function, reduction, problem, rows, kept, workers, progress)
        given = [
            *(Rows(np.ascontiguousarray(row), row.ndim == 3, by_sample=True) for row in rows),
            Rows(times[:, None].copy(), by_sample=True),
            Rows(held_rows(problem.loop, times), by_sample=True),
            Rows(found.columns, by_sample=True),
        ]
        ends, law = replace(problem, times=times[[0, -1]]), programs(one)
        at_samples = SampleProgram(found.at_sample, tuple(row.length for row in given))
        advance = self._integration(law.field, at_samples)
        lanes = MeasuringLanes(ends, law, self._settings, advance, found, times, given)
        solution = walked(lanes, self.groups(ends, workers), progress, workers)
        last = library.evaluation(found.ended, (len(found.starts),))
        numbers = last(problem.runs, 1, [Rows(lanes.memory, by_run=True)])
        ends_at = np.cumsum([math.prod(shape) for _, shape in found.kept])
        stretches = np.split(lanes.kept, ends_at, axis=-1)
        arrays = {
            name: stretch.reshape(*stretch.shape[:2], *shape)
            for (name, shape), stretch in zip(found.kept, stretches, strict=False)
        }
        return Measured(solution, {name: each[:, 0] for name, each in numbers.items()}, arrays)


def compiled_if_faster(engine: Engine, problem: Problem) -> Engine:
    """Return native, as accurate as an explicit method of solve_ivp, if it takes less time.

    Other engines, short problems and laws that cannot be compiled keep their engine.
    """
    if not isinstance(engine, SolveIvp) or engine.method not in FUNCTIONS:
        return engine
    long = max(len(problem.times), len(problem.spans)) >= WORTH_COMPILING
    if not long or Native.unavailable():
        return engine
    try:
        programs(LoopKey(problem.loop))
    except EqtError:
        return engine
    return Native(rtol=max(engine.rtol, SMALLEST_RTOL), atol=engine.atol)
