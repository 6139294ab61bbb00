"""DOP853 in C, compiled on this machine from the same laws that run on arrays.

The closed loop is traced once; its program is emitted as C, and templates in `c` integrate and
evaluate it. Everything that may differ from run to run is an input, so that one program serves all
runs of a structure. Each run has its own steps. All operations are fixed by IEEE 754, so that a run
has the same bits whatever its neighbours, its thread and the compiler.
"""

from __future__ import annotations

import ctypes
import math
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import EqtError, Problems, Remedy, TraceError
from eqt_cli.base.option_types import Count, Positive, Scale
from eqt_cli.base.stored import Status
from eqt_cli.components.laws import CodeCall, RunsCode
from eqt_cli.components.mechanics import LawInput
from eqt_cli.components.sensors import Errors
from eqt_cli.components.vehicle import command_length
from eqt_cli.engines import compiler, library
from eqt_cli.engines.engine import (
    SUSPECT,
    Engine,
    Failure,
    Integrator,
    Problem,
    Progress,
    Query,
    SampledFunction,
    Solution,
    Span,
    SpanResult,
    Work,
    walked,
)
from eqt_cli.engines.library import Rows, SampleProgram
from eqt_cli.engines.solve_ivp import FUNCTIONS, SolveIvp, steps
from eqt_cli.loop.closed_loop import MEMORY as CONTROLLER
from eqt_cli.loop.closed_loop import ClosedLoop, parts_of
from eqt_cli.loop.law_program import (
    INPUT,
    MEMORY,
    NUMBER,
    TORQUE,
    LawProgram,
    RunningPrograms,
    inputs_of,
    law_program,
    running,
    symbolic_loop,
)
from eqt_cli.numbers.leaves import leaves
from eqt_cli.numbers.program import NUMBERS, Chain, Numbers, Program, traced, with_numbers

# The programs of a loop: field, control instants, measurements ------------------------------------


ROWS = "law_rows"
"""Output of a program: the input of the user's code as `LawInput.rows` gives it."""


@dataclass(frozen=True)
class LoopPrograms:
    """The programs that move a closed loop; equal ones compile to the same code.

    Attributes
    ----------
    field
        Program of ``derivative``, the time derivative of a flat state.
    after_instant
        Program of ``state`` after a control instant; None if the law is not sampled, or if code
        takes part that is not compiled here: a user's own law, or a solver of the vehicle.
    around_code
        Programs of a control instant around such code.
    command
        Program of ``torque`` and ``memory``, the command of a law that is no such code, from the
        loop's inputs.
    """

    field: Program
    after_instant: Program | None
    around_code: InstantPrograms | None = None
    command: Program | None = None


MOST_OPERATIONS = 60_000
"""Operations of a function beyond which it is not compiled. gcc takes 2 s for 10,000, 20 s and 0.6
GB for 36,000, so about a minute for these; a count is the same under any load, unlike a time."""


@lru_cache(maxsize=64)
def programs(loop: ClosedLoop) -> LoopPrograms:
    """Return the programs of a closed loop, traced once.

    Raises
    ------
    TraceError
        If a component does what programs cannot; it names component, operation and remedy. Or if
        a program is too long to be compiled.
    """
    whole = _programs(loop)
    parts = [whole.field, whole.after_instant, whole.command]
    parts += [whole.around_code.input, whole.around_code.after] if whole.around_code else []
    longest = max(program.longest for program in parts if program is not None)
    if longest > MOST_OPERATIONS:
        raise TraceError(
            f"the loop takes {longest:,} operations at a time; beyond {MOST_OPERATIONS:,}, a C "
            "compiler takes more than a minute",
            Remedy("use engine solve_ivp"),
        )
    return whole


def _programs(loop: ClosedLoop) -> LoopPrograms:

    # A law is promised a leading run axis; here it has one entry.
    def field(inputs: Arrays) -> Arrays:
        rates = symbolic_loop(loop, inputs).vector_field(inputs["time"][0], inputs["state"][None])
        return {"derivative": rates[0]}

    numbers: Numbers = {}
    with _explained(loop):
        program = traced(field, inputs_of(loop, loop.moving_length), numbers)
    if loop.vehicle.control is None:
        return LoopPrograms(program, None)
    instant = at_instants(loop, numbers)
    program = with_numbers(program, numbers)
    if instant.law is None:
        return LoopPrograms(program, None, instant)
    if loop.vehicle.solves:
        return LoopPrograms(program, None, instant, instant.joined(loop))
    return LoopPrograms(program, instant.joined(loop))


@dataclass(frozen=True)
class InstantPrograms:
    """The programs of a control instant, in their order.

    Attributes
    ----------
    input
        Input of the law, by the names of `LawInput`, from the loop's inputs; and ``state``, if
        sensors hold their measurements; and `ROWS`, if C may call the code of the law.
    law
        Command of the law; None if the law is the user's code.
    after
        The new ``state``, from the loop's inputs with the measured state, ``torque``, the
        ``memory`` of the law, and ``solved``, the vehicle's solution, if it has one.
    """

    input: Program
    law: LawProgram | None
    after: Program

    def joined(self, loop: ClosedLoop) -> Program:
        """Return one program from the loop's inputs, bit for bit as the programs'.

        It gives ``state``; before a vehicle with a solver, ``torque``, ``memory`` if there is any,
        and the measured state.
        """
        control = loop.vehicle.control
        assert control is not None and self.law is not None
        chain = Chain(self.input.inputs)
        inputs = {group: chain.places_of(group) for group, _ in self.input.inputs}
        law_input = chain.then(self.input, inputs)
        places = {INPUT + entry.name: law_input[entry.source] for entry in self.law.inputs}
        for entry in self.law.numbers[:-1]:
            places[NUMBER + entry.name] = chain.places_of(*_stretch(loop, entry.source))
        places[NUMBER + self.law.numbers[-1].name] = chain.constant(control.period)
        places[NUMBERS] = inputs[NUMBERS][len(inputs[NUMBERS]) - len(self.input.numbers) :]
        for entry in self.law.memory:
            where = loop.layout.slices[CONTROLLER + entry.source]
            places[MEMORY + entry.name] = chain.places_of("state", where)
        answer = chain.then(self.law.step, places)
        memory = [place for entry in self.law.memory for place in answer[MEMORY + entry.name]]
        measured = {"state": law_input["state"]} if "state" in law_input else {}
        outputs = {"torque": answer[TORQUE]} | ({"memory": memory} if memory else {}) | measured
        if not loop.vehicle.solves:
            outputs = chain.then(self.after, {**inputs, "memory": memory, **outputs})
        return replace(chain.program(outputs), numbers=self.input.numbers)


def law_of(loop: ClosedLoop) -> LawProgram:
    """Return the law of a loop alone, with all its outputs.

    Raises
    ------
    TraceError
        If it does what programs cannot, as in `programs`.
    """
    with _explained(loop):
        return law_program(loop, with_outputs=True)


def at_instants(loop: ClosedLoop, numbers: Numbers | None = None) -> InstantPrograms:
    """Return the programs of control instants, all with the same `numbers` of expressions.

    Raises
    ------
    TraceError
        If a component does what programs cannot, as in `programs`.
    """
    code = loop.controller if isinstance(loop.controller, RunsCode) else None
    lengths = loop.vehicle.error_lengths(loop.group) if loop.vehicle.measures else ()

    def law_input(inputs: Arrays) -> Arrays:
        symbolic, (t,), state = symbolic_loop(loop, inputs), inputs["time"], inputs["state"][None]
        errors = None
        if "errors" in inputs:  # E = exp(n); without noise of the pose, E = 1
            G, parts = loop.group, np.split(inputs["errors"], np.cumsum(lengths)[:-1])
            n, *others = (part[None] for part in parts)
            errors = Errors(G.exp(n) if loop.vehicle.pose_sensors else G.identity[None], *others)
        state = symbolic.measured(t, state, errors)
        law = symbolic.law_input(t, state, errors)
        signals = {
            name: np.asarray(value) if name == "t" else value[0]
            for name, value in law._asdict().items()
            if value is not None
        }
        if loop.changes_by_measuring:
            signals["state"] = state[0]
        if code and code.code_call:
            signals[ROWS] = code.code_rows(loop.group, law)[0]
        return signals

    def after(inputs: Arrays) -> Arrays:
        symbolic, (t,), state = symbolic_loop(loop, inputs), inputs["time"], inputs["state"][None]
        of_law = loop.controller.memory(loop.group)
        parts = np.split(inputs["memory"][None], np.cumsum([*of_law.values()]), axis=1)
        memory = dict(zip(of_law, parts, strict=False))
        solved = inputs["solved"][None] if "solved" in inputs else None
        return {"state": symbolic.after_answer(t, state, inputs["torque"][None], memory, solved)[0]}

    commands = command_length(loop.vehicle, loop.group)
    inputs = inputs_of(loop, loop.state_length)
    measured = inputs | ({"errors": sum(lengths)} if lengths else {})
    remembered = sum(loop.controller.memory(loop.group).values())
    solved = {"solved": loop.vehicle.solves} if loop.vehicle.solves else {}
    numbers = {} if numbers is None else numbers
    with _explained(loop):
        law_inputs = traced(law_input, measured, numbers)
        law = None if code else law_program(loop, expressed=numbers)
        states = traced(
            after, inputs | {"torque": commands, "memory": remembered} | solved, numbers
        )
    return InstantPrograms(with_numbers(law_inputs, numbers), law, states)


@contextmanager
def _explained(loop: ClosedLoop) -> Iterator[None]:
    """Raise a `TraceError` that names the component which did what programs cannot."""
    try:
        yield
    except TraceError:
        raise
    except Exception as error:
        raise TraceError(_explain(error, loop)) from error


def _stretch(loop: ClosedLoop, parameter: str) -> tuple[str, slice]:
    """Return the group of inputs that a number is in, and its slice."""
    of_run, held = leaves(loop), loop.holding(0.0).held_leaves
    group, numbers = ("parameters", of_run) if parameter in of_run else ("held", held)
    sizes = {path: number.size for path, number in numbers.items()}
    end = dict(zip(sizes, np.cumsum(list(sizes.values())).tolist(), strict=True))[parameter]
    return group, slice(end - sizes[parameter], end)


@lru_cache(maxsize=64)
def sampled(
    function: SampledFunction, loop: ClosedLoop, lengths: tuple[int, ...]
) -> Program | None:
    """Trace a function of the loop; None if it does what programs cannot.

    Its rows of numbers follow each other in ``state``. Unlike a law, such a function need not be
    compiled: an actuator may compute by NumPy alone where it is at its limit, and a law its
    Lyapunov function.
    """

    def arrays(inputs: Arrays) -> Arrays:
        rows = np.split(inputs["state"][None], np.cumsum(lengths)[:-1], axis=1)
        computed = function(symbolic_loop(loop, inputs), inputs["time"][0], *rows)
        return {name: np.asarray(values)[0] for name, values in computed.items()}

    try:
        program = traced(arrays, inputs_of(loop, sum(lengths)), {})
        return program if program.longest <= MOST_OPERATIONS else None
    except Exception:
        return None


def parameter_rows(problem: Problem) -> Array:
    """Return every run's leaves in a row, in the order in which they are traced."""
    columns = problem.leaves_of_runs().values()
    rows = np.concatenate([values.reshape(problem.runs, -1) for values in columns], axis=1)
    return np.ascontiguousarray(rows, dtype=float)  # as C reads them


def held_rows(loop: ClosedLoop, times: Array, program: Program) -> Array:
    """Return the numbers held from each of these times to the next instant, a row each.

    Those of the expressions in a program follow them.
    """
    rows = [value.reshape(len(times), -1) for value in loop.holding(times).held_leaves.values()]
    rows.append(np.tile(program.numbers, (len(times), 1)))
    return np.ascontiguousarray(np.concatenate(rows, axis=1), dtype=float)  # as C reads them


def _explain(error: Exception, loop: ClosedLoop) -> str:
    """Describe which component did what, from its frames in the traceback."""
    # The traced components are copies of the same classes, with symbols for numbers.
    names = {type(part): name for part, _, name in reversed(parts_of(loop))}
    places: dict[str, str] = {}
    for frame, line in traceback.walk_tb(error.__traceback__):
        name = names.get(type(frame.f_locals.get("self")))
        if name:
            summary = traceback.FrameSummary(frame.f_code.co_filename, line, frame.f_code.co_name)
            places[name] = f"{Path(frame.f_code.co_filename).name}:{line}: {summary.line}"
    (owner, place), *callers = reversed((places or {"the closed loop": ""}).items())
    where = f" at {place}" if place else ""
    called = "".join(f", called by {name} at {where}" for name, where in callers)
    return (
        f"{owner} cannot be compiled: {type(error).__name__}: {error}{where}{called}; write it "
        "with operators, @ and the functions of eqt_cli.extend, or use `engine: solve_ivp`"
    )


# Integration of runs through a span by compiled DOP853; each run has its own steps ----------------


RUN_SPANS = 50_000
"""Most spans, counted for each run, between two reports of progress: some tenths of a second."""

LEFT = library.STOPPED + 1
"""Outcome of a run that has ended at an instant."""


def _at_one_time(program: Program, runs: int, inputs: list[Rows]) -> dict[str, Array]:
    """Return the arrays of a program for some runs, ``(runs, …)`` each."""
    arrays = library.evaluated(program, runs, 1, inputs)
    return {name: values[:, 0] for name, values in arrays.items()}


class Lanes(Integrator):
    """Integrates a group of runs, as many side by side as there are lanes.

    Parameters
    ----------
    law
        The programs of the loop.
    settings
        ``rtol`` and ``atol``, the tolerances of a step, and ``most_steps``, of a run.
    at_samples
        Program that looks at each sample; without it, states are stored.
    """

    _walk: library.Walk | None
    ends_stopped = True

    def __init__(
        self,
        problem: Problem,
        law: LoopPrograms,
        settings: Mapping[str, float],
        at_samples: SampleProgram | None = None,
    ) -> None:
        super().__init__(problem)
        self._law = law
        self._settings = settings
        self._all_parameters = parameter_rows(problem)
        self._span_starts = np.array([span.start for span in problem.spans])
        self._all_held = held_rows(problem.loop, self._span_starts, law.field)
        control = problem.loop.vehicle.control
        self._listed = np.empty(0, library.WALKED)
        if control is not None and not problem.loop.vehicle.solves:
            rows: list[tuple[float | int, ...]] = []
            for span in problem.spans:
                times = (span.start, span.stop, *span.within, span.longest)
                samples = (span.first, span.later, int(span.sampled_start))
                is_due = span.tick is not None and control.clock.is_due(span.tick)
                rows.append((*times, *samples, -1 if span.tick is None else span.tick, int(is_due)))
            self._listed = np.array(rows, library.WALKED)
        self._advance = library.integration(law.field, at_samples, walks=len(self._listed) > 0)

    def begin(self, runs: Array) -> None:
        """Begin these runs with no step taken, and the length of the first one unknown."""
        if self.stop is None:
            raise RuntimeError("lanes are moved by `walked`, which sets `stop`; use Native.solve")
        if self._law.around_code is not None:
            super().begin(runs)
        self._parameters = self._all_parameters[runs]
        self._times = np.zeros(len(runs))
        self._counts, self._ends = np.zeros((2, len(runs)), dtype=np.int64)
        self._of_runs = {
            "parameters": self._parameters,
            "steps": np.zeros(len(runs)),
            "counts": self._counts,
            "ends": self._ends,
            "times": self._times,
            "stopped": self.stop,
            **self._settings,
        }
        self._walk = self._walking(runs) if len(self._listed) else None

    def _walking(self, runs: Array) -> library.Walk | None:
        """Return what walks these runs through many spans; None where Python has to take part."""
        loop, around, samples = self.problem.loop, self._law.around_code, self.samples
        law = None if around is None else self.loop.controller
        call = law.code_call if isinstance(law, RunsCode) else None
        program = self._law.after_instant if around is None else around.input if call else None
        if samples is None or program is None:
            return None
        self._whole = np.empty((len(runs), loop.state_length))
        walk = library.Walk(
            self._law.field,
            self._listed,
            {"times": self.problem.times, "held": self._all_held, "samples": samples},
            to_next_run=samples[0].size,
            states=self._whole,
            **self._of_runs,
        )
        inputs = [
            Rows(self._whole, by_run=True),
            Rows(self._span_starts[:, None], by_sample=True),
            Rows(self._parameters, by_run=True),
            Rows(self._all_held, by_sample=True),
        ]
        parts = () if self.errors_at(0) is None else self.errors.of_runs
        measured = [Rows(part[0].reshape(len(runs), -1), by_run=True) for part in parts]
        outputs = walk.evaluate(program, [*inputs, *measured], len(measured))
        if around is not None and call is not None:
            outputs = self._call_code(walk, call, around.after, outputs, inputs)
        lost = -1 if loop.lost_at is None else loop.lost_at
        walk.set(commanded=outputs["state"], suspicious=SUSPECT, lost=lost)
        return walk

    def _call_code(
        self, walk: library.Walk, call: CodeCall, after: Program, outputs: Arrays, rows: list[Rows]
    ) -> Arrays:
        """Have the user's code called in C, between both programs around it."""
        loop, count = self.problem.loop, len(self.runs)
        slices = loop.layout.slices.items()
        memory = [place for name, place in slices if name.startswith(CONTROLLER)]
        length = sum(place.stop - place.start for place in memory)
        states = outputs.get("state", self._whole).reshape(self._whole.shape)
        commands = command_length(loop.vehicle, loop.group)
        torques, memories = np.zeros((count, commands)), np.empty((count, length))
        walk.set(
            code=ctypes.cast(call.function, ctypes.c_void_p).value,
            begins=call.begins,
            period=float(loop.period),
            measured=states,
            options=np.broadcast_to(call.options, (count, call.options.shape[-1])).copy(),
            law_inputs=outputs[ROWS],
            torques=torques,
            memory=memories,
            memory_at=memory[0].start if memory else 0,
            memory_length=length,
        )
        answer_rows = (Rows(values, by_run=True) for values in (torques, memories))
        return walk.evaluate(after, [Rows(states, by_run=True), *rows[1:], *answer_rows])

    def hold(self, span: Span) -> None:
        """Set the held numbers, which all runs share."""
        self._held = self._all_held[np.searchsorted(self._span_starts, span.start)]

    def leave(self, places: list[int]) -> None:
        """Integrate these runs no further."""
        self._ends[places] = np.where(self._ends[places], self._ends[places], LEFT)

    def walk_ahead(self, place: int, states: Array) -> tuple[int, Array, Array | int, Array | int]:
        """Walk in C, as far as sensor errors are known; see `Integrator.walk_ahead`."""
        if self._walk is None:
            return super().walk_ahead(place, states)
        stop, before = place + max(1, RUN_SPANS // len(states)), self._counts.copy()
        ticks = self._listed["tick"][place:stop]
        if self.drawn is not None and ticks.max() >= 0:
            self.errors_at(int(ticks[ticks >= 0][0]))
            self._walk.measure(self.errors.of_runs, self.ahead.start)
            stop = place + int(np.searchsorted(np.maximum.accumulate(ticks), self.ahead.stop))
        self._whole[...] = states
        place = self._walk(place, min(stop, len(self._listed)))
        return place, self._whole.copy(), self._counts - before, self._counts - self._walk.counts

    def measured(self, drawn: Errors) -> Errors:
        """Return sensor errors as they are drawn, because the programs compute E."""
        return drawn

    def at_instant(self, t: float, states: Array, errors: Errors | None) -> Array:
        """Return the states after an instant, by compiled code.

        A user's own law and a solver of the vehicle are called between two programs.
        """
        runs = len(states)
        inputs = [
            Rows(states, by_run=True),
            Rows(np.array([t])),
            Rows(self._parameters, by_run=True),
            Rows(self._held),
        ]
        parts = errors.of_runs if errors else ()
        measured = [Rows(part.reshape(runs, -1), by_run=True) for part in parts]
        around, program = self._law.around_code, self._law.after_instant
        if around is not None:
            torque, memory, states = self._answer(t, states, around, [*inputs, *measured])
            inputs[0] = Rows(states, by_run=True)  # with the held measurements
            inputs += [Rows(torque, by_run=True), Rows(memory, by_run=True)]
            if self.loop.vehicle.solves:
                inputs.append(Rows(self.loop.solution(states, torque), by_run=True))
            program = around.after
        else:
            inputs += measured
        assert program is not None
        return _at_one_time(program, runs, inputs)["state"]

    def _answer(
        self, t: float, states: Array, around: InstantPrograms, inputs: list[Rows]
    ) -> tuple[Array, Array, Array]:
        """Return the commanded torque, the law's memory and the measured states, a row per run."""
        runs, none = len(states), np.empty((len(states), 0))
        if self._law.command is not None:
            outputs = _at_one_time(self._law.command, runs, inputs)
            return outputs["torque"], outputs.get("memory", none), outputs.get("state", states)
        outputs = _at_one_time(around.input, runs, inputs)
        states = outputs.pop("state", states)
        rows = outputs.pop(ROWS, None)
        torque, memory = self.loop.answer_if_due(LawInput(**outputs)._replace(t=t), states, rows)
        return torque, np.concatenate([none, *memory.values()], axis=1), states

    def advance(self, span: Span, states: Array) -> SpanResult:
        """Integrate the runs that have not failed, leaving the others as they are."""
        was, before, samples = self._ends.copy(), self._counts.copy(), self.room(span)
        ended = self._advanced(span, states, span.grid[1 : 1 + span.later], samples)
        failed: dict[int, Failure | None] = {}
        if self._ends.any():
            for run in np.flatnonzero(self._ends):
                reached = (
                    0 if was[run] else np.searchsorted(span.grid[1:], self._times[run], "right")
                )
                samples[run, reached:] = np.nan
                failed[int(run)] = self._failure(run)
        return SpanResult(ended, samples, self._counts - before, failed)

    def _advanced(
        self, span: Span, states: Array, times: Array, samples: Array, measuring: Any = None
    ) -> Array:
        """Return the states at the end of a span; those at sample times are stored or measured."""
        ended = np.array(states, order="C")
        self._advance(
            measuring=measuring,
            runs=len(states),
            later=len(times),
            to_next_run=samples.strides[0] // samples.itemsize,
            start=span.start,
            stop=span.stop,
            first_inside=span.within[0],
            last_inside=span.within[1],
            longest=span.longest,
            grid=np.array(times),
            held=self._held,
            states=ended,
            samples=samples,
            **self._of_runs,
        )
        return ended

    def _failure(self, run: Any) -> Failure:
        """Return how and when a run has ended."""
        end, t = self._ends[run], float(self._times[run])
        if end == library.STEP_LIMIT:
            reason = f"step limit: {self._settings['most_steps']} steps (solver.max_steps)"
            return Failure(Status.STEP_LIMIT, reason, t)
        if end == library.STOPPED:
            return Failure(Status.STOPPED, "stopped", t)
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
    stored : (runs, samples, stored)
        Numbers that it keeps of each sample.
    """

    def __init__(
        self,
        problem: Problem,
        law: LoopPrograms,
        settings: Mapping[str, float],
        measures: RunningPrograms,
        times: Array,
        rows: Sequence[Rows],
    ) -> None:
        at_samples = SampleProgram(measures.at_sample, tuple(row.length for row in rows))
        super().__init__(problem, law, settings, at_samples=at_samples)
        self._sample_times, self._rows, self._starts = times, rows, measures.starts
        self.memory = np.empty((problem.runs, len(measures.starts)))
        length = sum(math.prod(shape) for _, shape in measures.stored)
        self.stored = np.empty((problem.runs, len(times), length))

    def advance(self, span: Span, states: Array) -> SpanResult:
        """Integrate and measure these runs, which are neighbours."""
        here = slice(int(self.runs[0]), int(self.runs[0]) + len(self.runs))
        rows = [row.of(here) for row in self._rows]
        memory, stored = self.memory[here], self.stored[here]
        measuring = library.measuring(rows, self._starts, memory, stored)
        ended = self._advanced(span, states, self._sample_times[1:], self.stored, measuring)
        failed = {int(run): self._failure(run) for run in np.flatnonzero(self._ends)}
        return SpanResult(ended, ended[:, None], self._counts, failed)


# The engine ---------------------------------------------------------------------------------------


STEP_SHARE = 1 / 30
"""The tolerance of a step, as a fraction of the accuracy that the results are judged by."""

SMALLEST_RTOL = 1000 * float(np.finfo(float).eps)
"""Smallest `rtol`: a hundredth of it, the error of a step, is still above rounding."""

WORTH_COMPILING = 200
"""Number of samples or spans from which a few runs as Python take longer than to compile a law."""

BLOCK_BYTES = 16 * 2**20
"""Memory for the states of a block of runs, which are measured when they are solved. Where C walks
them through many spans, their errors of sensors count, and it is twice as much."""

FEW_RUNS = 16
"""Most runs whose samples are stored and then measured, by code that is compiled in a third of the
time; their numbers have the same bits as those of many runs."""

GROUP_RUNS = 256
"""Number of runs that a thread integrates at a time: their states and samples fit its cache."""


@dataclass(frozen=True)
class Native(Engine):
    """DOP853 in C, compiled on this machine, in operations that IEEE 754 fixes to the bit.

    Attributes
    ----------
    rtol, atol
        Relative and absolute accuracy of the results; a step keeps its error below a thirtieth of
        it.
    max_steps
        Most steps of a run.
    """

    name: ClassVar[str] = "native"

    rtol: Annotated[Positive, Scale("relative tolerance")] = 1e-9
    atol: Annotated[Positive, Scale("absolute tolerance")] = 1e-12
    max_steps: Count = 1_000_000

    @classmethod
    def unavailable(cls) -> str | None:
        """Return how to get a compiler; None if there is one."""
        return compiler.missing()

    def check(self, problems: Problems) -> None:
        """Note a tolerance that doubles cannot meet, or that is not below 1."""
        if not SMALLEST_RTOL <= self.rtol < 1:
            limits = f"expected a number from {SMALLEST_RTOL:.3g} to 1"
            problems.at("rtol").add(f"{limits}, got {self.rtol:g}")

    def tightened(self, factor: float) -> Native:
        """Return the engine with both tolerances times `factor`."""
        return replace(self, rtol=self.rtol * factor, atol=self.atol * factor)

    def work_for_stability(self, rates: Array, duration: float) -> Work:
        """Return steps of DOP853."""
        return Work(steps(FUNCTIONS["DOP853"], rates, duration))

    def provenance(self) -> dict[str, str]:
        """Return the compiler, if there is one: shards are packed without."""
        with suppress(EqtError):
            chosen = compiler.compiler()
            return {"compiler": chosen.described, "lanes": str(chosen.lanes)}
        return {}

    def integrator(self, problem: Problem) -> Lanes:
        """Return the integrator of lanes, whose steps depend on their own run only."""
        return Lanes(problem, programs(problem.loop), self._settings)

    @property
    def _settings(self) -> dict[str, float]:
        """The tolerances of a step, and the most steps."""
        rtol, atol = self.rtol * STEP_SHARE, self.atol * STEP_SHARE
        return {"rtol": rtol, "atol": atol, "most_steps": self.max_steps}

    def groups(self, problem: Problem, threads: int) -> list[Array]:
        """Return groups of a few runs, equally many per thread; one each with several spans."""
        of_thread = -(-problem.runs // threads)
        turns = max(1, -(-of_thread // GROUP_RUNS)) if len(problem.spans) == 1 else 1
        size = max(1, -(-problem.runs // (turns * threads)))
        runs = np.arange(problem.runs)
        return [runs[start : start + size] for start in range(0, problem.runs, size)]

    def rehearse(self, problem: Problem) -> None:
        """Trace the law, which may fail, without compiling it."""
        programs(problem.loop)

    def blocks(self, problem: Problem, threads: int = 1) -> list[Array]:
        """Return blocks of as many runs per thread as fit a cache with their results.

        All runs are one block if Python walks them through several spans.
        """
        runs, loop = np.arange(problem.runs), problem.loop
        walks = loop.vehicle.control is not None and not loop.vehicle.solves
        if len(problem.spans) > 1 and not walks:
            return [runs]
        states = len(problem.times) * loop.state_length
        errors = 2 * problem.control_instants * loop.group.dimension
        fitting = BLOCK_BYTES * (2 if walks else 1) // (8 * (states + errors))
        return np.array_split(runs, -(-problem.runs // (max(1, fitting) * threads)))

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array] | None:
        """Evaluate by compiled code; None if the function cannot be compiled."""
        loop, times = problem.loop, problem.times
        program = sampled(function, loop, tuple(row.shape[-1] for row in rows))
        if program is None:
            return None
        inputs = [
            *(Rows(row, by_run=row.ndim == 3, by_sample=True) for row in rows),
            Rows(times[:, None], by_sample=True),
            Rows(parameter_rows(problem), by_run=True),
            Rows(held_rows(loop, times, program), by_sample=True),
        ]
        return library.evaluated(program, problem.runs, len(times), inputs)

    def measure(
        self, problem: Problem, query: Query, workers: int, progress: Progress
    ) -> Solution | None:
        """Solve and measure sample by sample on the way, if not all arrays are asked for.

        Few runs, those with several spans or a sampled law, and functions that cannot be compiled,
        are measured from stored states.
        """
        loop, times, (function, reduction, rows, returned) = problem.loop, problem.times, query
        lengths = (loop.state_length, *(row.shape[-1] for row in rows))
        if returned is None or problem.runs <= FEW_RUNS:
            return None
        if len(problem.spans) > 1 or loop.vehicle.control:
            return None
        grid = tuple(times.tolist())
        measures = running(function, reduction, loop, lengths, tuple(returned), grid)
        if measures is None:
            return None
        inputs = [
            *(Rows(row, row.ndim == 3, by_sample=True) for row in rows),
            Rows(times[:, None], by_sample=True),
            Rows(held_rows(loop, times, measures.at_sample), by_sample=True),
            Rows(measures.columns, by_sample=True),
        ]
        ends, law = replace(problem, times=times[[0, -1]]), programs(loop)
        lanes = MeasuringLanes(ends, law, self._settings, measures, times, inputs)
        solution = walked(lanes, self.groups(ends, workers), progress, workers)
        numbers = _at_one_time(measures.ended, problem.runs, [Rows(lanes.memory, by_run=True)])
        ends_at = np.cumsum([math.prod(shape) for _, shape in measures.stored])
        stretches = np.split(lanes.stored, ends_at, axis=-1)
        arrays = {
            name: stretch.reshape(*stretch.shape[:2], *shape)
            for (name, shape), stretch in zip(measures.stored, stretches, strict=False)
        }
        return replace(solution, numbers=numbers, arrays=arrays)


def refusal(loops: Iterable[ClosedLoop] = ()) -> TraceError | None:
    """Return why native cannot solve loops on this machine; None if it can."""
    try:
        compiler.compiler()
        for loop in loops:
            programs(loop)
    except TraceError as error:
        return error
    return None


def compiled_if_faster(engine: Engine, problem: Problem) -> Engine:
    """Return native, as accurate as an explicit method of solve_ivp, if it takes less time.

    Other engines, short problems and laws that cannot be compiled keep their engine.
    """
    long = max(len(problem.times), len(problem.spans)) >= WORTH_COMPILING
    return compiled_if_possible(engine, problem) if long else engine


def compiled_if_possible(engine: Engine, problem: Problem) -> Engine:
    """Return native, as accurate as an explicit method of solve_ivp: its bits are any machine's.

    Other engines and laws that cannot be compiled keep their engine.
    """
    if not isinstance(engine, SolveIvp) or engine.method not in FUNCTIONS:
        return engine
    if refusal([problem.loop]):
        return engine
    return Native(rtol=max(engine.rtol, SMALLEST_RTOL), atol=engine.atol)
