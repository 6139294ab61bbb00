"""The parts between a law and the motion: actuators, sensors, estimators, forces, plant."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.stored import THRUSTER, WHEEL, Signal
from eqt_cli.components.actuators import THRUSTS, Actuator, Solving
from eqt_cli.components.estimators import Deviations, Estimator, Schedule
from eqt_cli.components.forces import Force, in_currents
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia, InertiaLaw
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.sensors import Channel, DynamicSensor, Errors, Sensor, channels
from eqt_cli.components.vehicle_parts import CarriesMass, Clock, Sampling, TrueInertia
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

INERTIA = "plant.inertia"
"""Key of the true inertia in a configuration."""

FORCES, ACTUATORS, CONTROL = "plant.forces", "actuators", "control"
"""Keys of the lists of forces and of actuators, and of the clock of the law."""

INNER = "inner"
"""Key of the list of blocks that belong to one law, within its entry."""

SIGNALS = "pose", "velocity", "magnetometer", "accelerometer", "depth"
"""Names of what is measured."""

POSE, VELOCITY, FLUX, FELT, DEPTH = (f"sensors.{name}" for name in SIGNALS)
"""Keys of the lists of measurement errors."""

SENSOR = "sensor"
"""Beginning of the names of the states of sensors that follow the motion."""

ESTIMATOR = "estimator"
"""Key of the estimator; the names of its states begin with it."""

LOST = f"{ESTIMATOR}_lost"
"""The state that says whether the covariance of an estimate is no longer definite."""

PROPELLANT = "propellant"
"""The state with the propellant that thrusters have burnt, kg."""

COMMANDS, HELD, CLOCKS, TAKEN = "commands", "held", "clocks", "taken"
"""States of a sampled loop: the commands on their way, the first to arrive first; the command
that has arrived, as it leaves the actuators in front of the first with continuous states; the ticks
until each part with a clock of its own acts again, where they are not 1; the input that such an
actuator has taken, behind its name."""

RandomOf = Callable[[str], np.random.Generator]
"""Random generator of one run for the part at a place of the configuration."""


@dataclass(frozen=True)
class Vehicle:
    """The parts of a vehicle; without any, the command is the torque and the model is exact.

    As configured, its parts may have distributions for numbers. The vehicle of a run, from
    `of_run`, has arrays.

    Attributes
    ----------
    inertia
        True inertia of the plant; None where the law's model is exact.
    forces
        Forces that act beside the actuators.
    actuators
        Actuators in the order in which a command passes them.
    inner
        How many of these, the first, are blocks of the law that flies it; all laws share the rest.
    control
        Tick of the loop and clock of the law; None where it acts continuously.
    pose_sensors, velocity_sensors
        Measurement errors of the signals, which add up.
    moving_sensors
        For the vehicle of a run, the sensors whose states follow the motion.
    estimator
        Estimator from which the law reads pose and velocity; None where it reads measurements.
    configured
        For the vehicle of a run, the configured vehicle that it was made from.
    model
        The inertia of the law's model, whose added part a current moves; None where not needed.
    more_sensors
        Measurement errors of the magnetic field, of the specific force and of the depth.
    """

    inertia: TrueInertia | None = None
    forces: tuple[Force, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    control: Sampling | None = field(default=None, metadata=STRUCTURE)
    pose_sensors: tuple[Sensor, ...] = field(default=(), metadata=STRUCTURE)
    velocity_sensors: tuple[Sensor, ...] = field(default=(), metadata=STRUCTURE)
    moving_sensors: tuple[DynamicSensor, ...] = field(default=(), kw_only=True)
    estimator: Estimator | None = None
    configured: Self | None = field(default=None, compare=False, repr=False, metadata=STRUCTURE)
    model: InertiaLaw | None = field(default=None, kw_only=True, compare=False, metadata=STRUCTURE)
    more_sensors: tuple[tuple[Sensor, ...], ...] = field(
        default=((),) * 3, kw_only=True, metadata=STRUCTURE
    )
    inner: int = field(default=0, kw_only=True, metadata=STRUCTURE)

    # The parts and their numbers.

    @cached_property
    def parts(self) -> dict[str, Any]:
        """All parts by their places in a configuration."""
        lists: dict[str, tuple[Any, ...]] = {FORCES: self.forces}
        lists |= {INNER: self.actuators[: self.inner], ACTUATORS: self.actuators[self.inner :]}
        lists |= {POSE: self.pose_sensors, VELOCITY: self.velocity_sensors}
        lists |= dict(zip((FLUX, FELT, DEPTH), self.more_sensors, strict=True))
        parts: dict[str, Any] = {INERTIA: self.inertia}
        for name, listed in lists.items():
            parts |= {f"{name}[{k}]": part for k, part in enumerate(listed)}
        parts |= {ESTIMATOR: self.estimator, CONTROL: self.control}
        return {place: part for place, part in parts.items() if part is not None}

    @cached_property
    def shared_parts(self) -> dict[tuple[str, str], Any]:
        """Parts without draws, by group and place; all runs share them."""
        return {}

    @property
    def varies(self) -> bool:
        """Whether the numbers of any part differ from run to run."""
        parts = (self.configured or self).parts.values()
        return any(part.varies for part in parts if part is not self.control)

    def of_run(self, G: MatrixLieGroup, random_of: RandomOf | None = None) -> Self:
        """Return the vehicle of one run; without generators, with the means."""
        configured, felt = self.configured or self, self.more_sensors[1]
        estimator = configured.estimator

        def flying(place: str, part: Any = None) -> Any:
            part = part or configured.parts[place]
            if random_of and part.varies:
                return part.of_run(G, random_of(place))
            if (G.name, place) not in configured.shared_parts:
                configured.shared_parts[G.name, place] = part.of_run(G, None)
            return configured.shared_parts[G.name, place]

        inertia = None if configured.inertia is None else flying(INERTIA)
        acting = tuple(flying(f"{FORCES}[{k}]") for k in range(len(self.forces)))
        # A payload has a weight of its own, and no added mass.
        body = self.model if not self.model or not inertia else inertia.at(self.model.at(0.0), 0.0)
        for force in acting:
            inertia = force.loaded(inertia) if isinstance(force, CarriesMass) else inertia
        if estimator is not None:
            estimator = flying(ESTIMATOR, estimator.completed(G, configured.deviations(G)))

        return dataclasses.replace(
            self,
            inertia=inertia,
            forces=in_currents(G, acting, body) if acting else (),
            actuators=tuple(flying(place_of(self, k)) for k in range(len(self.actuators))),
            moving_sensors=tuple(
                flying(f"{signal}[{k}]")
                for signal, sensors in ((VELOCITY, self.velocity_sensors), (FELT, felt))
                for k, sensor in enumerate(sensors)
                if isinstance(sensor, DynamicSensor)
            ),
            estimator=estimator,
            configured=configured,
        )

    @property
    def linear_part(self) -> Self:
        """The vehicle without an estimator, and without limits, steps and dead zones."""
        linear = tuple(
            with_fields(part.linear_part, period=part.period, offset=part.offset)
            for part in self.actuators
        )
        return dataclasses.replace(self, actuators=linear, estimator=None)

    @property
    def magnet(self) -> Any:
        """The actuator with `in_body`, the magnetic field in the body; None without one."""
        return next((part for part in self.actuators if hasattr(part, "in_body")), None)

    # Measurements.

    @property
    def measures(self) -> bool:
        """Whether measurements have errors."""
        return bool(self.pose_sensors or self.velocity_sensors or any(self.more_sensors))

    def sensors(self) -> dict[str, Sensor]:
        """Return all sensors by their places in a configuration."""
        return {place: part for place, part in self.parts.items() if isinstance(part, Sensor)}

    def started(self, G: MatrixLieGroup, V: Array) -> dict[str, Array]:
        """Return the states of clocks, sensors and actuators at t = 0, where they are not 0."""
        moving = moving_sensors(self)
        chain = self._chain()
        started = {place: x for place, part in chain if (x := part.started(G, V)) is not None}
        started |= {f"{SENSOR}_{k}": sensor.started(V[..., sensor.axes(G)]) for k, sensor in moving}
        return {**started, CLOCKS: self.ticks_left(0)} if self.clocks else started

    def channels(self, G: MatrixLieGroup) -> list[Channel]:
        """Return the parts of the measured pose and velocity that have sensors."""
        if self.control is None:
            return []
        sensing = self.pose_sensors, self.velocity_sensors, *self.more_sensors
        return list(channels(G, dict(zip(SIGNALS, sensing, strict=True)), self.control))

    def holding(self, G: MatrixLieGroup) -> list[Channel]:
        """Return the channels whose last measurement is held for the law."""
        return [channel for channel in self.channels(G) if channel.holds]

    def drawings(self, G: MatrixLieGroup) -> Iterator[tuple[str, Sensor, Clock, Any, Any]]:
        """Yield place, sensor, clock of the measurements, and axes, for each clock of a sensor.

        The axes are given twice: in the group, and among the sensor's own coordinates.
        """
        for place, sensor in self.sensors().items():
            signal, clocks = place.partition("[")[0], dict[Clock, list[int]]()
            for channel in self.channels(G):
                if f"sensors.{channel.signal}" == signal and sensor.of in (None, channel.part.name):
                    axes = clocks.setdefault(channel.clock, [])
                    axes += range(G.dimension)[channel.part.axes]
            for clock, axes in clocks.items():
                columns = axes if sensor.of is None else slice(None)
                yield place, sensor, clock, axes, columns

    def error_lengths(self, G: MatrixLieGroup) -> tuple[int, ...]:
        """Return the number of entries of each part of `Errors`, as they are drawn for a tick."""
        m = G.dimension
        more = 3 * bool(self.magnet), m * bool(self.more_sensors[1]), 1 * bool(self.more_sensors[2])
        return m, m, len(self.holding(G)), m * self.estimates, *more

    def measurement_errors(
        self, G: MatrixLieGroup, instants: int, runs: Sequence[RandomOf]
    ) -> Errors:
        """Return the measurement errors of some runs at the ticks, ``(runs, instants, …)``.

        The numbers that a sensor draws for a part depend only on the index of the measurement.
        """
        shape, holding = (len(runs), instants), self.holding(G)
        names = POSE, VELOCITY, FLUX, FELT, DEPTH
        n = {name: np.zeros((*shape, G.dimension)) for name in names}
        *_, biased, in_field, feeling, deep = self.error_lengths(G)
        bias = np.zeros((*shape, biased))
        for place, sensor, clock, axes, columns in self.drawings(G):
            last, period = clock.numbers(instants), clock.every * self.tick
            sizes = G, int(last[-1]) + 1, period
            drawn = np.array([sensor.errors(*sizes, random_of(place)) for random_of in runs])
            errors, signal = drawn[:, last][..., columns], place.partition("[")[0]
            n[signal][..., axes] += errors
            if (
                self.estimator
                and signal in bias_signals(self)
                and sensor.bias_deviation(G) is not None
            ):
                bias[..., axes] += errors
        arrived = [
            [channel.arrivals(instants, random_of(f"{channel.name}.arrived")) for random_of in runs]
            for channel in holding
        ]
        flags: Array = np.moveaxis(np.array(arrived).reshape(len(holding), *shape), 0, -1)
        more = n[FLUX][..., :in_field], n[FELT][..., :feeling], n[DEPTH][..., G.dimension - deep :]
        return Errors(n[POSE], n[VELOCITY], flags, bias, *more)

    # Estimates.

    def schedule(self, G: MatrixLieGroup) -> Schedule:
        """Return the measurement schedule for an estimator."""
        signals = SIGNALS if navigates(self) else SIGNALS[:2]
        channels = [part for part in self.channels(G) if part.signal in signals]
        return Schedule(G, channels, self.tick)

    def deviations(self, G: MatrixLieGroup) -> Deviations:
        """Return the standard deviations of the errors that the sensors specify."""
        squares = {name: np.zeros(G.dimension) for name in (POSE, VELOCITY, FLUX, FELT, DEPTH)}
        bias = np.zeros((2, G.dimension))
        for place, sensor, clock, axes, columns in self.drawings(G):
            white = sensor.drawn(None).white_deviation(G, clock.every * self.tick)
            signal = place.partition("[")[0]
            if white is not None:
                squares[signal][axes] += white[columns] ** 2
            drift = sensor.bias_deviation(G)
            if drift is not None and signal in bias_signals(self):
                bias[:, axes] += np.array(drift)[:, columns] ** 2
        sensed = np.sqrt(sum(squares[signal] for signal in bias_signals(self)))
        walk, depth = np.sqrt(bias[1]), np.sqrt(squares[DEPTH])
        return Deviations(np.sqrt(squares[POSE]), sensed, np.sqrt(bias[0]), walk, depth)

    # From the command to the force that changes the momentum.

    @property
    def is_ideal(self) -> bool:
        """Whether the law's model is exact and its command the only force on the plant."""
        return not self.parts

    @property
    def departures(self) -> str:
        """Departures of the loop from the one of the theorems, in words; empty if ideal."""
        return ", ".join(dict.fromkeys(part.departs for part in self.parts.values()))

    @property
    def estimates(self) -> bool:
        """Whether the law reads pose and velocity from an estimator."""
        return self.estimator is not None

    @property
    def knows_covariance(self) -> bool:
        """Whether the estimator has a covariance."""
        return self.estimator is not None and self.estimator.has_covariance

    @property
    def limits(self) -> bool:
        """Whether any actuator can be at a limit."""
        return any(actuator.limits for actuator in self.actuators)

    @property
    def burns(self) -> Any:
        """The thrusters with a specific impulse; None without any."""
        return next((a for a in self.actuators if getattr(a, "isp", None) is not None), None)

    @property
    def wheels(self) -> tuple[str, Any] | None:
        """The actuator with wheels, and the name of its states."""
        return next(((place, x) for place, x in self._chain() if WHEEL in x.members), None)

    @property
    def members(self) -> dict[str, tuple[str, ...]]:
        """Names of thrusters, wheels and other members, by the name of one."""
        return {dim: names for part in self.actuators for dim, names in part.members.items()}

    @property
    def shows(self) -> dict[str, Signal]:
        """The signals of the actuators' own, by name."""
        return {signal.name: signal for part in self.actuators for signal in part.shows}

    def range_of(self, signal: str) -> tuple[Array, Array] | None:
        """Return the least and largest values of a signal by limits of actuators, or None."""
        ranges = [part.ranges[signal] for part in self.actuators if signal in part.ranges]
        lows, highs = zip(*ranges, strict=True) if ranges else ((), ())
        return (np.max(lows, axis=0), np.min(highs, axis=0)) if ranges else None

    @property
    def solves(self) -> int:
        """Number of values that code outside the engines solves for at control instants."""
        return sum(part.solves for part in self.actuators if isinstance(part, Solving))

    @cached_property
    def _at_instants(self) -> int:
        """Number of actuators that act at ticks only: before the first that `moves`, `changes`."""
        if self.control is None:
            return 0
        moving = (
            k for k, actuator in enumerate(self.actuators) if actuator.moves or actuator.changes
        )
        return next(moving, len(self.actuators))

    @property
    def moving(self) -> tuple[Actuator, ...]:
        """The actuators from the first that `moves` or `changes`; only these may between ticks."""
        return self.actuators[self._at_instants :]

    def states(self, G: MatrixLieGroup) -> dict[str, int]:
        """Return the number of states of each part besides the plant, by name."""
        lengths = {place: count for place, part in self._chain() if (count := part.states(G))}
        lengths |= {PROPELLANT: 1} if self.burns else {}
        if self.control is None:
            return lengths
        held, command = {HELD: G.dimension} if self._at_instants else {}, command_length(self, G)
        moving = enumerate(self.moving_sensors)
        measured = {f"{SENSOR}_{k}": sensor.states(G) for k, sensor in moving}
        measured |= {channel.name: channel.states for channel in self.holding(G)}
        commands = {COMMANDS: (self.control.delay + 1) * command}
        if self.clocks:
            for place, part in self._chain():
                if place in self.clocks:
                    held[f"{place}_{TAKEN}"] = command if part.takes == THRUSTS else G.dimension
            held[CLOCKS] = len(self.clocks)
        return {**commands, **held, **lengths, **measured, **self.estimator_lengths(G)}

    # Clocks of law and actuators.

    @property
    def tick(self) -> float:
        """Time between two ticks, s."""
        assert self.control is not None
        return self.control.tick

    @cached_property
    def clocks(self) -> dict[str, Clock]:
        """The clocks of law and actuators that do not act at every tick, by the names of states."""
        if self.control is None:
            return {}
        clocks = {CONTROL: self.control.clock}
        for place, actuator in self._chain():
            if actuator.period is not None:
                clocks[place] = self.control.clock_of(actuator.period, actuator.offset or 0.0)
        return {place: clock for place, clock in clocks.items() if not clock.acts_always}

    def ticks_left(self, tick: int) -> Array:
        """Return the ticks from a tick until each of the `clocks` acts."""
        ticks = [(clock.offset - tick) % clock.every for clock in self.clocks.values()]
        return np.array(ticks, dtype=float)

    def estimator_lengths(self, G: MatrixLieGroup) -> dict[str, int]:
        """Return the number of states of the estimator, which come last and are held, by name."""
        if self.estimator is None or self.control is None:
            return {}
        lengths = self.estimator.states(self.schedule(G))
        return {f"{ESTIMATOR}_{name}": count for name, count in lengths.items()}

    def _chain(self, start: int = 0) -> Iterator[tuple[str, Actuator]]:
        """Yield the actuators from index `start`, with the names of their states."""
        for index, actuator in enumerate(self.actuators[start:], start):
            yield f"{ACTUATORS}_{index}", actuator

    def inertia_at(self, s: Tracking) -> Inertia:
        """Return the true inertia tensor in a run."""
        if self.inertia is None:
            return s.inertia
        return self.inertia.at(s.inertia, s.t)


# What is asked of a vehicle -----------------------------------------------------------------------


def place_of(vehicle: Vehicle, index: int) -> str:
    """Return the place of an actuator: ``actuators[0]``, or ``inner[0]`` of the law's entry."""
    if index < vehicle.inner:
        return f"{INNER}[{index}]"
    return f"{ACTUATORS}[{index - vehicle.inner}]"


def with_inner(vehicle: Vehicle, blocks: Sequence[Actuator], G: MatrixLieGroup) -> Vehicle:
    """Return the vehicle as a law flies it that puts blocks of its own before the actuators."""
    if not blocks:
        return vehicle
    base = vehicle.configured or vehicle
    chain = *blocks, *base.actuators
    return dataclasses.replace(base, actuators=chain, inner=len(blocks)).of_run(G)


def without_inner(vehicle: Vehicle) -> Vehicle:
    """Return what all laws share of the vehicle of one."""
    base, rest = vehicle.configured, vehicle.actuators[vehicle.inner :]
    if not vehicle.inner:
        return vehicle
    configured = None if base is None else without_inner(base)
    return dataclasses.replace(vehicle, actuators=rest, inner=0, configured=configured)


def is_direct(vehicle: Vehicle) -> bool:
    """Whether forces are all that acts beside the command: it arrives, of the true state."""
    if vehicle.inertia or vehicle.control or vehicle.measures or vehicle.estimator:
        return False
    bare = (not (a.limits or a.moves or a.changes) for a in vehicle.actuators)
    return all(bare) and all(THRUSTER in a.members for a in vehicle.actuators)


def pushes(vehicle: Vehicle, G: MatrixLieGroup) -> Array | None:
    """Return the forces of unit thrusts on a rigid body, ``(n, k)``; None without thrusters."""
    for actuator in vehicle.actuators:
        if THRUSTER in actuator.members and G.translation is not None:
            return actuator.columns(G)[G.translation.axes]  # type: ignore[attr-defined]
    return None


def navigates(vehicle: Vehicle) -> bool:
    """Return whether the estimator predicts by an accelerometer, and says so as laws do."""
    return bool(getattr(vehicle.estimator, "reads_specific_force", False))


def bias_signals(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the signals whose biases are estimated; a force stands for a velocity."""
    return (VELOCITY, FELT) if navigates(vehicle) else (VELOCITY,)


def taking_thrusts(vehicle: Vehicle) -> Any:
    """Return the thrusters to which the law commands thrusts; None where it commands a torque."""
    return next((part for part in vehicle.actuators if part.takes == THRUSTS), None)


def command_length(vehicle: Vehicle, G: MatrixLieGroup) -> int:
    """Return the number of entries of a command: a torque, and the thrusts behind it, if any."""
    rotors = taking_thrusts(vehicle)
    return G.dimension + (0 if rotors is None else rotors.count)


def requested_torque(vehicle: Vehicle, command: Array) -> Array:
    """Return the torque that a command asks for, ``(..., m)``; of thrusts, what they give."""
    rotors = taking_thrusts(vehicle)
    torque: Array = command if rotors is None else rotors.requested(command)
    return torque


def moving_sensors(
    vehicle: Vehicle, signal: str = "velocity"
) -> Iterator[tuple[int, DynamicSensor]]:
    """Yield the sensors of a signal whose states follow the motion, with their numbers."""
    count = sum(isinstance(sensor, DynamicSensor) for sensor in vehicle.velocity_sensors)
    numbered = list(enumerate(vehicle.moving_sensors))
    yield from numbered[:count] if signal == "velocity" else numbered[count:]


def estimator_states(states: Arrays) -> dict[str, Array]:
    """Return the states of the estimator, by its own names."""
    start = f"{ESTIMATOR}_"
    names = (name for name in states if name.startswith(start))
    return {name.removeprefix(start): states[name] for name in names}


def exactly_measured(G: MatrixLieGroup, vehicle: Vehicle) -> str:
    """Name what no sensor measures with errors beside what some do: ``velocity (translation)``.

    An estimator does not read a pose without a sensor.
    """
    measured = {(channel.signal, channel.part.name) for channel in vehicle.channels(G)}
    words = []
    if navigates(vehicle):
        return ""
    for signal in ("velocity",) if vehicle.estimator else ("pose", "velocity"):
        parts = [part.name for part in G.parts if (signal, part.name) not in measured]
        of = f" ({', '.join(parts)})" if len(parts) < len(G.parts) else ""
        if measured and parts:
            words += [f"{signal}{of}"]
    return ", ".join(words)
