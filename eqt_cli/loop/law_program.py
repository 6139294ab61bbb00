"""A law by itself as a program: from its input, its numbers and its memory to a torque.

The groups of its inputs are named `INPUT`, `NUMBER` or `MEMORY` followed by the name of an entry of
`LawProgram`; its outputs are `TORQUE`, and `MEMORY` followed by a name for each state of the law.
Engines evaluate it at control instants, and it is exported.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import TraceError
from eqt_cli.components.accelerometer import reads_specific_force
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import Controller, output_units, outputs, stored_numbers
from eqt_cli.components.mechanics import LATER, NOT_IN_CODE, LawInput
from eqt_cli.components.motions import FlatOutput
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.c_code import distinct
from eqt_cli.numbers.leaves import leaves, with_leaves
from eqt_cli.numbers.program import Input, Numbers, Program, traced
from eqt_cli.numbers.running import MOST_RUNNING, Memory, Running

INPUT, NUMBER, MEMORY, OUTPUT = "input_", "number_", "memory_", "output_"
TORQUE, MISSING = "torque", "missing_"
PERIOD = "period"
"""Name of the control period, by which memory advances, s."""

CONTROLLER = "controller."
"""Prefix of the paths of a law's own numbers."""

HELD = "held_law."
"""The same of those that are held between two known instants."""

NUMBER_NAMES = {
    "inertia.matrix": "inertia",
    "inertia.inverse": "inertia_inverse",
    "inertia.initial": "inertia",
    "gains.K": "kp",
    "gains.K_d": "kd",
}
"""Names in a configuration of the numbers shared by all laws, by their paths."""


@dataclass(frozen=True)
class Entry:
    """An array of the interface between a law and its vehicle.

    Attributes
    ----------
    name
        Name of its field in C.
    shape
        Shape; C stores it row by row, and () is a single number.
    source
        Its name in eqt; for a number, its path among the leaves of a closed loop.
    unit
        Unit in each part of the coordinates; "" where eqt knows none.
    """

    name: str
    shape: tuple[int, ...]
    source: str
    unit: str = ""

    @property
    def size(self) -> int:
        """The number of its entries."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class LawProgram:
    """A law on a group, with its inputs and outputs; equal ones compute the same.

    Attributes
    ----------
    inputs
        The input of the law, in the order of `LawInput`.
    numbers
        The gains, inertia and options that it reads, and last the period.
    memory
        Its own states; may be empty.
    torque
        Commanded torque, body frame.
    step
        Program of the torque, and of the memory after a period.
    start
        Program of the initial memory, from the same inputs; None if there is no memory.
    outputs
        The other numbers that it gives, such as a sliding variable.
    output
        Program of them, from the same inputs; None if there are none, or none were asked for.
    """

    inputs: tuple[Entry, ...]
    numbers: tuple[Entry, ...]
    memory: tuple[Entry, ...]
    torque: Entry
    step: Program
    start: Program | None
    outputs: tuple[Entry, ...] = ()
    output: Program | None = None

    def values(self, loop: ClosedLoop) -> dict[str, Array]:
        """Return the law's numbers in a loop, by name; the period is 0 without sampled control."""
        numbers = leaves(loop) | {PERIOD: np.array(loop.period)}
        return {entry.name: numbers[entry.source].reshape(entry.shape) for entry in self.numbers}


def law_program(
    loop: ClosedLoop,
    adapter: Any = None,
    with_outputs: bool = False,
    expressed: Numbers | None = None,
) -> LawProgram:
    """Return the law of a closed loop as a program.

    A law that cannot be traced raises whatever error it raises on symbols.

    Parameters
    ----------
    adapter
        What gives the `entries` of the program, and the input of a law that it can `read` from
        them; its `output` gives what is `returned` for a torque. What it does not give, and the law
        reads, is `MISSING` among the inputs of `step`.
    with_outputs
        Whether to trace what the law gives besides torque and memory.
    expressed
        Numbers of expressions, as of `traced`, for `step`.
    """
    G = loop.group
    loop = dataclasses.replace(loop, held_law=loop.controller.held(G, 0.0))
    entries, numbers, law = _inputs(loop), _numbers(loop), loop.controller
    memory, further = _numbers_of_law(law, law.memory(G)), tuple[Entry, ...]()
    if with_outputs:
        lengths = outputs(law, G).items()
        more = {name: length for name, length in lengths if name not in law.memory(G)}
        further = _numbers_of_law(law, more)
    units, head = (
        {argument.source: argument.unit for argument in entries},
        MISSING if adapter else INPUT,
    )
    reads = tuple(adapter.entries(G, units)) if adapter else entries
    groups = sizes({head: entries, INPUT: reads, NUMBER: numbers, MEMORY: memory})

    def symbols(inputs: Arrays) -> tuple[ClosedLoop, LawInput, dict[str, Array]]:
        """Return the loop with symbols for the law's numbers, its input, and its memory."""

        # A law is promised a leading run axis; here it has one entry.
        def one(prefix: str, entry: Entry) -> Array:
            return inputs[prefix + entry.name].reshape(1, *entry.shape or (1,))

        law_input = LawInput(**{entry.source: one(head, entry) for entry in entries})
        if adapter:
            law_input = adapter.read(
                G, law_input, {entry.name: one(INPUT, entry) for entry in reads}
            )
        # Constant entries of a pose need not be read.
        Q, Qd = (G.unpack(G.pack(pose)) for pose in (law_input.pose, law_input.desired_pose))
        law_input = law_input._replace(t=law_input.t[0, 0], pose=Q, desired_pose=Qd)
        symbolic = with_leaves(loop, {entry.source: one(NUMBER, entry) for entry in numbers[:-1]})
        return symbolic, law_input, {entry.source: one(MEMORY, entry) for entry in memory}

    def step(inputs: Arrays) -> Arrays:
        symbolic, law_input, state = symbols(inputs)
        torque, after = symbolic.answer(law_input, state, inputs[NUMBER + numbers[-1].name][0])
        if adapter:
            s = law_input.tracking(G, symbolic.inertia, symbolic.gains, state)
            torque = adapter.output.returned(s, torque)
        return {TORQUE: torque[0], **_flat(memory, after)}

    def start(inputs: Arrays) -> Arrays:
        symbolic, law_input, state = symbols(inputs)
        unset = {name: 0 * z for name, z in state.items()}
        s = symbolic.seen(law_input.tracking(G, symbolic.inertia, symbolic.gains, unset))
        zero = {name: np.zeros(z.shape) for name, z in state.items()}
        return _flat(memory, zero | dict(symbolic.controller.initial_memory(s)))

    def output(inputs: Arrays) -> Arrays:
        symbolic, law_input, state = symbols(inputs)
        s = symbolic.seen(law_input.tracking(G, symbolic.inertia, symbolic.gains, state))
        values = stored_numbers(symbolic.controller, s)
        return {OUTPUT + entry.name: np.ravel(values[entry.source]) for entry in further}

    programs = [traced(step, groups, expressed), *([traced(start, groups)] if memory else [])]
    programs += [traced(output, groups)] if further else []
    read = {value.group for law in programs for value in law.values if isinstance(value, Input)}
    flat = loop.controller.reads_flat_output  # instead of the desired pose, or beside its rates
    without = adapter or flat or loop.setpoint != "full"
    spare = {head + name for name in units if adapter or (without and name.startswith("desired_"))}
    unused = (spare | {NUMBER + entry.name for entry in numbers[:-1]}) - read
    used = tuple(entry for entry in numbers if NUMBER + entry.name not in unused)
    reads = tuple(entry for entry in reads if INPUT + entry.name not in unused)
    inputs = tuple((group, size) for group, size in groups.items() if group not in unused)
    trimmed = [dataclasses.replace(program, inputs=inputs) for program in programs]
    words = adapter.output.words if adapter else str
    turns, unit = G.parts[0], by_part(G, "force_unit")
    of_command = {"torque": turns.force_unit, "rates": turns.velocity_unit, "dipole": "A m^2"}
    unit = unit.replace(turns.force_unit, of_command[loop.controller.commands], 1)
    torque = Entry(TORQUE, (G.dimension,), TORQUE, words(unit))
    started, output_program = (trimmed[1] if memory else None), (trimmed[-1] if further else None)
    return LawProgram(reads, used, memory, torque, trimmed[0], started, further, output_program)


def sizes(entries: Mapping[str, Iterable[Entry]]) -> dict[str, int]:
    """Return the lengths of the groups of inputs of a program, by the prefixes of their names."""
    return {prefix + one.name: one.size for prefix, entry in entries.items() for one in entry}


def by_part(G: MatrixLieGroup, attribute: str, more: str = "") -> str:
    """Return the unit in each part: ``rad/s (rotation), m/s (translation)``."""
    units = {part.name: getattr(part, attribute) + more for part in G.parts}
    if len(set(units.values())) == 1:
        return next(iter(units.values()))
    return ", ".join(f"{unit} ({name})" for name, unit in units.items())


def _inputs(loop: ClosedLoop) -> tuple[Entry, ...]:
    G = loop.group
    d, m = G.size, G.dimension
    pose = by_part(G, "pose_unit")
    units = {
        "t": "s",
        "velocity": by_part(G, "velocity_unit"),
        "desired_velocity": by_part(G, "velocity_unit"),
        "desired_acceleration": by_part(G, "velocity_unit", "/s"),
        "position": "m, m/s, …",
        "heading": "rad, rad/s, …",
        "flux": "T",
        "specific_force": "m/s^2",
    }
    shapes: dict[str, tuple[int, ...]] = {"t": (), "flux": (3,)}
    shapes |= dict.fromkeys(("pose", "desired_pose"), (d, d))
    others = {*FlatOutput._fields, *LATER, *NOT_IN_CODE}
    others |= {"flux"} if loop.controller.commands != "dipole" else set()
    if G.translation:
        shapes["specific_force"] = (len(range(m)[G.translation.axes]),)
    others -= {"specific_force"} if reads_specific_force(loop.controller) else set()
    names = [name for name in LawInput._fields if name not in others]
    if loop.controller.reads_flat_output:
        output = loop.reference.flat_output(G, 0.0)
        assert output is not None
        flat = {name: part.shape for name, part in output._asdict().items() if part is not None}
        names, shapes = [*names, *flat], shapes | flat
    return tuple(Entry(name, shapes.get(name, (m,)), name, units.get(name, pose)) for name in names)


def _numbers(loop: ClosedLoop) -> tuple[Entry, ...]:
    """Return the numbers that a law can read, and the period."""
    readable = dataclasses.replace(loop, vehicle=Vehicle(), held_reference=None)
    # Scalars are stored as (1,).
    shapes = {path: () if x.shape == (1,) else x.shape for path, x in leaves(readable).items()}
    names = distinct([name_of_number(path) for path in shapes], taken=(PERIOD,))
    pairs = zip(names, shapes.items(), strict=True)
    entries = (Entry(name, shape, source) for name, (source, shape) in pairs)
    return (*entries, Entry(PERIOD, (), PERIOD, "s"))


def name_of_number(path: str) -> str:
    """Return the name in a configuration of the number at a path."""
    return NUMBER_NAMES.get(path, path.removeprefix(CONTROLLER).removeprefix(HELD))


def _numbers_of_law(law: Controller, lengths: Mapping[str, int]) -> tuple[Entry, ...]:
    return tuple(
        Entry(name, (lengths[source],), source, output_units(law).get(source, ""))
        for name, source in zip(distinct(lengths), lengths, strict=True)
    )


def _flat(memory: tuple[Entry, ...], values: Arrays) -> dict[str, Array]:
    for name in (entry.source for entry in memory):
        if name not in values:
            said = f"a law returns its memory, by name, from answer and initial_memory: no {name!r}"
            raise TraceError(said)
    return {MEMORY + entry.name: values[entry.source][0] for entry in memory}


# A loop with symbols for its numbers, and the programs that measure its runs on the way -----------
#
# The symbols stand by the names of the groups of inputs: ``state``, ``time``, ``parameters``,
# ``held``, and at a control instant ``errors``, the numbers of `Errors` one after the other.


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
    stored
        Name and shape of each array that is kept of a sample.
    """

    at_sample: Program
    ended: Program
    starts: Array
    columns: Array
    stored: tuple[tuple[str, tuple[int, ...]], ...]


@lru_cache(maxsize=64)
def running(
    function: Callable[..., Arrays],
    reduction: Callable[..., Mapping[str, Any]],
    loop: ClosedLoop,
    lengths: tuple[int, ...],
    stored: tuple[str, ...],
    times: tuple[float, ...],
) -> RunningPrograms | None:
    """Trace a reduction as a running computation; None if it does what programs cannot.

    Parameters
    ----------
    stored
        Names of the function's arrays that are kept.
    """
    memory, shapes = Memory(np.empty(0), np.empty(0)), dict[str, tuple[int, ...]]()
    over = np.array(times)

    def at_sample(inputs: Arrays) -> Arrays:
        nonlocal memory
        rows = np.split(inputs["state"][None], np.cumsum(lengths)[:-1], axis=1)
        computed = function(symbolic_loop(loop, inputs), inputs["time"][0], *rows)
        memory = Memory(inputs["memory"], inputs["columns"])
        reduction(Running(over, memory), computed)
        shapes.update({name: np.shape(values) for name, values in computed.items()})
        stretches = [np.ravel(computed[name]) for name in stored]
        return {
            "memory": np.array(memory.after, dtype=object),
            "kept": np.concatenate([np.empty(0, dtype=object), *stretches]),
        }

    def ended(inputs: Arrays) -> Arrays:
        blank = {name: np.zeros(shape) for name, shape in shapes.items()}
        behind = Memory(inputs["memory"], np.zeros(len(memory.columns)), ended=True)
        numbers = reduction(Running(over, behind), blank)
        return {name: np.asarray(number)[0] for name, number in numbers.items()}

    inputs = inputs_of(loop, sum(lengths))
    try:
        traced(at_sample, inputs | {"columns": MOST_RUNNING, "memory": MOST_RUNNING})
        columns = np.array(memory.columns).reshape(-1, len(times)).T.copy()
        sizes = {"columns": columns.shape[1], "memory": len(memory.after)}
        program = traced(at_sample, inputs | sizes, {})
        last = traced(ended, {"memory": sizes["memory"]})
        of_sample = tuple((name, shapes[name][1:]) for name in stored)
        return RunningPrograms(program, last, np.array(memory.starts), columns, of_sample)
    except Exception:
        return None


def inputs_of(loop: ClosedLoop, length: int) -> dict[str, int]:
    """Return the lengths of the groups of inputs of a program, for so many numbers of the state."""
    parameters, held = (
        sum(number.size for number in numbers.values())
        for numbers in (leaves(loop), loop.holding(0.0).held_leaves)
    )
    return {"state": length, "time": 1, "parameters": parameters, "held": held}


def symbolic_loop(loop: ClosedLoop, inputs: Arrays) -> ClosedLoop:
    """Return the loop with symbols for all its numbers, in the order of the rows."""
    holding = loop.holding(0.0)
    symbols, numbers = np.concatenate([inputs["parameters"], inputs["held"]]), leaves(holding)
    ends = np.cumsum([value.size for value in numbers.values()])
    parts = zip(numbers.items(), np.split(symbols, ends), strict=False)
    # Each has a leading run axis.
    cut = {name: part.reshape(1, *value.shape) for (name, value), part in parts}
    return with_leaves(holding, cut)
