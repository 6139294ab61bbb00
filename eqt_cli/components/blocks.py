"""The parts of a vehicle as blocks of a block diagram, and the one way in which they are evaluated.

A block has states, and ports that others read. A port is computed where it is first read, from the
ports that its block reads. At a tick a block first takes its states to those after it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, absolute, less, stack, where
from eqt_cli.components.accelerometer import felt
from eqt_cli.components.actuators import THRUSTS, Actuator, Running, Solving
from eqt_cli.components.estimators import Estimator, Measurement, Schedule
from eqt_cli.components.forces import GRAVITY
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.mechanics import Gains, Tracking
from eqt_cli.components.sensors import CHANNEL_MEASURED as MEASURED
from eqt_cli.components.sensors import Channel, DynamicSensor, Errors, depth_of
from eqt_cli.components.vehicle import (
    ACTUATORS,
    CLOCKS,
    COMMANDS,
    CONTROL,
    ESTIMATOR,
    HELD,
    PROPELLANT,
    SENSOR,
    SIGNALS,
    TAKEN,
    Vehicle,
    command_length,
    estimator_states,
    moving_sensors,
)

COMMAND = "law.command"
"""The port with the command of the law."""

SOLVED = "solved"
"""The port with the `solution` of an actuator, where it is known."""


@dataclass(frozen=True)
class Block:
    """A block; each of its ports is a method, ``"commands.last"`` that of the block `commands`.

    Attributes
    ----------
    stretches
        The names of its states.
    """

    name: str
    stretches: tuple[str, ...]

    def port(self, key: str) -> Callable[["Now"], Any]:
        """Return the function of a port."""
        port: Callable[[Now], Any] = getattr(self, key)
        return port

    def rates(self, ports: "Now", x: Arrays) -> Arrays:
        """Return the time derivatives of its states."""
        return {name: 0.0 * values for name, values in x.items()}

    def step(self, ports: "Now", x: Arrays) -> Arrays:
        """Return its states after a tick."""
        return x


class Blocks:
    """Blocks by their names, the last of which is what the law reads."""

    def __init__(self, blocks: Iterable[Block]) -> None:
        self.named = {block.name: block for block in blocks}
        self.moving = [block for block in self.named.values() if block.stretches]
        self.actuated = [block for block in self.named.values() if isinstance(block, Actuated)]
        clocks = self.named.get(CLOCKS)
        self._places = [*clocks.every] if isinstance(clocks, Clocks) else []
        self._ports: dict[str, Callable[[Now], Any]] = {}

    def port(self, port: str) -> Callable[["Now"], Any]:
        """Return the function of a port."""
        if port not in self._ports:
            name, _, key = port.partition(".")
            self._ports[port] = self.named[name].port(key)
        return self._ports[port]

    def due(self, states: Arrays, place: str) -> Any:
        """Return whether law or actuator acts at the tick of these states; None: at every one."""
        if place not in self._places:
            return None
        k = self._places.index(place)
        return less(states[CLOCKS][..., k : k + 1], 0.5)

    @property
    def read(self) -> str:
        """The name of the block that the law reads."""
        return [*self.named][-1]


class Now:
    """The values of all ports of a vehicle in a state.

    Parameters
    ----------
    ports
        Values of ports that are given: `COMMAND`, or the solution `SOLVED`.
    acts
        Whether it is a tick. States are then those before it, ports those after it.
    errors
        Measurement errors at a tick; None where the law knows the truth.
    """

    def __init__(
        self,
        blocks: Blocks,
        s: Tracking,
        ports: Mapping[str, Any] | None = None,
        acts: bool = False,
        errors: Errors | None = None,
    ) -> None:
        self.blocks, self.s, self.acts, self.errors = blocks, s, acts, errors
        self._values, self._after = dict(ports or {}), dict[str, Arrays]()

    def __contains__(self, port: str) -> bool:
        return port in self._values

    def __getitem__(self, port: str) -> Any:
        if port not in self._values:
            self._values[port] = self.blocks.port(port)(self)
        return self._values[port]

    def after(self, name: str) -> Arrays:
        """Return the states of a block; at a tick, those after it."""
        if name not in self._after:
            block, states = self.blocks.named[name], self.s.vehicle
            x = {stretch: states[stretch] for stretch in block.stretches if stretch in states}
            self._after[name] = block.step(self, x) if self.acts else x
        return self._after[name]

    def stepped(self) -> dict[str, Array]:
        """Return the states of all blocks after a tick."""
        return {k: x for block in self.blocks.moving for k, x in self.after(block.name).items()}

    def rates(self) -> dict[str, Array]:
        """Return the time derivatives of the states of all blocks."""
        rates: dict[str, Array] = {}
        for block in self.blocks.moving:
            rates |= block.rates(self, self.after(block.name))
        return rates

    def if_due(self, place: str, new: Array, old: Array) -> Array:
        """Return new values of law or actuator at a tick at which it acts, else the old ones."""
        acts = self.blocks.due(self.s.vehicle, place)
        return new if acts is None else where(acts, new, old)


# From the command to the force that changes the momentum ------------------------------------------


@dataclass(frozen=True)
class Commands(Block):
    """The commands on their way, the first to arrive first.

    Attributes
    ----------
    length
        Number of entries of a command.
    """

    length: int

    def arrived(self, ports: Now) -> Array:
        """Return the command that has arrived."""
        return ports.after(self.name)[COMMANDS][..., : self.length]

    def step(self, ports: Now, x: Arrays) -> Arrays:
        """Return the commands with that of the law, if it acts."""
        queue, n = x[COMMANDS], self.length
        command = ports.if_due(CONTROL, ports[COMMAND], queue[..., -n:])
        return {COMMANDS: np.concatenate([queue[..., n:], command], axis=-1)}


@dataclass(frozen=True)
class Clocks(Block):
    """The ticks that are left to each part with a clock of its own.

    Attributes
    ----------
    every
        Ticks from one time at which a part acts to the next, by its name.
    """

    every: Mapping[str, int]

    def step(self, ports: Now, x: Arrays) -> Arrays:
        """Return the ticks that are left a tick later."""
        left, every = x[CLOCKS], np.array([*self.every.values()], float)
        return {CLOCKS: where(less(left, 0.5), every + 0.0 * left, left) - 1.0}


@dataclass(frozen=True)
class Held(Block):
    """The output of the last actuator that acts at ticks only, between them.

    Attributes
    ----------
    source
        The port that is held.
    """

    source: str

    def output(self, ports: Now) -> Array:
        """Return the torque that is held."""
        return ports.after(self.name)[HELD]

    def step(self, ports: Now, x: Arrays) -> Arrays:
        """Return the output of the actuator at this tick."""
        return {HELD: ports[self.source]}


@dataclass(frozen=True)
class Actuated(Block):
    """An actuator, with the command that it gets.

    Attributes
    ----------
    part
        The actuator.
    source
        The port with its command.
    stored
        The port with the momentum that wheels store; "" without wheels.
    period
        Time between ticks at which it takes its command, s; 0 where it takes none at ticks.
    held
        Whether it acts at ticks only.
    clips
        Whether limits behind it must not hide a command that is not finite.
    """

    part: Actuator
    source: str
    stored: str = ""
    period: float = 0.0
    held: bool = False
    clips: bool = False

    @cached_property
    def taken(self) -> str:
        """The name of the command that it has taken, if it has a clock."""
        return f"{self.name}_{TAKEN}"

    def state(self, ports: Now, like: Array) -> Array:
        """Return the states of the actuator."""
        return ports.after(self.name).get(self.name, like[..., :0])

    def input(self, ports: Now) -> Array:
        """Return its command."""
        x = ports.after(self.name)
        command: Array = x[self.taken] if self.taken in x else ports[self.source]
        return command

    def driven(self, ports: Now) -> Array:
        """Return its command; NaN where it is infinite and limits would hide it."""
        u: Array = ports[f"{self.name}.input"]
        return u - (u - u) if self.clips else u

    def at(self, ports: Now) -> Actuator:
        """Return the actuator at this time and state."""
        if not self.part.changes:
            return self.part
        return self.part.at(ports.s, ports[self.stored] if self.stored else 0.0 * ports.s.V)

    def output(self, ports: Now) -> Array:
        """Return what it makes of its command."""
        u, part = ports[f"{self.name}.driven"], ports[f"{self.name}.at"]
        torque: Array = part.output(ports.s.G, u, self.state(ports, u))
        return torque

    def reaction(self, ports: Now) -> tuple[Array, Array] | None:
        """Return its force that depends on the velocity, and the rates that go with it."""
        return self.part.reaction(ports.s.G, ports.s.V, self.state(ports, ports.s.V))

    def arguments(self, ports: Now) -> tuple[MatrixLieGroup, Array, Array]:
        """Return what its limits are asked with: the group, its command and its states."""
        u = ports[f"{self.name}.input"]
        return ports.s.G, u, self.state(ports, u)

    def signals(self, ports: Now) -> Arrays:
        """Return its signals over time."""
        G, u, x = self.arguments(ports)
        values: Arrays = ports[f"{self.name}.at"].signals(G, ports.s.V, u, x)
        return values

    def momentum(self, ports: Now) -> Array:
        """Return the momentum A h of wheels in the body frame."""
        wheels: Any = self.part
        momentum: Array = wheels.stored(self.state(ports, ports.s.V))
        return momentum

    def rates(self, ports: Now, x: Arrays) -> Arrays:
        """Return the rates by its command, and those of its reaction."""
        rates = {name: 0.0 * values for name, values in x.items()}
        if self.name not in x:
            return rates
        if not self.held:
            part, u = ports[f"{self.name}.at"], ports[f"{self.name}.driven"]
            rates[self.name] = part.state_rate(ports.s.G, u, x[self.name])
        if (reaction := ports[f"{self.name}.reaction"]) is not None:
            rates[self.name] = rates[self.name] + reaction[1]
        return rates

    def step(self, ports: Now, x: Arrays) -> Arrays:
        """Return its states after it has taken its command, if it does at ticks."""
        if not self.period or not x:
            return x
        after, u, G = dict(x), ports[self.source], ports.s.G
        if self.taken in x:
            u = after[self.taken] = ports.if_due(self.name, u, x[self.taken])
        if self.name in x:
            if isinstance(self.part, Solving) and self.part.solves:
                u = ports[SOLVED] if SOLVED in ports else self.part.solution(G, u)
            later = self.part.step(G, u, x[self.name], self.period)
            after[self.name] = ports.if_due(self.name, later, x[self.name])
        return after


@dataclass(frozen=True)
class Burning(Block):
    """The propellant that thrusters burn.

    Attributes
    ----------
    thrusters
        The name of their block.
    """

    thrusters: str

    def rates(self, ports: Now, x: Arrays) -> Arrays:
        """Return Σ|f|/(g₀ isp)."""
        thrust = ports[f"{self.thrusters}.signals"]["thrust"]
        flow = absolute(thrust) / (GRAVITY * ports[f"{self.thrusters}.at"].isp)
        return {PROPELLANT: stack([flow.sum(axis=-1)])}


@dataclass(frozen=True)
class Forces(Block):
    """All that acts on the body.

    Attributes
    ----------
    vehicle
        The vehicle, with the forces of the environment and the true inertia.
    source
        The port with the torque of the actuators.
    """

    vehicle: Vehicle
    source: str

    def torque(self, ports: Now) -> Array:
        """Return the torque of the last actuator, or the command that has arrived."""
        torque: Array = ports[self.source]
        return torque

    def with_reactions(self, ports: Now) -> Array:
        """Return the torque with the reactions of all actuators."""
        torque = ports[self.source]
        for block in ports.blocks.actuated:
            if (reaction := ports[f"{block.name}.reaction"]) is not None:
                torque = torque + reaction[0]
        return torque

    def acting(self, ports: Now) -> Array:
        """Return the force that would move the law's model as the true plant moves."""
        return acting_force(self.vehicle, ports.s, ports["forces.with_reactions"])


def acting_force(vehicle: Vehicle, s: Tracking, torque: Array) -> Array:
    """Return the force that would move the law's model as the true plant moves.

    It is d/dt(𝕀V) − ad*_V 𝕀V with the model's 𝕀 and the true V̇; body frame, ``(..., m)``.
    """
    G = s.G
    for force in vehicle.forces:
        torque = torque + force.in_body(G, s.t, s.Q, s.V)
    if vehicle.inertia is None:
        return torque
    true = vehicle.inertia_at(s)
    free = G.ad_star(s.V, true.momentum(s.V)) - true.rate_force(s.V)
    V_dot = true.velocity(free + torque)
    return s.inertia.momentum(V_dot) + s.inertia.rate_force(s.V) - G.ad_star(s.V, s.P)


def solution(ports: Now) -> Array:
    """Return the solution of the actuator that `solves`, at a tick, ``(runs, n)``."""
    for block in ports.blocks.actuated:
        if isinstance(block.part, Solving) and block.part.solves:
            return block.part.solution(ports.s.G, ports[f"{block.name}.input"])
    return ports.s.P[..., :0]


# What signals read of actuators -------------------------------------------------------------------


def signals(ports: Now) -> dict[str, Array]:
    """Return the signals of the actuators' own, by name."""
    named: dict[str, Array] = {}
    for block in ports.blocks.actuated:
        if block.part.shows:
            named |= ports[f"{block.name}.signals"]
    return named


def beyond_limits(ports: Now) -> Array:
    """Return 1 where the input of any actuator exceeds its limit, else 0, ``(...)``."""
    beyond = np.zeros(ports.s.P.shape[:-1])
    for block in ports.blocks.actuated:
        if (flags := ports[f"{block.name}.at"].at_limit(*block.arguments(ports))) is not None:
            beyond = where(less(0.5, flags), 1.0, beyond)
    return beyond


def cut_axes(ports: Now, limits: bool) -> Array:
    """Return 1 along axes where limits change the input of any actuator, else 0, ``(..., m)``.

    A difference of the size of rounding is none.
    """
    flags = 0.0 * ports.s.P
    if limits:
        for block in ports.blocks.actuated:
            part = ports[f"{block.name}.at"]
            G, u, x = block.arguments(ports)
            torque = part.requested(u) if part.takes == THRUSTS else u
            most = 1e-12 * (1 + absolute(torque))
            flags = where(less(most, absolute(torque - part.within(G, u, x))), 1.0, flags)
    return flags


# Measurements and estimate ------------------------------------------------------------------------


@dataclass(frozen=True)
class Reading(Block):
    """A sensor of the velocity whose state follows the motion.

    Attributes
    ----------
    sensor
        The sensor.
    source
        The port with the velocity that it reads; "" for the true one.
    """

    sensor: DynamicSensor
    source: str

    def _read(self, ports: Now) -> Array:
        V: Array = ports[self.source] if self.source else ports.s.V
        return V

    def velocity(self, ports: Now) -> Array:
        """Return the velocity as it is read."""
        V, axes = self._read(ports).copy(), self.sensor.axes(ports.s.G)
        V[..., axes] = self.sensor.reading(V[..., axes], ports.after(self.name)[self.name])
        return V

    def rates(self, ports: Now, x: Arrays) -> Arrays:
        """Return the rate of its state."""
        part = self._read(ports)[..., self.sensor.axes(ports.s.G)]
        return {self.name: self.sensor.state_rate(part, x[self.name])}


@dataclass(frozen=True)
class Feeling(Block):
    """The accelerometer, whose sensors have the states, before errors.

    Attributes
    ----------
    vehicle
        Its vehicle.
    """

    vehicle: Vehicle

    def force(self, ports: Now) -> Array:
        """Return the specific force."""
        return felt(self.vehicle, ports.s, ports["forces.acting"])[0]

    def rates(self, ports: Now, x: Arrays) -> Arrays:
        """Return the rates of the states."""
        return felt(self.vehicle, ports.s, ports["forces.acting"])[1]


@dataclass(frozen=True)
class Noisy(Block):
    """The measurements with their errors.

    Attributes
    ----------
    source
        The port with the velocity behind all sensors that follow the motion; "" for the true one.
    """

    source: str

    def pose(self, ports: Now) -> Array:
        """Return Q_m."""
        return ports.s.Q if ports.errors is None else ports.s.Q @ ports.errors.pose

    def velocity(self, ports: Now) -> Array:
        """Return V_m."""
        V: Array = ports[self.source] if self.source else ports.s.V
        return V if ports.errors is None else V + ports.errors.velocity

    def magnetometer(self, ports: Now) -> Array | None:
        """Return B_m; None without a field."""
        B: Array | None = ports.s.flux
        return B if B is None or ports.errors is None else B + ports.errors.flux

    def accelerometer(self, ports: Now) -> Array:
        """Return f_m."""
        force: Array = ports["felt.force"]
        noise = None if ports.errors is None else ports.errors.felt
        return force if noise is None or not noise.shape[-1] else force + noise

    def depth(self, ports: Now) -> Array:
        """Return Q with the last coordinate of the position as it is measured."""
        Q, (part,) = ports.s.Q.copy(), depth_of(ports.s.G)
        if ports.errors is not None:
            Q[(..., *part.entries)] = Q[(..., *part.entries)] + ports.errors.depth[..., None]
        return Q


@dataclass(frozen=True)
class Arrived(Block):
    """The measurements that have arrived, by `SIGNALS`: of parts that hold, the last one.

    Attributes
    ----------
    holding
        The channels whose last measurement is held.
    """

    holding: Sequence[Channel]

    def port(self, key: str) -> Callable[[Now], Any]:
        """Return the function of a measurement."""
        channels = [channel for channel in self.holding if channel.signal == key]

        def arrived(ports: Now) -> Any:
            value = ports[f"noisy.{key}"]
            if ports.errors:
                for channel in channels:
                    value = channel.read(value, ports.after(self.name)[channel.name])
            return value

        return arrived

    def step(self, ports: Now, x: Arrays) -> Arrays:
        """Return the measurements on their way, or held."""
        if ports.errors is None:
            return x
        after = {}
        for k, channel in enumerate(self.holding):
            value, flags = ports[f"noisy.{channel.signal}"], ports.errors.arrived[..., k]
            after[channel.name] = channel.measured(value, x[channel.name], flags)
        return after


@dataclass(frozen=True)
class Estimating(Block):
    """An estimator, from which the law reads pose and velocity, and other things as they arrive.

    Attributes
    ----------
    estimator
        The filter.
    schedule
        When what is measured.
    holding
        The names of the channels whose last measurement is held.
    """

    estimator: Estimator
    schedule: Schedule
    holding: Sequence[str]

    def port(self, key: str) -> Callable[[Now], Any]:
        """Return the function of a measurement, or of its estimate."""

        def estimated(ports: Now) -> Any:
            if ports.errors is None or key not in SIGNALS[:2]:
                return ports[f"arrived.{key}"]
            estimate = ports.after(self.name)[f"{self.name}_{key}"]
            return ports.s.G.unpack(estimate) if key == "pose" else estimate

        return estimated

    def step(self, ports: Now, x: Arrays) -> Arrays:
        """Return its states after the measurements of this tick."""
        if (errors := ports.errors) is None:
            return x
        fresh = [
            where(
                less(0.5 * MEASURED, errors.arrived[..., self.holding.index(part.name)]), 1.0, 0.0
            )
            if part.holds
            else 1.0
            for part in self.schedule.timed
        ]
        flags = stack([flag + 0.0 * ports.s.V[..., 0] for flag in fresh])
        arrived = ports["arrived.pose"], ports["arrived.velocity"]
        measured = Measurement(*arrived, flags, ports.s.Q, errors.bias, ports)
        after = self.estimator.after(self.schedule, measured, estimator_states(x))
        return {f"{self.name}_{name}": values for name, values in after.items()}


def body(G: MatrixLieGroup, Q: Array, V: Array, states: Arrays) -> Tracking:
    """Return the state of a body of unit inertia, for parts of which only the motion counts."""
    one, still = np.eye(G.dimension), 0.0 * V
    inertia, gains = Inertia(one, one), Gains(np.eye(G.size), one)
    return Tracking(G, inertia, gains, 0.0, Q, V, Q, still, still, vehicle=states)


# The blocks of a vehicle --------------------------------------------------------------------------


def blocks_of(vehicle: Vehicle, G: MatrixLieGroup, *others: Block) -> Blocks:
    """Return the blocks of a vehicle, wired as its parts are joined, behind some others."""
    blocks = [*others]
    free = vehicle.states(G)

    def stretches_of(*names: str) -> tuple[str, ...]:
        return tuple(name for name in names if free.pop(name, None))

    velocity, source, control = "", COMMAND, vehicle.control
    if control is not None:
        blocks.append(Commands("commands", stretches_of(COMMANDS), command_length(vehicle, G)))
        source = "commands.arrived"
    if vehicle.clocks:
        every = {place: clock.every for place, clock in vehicle.clocks.items()}
        blocks.append(Clocks(CLOCKS, stretches_of(CLOCKS), every))
    held = len(vehicle.actuators) - len(vehicle.moving)
    stored = f"{vehicle.wheels[0]}.momentum" if vehicle.wheels else ""
    for k, part in enumerate(vehicle.actuators):
        place = f"{ACTUATORS}_{k}"
        period = 0.0
        if control is not None and k <= held:
            clock = vehicle.clocks.get(place)
            period = control.tick if clock is None else clock.every * control.tick
        clips = k == 0 and control is None and vehicle.limits
        stretches = stretches_of(f"{place}_{TAKEN}", place)
        blocks.append(Actuated(place, stretches, part, source, stored, period, k < held, clips))
        source = f"{place}.output"
        if k == held - 1:
            blocks.append(Held(HELD, stretches_of(HELD), source))
            source = f"{HELD}.output"
        if part is vehicle.burns:
            blocks.append(Burning("burning", stretches_of(PROPELLANT), place))
    blocks.append(Forces("forces", (), vehicle, source))
    for k, sensor in moving_sensors(vehicle):
        name = f"{SENSOR}_{k}"
        blocks.append(Reading(name, stretches_of(name), sensor, velocity))
        velocity = f"{name}.velocity"
    feeling = stretches_of(*(f"{SENSOR}_{k}" for k, _ in moving_sensors(vehicle, "accelerometer")))
    blocks += [Feeling("felt", feeling, vehicle), Noisy("noisy", (), velocity)]
    estimate = stretches_of(*vehicle.estimator_lengths(G))
    holding = vehicle.holding(G)
    blocks.append(Arrived("arrived", stretches_of(*free), holding))
    if vehicle.estimator is not None and estimate:
        names = [channel.name for channel in holding]
        schedule = vehicle.schedule(G)
        blocks.append(Estimating(ESTIMATOR, estimate, vehicle.estimator, schedule, names))
    return Blocks(blocks)


def at_start(ports: Now) -> dict[str, Array]:
    """Return states at the start of a run that follow from its first command.

    It has then been given before, too.
    """
    states, passed = dict[str, Array](), ports[COMMAND]
    for block in ports.blocks.actuated:
        part = ports[f"{block.name}.at"]
        if isinstance(part, Running) and part.runs:
            states[block.name] = part.running(ports.s.G, passed)
        elif part.takes == "rates" or not block.stretches:
            x = ports.after(block.name)
            passed = part.output(ports.s.G, passed, x.get(block.name, passed[..., :0]))
        if block.taken in block.stretches:
            states[block.taken] = ports[COMMAND][..., : ports.s.vehicle[block.taken].shape[-1]]
    if (queue := ports.s.vehicle.get(COMMANDS)) is not None:
        count = queue.shape[-1] // ports[COMMAND].shape[-1]
        states[COMMANDS] = np.concatenate([ports[COMMAND]] * count, axis=-1)
    if HELD in ports.s.vehicle:
        states[HELD] = ports[COMMAND][..., : ports.s.G.dimension]
    return states
