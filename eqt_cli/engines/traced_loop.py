"""The programs of a closed loop, for engines that compile it: field, instants and measurements.

Everything that may differ from run to run is an input, so that one program serves all runs of a
structure. It knows no engine.
"""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import TracebackType

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import TraceError
from eqt_cli.components.sensors import Errors
from eqt_cli.engines.engine import Problem, Reduction, SampledFunction
from eqt_cli.loop.closed_loop import MEMORY as CONTROLLER
from eqt_cli.loop.closed_loop import ClosedLoop, parts_of
from eqt_cli.loop.law_program import MEMORY, NUMBER, TOLD, TORQUE, LawProgram, law_program
from eqt_cli.numbers.leaves import leaves, with_leaves
from eqt_cli.numbers.program import Chain, Program
from eqt_cli.numbers.running import Memory, Running
from eqt_cli.numbers.symbols import traced

MOST_RUNNING = 512
"""Most numbers that a reduction may keep from sample to sample."""

Arrays = Mapping[str, Array]
"""Symbols by the names of the groups of inputs: ``state``, ``time``, ``parameters``, ``held``, and
at a control instant ``errors``, the numbers of `Errors` one after the other."""


@dataclass(frozen=True, eq=False)
class LoopKey:
    """A loop compared by identity, as a cache key: it is traced only once."""

    loop: ClosedLoop

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LoopKey) and self.loop is other.loop

    def __hash__(self) -> int:
        return id(self.loop)


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
    asked
        Program of ``torque`` and ``memory``, the command of a law that is no such code, from the
        loop's inputs.
    """

    field: Program
    after_instant: Program | None
    around_code: InstantPrograms | None = None
    asked: Program | None = None


@lru_cache(maxsize=64)
def programs(one: LoopKey) -> LoopPrograms:
    """Return the programs of a loop, traced once."""
    return trace(one.loop)


def trace(loop: ClosedLoop) -> LoopPrograms:
    """Trace a closed loop to its programs.

    Raises
    ------
    TraceError
        If a component does what programs cannot; it names component, operation and remedy.
    """

    # A law is promised a leading run axis; here it has one entry.
    def field(given: Arrays) -> Mapping[str, Array]:
        rates = _symbolic(loop, given).vector_field(given["time"][0], given["state"][None])
        return {"derivative": rates[0]}

    with _explained(loop):
        program = traced(field, _inputs(loop, loop.moving_length))
    if loop.vehicle.control is None:
        return LoopPrograms(program, None)
    instant = at_instants(loop)
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
    told
        Input of the law, by the names of `LawInput`, from the loop's inputs; and ``state``, if
        sensors hold their measurements.
    law
        Command of the law; None if the law is the user's code.
    answered
        The new ``state``, from the loop's inputs with the measured state, ``torque``, the
        ``memory`` of the law, and ``solved``, the vehicle's solution, if it has one.
    """

    told: Program
    law: LawProgram | None
    answered: Program

    def joined(self, loop: ClosedLoop) -> Program:
        """Return one program from the loop's inputs, bit for bit as the programs'.

        It gives ``state``; before a vehicle with a solver, ``torque``, ``memory`` if there is any,
        and the measured state.
        """
        control = loop.vehicle.control
        assert control is not None and self.law is not None
        chain = Chain(dict(self.told.inputs))
        inputs = {group: chain.given(group) for group, _ in self.told.inputs}
        told = chain.then(self.told, inputs)
        given = {TOLD + entry.name: told[entry.source] for entry in self.law.told}
        for entry in self.law.numbers[:-1]:
            given[NUMBER + entry.name] = chain.given(*_stretch(loop, entry.source))
        given[NUMBER + self.law.numbers[-1].name] = chain.constant(control.period)
        for entry in self.law.memory:
            where = loop.layout.slices[CONTROLLER + entry.source]
            given[MEMORY + entry.name] = chain.given("state", where)
        answer = chain.then(self.law.step, given)
        memory = [place for entry in self.law.memory for place in answer[MEMORY + entry.name]]
        measured = {"state": told["state"]} if "state" in told else {}
        outputs = {"torque": answer[TORQUE]} | ({"memory": memory} if memory else {}) | measured
        if not loop.vehicle.solves:
            outputs = chain.then(self.answered, {**inputs, "memory": memory, **outputs})
        return chain.program({name: ((len(places),), places) for name, places in outputs.items()})


def law_of(loop: ClosedLoop) -> LawProgram:
    """Return the law of a loop by itself.

    Raises
    ------
    TraceError
        If it does what programs cannot, as in `trace`.
    """
    with _explained(loop):
        return law_program(loop)


def at_instants(loop: ClosedLoop) -> InstantPrograms:
    """Return the programs of control instants.

    Raises
    ------
    TraceError
        If a component does what programs cannot, as in `trace`.
    """

    def told(given: Arrays) -> Mapping[str, Array]:
        symbolic, (t,), state = _symbolic(loop, given), given["time"], given["state"][None]
        errors = _errors(loop, given)
        state = symbolic.measured(t, state, errors)
        law_input = symbolic.told(t, state, errors)._asdict() | ({"state": state} if holds else {})
        arrays = {name: np.asarray(value) for name, value in law_input.items() if value is not None}
        return {name: value if name == "t" else value[0] for name, value in arrays.items()}

    def answered(given: Arrays) -> Mapping[str, Array]:
        symbolic, (t,), state = _symbolic(loop, given), given["time"], given["state"][None]
        lengths = loop.controller.memory(loop.group)
        parts = np.split(given["memory"][None], np.cumsum([*lengths.values()]), axis=1)
        memory = dict(zip(lengths, parts, strict=False))
        solved = given["solved"][None] if "solved" in given else None
        return {"state": symbolic.answered(t, state, given["torque"][None], memory, solved)[0]}

    m, holds = loop.group.dimension, loop.changes_by_measuring
    inputs = _inputs(loop, loop.state_length)
    measured = inputs | ({"errors": sum(_lengths(loop))} if loop.vehicle.measures else {})
    remembered = sum(loop.controller.memory(loop.group).values())
    solved = {"solved": loop.vehicle.solves} if loop.vehicle.solves else {}
    with _explained(loop):
        return InstantPrograms(
            traced(told, measured),
            None if loop.controller.code else law_program(loop),
            traced(answered, inputs | {"torque": m, "memory": remembered} | solved),
        )


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
    own, held = leaves(loop), loop.holding(0.0).held_leaves
    group, numbers = ("parameters", own) if parameter in own else ("held", held)
    sizes = {path: number.size for path, number in numbers.items()}
    end = dict(zip(sizes, np.cumsum(list(sizes.values())).tolist(), strict=True))[parameter]
    return group, slice(end - sizes[parameter], end)


@lru_cache(maxsize=64)
def sampled(function: SampledFunction, one: LoopKey, lengths: tuple[int, ...]) -> Program | None:
    """Trace a function of the loop; None if it does what programs cannot.

    Its rows of numbers follow each other in ``state``. Unlike a law, such a function need not be
    compiled: an actuator may compute by NumPy alone where it is at its limit, and a law its
    Lyapunov function.
    """

    def arrays(given: Arrays) -> Mapping[str, Array]:
        rows = np.split(given["state"][None], np.cumsum(lengths)[:-1], axis=1)
        computed = function(_symbolic(one.loop, given), given["time"][0], *rows)
        return {name: np.asarray(values)[0] for name, values in computed.items()}

    try:
        return traced(arrays, _inputs(one.loop, sum(lengths)))
    except Exception:
        return None


@dataclass(frozen=True)
class RunningPrograms:
    """The programs that measure runs, sample by sample.

    Attributes
    ----------
    at_sample
        Program of ``memory`` after a sample and of its ``kept`` numbers. Besides the inputs of the
        loop, with the rows of `sampled`, it takes ``columns``, numbers of the sample, and
        ``memory``.
    ended
        Program of the numbers of a run, from ``memory``.
    starts
        The memory before the first sample.
    columns : (samples, n)
        Numbers that belong to each sample.
    kept
        Name and shape of each array that is kept of a sample.
    """

    at_sample: Program
    ended: Program
    starts: Array
    columns: Array
    kept: tuple[tuple[str, tuple[int, ...]], ...]


@lru_cache(maxsize=64)
def running(
    function: SampledFunction,
    reduction: Reduction,
    one: LoopKey,
    lengths: tuple[int, ...],
    kept: tuple[str, ...],
    times: tuple[float, ...],
) -> RunningPrograms | None:
    """Trace a reduction as a running computation; None if it does what programs cannot.

    Parameters
    ----------
    kept
        Names of the function's arrays that are kept.
    """
    loop, shapes, memory = one.loop, {}, Memory(np.empty(0), np.empty(0))
    over = np.array(times)

    def at_sample(given: Arrays) -> Mapping[str, Array]:
        nonlocal memory
        rows = np.split(given["state"][None], np.cumsum(lengths)[:-1], axis=1)
        computed = function(_symbolic(loop, given), given["time"][0], *rows)
        memory = Memory(given["memory"], given["columns"])
        reduction(Running(over, memory), computed)
        shapes.update({name: np.shape(values) for name, values in computed.items()})
        stretches = [np.ravel(computed[name]) for name in kept]
        return {
            "memory": np.array(memory.after, dtype=object),
            "kept": np.concatenate([np.empty(0, dtype=object), *stretches]),
        }

    def ended(given: Arrays) -> Mapping[str, Array]:
        blank = {name: np.zeros(shape) for name, shape in shapes.items()}
        behind = Memory(given["memory"], np.zeros(len(memory.columns)), ended=True)
        numbers = reduction(Running(over, behind), blank)
        return {name: np.asarray(number)[0] for name, number in numbers.items()}

    inputs = _inputs(loop, sum(lengths))
    try:
        traced(at_sample, inputs | {"columns": MOST_RUNNING, "memory": MOST_RUNNING})
        columns = np.array(memory.columns).reshape(-1, len(times)).T.copy()
        sizes = {"columns": columns.shape[1], "memory": len(memory.after)}
        program = traced(at_sample, inputs | sizes)
        last = traced(ended, {"memory": sizes["memory"]})
        of_sample = tuple((name, shapes[name][1:]) for name in kept)
        return RunningPrograms(program, last, np.array(memory.starts), columns, of_sample)
    except Exception:
        return None


def _inputs(loop: ClosedLoop, length: int) -> dict[str, int]:
    parameters, held = (
        sum(number.size for number in numbers.values())
        for numbers in (leaves(loop), loop.holding(0.0).held_leaves)
    )
    return {"state": length, "time": 1, "parameters": parameters, "held": held}


def _symbolic(loop: ClosedLoop, given: Arrays) -> ClosedLoop:
    """Return the loop with symbols for all its numbers, in the order of the rows."""
    holding = loop.holding(0.0)
    symbols, numbers = np.concatenate([given["parameters"], given["held"]]), leaves(holding)
    ends = np.cumsum([value.size for value in numbers.values()])
    parts = zip(numbers.items(), np.split(symbols, ends), strict=False)
    # Each has a leading run axis.
    cut = {name: part.reshape(1, *value.shape) for (name, value), part in parts}
    return with_leaves(holding, cut)


def _errors(loop: ClosedLoop, given: Arrays) -> Errors | None:
    """Return the sensor errors at an instant."""
    if "errors" not in given:
        return None
    d = loop.group.size
    pose, *others = np.split(given["errors"], np.cumsum(_lengths(loop))[:-1])
    return Errors(pose.reshape(1, d, d), *(part[None] for part in others))


def _lengths(loop: ClosedLoop) -> tuple[int, int, int, int]:
    """Return the number of entries of each part of `Errors`."""
    G, estimates = loop.group, loop.vehicle.estimator is not None
    return G.size**2, G.dimension, len(loop.vehicle.holding(G)), G.dimension * estimates


def parameter_rows(problem: Problem) -> Array:
    """Return every run's leaves in a row, in the order in which they are traced."""
    columns = []
    for name, shared in leaves(problem.loop).items():
        values = problem.varying.get(name)
        if values is None:
            values = np.broadcast_to(shared, (problem.runs, *shared.shape))
        columns.append(values.reshape(problem.runs, -1))
    return np.concatenate(columns, axis=1)


def held_rows(loop: ClosedLoop, times: Array) -> Array:
    """Return the numbers held from each of these times to the next instant, a row each."""
    held = loop.holding(times).held_leaves.values()
    rows = [value.reshape(len(times), -1) for value in held]
    return np.concatenate([np.empty((len(times), 0)), *rows], axis=1)


def _explain(error: Exception, loop: ClosedLoop) -> str:
    """Describe which component did what, from its frames in the traceback."""
    places = _places(error.__traceback__, loop) or {"the closed loop": ""}
    (owner, place), *callers = reversed(places.items())
    called = "".join(f", called by {name} at {where}" for name, where in callers)
    return (
        f"{owner} cannot be compiled: {type(error).__name__}: {error}"
        f"{place and ' at ' + place}{called}; write it with operators, @ and the functions of "
        "eqt_cli.base.arrays, or use `engine: solve_ivp`"
    )


def _places(trace: TracebackType | None, loop: ClosedLoop) -> dict[str, str]:
    """Return the components in the traceback, the innermost last, and the line of each."""
    # The traced components are copies of the same classes, with symbols for numbers.
    names = {type(part): name for part, _, name in reversed(parts_of(loop))}
    places: dict[str, str] = {}
    for frame, line in traceback.walk_tb(trace):
        name = names.get(type(frame.f_locals.get("self")))
        if name:
            summary = traceback.FrameSummary(frame.f_code.co_filename, line, frame.f_code.co_name)
            places[name] = f"{Path(frame.f_code.co_filename).name}:{line}: {summary.line}"
    return places
