"""What flies: the parts between the law's command and the motion; it knows no law and no engine."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array, less, stack, where
from eqt_cli.core.leaves import STRUCTURE
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.tracking import Tracking
from eqt_cli.vehicle.actuators import Actuator
from eqt_cli.vehicle.estimators import Estimator
from eqt_cli.vehicle.estimators.base import Deviations, Measured
from eqt_cli.vehicle.estimators.schedule import Schedule
from eqt_cli.vehicle.forces import Force
from eqt_cli.vehicle.inertia import TrueInertia
from eqt_cli.vehicle.sampling import Sampling
from eqt_cli.vehicle.sensors import Sensor
from eqt_cli.vehicle.sensors.channels import MEASURED, Channel, Errors, channels

INERTIA = "plant.inertia"
"""Where the true inertia stands in a configuration."""

FORCES, ACTUATORS, CONTROL = "plant.forces", "actuators", "control"
"""Where the lists of forces and of actuators stand, and the clock of the law."""

POSE, VELOCITY = "sensors.pose", "sensors.velocity"
"""Where the lists of errors of measurement stand."""

ESTIMATOR = "estimator"
"""Where the estimator stands; the names of its states begin with it."""

LOST = f"{ESTIMATOR}_lost"
"""The state that says whether the covariance of an estimate is no longer definite."""

COMMANDS, HELD = "commands", "held"
"""The states of a sampled loop: the commands on their way, the first to arrive first, and what the
actuators in front of all that move by themselves make of the one that has arrived."""

RandomOf = Callable[[str], np.random.Generator]
"""The generator of one run for the part at a place of the configuration."""


@dataclass(frozen=True)
class Vehicle:
    """The parts of a vehicle; without any, it gives what the law asks, and is what it believes.

    As configured, its parts may have distributions for numbers. What flies in a run, `of_run`, has
    arrays.

    Attributes
    ----------
    inertia
        The plant's; None where it is the law's.
    forces
        Those that act beside the actuators.
    actuators
        In the order in which a command passes them.
    control
        The clock of the law; None where it acts continuously.
    pose_sensors, velocity_sensors
        The errors of what the law is told, which add up.
    estimator
        What tells the law pose and velocity; None where it is told what is measured.
    configured
        Of what flies, the vehicle that it was made of.
    """

    inertia: TrueInertia | None = None
    forces: tuple[Force, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    control: Sampling | None = field(default=None, metadata=STRUCTURE)
    pose_sensors: tuple[Sensor, ...] = field(default=(), metadata=STRUCTURE)
    velocity_sensors: tuple[Sensor, ...] = field(default=(), metadata=STRUCTURE)
    estimator: Estimator | None = None
    configured: Self | None = field(default=None, compare=False, repr=False, metadata=STRUCTURE)

    # The parts and their numbers.

    @cached_property
    def parts(self) -> dict[str, Any]:
        """Every part by its place in a configuration."""
        found: dict[str, Any] = {} if self.inertia is None else {INERTIA: self.inertia}
        for name, parts in (
            (FORCES, self.forces),
            (ACTUATORS, self.actuators),
            (POSE, self.pose_sensors),
            (VELOCITY, self.velocity_sensors),
        ):
            found |= {f"{name}[{index}]": part for index, part in enumerate(parts)}
        found |= {} if self.estimator is None else {ESTIMATOR: self.estimator}
        return found if self.control is None else {**found, CONTROL: self.control}

    @property
    def varies(self) -> bool:
        """Whether its numbers differ from run to run."""
        parts = (self.configured or self).parts.values()
        return any(part.varies for part in parts if part is not self.control)

    def of_run(self, G: MatrixLieGroup, random_of: RandomOf | None = None) -> Self:
        """What flies in one run; without generators, with the means."""
        configured = self.configured or self

        def flying(place: str) -> Any:
            random = random_of(place) if random_of else None
            return configured.parts[place].of_run(G, random)

        return dataclasses.replace(
            self,
            inertia=None if self.inertia is None else flying(INERTIA),
            forces=tuple(flying(f"{FORCES}[{k}]") for k in range(len(self.forces))),
            actuators=tuple(flying(f"{ACTUATORS}[{k}]") for k in range(len(self.actuators))),
            estimator=configured._flying_estimator(G, random_of),
            configured=configured,
        )

    def _flying_estimator(self, G: MatrixLieGroup, random_of: RandomOf | None) -> Estimator | None:
        if self.estimator is None:
            return None
        random = random_of(ESTIMATOR) if random_of else None
        return self.estimator.completed(G, self.deviations(G)).of_run(G, random)

    @property
    def linear_part(self) -> Self:
        """The same without limits, steps and dead zones of actuators, and told what is measured."""
        return dataclasses.replace(
            self, actuators=tuple(part.linear_part for part in self.actuators), estimator=None
        )

    # What the law is told.

    @property
    def measures(self) -> bool:
        """Whether what the law is told has errors."""
        return bool(self.pose_sensors or self.velocity_sensors)

    def sensors(self) -> dict[str, Sensor]:
        """Every sensor by its place in a configuration."""
        pairs = (POSE, self.pose_sensors), (VELOCITY, self.velocity_sensors)
        return {f"{name}[{k}]": part for name, parts in pairs for k, part in enumerate(parts)}

    def channels(self, G: MatrixLieGroup) -> list[Channel]:
        """The parts of the measured pose and velocity that have sensors."""
        if self.control is None:
            return []
        signals = {"pose": self.pose_sensors, "velocity": self.velocity_sensors}
        return list(channels(G, signals, self.control.period))

    def holding(self, G: MatrixLieGroup) -> list[Channel]:
        """Those of which the law reads what was measured last."""
        return [channel for channel in self.channels(G) if channel.holds]

    def drawings(self, G: MatrixLieGroup) -> Iterator[tuple[str, Sensor, int, Any, Any]]:
        """Place and sensor, with each of its rates: the periods between measurements, and axes.

        The axes are those of the group, and which of the sensor's own coordinates they are.
        """
        for place, sensor in self.sensors().items():
            signal, rates = place.partition("[")[0], dict[int, list[int]]()
            for channel in self.channels(G):
                if f"sensors.{channel.signal}" == signal and sensor.of in (None, channel.part.name):
                    axes = rates.setdefault(channel.every, [])
                    axes += range(G.dimension)[channel.part.axes]
            for every, axes in rates.items():
                own = axes if sensor.of is None else slice(None)
                yield place, sensor, every, axes, own

    def measurement_errors(self, G: MatrixLieGroup, instants: int, random_of: RandomOf) -> Errors:
        """What the sensors do at the control instants of a run.

        What a sensor draws for a part depends on the number of the measurement and on nothing else.
        """
        assert self.control is not None
        n = {name: np.zeros((instants, G.dimension)) for name in (POSE, VELOCITY)}
        bias = np.zeros((instants, 0 if self.estimator is None else G.dimension))
        for place, sensor, every, axes, own in self.drawings(G):
            count, period = -(-instants // every), every * self.control.period
            drawn = sensor.errors(G, count, period, random_of(place))
            errors, signal = np.repeat(drawn[:, own], every, 0)[:instants], place.partition("[")[0]
            n[signal][:, axes] += errors
            if self.estimator and signal == VELOCITY and sensor.bias_deviation(G) is not None:
                bias[:, axes] += errors
        arrived = [
            channel.arrivals(instants, random_of(f"{channel.name}.arrived"))
            for channel in self.holding(G)
        ]
        flags = np.array(arrived).reshape(len(arrived), instants).T
        return Errors(G.exp(n[POSE]), n[VELOCITY], flags, bias)

    def after_measuring(
        self, G: MatrixLieGroup, Q: Array, V: Array, errors: Errors, states: Mapping[str, Array]
    ) -> dict[str, Array]:
        """The states of sensors and estimator behind an instant, at which Q and V are true."""
        found, holding = {}, self.holding(G)
        Q_m, V_m = Q @ errors.pose, V + errors.velocity
        for k, channel in enumerate(holding):
            value, flags = Q_m if channel.signal == "pose" else V_m, errors.arrived[..., k]
            found[channel.name] = channel.measured(value, states[channel.name], flags)
        if self.estimator is None:
            return found
        schedule, own = self.schedule(G), estimator_states(states)
        arrived = {channel.name: errors.arrived[..., k] for k, channel in enumerate(holding)}
        fresh = [
            where(less(0.5 * MEASURED, arrived[fix.name]), 1.0, 0.0) if fix.holds else 1.0
            for fix in schedule.fixes
        ]
        now = stack([flag + 0.0 * V[..., 0] for flag in fresh])
        measured = Measured(*self.as_arrived(G, Q_m, V_m, found), now, Q, errors.bias)
        after = self.estimator.after(schedule, measured, own)
        return found | {f"{ESTIMATOR}_{name}": values for name, values in after.items()}

    # What an estimator makes of it.

    def schedule(self, G: MatrixLieGroup) -> Schedule:
        """When what is measured, for an estimator."""
        return Schedule(G, self.channels(G), self._period)

    def deviations(self, G: MatrixLieGroup) -> Deviations:
        """What the sensors say of their errors."""
        squares = {name: np.zeros(G.dimension) for name in (POSE, VELOCITY)}
        bias = np.zeros((2, G.dimension))
        for place, sensor, every, axes, own in self.drawings(G):
            white = sensor.drawn(None).white_deviation(G, every * self._period)
            if white is not None:
                squares[place.partition("[")[0]][axes] += white[own] ** 2
            known = sensor.bias_deviation(G)
            if known is not None and place.startswith(VELOCITY):
                bias[:, axes] += np.array(known)[:, own] ** 2
        found = [np.sqrt(squares[name]) for name in (POSE, VELOCITY)]
        return Deviations(*found, *np.sqrt(bias))

    def estimated(self, G: MatrixLieGroup, states: Mapping[str, Array]) -> tuple[Array, Array]:
        """Q̂ and V̂."""
        own = estimator_states(states)
        return G.unpack(own["pose"]), own["velocity"]

    def as_arrived(
        self, G: MatrixLieGroup, Q: Array, V: Array, states: Mapping[str, Array]
    ) -> tuple[Array, Array]:
        """A measured pose and velocity, with the parts in them that have arrived before."""
        for channel in self.holding(G):
            if channel.signal == "pose":
                Q = channel.read(Q, states[channel.name])
            else:
                V = channel.read(V, states[channel.name])
        return Q, V

    # From the command to the force that moves the momentum.

    @property
    def is_ideal(self) -> bool:
        """Whether the law's command is the only force on the plant that the law believes in."""
        return not self.parts

    @property
    def departures(self) -> str:
        """In what it departs from what theorems are about, in words; nothing where it is ideal."""
        return ", ".join(dict.fromkeys(part.departs for part in self.parts.values()))

    @property
    def estimates(self) -> bool:
        """Whether an estimator tells the law pose and velocity."""
        return self.estimator is not None

    @property
    def knows_covariance(self) -> bool:
        """Whether it does so with a covariance."""
        return self.estimator is not None and self.estimator.has_covariance

    @property
    def limits(self) -> bool:
        """Whether an actuator can be at a limit."""
        return any(actuator.limits for actuator in self.actuators)

    @property
    def thruster_names(self) -> tuple[str, ...]:
        """The names of the thrusters, which one actuator has."""
        return next((part.thruster_names for part in self.actuators if part.thruster_names), ())

    @property
    def thrust_limits(self) -> tuple[Array, Array] | None:
        """The least and the largest thrust of each thruster; None where it has no limits."""
        parts: tuple[Any, ...] = self.actuators  # whoever names thrusters has limits for each
        limited = (part for part in parts if part.thruster_names and part.limits)
        return next(((part.low, part.high) for part in limited), None)

    def torque_limits(self, G: MatrixLieGroup) -> tuple[Array, Array] | None:
        """The least and the largest torque along each axis; None where none has such limits."""
        ranges = [found for part in self.actuators if (found := part.torque_range(G)) is not None]
        if not ranges:
            return None
        lows, highs = zip(*ranges, strict=True)
        return np.max(lows, axis=0), np.min(highs, axis=0)

    @property
    def solves(self) -> int:
        """How many numbers are found at control instants by code that no engine compiles."""
        return sum(len(part.thruster_names) for part in self.actuators if part.solves)

    @cached_property
    def _at_instants(self) -> int:
        """How many actuators act at control instants: those in front of all with a rate."""
        if self.control is None:
            return 0
        moving = (k for k, actuator in enumerate(self.actuators) if actuator.moves)
        return next(moving, len(self.actuators))

    @property
    def first_moving(self) -> Actuator | None:
        """The first actuator with a rate, which a sampled law gives a command that is held."""
        rest = self.actuators[self._at_instants :]
        return rest[0] if rest and rest[0].moves else None

    def first_moving_after(
        self,
        G: MatrixLieGroup,
        states: Mapping[str, Array],
        later: Mapping[str, Array],
        duration: Array,
    ) -> tuple[Array, Array]:
        """Its moving states after a command was held, by its closed form and as they are later."""
        place, actuator = next(self._chain(self._at_instants))
        held = self._held(G, states)
        found = actuator.after(G, held, states[place], duration)
        return found, later[place][..., -found.shape[-1] :]

    def _held(self, G: MatrixLieGroup, states: Mapping[str, Array]) -> Array:
        """The command that is held, as the actuators at instants have left it."""
        return states[HELD] if self._at_instants else states[COMMANDS][..., : G.dimension]

    def states(self, G: MatrixLieGroup) -> dict[str, int]:
        """What has states besides the plant, and how many."""
        counted = {
            f"{ACTUATORS}_{index}": actuator.states(G)
            for index, actuator in enumerate(self.actuators)
        }
        found = {place: count for place, count in counted.items() if count}
        if self.control is None:
            return found
        held = {HELD: G.dimension} if self._at_instants else {}
        told = {channel.name: channel.states for channel in self.holding(G)}
        commands = {COMMANDS: (self.control.delay + 1) * G.dimension}
        return {**commands, **held, **found, **told, **self.estimator_lengths(G)}

    def estimator_lengths(self, G: MatrixLieGroup) -> dict[str, int]:
        """Those of the estimator, which are the last; nothing moves them between instants."""
        if self.estimator is None or self.control is None:
            return {}
        own = self.estimator.states(self.schedule(G))
        return {f"{ESTIMATOR}_{name}": count for name, count in own.items()}

    def _chain(self, start: int = 0) -> Iterator[tuple[str, Actuator]]:
        """The actuators from the first that counts, with the names of their states."""
        for index, actuator in enumerate(self.actuators[start:], start):
            yield f"{ACTUATORS}_{index}", actuator

    def passed(
        self, G: MatrixLieGroup, command: Array, states: Mapping[str, Array]
    ) -> tuple[Array, dict[str, Array]]:
        """What becomes of a command on its way.

        Returns
        -------
        torque : (..., m)
            What the last actuator gives.
        rates
            The time derivatives of all states; those that are held have none.
        """
        rates = {place: 0.0 * values for place, values in states.items()}
        if self.control is not None:
            command = self._held(G, states)
        for place, actuator in self._chain(self._at_instants):
            x = states.get(place, command[..., :0])
            if place in states:
                rates[place] = actuator.state_rate(G, command, x)
            command = actuator.output(G, command, x)
        return command, rates

    def last_command(self, G: MatrixLieGroup, states: Mapping[str, Array]) -> Array:
        """What a sampled law asked at the last instant."""
        return states[COMMANDS][..., -G.dimension :]

    def after_instant(
        self,
        G: MatrixLieGroup,
        asked: Array,
        states: Mapping[str, Array],
        solved: Array | None = None,
    ) -> dict[str, Array]:
        """The states after a control instant, at which the law asks for a torque.

        Parameters
        ----------
        solved
            The `solution`, where it is known.
        """

        def solve(actuator: Actuator, command: Array) -> Array:
            return actuator.solution(G, command) if solved is None else solved

        return self._after_instant(G, asked, states, solve)

    def solution(self, G: MatrixLieGroup, asked: Array, states: Mapping[str, Array]) -> Array:
        """What an actuator that `solves` finds at a control instant, ``(runs, n)``."""
        found = []

        def solve(actuator: Actuator, command: Array) -> Array:
            found.append(actuator.solution(G, command))
            return found[0]

        self._after_instant(G, asked, states, solve)
        return found[0]

    def _after_instant(
        self,
        G: MatrixLieGroup,
        asked: Array,
        states: Mapping[str, Array],
        solve: Callable[[Actuator, Array], Array],
    ) -> dict[str, Array]:
        before = states[COMMANDS]
        queue = np.concatenate([before[..., G.dimension :], asked], axis=-1)
        found, command = {**states, COMMANDS: queue}, queue[..., : G.dimension]
        # The first actuator that moves may have a part that acts at instants, too.
        for index, (place, actuator) in enumerate(self._chain()):
            if index > self._at_instants:
                break
            x = states.get(place, command[..., :0])
            if place in states:
                taken = solve(actuator, command) if actuator.solves else command
                x = found[place] = actuator.step(G, taken, x, self._period)
            if index < self._at_instants:
                command = actuator.output(G, command, x)
        return {**found, HELD: command} if self._at_instants else found

    @property
    def _period(self) -> float:
        """Between control instants, s."""
        assert self.control is not None
        return self.control.period

    def thrust(self, G: MatrixLieGroup, command: Array, states: Mapping[str, Array]) -> Array:
        """What each thruster gives, ``(..., k)``."""
        if self.control is not None:
            command = states[COMMANDS][..., : G.dimension]
        for place, actuator in self._chain():
            x = states.get(place, command[..., :0])
            if actuator.thruster_names:
                return actuator.thrust(G, command, x)
            command = actuator.output(G, command, x)
        return command[..., :0]

    def at_limit(self, G: MatrixLieGroup, command: Array, states: Mapping[str, Array]) -> Array:
        """Where any actuator is given more than its limit, ``(...)``."""
        found = np.zeros(command.shape[:-1], dtype=bool)
        if self.control is not None:
            command = states[COMMANDS][..., : G.dimension]
        for place, actuator in self._chain():
            x = states.get(place, command[..., :0])
            here = actuator.at_limit(G, command, x)
            found = found if here is None else found | here
            command = actuator.output(G, command, x)
        return found

    def acting(self, s: Tracking, torque: Array) -> Array:
        """The force that would move the plant that the law believes in as this one moves.

        That is d/dt(𝕀V) − ad*_V 𝕀V with the model's 𝕀 and the true V̇; body frame, ``(..., m)``.
        """
        G = s.G
        for force in self.forces:
            torque = torque + force.in_body(G, s.t, s.Q, s.V)
        if self.inertia is None:
            return torque
        true = self.inertia.at(s.inertia, s.t)
        free = G.ad_star(s.V, true.momentum(s.V)) - true.rate_force(s.V)
        V_dot = true.velocity(free + torque)
        return s.inertia.momentum(V_dot) + s.inertia.rate_force(s.V) - G.ad_star(s.V, s.P)


def estimator_states(states: Mapping[str, Array]) -> dict[str, Array]:
    """The states of the estimator, by its own names for them."""
    start = f"{ESTIMATOR}_"
    own = (name for name in states if name.startswith(start))
    return {name.removeprefix(start): states[name] for name in own}
