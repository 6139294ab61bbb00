"""Laws, references and filters as programs for export."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, norm
from eqt_cli.base.errors import EqtError, EqtWarning, Remedy, suggestion
from eqt_cli.base.registry import description
from eqt_cli.base.reporting import reporter, step
from eqt_cli.base.stored import THRUSTER
from eqt_cli.components.actuators import Solving
from eqt_cli.components.blocks import Now, blocks_of, body
from eqt_cli.components.estimators import Estimator, Measurement
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.initial_states import Stream, generator, generator_at
from eqt_cli.components.laws import RunsCode
from eqt_cli.components.mechanics import LawInput
from eqt_cli.components.references import ClosedReference, references
from eqt_cli.components.sensors import CHANNEL_MEASURED as ARRIVED
from eqt_cli.components.vehicle import ESTIMATOR, Vehicle, navigates
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.study import Study
from eqt_cli.engines import library
from eqt_cli.engines.engine import Compiled, evaluate
from eqt_cli.engines.library import Rows
from eqt_cli.engines.native import compiled_if_possible, law_of
from eqt_cli.extensions.export.program_error import (
    DOUBLE,
    FLOAT,
    Arithmetic,
    BoundedOutput,
    bounded,
)
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.law_program import (
    CONTROLLER,
    INPUT,
    MEMORY,
    MISSING,
    NUMBER,
    PERIOD,
    TORQUE,
    Entry,
    LawProgram,
    by_part,
    law_program,
    sizes,
)
from eqt_cli.numbers.c_code import distinct
from eqt_cli.numbers.leaves import leaves, with_fields, with_leaves
from eqt_cli.numbers.program import Input, Program, traced
from eqt_cli.numbers.rounded import evaluated
from eqt_cli.results.origin import label_named
from eqt_cli.runs.batches import batches
from eqt_cli.runs.preflight import rehearse

# The filter of an exported law: its program, and instants at which it is checked ------------------
#
# An estimator by itself is a program from measurements and its states to a law's input. Its states
# are those that a law needs: neither those that only judge the estimate, nor the initial error of a
# simulated run, are part of it.


MEASURED, STATE = "measured_", "state_"
POSE, VELOCITY = "pose", "velocity"

QUALITY = ("error", "innovations", "last_innovation")
"""States that judge an estimate and that it does not need."""


INSTANTS = 40
"""Number of instants at which the filter is checked."""

TOLERANCE = {"double": 1e-9, "float": 1e-2}
"""Largest difference by rounding between the filter and eqt's over these instants, in the units of
the pose and of the velocity."""


@dataclass(frozen=True)
class ExportedFilter:
    """The filter of a loop, to be written as C.

    Attributes
    ----------
    estimator
        The estimator as it flies; it starts at the first fix.
    measured
        Measured ``pose`` and ``velocity``, and ``arrived``, 1 for each part that has a new
        measurement: those of the pose, and of a velocity that is not measured at every tick.
    numbers
        Its options.
    states
        Its states, all 0 before the first call.
    step
        Program of ``pose``, ``velocity`` and the states after an instant; it takes the ``period``
        as well.
    flight : (instants, n)
        Measurements at the instants of the check, by name.
    estimates : (instants, n)
        Estimates of eqt there: pose and velocity.
    """

    estimator: Estimator
    measured: tuple[Entry, ...]
    numbers: tuple[Entry, ...]
    states: tuple[Entry, ...]
    step: Program
    flight: dict[str, Array]
    estimates: Array

    @property
    def values(self) -> dict[str, Array]:
        """The options, by name."""
        return leaves(self.estimator)

    @property
    def about(self) -> str:
        """Description of the filter in a sentence."""
        return description(type(self.estimator))

    def arguments(self) -> list[str]:
        """Return the arguments of the emitted function, in the order of the program."""
        entries = {MEASURED + entry.name: f"measured->{entry.name}" for entry in self.measured}
        entries |= {NUMBER + entry.name: f"options->{entry.name}" for entry in self.numbers}
        entries |= {STATE + entry.name: f"filter->{entry.name}" for entry in self.states}
        entries[NUMBER + PERIOD] = f"&numbers->{PERIOD}"
        inputs = [entries[group] for group, _ in self.step.inputs]
        estimate = [f"input->{POSE}", f"input->{VELOCITY}"]
        return [*inputs, *estimate, *(f"next.{entry.name}" for entry in self.states)]


def exported_filter(loop: ClosedLoop, label: str, seed: int) -> ExportedFilter | None:
    """Return the filter of a loop; None where the law reads measurements.

    Raises
    ------
    EqtError
        If measurements arrive late.
    """
    vehicle, G = loop.vehicle, loop.group
    if vehicle.estimator is None:
        return None
    if vehicle.clocks:
        reporter().remark(
            EqtWarning(
                f"the C of '{label}' has no filter, which acts every {vehicle.tick:g} s; it has "
                "one if all periods and delays of sensors are multiples of control.period"
            )
        )
        return None
    schedule = vehicle.schedule(G)
    if navigates(vehicle):
        raise EqtError(
            f"{label}: a filter that predicts by an accelerometer is not written as C",
            Remedy("remove the keys estimator, sensors.accelerometer and sensors.depth"),
        )
    if schedule.depth:
        raise EqtError(
            f"{label}: a filter whose measurements arrive late is not written as C",
            Remedy("remove `delay` from the sensors, or the key estimator"),
        )
    estimator = with_fields(vehicle.estimator, initial_error=None)
    d, m = G.size, G.dimension
    timed = [f"{channel.signal} ({channel.part.name})" for channel in schedule.timed]
    measured = (
        Entry(POSE, (d, d), "Q as it is measured", by_part(G, "pose_unit")),
        Entry(VELOCITY, (m,), "V as it is measured", by_part(G, "velocity_unit")),
        Entry("arrived", (len(timed),), f"1 where a part is new: {', '.join(timed)}"),
    )
    numbers = tuple(Entry(path, value.shape, path) for path, value in leaves(estimator).items())
    lengths = estimator.states(schedule)
    states = tuple(
        Entry(name, (length,), name) for name, length in lengths.items() if name not in QUALITY
    )

    def step(inputs: Arrays) -> Arrays:
        def values(prefix: str, entry: Entry) -> Array:
            return inputs[prefix + entry.name].reshape(1, *entry.shape)

        now: Any = replace(schedule, period=inputs[NUMBER + PERIOD][0])
        options = {entry.source: values(NUMBER, entry) for entry in numbers}
        Q, V, fresh = (values(MEASURED, entry) for entry in measured)
        Q = G.unpack(G.pack(Q))
        before = {name: np.zeros((1, lengths[name])) for name in QUALITY if name in lengths}
        before |= {entry.name: values(STATE, entry) for entry in states}
        measurement = Measurement(Q, V, fresh, Q, 0.0 * V)
        after = with_leaves(estimator, options).after(now, measurement, before)
        estimate = {POSE: G.unpack(after["pose"])[0], VELOCITY: after["velocity"][0]}
        return estimate | {STATE + entry.name: after[entry.name][0] for entry in states}

    groups = sizes({MEASURED: measured, NUMBER: numbers, STATE: states}) | {NUMBER + PERIOD: 1}
    flight, estimates = _flown(G, replace(vehicle, estimator=estimator), seed)
    program = traced(step, groups)
    return ExportedFilter(estimator, measured, numbers, states, program, flight, estimates)


def _flown(G: MatrixLieGroup, flying: Vehicle, seed: int) -> tuple[dict[str, Array], Array]:
    """Return measurements of a motion with constant velocity, and the estimates of eqt."""
    random_of = partial(generator_at, seed, Stream.VEHICLE, 0)
    errors = flying.measurement_errors(G, INSTANTS, [random_of])
    V = 0.3 * random_of("the motion of an exported filter").standard_normal(G.dimension)
    states = {name: np.zeros(count) for name, count in flying.states(G).items()}
    flown: dict[str, list[Array]] = {"pose": [], "velocity": [], "arrived": []}
    blocks, estimates = blocks_of(flying, G), list[Array]()
    holding = [channel.name for channel in flying.holding(G)]
    for k in range(INSTANTS):
        at = errors.measured(G, 0, k)
        Q = G.exp(k * flying.tick * V)
        before = Now(blocks, body(G, Q, V, states), {}, acts=True, errors=at)
        states = {**states, **before.after("arrived"), **before.after(ESTIMATOR)}
        now = Now(blocks, body(G, Q, V, states), {}, errors=at)
        Q_m, V_m = now["arrived.pose"], now["arrived.velocity"]
        new = dict(zip(holding, 1.0 * (at.arrived >= ARRIVED), strict=True))
        fresh = np.array([new.get(part.name, 1.0) for part in flying.schedule(G).timed])
        for name, values in zip(flown, (Q_m, V_m, fresh), strict=True):
            flown[name].append(values.ravel())
        Q_hat, V_hat = now[f"{ESTIMATOR}.pose"], now[f"{ESTIMATOR}.velocity"]
        estimates.append(np.concatenate([Q_hat.ravel(), V_hat]))
    return {name: np.array(rows) for name, rows in flown.items()}, np.array(estimates)


# A law to export: its program, numbers and error bounds, and the states at which it is checked ----
#
# A reference in closed form is exported, too: from a time, and the piece it is in, to a motion.


@dataclass(frozen=True)
class ReferenceMoments:
    """A reference at some times, in order.

    Attributes
    ----------
    times : (n,)
        The times, s.
    values, bounds : (n, k) each
        Exact values of what the law is told, and how far rounding takes the exported function from
        them, by name.
    """

    times: Array
    values: dict[str, Array]
    bounds: dict[str, Array]

    @property
    def until(self) -> float:
        """The last time, s."""
        return float(self.times[-1])

    def in_words(self) -> str:
        """Return the largest bound of each value: ``desired_pose 6.0e-08, …``."""
        return ", ".join(f"{name} {bound.max():.2g}" for name, bound in self.bounds.items())


@dataclass(frozen=True)
class ReferenceProgram:
    """The motion of a reference as a program.

    Attributes
    ----------
    motion
        What the law is told of it from ``t`` and the numbers ``held`` in a piece.
    starts : (pieces,)
        Times at which the pieces begin, s; empty for a single piece.
    held : (pieces, n)
        Numbers of each piece.
    ends
        Times between which the reference is known, s; before and after, it stands still.
    """

    motion: Program
    starts: Array
    held: Array
    ends: tuple[float, float]

    @property
    def stops(self) -> bool:
        """Whether it stands still before and after."""
        return bool(np.isfinite(self.ends).all())

    @property
    def rates(self) -> list[str]:
        """The outputs that are 0 where it stands still."""
        names = [output.name for output in self.motion.outputs]
        return [name for name in names if name in ("desired_velocity", "desired_acceleration")]

    def moments(self, times: Array, by: Arithmetic) -> ReferenceMoments:
        """Return the reference at some times, as a function in double gives it to a law."""
        inside = np.clip(times, *self.ends)
        piece = np.maximum(np.searchsorted(self.starts, inside, side="right") - 1, 0)
        inputs = {"t": inside[:, None], "held": self.held[piece]}
        judged = bounded(self.motion, inputs)
        clear = ~np.logical_or.reduce([output.singular for output in judged.values()])
        clear |= times == times[-1]
        exact = [
            evaluated(self.motion, {name: rows[k] for name, rows in inputs.items()})
            for k in np.flatnonzero(clear)
        ]
        values = {name: np.array([list(map(float, row[name])) for row in exact]) for name in judged}
        bounds, still = {}, (inside != times)[clear]
        for name, output in judged.items():
            errors = output.errors[clear]
            if name in self.rates:
                values[name][still] = errors[still] = 0.0
            size = np.abs(values[name])
            errors = errors + DOUBLE.unit * size
            if by is not DOUBLE:
                errors = errors + by.unit * (size + errors) + by.least
            bounds[name] = np.nextafter(errors, np.inf)
        return ReferenceMoments(times[clear], values, bounds)


def reference_program(loop: ClosedLoop, law: LawProgram) -> ReferenceProgram:
    """Return the program of the reference of a loop, for its law.

    Raises
    ------
    EqtError
        If the reference is integrated, or uses operations that programs do not have.
    """
    G, reference = loop.group, loop.reference
    if not isinstance(reference, ClosedReference):
        both = "velocity" in reference.starts_from
        parts = "Q_d and V_d follow" if both else "Q_d follows"
        closed = [kind.name for kind in references.all() if issubclass(kind, ClosedReference)]
        raise EqtError(
            f"--reference: the reference '{reference.name}' is integrated: its {parts} from a "
            f"differential equation, and no formula gives {'them' if both else 'it'} at a time. "
            "Integrate it on the vehicle, or use a reference in closed form: "
            f"{', '.join(closed[:-1])} or {closed[-1]}"
        )
    starts = reference.instants(G, 0.0) if loop.holds else np.empty(0)
    at = starts if len(starts) else np.zeros(1)
    moving = reference.held(G, at)
    numbers = {} if moving is None else leaves(moving)
    rows = [values.reshape(len(at), -1) for values in numbers.values()]
    held = np.concatenate([np.empty((len(at), 0)), *rows], axis=1)

    def motion(inputs: Arrays) -> Arrays:
        parts = np.split(inputs["held"], np.cumsum([row.shape[1] for row in rows]))
        held_leaves = {
            name: part.reshape(values.shape[1:])
            for (name, values), part in zip(numbers.items(), parts, strict=False)
        }
        here: Any = reference if moving is None else with_leaves(moving, held_leaves)
        t, names = inputs["t"][0], [entry.source for entry in law.inputs]
        moves = [name for name in LawInput._fields if name.startswith("desired_")]
        motion = dict(zip(moves, here.motion(G, t), strict=True))
        flat = here.flat_output(G, t) if loop.controller.reads_flat_output else None
        motion |= {} if flat is None else flat._asdict()
        return {name: motion[name] for name in names if name in motion}

    try:
        program = traced(motion, {"t": 1, "held": held.shape[1]})
    except Exception as error:
        raise EqtError(
            f"--reference: the reference '{reference.name}' cannot be written as C: "
            f"{type(error).__name__}: {error}"
        ) from error
    return ReferenceProgram(program, starts, held, reference.ends(G))


LATE = 1e6
"""Time until which an exported reference is checked, s: eleven days."""

RUNS = 20
"""Number of runs of a law that are integrated, unless there are fewer."""

RANDOM = 1000
"""Number of random states beside the states of the runs."""

HALF_TURNS = 100
"""Number of random states 2^-7 to 2^-53 rad from a half turn, where a group has such."""


@dataclass(frozen=True)
class CheckedStates:
    """The inputs and the memory of a law at many states.

    Attributes
    ----------
    inputs
        ``(states, length)`` for each group of inputs that varies.
    runs
        Number of runs.
    along
        Number of states from runs; the others are random.
    """

    inputs: Arrays
    runs: int
    along: int

    @property
    def count(self) -> int:
        """Number of states."""
        return len(next(iter(self.inputs.values())))

    def at(self, states: Array | slice) -> dict[str, Array]:
        """Return the inputs at some states."""
        return {name: values[states] for name, values in self.inputs.items()}


def states_of(experiment: Experiment, label: str, law: LawProgram, workers: int) -> CheckedStates:
    """Return the states of a law in the first runs of an experiment, and random ones of that size.

    Raises
    ------
    EqtError
        If all of these runs fail.
    """
    few = experiment.of_runs(RUNS)
    ensemble = few.config.ensemble
    study = Study(None, few)
    rehearse(study)
    [batch] = batches(study, label, np.arange(ensemble.runs))
    engine = compiled_if_possible(batch.engine, batch.problem)
    if engine is not batch.engine:  # it also computes where runs start
        few = replace(few, solver=replace(few.solver, engine=engine))
        [batch] = batches(Study(None, few), label, np.arange(ensemble.runs))
    with step(f"runs of '{label}'", ensemble.runs):
        solution = engine.solve(batch.problem, workers, reporter().advance)
    good = np.flatnonzero(solution.status == 0)
    if not len(good):
        raise EqtError(
            f"{label}: all of the first {ensemble.runs} runs fail, so that there is no state to "
            f"check the exported law at: {solution.messages[0]}"
        )
    problem, states = batch.problem.select(good), solution.states[good]
    shape = states.shape[:2]

    def read(loop: ClosedLoop, t: Any, states: Array) -> dict[str, Array]:
        inputs_of, memory = loop.law_input(t, states), loop.memory(states)
        columns = {
            INPUT + entry.name: np.broadcast_to(
                getattr(inputs_of, entry.source), (*states.shape[:-1], *entry.shape)
            )
            for entry in law.inputs
        }
        return columns | {MEMORY + entry.name: memory[entry.source] for entry in law.memory}

    with np.errstate(all="ignore"):
        columns = evaluate(engine, read, problem, states)
    rows = {name: np.array(values).reshape(np.prod(shape), -1) for name, values in columns.items()}
    finite = np.logical_and.reduce([np.isfinite(values).all(axis=1) for values in rows.values()])
    rows = {name: values[finite] for name, values in rows.items()}
    random = generator(ensemble.seed, Stream.EXPORTED_STATES, list(few.loops).index(label))
    drawn = _random(rows, problem.loop.group, random, isinstance(engine, Compiled))
    inputs = {name: np.concatenate([values, drawn[name]]) for name, values in rows.items()}
    return CheckedStates(inputs, len(good), int(finite.sum()))


def _random(
    rows: Arrays, G: MatrixLieGroup, random: np.random.Generator, compiled: bool = False
) -> dict[str, Array]:
    """Return states with any error of the pose, and all else as large as in the runs.

    Compiled code computes the poses in the same bits on every machine.
    """
    chosen = random.integers(0, len(rows[f"{INPUT}t"]), RANDOM)
    errors = random.standard_normal((RANDOM, G.dimension))
    for part in G.parts:
        if part.turns:
            turn = errors[:HALF_TURNS, part.axes]
            power = random.uniform(-53, -7, (HALF_TURNS, 1))
            angle = np.pi - np.ldexp(1 + power % 1, np.floor(power).astype(int))
            errors[:HALF_TURNS, part.axes] = turn * angle / norm(turn)[:, None]
    drawn = {}
    for name, values in rows.items():
        if name in (f"{INPUT}t", f"{INPUT}desired_pose"):
            drawn[name] = values[chosen]
        elif name == f"{INPUT}pose":
            about = f"{INPUT}desired_pose" if f"{INPUT}desired_pose" in rows else name
            starts = {"desired": rows[about][chosen], "error": errors}
            if compiled:
                program = traced(
                    lambda inputs: {"pose": _moved(G, **inputs)},
                    {key: values.shape[1] for key, values in starts.items()},
                )
                inputs = [Rows(values, by_run=True) for values in starts.values()]
                pose = library.evaluated(program, RANDOM, 1, inputs)["pose"]
            else:
                pose = _moved(G, **starts)
            drawn[name] = pose.reshape(RANDOM, -1)
        else:
            size = np.abs(values).max(axis=0)
            drawn[name] = size * random.uniform(-1, 1, (RANDOM, len(size)))
    return drawn


def _moved(G: MatrixLieGroup, desired: Array, error: Array) -> Array:
    return desired.reshape(*error.shape[:-1], G.size, G.size) @ G.exp(error)


CHECK = "_check"
"""After the name of a law: its program that checks it."""


class Allocation(NamedTuple):
    """The allocation of a torque to thrusters or wheels by a matrix, or by a program.

    Attributes
    ----------
    what
        Its outputs, in words.
    inverse : (k, m)
        B⁺.
    limits
        Name, sign and numbers of each limit behind it, which holds where a number is beyond it;
        empty if none are part of it.
    rounding, carried
        Bounds of what rounding, and the bound of the torque, move the outputs by; the first for a
        torque whose largest number is 1, or of a program, at the states of the check.
    program
        From ``torque`` to ``found``; None for a matrix.
    """

    what: str
    inverse: Array
    limits: list[tuple[str, str, Array]]
    rounding: float
    carried: float
    program: Program | None = None


@dataclass(frozen=True)
class ExportedLaw:
    """A law of an experiment, to be written as C.

    Attributes
    ----------
    label, name
        Name of the law in the experiment, and in C.
    by
        Arithmetic in which the law is computed.
    reference
        Program of the reference; None where it is not exported.
    filter
        Filter whose estimate the law reads; None where it reads measurements.
    adapter
        How the vehicle writes what the law reads and returns; None: as eqt does.
    """

    experiment: Experiment
    label: str
    name: str
    by: Arithmetic
    program: LawProgram
    states: CheckedStates
    reference: ReferenceProgram | None
    filter: ExportedFilter | None
    adapter: Any = None

    @property
    def title(self) -> str:
        """Display name of the law."""
        return self.experiment.titles[self.label]

    @property
    def about(self) -> str:
        """Description of the law in sentences."""
        return description(type(self.loop.controller))

    @property
    def loop(self) -> ClosedLoop:
        """Closed loop of the law."""
        return self.experiment.loops[self.label]

    @cached_property
    def numbers(self) -> dict[str, Array]:
        """Numbers of the experiment, by name."""
        return self.program.values(self.loop)

    @cached_property
    def fixed(self) -> frozenset[str]:
        """Names of the numbers that are no options: the law fixes them."""
        of_law = [number for number in self.program.numbers if number.source.startswith(CONTROLLER)]
        return frozenset(
            number.name
            for number in of_law
            for field in fields(self.owner(number))
            if field.name == number.source.rpartition(".")[2].partition("[")[0]
            and not (field.init and ".acting" not in number.source)
        )

    def owner(self, number: Entry) -> Any:
        """Return the part of the loop that has a number: the law, or a part of it."""
        part: Any = self.loop
        for name in re.findall(r"\w+", number.source.rpartition(".")[0]):
            part = part[int(name)] if name.isdigit() else getattr(part, name)
        return part

    def bounded(self, program: Program, states: Arrays) -> dict[str, BoundedOutput]:
        """Return the output of a program of the law at some states, with bounds of its errors.

        In float, the inputs and the numbers of the law are rounded too.
        """
        inputs = {**states, **self.flat_numbers}
        errors = None
        if self.by is FLOAT:
            errors = {name: np.abs(self.by.rounded(x) - x) for name, x in inputs.items()}
        return bounded(program, inputs, self.by, errors)

    @property
    def reads_time(self) -> bool:
        """Whether the law reads the time, in float: rounding then grows with it."""
        read = {value.group for value in self.program.step.values if isinstance(value, Input)}
        return self.by is FLOAT and f"{INPUT}t" in read

    @property
    def latest(self) -> float:
        """The latest time of the states, s."""
        return float(self.states.inputs[f"{INPUT}t"].max())

    @cached_property
    def moments(self) -> ReferenceMoments:
        """The reference at some times, of the experiment and long after it."""
        assert self.reference is not None
        end = float(self.experiment.times[-1])
        times = np.unique([*np.linspace(0.0, end, 9), *np.geomspace(end, max(LATE, end), 9)])
        return self.reference.moments(times, self.by)

    @cached_property
    def flat_numbers(self) -> dict[str, Array]:
        """`numbers` as inputs of the programs of the law."""
        return {NUMBER + name: values.reshape(-1) for name, values in self.numbers.items()}

    @cached_property
    def judged(self) -> dict[str, BoundedOutput]:
        """Output of the law and bounds of its errors at all its states."""
        return self.bounded(self.program.step, self.states.inputs)

    @property
    def singular(self) -> Array:
        """Mask of the states near a singularity, ``(states,)``."""
        return np.logical_or.reduce([output.singular for output in self.judged.values()])

    @cached_property
    def allocation(self) -> Allocation | None:
        """The allocation of a torque behind the law, by a matrix or a program; else None."""
        if self.adapter or self.loop.controller.commands != "torque":
            return None
        for actuator in self.loop.vehicle.actuators:
            if (matrices := actuator.allocation_matrix) is not None:
                inverse, low, high = matrices
                what = (
                    "thrusts, N," if THRUSTER in actuator.members else "torques of the wheels, N m,"
                )
                both = ("low", "<", low), ("high", ">", high)
                limits = [(name, sign, x) for name, sign, x in both if x is not None]
                # Each number is rounded, multiplied and added up: m + 1 errors of relative size u.
                size, u = np.abs(inverse), (inverse.shape[1] + 1) * self.by.unit
                rounding = u / (1 - u) * size.sum(axis=1).max()
                carried = (1 + 2 * u) * (size @ self.torque_bound).max()
                return Allocation(what, inverse, limits, float(rounding), float(carried))
            if actuator.sampled and isinstance(actuator, Solving) and not actuator.solves:
                return self._by_program(actuator)
        return None

    def _by_program(self, actuator: Any) -> Allocation:
        """Return an allocation that is no matrix, as a program with bounds at the states."""
        G, torque, apart = self.loop.group, self.judged[TORQUE], ~self.singular
        inputs, sizes = {"torque": torque.values[apart]}, {"torque": G.dimension}
        program = traced(lambda x: {"found": actuator.solution(G, x["torque"])}, sizes)
        rounding, both = (
            float(bounded(program, inputs, self.by, errors)["found"].errors.max(initial=0.0))
            for errors in ({}, {"torque": torque.errors[apart]})
        )
        return Allocation("thrusts, N,", actuator.inverse, [], rounding, both - rounding, program)

    @cached_property
    def torque_bound(self) -> Array:
        """Largest bound of each torque away from singularities, ``(m,)``."""
        return self._largest(~self.singular)

    @cached_property
    def singular_bound(self) -> Array:
        """Largest bound of each torque near singularities, ``(m,)``; empty without such states."""
        return self._largest(self.singular)

    def _largest(self, states: Array) -> Array:
        errors = self.judged[TORQUE].errors[states]
        return errors.max(axis=0) if len(errors) else np.empty(0)


def exported(
    experiment: Experiment,
    labels: Sequence[str],
    by: Arithmetic,
    *,
    reference: bool = False,
    adapter: Any = None,
    workers: int = 1,
) -> list[ExportedLaw]:
    """Return laws of an experiment, to be written as C, in its order.

    Parameters
    ----------
    labels
        Labels of the laws; all if empty.
    reference
        Whether to export the reference too.
    adapter
        How the vehicle writes what the law reads and returns. Default: as eqt does.

    Raises
    ------
    EqtError
        If there is no such law, one cannot be traced or has memory without a period, the reference
        is integrated, or measurements for an estimator arrive late.
    """
    titles = {label: law.controller.title for label, law in experiment.loops.items()}
    labels = [label_named(label, titles) for label in labels]
    for label in labels:
        if label not in experiment.loops:
            raise EqtError(
                f"controller {label!r} is not in this experiment; expected "
                f"{', '.join(experiment.loops)}{suggestion(label, experiment.loops)}"
            )
    names = distinct(experiment.loops, endings=("", CHECK))
    wanted = {
        k: v for k, v in zip(experiment.loops, names, strict=True) if not labels or k in labels
    }
    programs, laws = {label: _program(experiment, label) for label in wanted}, []
    for label, program in programs.items():
        loop, seed = experiment.loops[label], experiment.config.ensemble.seed
        states = states_of(experiment, label, program, workers)
        moving = reference_program(loop, program) if reference else None
        estimator = exported_filter(loop, label, seed)
        law = ExportedLaw(experiment, label, wanted[label], by, program, states, moving, estimator)
        laws.append(_adapted(law, adapter) if adapter else law)
    return laws


def _adapted(law: ExportedLaw, adapter: Any) -> ExportedLaw:
    """Return a law as a vehicle writes what it reads and returns.

    Raises
    ------
    EqtError
        If the adapter does not give what the law reads, or more than a law is exported.
    """
    rows, program = law.states.inputs, law_program(law.loop, adapter, with_outputs=True)
    for name in (name for name, _ in program.step.inputs if name.startswith(MISSING)):
        left = name.removeprefix(MISSING)
        raise EqtError(f"{law.label}: the adapter lacks {left}, or a part of it; add an input")
    if law.reference or law.filter:
        raise EqtError(f"{law.label}: leave out --reference and the estimator, or the adapter")
    entries = {entry.source: entry for entry in law.program.inputs}
    signals = {
        name: rows[INPUT + name].reshape(-1, *entry.shape) for name, entry in entries.items()
    }
    x = LawInput._make(map(signals.get, LawInput._fields))
    inputs = {name: values for name, values in rows.items() if name.startswith(MEMORY)}
    for name, signal in adapter.inputs.items():
        inputs[INPUT + name] = signal.values(law.loop.group, x).reshape(len(x.t), -1)
    return replace(law, program=program, states=replace(law.states, inputs=inputs), adapter=adapter)


def _program(experiment: Experiment, label: str) -> LawProgram:
    loop = experiment.loops[label]
    if isinstance(law := loop.controller, RunsCode):
        claimed = ", or export the law that it claims to be" if law.formula else ""
        raise EqtError(
            f"{label}: the law is code in {law.code.file}, not a formula",
            Remedy(f"leave it out{claimed}"),
        )
    program = law_of(loop)
    if not {entry.source for entry in program.numbers[:-1]} <= leaves(loop).keys():
        raise EqtError(
            f"{label}: the numbers of {loop.controller.name} change during the run, but "
            "C code has one set of numbers",
            Remedy("export another law, or lqr for a reference that does not change its loop"),
        )
    if program.memory and loop.vehicle.control is None:
        states = ", ".join(entry.source for entry in program.memory)
        raise EqtError(
            f"{label}: the law has memory ({states}), which advances by one period; the "
            "configuration has no period",
            Remedy("set control.period to the period of your vehicle in s"),
        )
    return program
