"""A plant in Python of the user's own: its conventions, its calls, and what it should be."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, apply_matrix
from eqt_cli.base.errors import EqtError, InputError, KeyPath, Problems
from eqt_cli.base.extensions import function_for
from eqt_cli.base.files import text_of
from eqt_cli.base.option_types import Real, shown, validated
from eqt_cli.base.registry import Keys
from eqt_cli.base.stored import THRUSTER
from eqt_cli.base.units import size_of
from eqt_cli.base.yaml_source import Source, load
from eqt_cli.components.blocks import acting_force
from eqt_cli.components.forces import Restoring
from eqt_cli.components.groups import MatrixLieGroup, command_axes
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.matrix_groups import rigid_motions
from eqt_cli.components.mechanics import LawInput, lie_poisson
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.leaves import with_fields

# What the configuration says of the plant ---------------------------------------------------------

COVERED = ("SO3", "SE3")
"""The groups on which plants are judged."""

HOVER = (0.3, 1.7)
"""Range of thrusts, in that of hovering, or of 1 N without a weight."""


class States(NamedTuple):
    """Motions, and the inputs of the plant at them; a row for each."""

    Q: Array
    V: Array
    inputs: Array

    def of(self, where: Any) -> States:
        """Return some of them."""
        return States(*(part[where] for part in self))

    @property
    def law_input(self) -> LawInput:
        """As signals read it, at t = 0."""
        return LawInput(np.zeros(self.Q.shape[:-2]), self.Q, self.V, self.Q, 0 * self.V, 0 * self.V)

    def signed(self, signs: Array) -> States:
        """Return them in axes of space and body with other signs."""
        h = np.concatenate([signs, np.ones(self.Q.shape[-1] - 3)])
        V = self.V * np.resize(signs, self.V.shape[1])
        return self._replace(Q=self.Q * np.outer(h, h), V=V)


@dataclass(frozen=True)
class Model:
    """The rigid body, forces and thrusters of a configuration: what a plant should be.

    Attributes
    ----------
    loop
        Its loop, with a vehicle that has the means of what is drawn.
    columns
        B, the wrench of a unit of each input, ``(m, k)``.
    thrusters
        The thrusters; None where the input is a torque or a wrench.
    """

    loop: ClosedLoop
    columns: Array
    thrusters: Any

    @classmethod
    def of(cls, loop: ClosedLoop, axes: list[str] | None) -> Self:
        """Return the model of a loop, whose input is that of its thrusters or a wrench along axes.

        Raises
        ------
        EqtError
            If its inertia is not covered, or it has no such axes.
        """
        G = loop.group
        if not isinstance(loop.inertia, Inertia) or loop.inertia.change is not None:
            raise EqtError("--plant: an inertia that varies in time is not covered")
        loop = with_fields(loop, vehicle=loop.vehicle.of_run(G))
        if unknown := [axis for axis in axes or () if axis not in command_axes(G)]:
            names = ", ".join(command_axes(G))
            raise EqtError(f"--adapter: input.axes: expected {names}, got {shown(unknown[0])}")
        parts: Any = next((x for x in loop.vehicle.actuators if THRUSTER in x.members), None)
        rows = [command_axes(G).index(axis) for axis in axes or command_axes(G)]
        return cls(loop, np.eye(G.dimension)[:, rows] if parts is None else parts.matrix, parts)

    @property
    def group(self) -> MatrixLieGroup:
        """SO(3) or SE(3)."""
        return self.loop.group

    @property
    def input_names(self) -> list[str]:
        """Short names of the inputs: f1, … of thrusters; τx, …, Fz."""
        if self.thrusters is not None:
            return [f"f{k + 1}" for k in range(self.columns.shape[1])]
        return ["τx τy τz Fx Fy Fz".split()[k] for k in self.columns.argmax(axis=0)]

    @cached_property
    def inertia(self) -> Inertia:
        """The true inertia."""
        true, model = self.loop.vehicle.inertia, self.loop.inertia.at(0.0)
        return model if true is None else true.at(model, 0.0)

    def acceleration(self, states: States) -> Array:
        """V̇ = 𝕀⁻¹(ad*_V 𝕀V + B f + forces + h × ω) at t = 0, body frame, ``(..., m)``.

        Forces are those of `plant.forces`, and h the momentum of rotors with `rotor_inertia`.
        """
        loop, parts = self.loop, self.thrusters
        s = states.law_input.tracking(self.group, loop.inertia, loop.gains, {})
        wrench = apply_matrix(self.columns, states.inputs)
        if parts is not None and parts.spin is not None:
            wrench = wrench + parts.reaction(self.group, states.V, self.speeds(states.inputs))[0]
        acting = acting_force(self.loop.vehicle, s, wrench)
        return s.inertia.velocity(lie_poisson(self.group, s.Q, s.P, s.V, acting)[1])

    def speeds(self, thrusts: Array) -> Array:
        """Return the speeds of rotors with these thrusts, rad/s."""
        constant = getattr(self.thrusters, "thrust_constant", None)
        if constant is None:
            raise EqtError("--plant: speeds need actuators: thrusters with a thrust_constant")
        return np.asarray(self.thrusters.followed(thrusts))

    def drawn_inputs(self, limits: Any, count: int, random: np.random.Generator) -> Array:
        """Draw inputs within limits; without, thrusts about hovering, or wrenches like 𝕀."""
        k = self.columns.shape[1]
        if limits is None and self.thrusters is None:
            size = np.diag(self.inertia.matrix) @ np.abs(self.columns)
            return np.asarray(random.standard_normal((count, k)) * size)
        held: Any = (f for f in self.loop.vehicle.forces if isinstance(f, Restoring))
        hover = abs(sum(np.sum(f.weight) - np.sum(f.buoyancy) for f in held)) / k or 1.0
        low, high = limits or np.multiply(HOVER, hover)
        return np.asarray(random.uniform(low, high, (count, k)))


# The conventions of the user's function -----------------------------------------------------------

AXES = {"z": np.ones(3), "-z": np.array([1.0, -1.0, -1.0])}
"""Signs of vectors in axes whose z points up, or down: forward, right, down."""

FILLED = ("speeds", "thrusts")
"""What a state may hold of the thrusters; it follows from the input."""

KINDS = {
    "pose.translation": "position",
    "pose.rotation": "attitude",
    "velocity.translation": "velocity",
    "velocity.rotation": "rates",
}
"""The parts of a motion by their signals."""

Order = Literal["matrix", "columns", "quaternion wxyz", "quaternion xyzw", "roll-pitch-yaw"]

TURNS = {"pose": "pose.rotation", "velocity": "velocity.rotation"}
"""Those of a rotation alone."""


@dataclass(frozen=True)
class StatePart(Keys):
    """A part of the state of a plant: a signal of the motion, or what eqt fills.

    Attributes
    ----------
    signal, as_, frame, unit, scale, sign
        As in an adapter of code: what it is, in which order of rotations, frame and unit.
    skip
        Instead of a signal: so many entries, which are 0.
    """

    signal: str = ""
    as_: Order = "matrix"
    frame: Literal["body", "desired", "space"] | None = None
    unit: str | None = None
    scale: Real = 1.0
    sign: Real | list[Real] = 1.0
    skip: int = 0

    @cached_property
    def in_code(self) -> Any:
        """The signal as code has it."""
        keys = {name: getattr(self, name) for name in ("as_", "frame", "unit", "scale", "sign")}
        return function_for(purposes.signal_of_code)(signal=self.signal, **keys)

    @property
    def factor(self) -> Array:
        """What the code has of 1, in units of eqt."""
        return np.asarray(self.in_code.factor)

    def values(self, G: MatrixLieGroup, x: LawInput) -> Array:
        """Return the part as code has it, ``(..., *shape)``."""
        return np.asarray(self.in_code.values(G, x))


@dataclass(frozen=True)
class PlantInput(Keys):
    """The input of a plant.

    Attributes
    ----------
    as_
        thrusts (N), speeds of rotors, or wrench; else an expression in Python of `thrusts`,
        `torque` and `force`.
    unit
        Of speeds: rad/s, rpm, krpm.
    axes
        Of a wrench without thrusters, such as [force z, torque x, torque y, torque z].
    range
        Least and largest input, in its unit.
    """

    as_: str = "thrusts"
    unit: str = "rad/s"
    axes: list[str] | None = None
    range: list[Real] | None = None


@dataclass(frozen=True)
class PlantAdapter(Keys):
    """What a plant takes and returns.

    Attributes
    ----------
    state
        The parts of the state in their order; `names` are those of separate arguments.
    input
        The input.
    call
        An expression of `x`, or of the names, and of `u`, `thrusts`, `speeds`, `torque`, `force`
        and `t`. Default: the function of the state and `u`.
    returns
        derivative, or `{state: dt}`: the state after a time, with the name of that in `call`.
    up
        −z if the axes of space and body are forward, right, down, and those of CONFIG are not.
    """

    state: list[StatePart]
    names: list[str] = field(default_factory=lambda: ["x"])
    input: PlantInput = PlantInput()
    call: str | None = None
    returns: Literal["derivative"] | dict[Literal["state"], str] = "derivative"
    up: Literal["z", "-z"] = "z"

    @property
    def step(self) -> str:
        """The name of the time of a step; "" of a derivative."""
        return "" if isinstance(self.returns, str) else self.returns["state"]


def _problems_in(source: Source) -> Problems:
    """Return problems with places in an adapter, whose named state is checked as a list."""
    state = source.data.get("state")
    names = [*state] if isinstance(state, dict) else []

    def located(path: KeyPath) -> str:
        if names and path[:1] == ("state",) and len(path) > 1:
            path = ("state", names[int(path[1])], *path[2:])
        return source.key_place(path)

    return Problems(located)


def adapter_in(file: Path, G: MatrixLieGroup) -> PlantAdapter:
    """Return the adapter in a file.

    Raises
    ------
    EqtError
        If it is no adapter of a plant on this group, or this is not covered.
    """
    if G.name not in COVERED:
        raise EqtError(f"--plant: {G.name} is not covered; {' and '.join(COVERED)} are")
    source = load(text_of(file, "it is an adapter", EqtError), str(file))
    data, problems = source.data, _problems_in(source)
    state: Any = data.get("state")
    if isinstance(state, dict):
        data, state = {**data, "names": [*state]}, [*state.values()]
    if not isinstance(state, list) or not state:
        problems.at("state").add("expected the parts of the state in their order")
        problems.raise_if_any()
    parts = [{"signal": part} if isinstance(part, str) else part for part in state]
    adapter: Any = validated(PlantAdapter, {**data, "state": parts}, problems)
    needed = [*KINDS] if rigid_motions(G) else [*TURNS.values()]
    signals = [TURNS.get(part.signal, part.signal) for part in adapter.state] if adapter else needed
    for index, signal in enumerate(signals):
        if signal not in (*needed, *FILLED) and not (adapter and adapter.state[index].skip):
            words = f"expected {', '.join((*needed, *FILLED))}, got {shown(signal)}"
            problems.at("state", index, "signal").add(words)
        if adapter and signal == "pose.translation" and adapter.state[index].frame == "body":
            problems.at("state", index, "frame").add("expected space, got 'body'")
    for signal in needed[rigid_motions(G) :]:
        if signal not in signals:
            problems.at("state").add(f"lacks {signal}, which eqt compares")
    problems.raise_if_any()
    state = [with_fields(x, signal=y) for x, y in zip(adapter.state, signals, strict=True)]
    return with_fields(adapter, state=state)


# The function, called at states -------------------------------------------------------------------

SHORT = 3e-6
"""Turn by which derivatives of an attitude are computed, rad: an error of 1e-10 of them."""


@dataclass(frozen=True)
class Plant:
    """The user's function.

    Attributes
    ----------
    adapter, model
        Its conventions, and what it should be.
    file, function
        Where it is.
    """

    adapter: PlantAdapter
    model: Model
    file: Path
    function: str

    @property
    def name(self) -> str:
        """Function and file, for messages."""
        return f"{self.function} in {self.file.name}"

    @property
    def signs(self) -> Array:
        """Signs of vectors in the user's axes."""
        return AXES[self.adapter.up]

    @cached_property
    def unit(self) -> float:
        """The unit of speeds, rad/s."""
        unit = self.adapter.input.unit
        if (size := size_of(unit.removeprefix("k"))) is None:
            raise EqtError(f"--adapter: input.unit: expected rad/s, rpm or krpm, got {shown(unit)}")
        return size[0] * (1000.0 if unit.startswith("k") else 1.0)

    @property
    def limits(self) -> Any:
        """The range of the inputs of the model; None without one."""
        entry, limits = self.adapter.input, self.adapter.input.range
        if limits is None or entry.as_ != "speeds":
            return limits
        constant = np.mean(self.model.thrusters.thrust_constant)
        return tuple(constant * (np.array(limits) * self.unit) ** 2)

    def values(self, states: States) -> list[Array]:
        """Return the parts of the user's state, ``(states, …)`` each."""
        x = states.signed(self.signs).law_input

        def value(part: StatePart) -> Array:
            if part.skip:
                return np.zeros((len(states.V), part.skip))
            if part.signal in FILLED:
                return self.filled(part.signal, states)
            return self._signal(part).values(self.model.group, x)

        return [*map(value, self.adapter.state)]

    def filled(self, name: str, states: States) -> Array:
        """Return the thrusts, N, or the speeds of rotors in the user's unit."""
        thrusts = states.inputs
        return self.model.speeds(thrusts) / self.unit if name == "speeds" else thrusts

    def _signal(self, part: StatePart) -> StatePart:
        """Return a part with the signal that it has on the group."""
        name = part.signal.partition(".")[0]
        return part if rigid_motions(self.model.group) else with_fields(part, signal=name)

    def flat(self, states: States) -> Array:
        """Return the user's state as a vector."""
        return np.hstack([value.reshape(len(states.V), -1) for value in self.values(states)])

    @cached_property
    def parts(self) -> dict[str, tuple[StatePart, slice]]:
        """The parts of the motion by their kind, with their entries in a state."""
        G, k = self.model.group, self.model.columns.shape[1]
        values = self.values(States(G.identity[None], np.zeros((1, G.dimension)), np.ones((1, k))))
        ends = np.cumsum([value.size for value in values]).tolist()
        places = map(slice, [0, *ends], ends)
        pairs = zip(self.adapter.state, places, strict=True)
        return {KINDS[p.signal]: (self._signal(p), at) for p, at in pairs if p.signal in KINDS}

    def _arguments(self, states: States, step: float) -> dict[str, Array]:
        """Return all that a call may name."""
        values, entry, n = self.values(states), self.adapter.input, len(states.V)
        state = values if self.adapter.names != ["x"] else [self.flat(states)]
        named = dict(zip(self.adapter.names, state, strict=True))
        wrench = apply_matrix(self.model.columns, states.inputs)
        wrench = wrench * np.resize(self.signs, wrench.shape[1])
        named |= {"torque": wrench[:, :3], "force": wrench[:, 3:], "t": np.zeros(n)}
        named |= {"thrusts": states.inputs, self.adapter.step or "dt": np.full(n, step)}
        axes = command_axes(self.model.group)
        u = wrench[:, [*map(axes.index, entry.axes or axes)]]
        if entry.as_ == "speeds" or (entry.as_ != "wrench" and self.model.thrusters is not None):
            u = self.filled(entry.as_, states)
        return named | {"u": u}

    @cached_property
    def called(self) -> Any:
        """The function after its first call, in a process of its own."""
        G, names, entry = self.model.group, self.adapter.names, self.adapter.input
        inputs = self.model.drawn_inputs(self.limits, 1, np.random.default_rng(0))
        single = States(G.exp(np.ones((1, G.dimension))), np.ones((1, G.dimension)), inputs)
        arguments = self._arguments(single, STEP)
        step, state = (f", {self.adapter.step}" if self.adapter.step else ""), ", ".join(names)
        call = self.adapter.call or f"function({state}, u{step})"
        if entry.as_ not in (*FILLED, "wrench"):
            call = f"(lambda u: {call})({entry.as_})"
        n = self.flat(single).size
        result = f"[result[name] for name in {names}] if isinstance(result, dict) else result"
        # With the state, which the call must leave as it is.
        parts = f"[*flat({result}, {n}), *flat([{state}], {n})]"
        text = text_of(self.file, "it is a plant", EqtError)
        source = self.file.name, self.function, text, arguments
        how: Any = {"call": call, "result": parts, "returns": 2 * n, "period": STEP}
        return function_for(purposes.function_in_python)(*source, **how)

    def answers(self, states: States, step: float = 0.0) -> Array:
        """Return what the function returns, ``(states, n)``.

        Raises
        ------
        InputError
            If it changes its state, or returns what is not finite.
        """
        arguments = self._arguments(states, step).values()
        rows = np.hstack([value.reshape(len(value), -1) for value in arguments])
        none = rows[:, :0]
        values, state = np.split(self.called.call(0, none, 0.0, none, rows)[0], 2, axis=1)
        bad = ~np.isfinite(values).all(axis=1)
        if bad.any():
            raise InputError(
                f"{self.name} returns numbers that are not finite at {bad.sum()} of {len(bad)} "
                f"states, first at {self.called.in_words(rows[bad.argmax()])}; call it there"
            )
        if np.any(state != self.flat(states)):
            raise InputError(f"{self.name} changes its state in place; copy it first: x = x.copy()")
        return np.asarray(values)

    def derivatives(self, states: States) -> tuple[Array, Array]:
        """Return the derivative, and of a step x(h) the slope of (x(h) − x)/h by h, else 0.

        (x(h) − x)/h at h, h/2 and h/4 is extrapolated to h = 0.
        """
        if not self.adapter.step:
            rates = self.answers(states)
            return rates, 0 * rates
        x, (part, where) = self.flat(states), self.parts["attitude"]

        def slope(h: float) -> Array:
            moved = self.answers(states, h)
            change = moved - x
            change[:, where] = short_way(part, moved[:, where], x[:, where])
            return change / h

        a, b, c = map(slope, STEP / 2.0 ** np.arange(3))
        return (a - 6 * b + 8 * c) / 3, (-2 * a + 10 * b - 8 * c) / STEP

    def turned(self, states: States) -> tuple[Array, Array]:
        """Return the attitude, and its derivatives by turns about the axes of the body.

        ``(states, n), (states, n, 3)``.
        """
        return self.turned_as(self.parts["attitude"][0], states.signed(self.signs))

    def turned_as(self, part: StatePart, states: States) -> tuple[Array, Array]:
        """Return the same of a part, with states and turns in the user's axes."""
        G = self.model.group

        def at(Q: Array) -> Array:
            return part.values(G, states._replace(Q=Q).law_input).reshape(len(Q), -1)

        attitude = at(states.Q)
        ends = (
            [at(states.Q @ G.exp(h * axis)) for h in (SHORT, -SHORT)]
            for axis in np.eye(3, G.dimension)
        )
        turns = [short_way(part, a, attitude) - short_way(part, b, attitude) for a, b in ends]
        return attitude, np.stack(turns, axis=-1) / (2 * SHORT)


def short_way(part: StatePart, attitude: Array, base: Array) -> Array:
    """Return attitude − other; the signs of quaternions and the turns of angles are free."""
    if part.as_.startswith("quaternion"):
        attitude = attitude * np.sign((attitude * base).sum(axis=1, keepdims=True))
    difference = attitude - base
    if part.as_ != "roll-pitch-yaw":
        return difference
    turn = 2 * np.pi * np.abs(part.factor)
    return np.asarray(difference - turn * np.round(difference / turn))


STEP = 1e-3
"""Longest step from which a derivative is extrapolated, s; what is left is of its third power."""
