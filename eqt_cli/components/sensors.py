"""Sensors: errors of the measured pose and velocity, and when they are measured."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator

from eqt_cli.base.arrays import Array, less, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import (
    DENSITY,
    MEASURED,
    WALK,
    CountOrTime,
    Offset,
    Positive,
    Real,
    Scale,
    Unit,
)
from eqt_cli.base.registry import Registry
from eqt_cli.components import vehicle_parts
from eqt_cli.components.groups import MatrixLieGroup, Part

# The base class of measurement errors; it knows no law or engine ----------------------------------


@dataclass(frozen=True)
class Sensor(vehicle_parts.VehiclePart):
    """An error of a measured pose or velocity, at the instants at which it is measured.

    Errors of a pose add up to n with Q_m = Q exp(n), errors of a velocity to b with V_m = V + b.
    They depend on the run and on the instant. Entries of one part share `period`, `offset`, `delay`
    and `dropout`, given at one of them.

    Attributes
    ----------
    of
        Part of the pose or velocity that is measured, by its name in the group. Default: all.
    period
        Time between measurements, s, a whole number of ticks of `control`; the law reads the last
        one. Default: one at each instant of the law.
    offset
        Time of the first measurement after t = 0, s, a whole number of ticks.
    delay
        Delay of a measurement, in control periods or as a time such as 50 ms. The first one, at t =
        0, arrives at once.
    dropout
        Probability that a measurement never arrives; the first one always does.
    """

    of: str | None = field(default=None, kw_only=True)
    period: Annotated[Positive | None, Scale("measurement period", "s")] = field(
        default=None, kw_only=True
    )
    offset: Offset | None = field(default=None, kw_only=True)
    delay: Annotated[CountOrTime | None, Scale("delay of the measurement in periods")] = field(
        default=None, kw_only=True
    )
    dropout: Real | None = field(default=None, kw_only=True)

    @abstractmethod
    def errors(self, G: MatrixLieGroup, instants: int, period: float, random: Generator) -> Array:
        """Return the errors of `instants` measurements, ``(instants, n)``, n from `coordinates`.

        Measurements are `period` seconds apart: the sensor's own period, or the control period. The
        first errors do not depend on how many there are.
        """

    @property
    def loses(self) -> bool:
        """Whether measurements may be lost."""
        return bool(self.dropout)

    def lost(self, measurements: int, random: Generator) -> Array:
        """Return which measurements are lost, ``(measurements,)`` booleans.

        The first entries do not depend on how many there are. The first measurement always arrives,
        whatever its entry.
        """
        return random.random(measurements) < (self.dropout or 0.0)

    def axes(self, G: MatrixLieGroup) -> slice:
        """Return the measured coordinates: those of the part, or all."""
        parts = *G.parts, *depth_of(G)
        return next((part.axes for part in parts if part.name == self.of), slice(None))

    def coordinates(self, G: MatrixLieGroup) -> int:
        """Return the number of measured coordinates."""
        return len(range(G.dimension)[self.axes(G)])

    def entries(self, value: float | list[float], G: MatrixLieGroup) -> Array:
        """Return a number for each measured coordinate; one given number stands for all."""
        return np.broadcast_to(np.asarray(value, dtype=float), self.coordinates(G))

    def check_entries(
        self,
        value: vehicle_parts.Numbers,
        G: MatrixLieGroup,
        problems: Problems,
        deviations: bool = False,
    ) -> None:
        """Note invalid numbers, negative `deviations`, or a wrong number of coordinates."""
        what = G.name if self.of is None else f"the {self.of} of {G.name}"
        vehicle_parts.check_count(value, self.coordinates(G), what, problems, deviations)

    def bias_deviation(self, G: MatrixLieGroup) -> tuple[Array, Array] | None:
        """Return what an estimator may know of a bias; None for other errors.

        It is the root mean square at t = 0, and the deviation of the drift after one second,
        ``(n,)`` each.
        """
        return None

    def white_deviation(self, G: MatrixLieGroup, period: float) -> Array | None:
        """Return the standard deviation of white noise, ``(n,)``; None for correlated errors.

        The numbers of the sensor must be drawn before.
        """
        return None


sensors = Registry("sensor", "sensors", Sensor, ("components.sensors", "components.accelerometer"))


@dataclass(frozen=True)
class Bias(Sensor):
    """A constant offset plus a random walk.

    Attributes
    ----------
    value
        Offset at t = 0.
    walk
        Standard deviation of the drift after one second; it grows with √t.
    """

    name: ClassVar[str] = "bias"
    departs: ClassVar[str] = "measurements with bias"

    value: Annotated[vehicle_parts.Numbers, Unit(MEASURED)] = 0.0
    walk: Annotated[vehicle_parts.Numbers, Unit(WALK)] = 0.0

    def errors(self, G: MatrixLieGroup, instants: int, period: float, random: Generator) -> Array:
        """Return value + walk √period Σ N(0, 1)^n, with a step from each instant to the next."""
        part = self.drawn(random)
        steps = random.standard_normal((instants, self.coordinates(G)))
        drift = np.cumsum(steps, axis=0) - steps[:1]
        return self.entries(part.value, G) + self.entries(part.walk, G) * np.sqrt(period) * drift

    def bias_deviation(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        """Return the root mean square of `value`, and `walk`, ``(n,)`` each."""
        values = self.value if isinstance(self.value, list) else [self.value]
        size = self.entries([vehicle_parts.mean_square(value) for value in values], G)
        return np.sqrt(size), self.entries(vehicle_parts.drawn(self.walk, None), G)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note negative deviations of the walk, and a wrong length."""
        self.check_entries(self.value, G, problems.at("value"))
        self.check_entries(self.walk, G, problems.at("walk"), deviations=True)


# Sensors of a velocity whose states follow the motion ---------------------------------------------


class DynamicSensor(Sensor):
    """A sensor of a velocity with states x, which follow the motion, ẋ = f(V, x).

    What it measures is their `reading`, to which the errors of all sensors add. V stands for the
    measured coordinates, ``(..., n)``.
    """

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states; by default one for each measured coordinate."""
        return self.coordinates(G)

    def started(self, V: Array) -> Array:
        """Return the states at t = 0, ``(..., states)``."""
        return V

    @abstractmethod
    def state_rate(self, V: Array, x: Array) -> Array:
        """Return the time derivative of the states, ``(..., states)``."""

    @abstractmethod
    def reading(self, V: Array, x: Array) -> Array:
        """Return the velocity as it is measured before errors, ``(..., n)``."""


@dataclass(frozen=True)
class SensorLag(DynamicSensor):
    """A lag of first order, as of a gyroscope: ẋ = (V − x) / T from x = V, and x is measured.

    Attributes
    ----------
    time_constant
        T, s.
    """

    name: ClassVar[str] = "lag"
    departs: ClassVar[str] = "measurements that lag"
    positive: ClassVar[tuple[str, ...]] = ("time_constant",)

    time_constant: Annotated[vehicle_parts.Numbers, Scale("time constant", "s")]

    def errors(self, G: MatrixLieGroup, instants: int, period: float, random: Generator) -> Array:
        """Return 0: the lag depends on the motion."""
        return np.zeros((instants, self.coordinates(G)))

    def state_rate(self, V: Array, x: Array) -> Array:
        """Return (V − x) / T."""
        return (V - x) / self.time_constant

    def reading(self, V: Array, x: Array) -> Array:
        """Return the state."""
        return x

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note time constants that are not greater than 0, and a wrong length."""
        here = problems.at("time_constant")
        vehicle_parts.check_numbers(self.time_constant, here, positive=True)
        if not here:
            self.check_entries(self.time_constant, G, here)


# White noise of a measurement ---------------------------------------------------------------------


@dataclass(frozen=True)
class Noise(Sensor):
    """Independent normals at every measurement, along every coordinate.

    Attributes
    ----------
    std
        Standard deviation of one measurement, at any period.
    density
        Instead: the standard deviation times √period, so that a mean over a second has the same
        deviation at any period.
    """

    name: ClassVar[str] = "noise"
    departs: ClassVar[str] = "measurements with noise"

    std: Annotated[vehicle_parts.Numbers | None, Unit(MEASURED)] = None
    density: Annotated[vehicle_parts.Numbers | None, Unit(DENSITY)] = None

    def errors(self, G: MatrixLieGroup, instants: int, period: float, random: Generator) -> Array:
        """Return std · N(0, 1)^n, or density/√period · N(0, 1)^n."""
        deviation = self.drawn(random).white_deviation(G, period)
        return deviation * random.standard_normal((instants, self.coordinates(G)))

    def white_deviation(self, G: MatrixLieGroup, period: float) -> Array:
        """Return std, or density/√period."""
        part: Any = self
        if part.std is not None:
            return self.entries(part.std, G)
        return self.entries(part.density or 0.0, G) / np.sqrt(period)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note both or neither of std and density, negative deviations, and a wrong length."""
        if (self.std is None) == (self.density is None):
            got = "neither" if self.std is None else "both"
            problems.add(f"expected std or density, got {got}")
        for name, value in (("std", self.std), ("density", self.density)):
            if value is not None:
                self.check_entries(value, G, problems.at(name), deviations=True)


# Measurement channels: when parts of pose and velocity are measured, and when that arrives --------
#
# A part without a clock of its own, a delay or a dropout is measured at the instants of the law. A
# channel knows no law or engine.


NOTHING, CHANNEL_MEASURED, FIRST = 0.0, 1.0, 2.0
"""Events of a channel at a tick; the first measurement is there from the start."""

FIXES = "pose", "depth"
"""Signals that are entries of a pose."""

TIMING = ("period", "offset", "delay", "dropout")
"""Options that the entries of one part share."""


class Errors(NamedTuple):
    """Measurement errors at the ticks of a loop, with runs and instants along leading axes.

    Attributes
    ----------
    pose : (..., m)
        n with Q_m = Q exp(n), as it is drawn; for a measurement, E = exp(n), ``(..., d, d)``.
    velocity : (..., m)
        b with V_m = V + b.
    arrived : (..., channels)
        `NOTHING`, `MEASURED` or `FIRST` for each channel that holds.
    bias : (..., m)
        Part of b that is a bias, for an estimator to find; ``(0,)`` without an estimator.
    flux : (..., 3)
        Errors of the magnetometer, T, as they are drawn; for a measurement, B_m; ``(0,)`` without
        a field.
    felt : (..., m)
        Errors of the specific force, m/s², as they are drawn; for a measurement that waits, the
        force itself; ``(0,)`` without an accelerometer.
    depth : (..., 1)
        Errors of the measured depth, m; ``(0,)`` without such a sensor.
    """

    pose: Array
    velocity: Array
    arrived: Array
    bias: Array = np.empty(0)
    flux: Array = np.empty(0)
    felt: Array = np.empty(0)
    depth: Array = np.empty(0)

    def of(self, *places: Any) -> "Errors":
        """Return the errors of some runs, or at some instants."""
        return Errors(*(part[places] for part in self.of_runs))

    def measured(self, G: MatrixLieGroup, *places: Any) -> "Errors":
        """Return the errors of some runs, or at some instants, with E."""
        return self.of(*places)._replace(pose=G.exp(self.pose[places]))

    @property
    def of_runs(self) -> list[Array]:
        """Arrays of many runs; an empty `bias` is left out."""
        return [part for part in self if part.ndim > 1]


@dataclass(frozen=True)
class Channel:
    """The measurement of one part of the pose or velocity.

    Attributes
    ----------
    signal
        ``"pose"`` or ``"velocity"``, or another one.
    shape
        Shape of the entries of a pose, or of the coordinates of a velocity.
    clock
        Ticks at which the part is measured.
    delay
        Number of ticks after which a measurement arrives.
    loses
        Sensor that says which measurements are lost; None where all arrive.
    holds
        Whether the law reads the last measurement that has arrived, and not a current one.
    """

    signal: str
    part: Part
    shape: tuple[int, ...]
    clock: vehicle_parts.Clock = vehicle_parts.ALWAYS
    delay: int = 0
    loses: Sensor | None = None
    holds: bool = False

    @property
    def every(self) -> int:
        """Number of ticks between measurements."""
        return self.clock.every

    @property
    def name(self) -> str:
        """Name of the states: ``measured_pose_translation``."""
        return f"measured_{self.signal}_{self.part.name}"

    @property
    def entries(self) -> Any:
        """Index of the part in a pose, or in a velocity."""
        return (..., *self.part.entries) if self.signal in FIXES else (..., self.part.axes)

    @property
    def size(self) -> int:
        """Number of measured numbers."""
        return int(np.prod(self.shape))

    @property
    def states(self) -> int:
        """Number of states: measurements on their way, the first to arrive first."""
        return (self.delay + 1) * self.size if self.holds else 0

    def measured(self, value: Array, held: Array, arrived: Array) -> Array:
        """Return the states after a tick at which the part of `value` may be measured."""
        now = value[self.entries].reshape(*held.shape[:-1], self.size)
        fresh = less(0.5 * CHANNEL_MEASURED, arrived[..., None])
        first = less(0.5 * (CHANNEL_MEASURED + FIRST), arrived[..., None])
        waiting = [held[..., k : k + self.size] for k in range(self.size, self.states, self.size)]
        rows = [where(first, now, entry) for entry in waiting]
        return np.concatenate([*rows, where(fresh, now, held[..., -self.size :])], axis=-1)

    def read(self, value: Array, held: Array) -> Array:
        """Return the value with the part as it has arrived."""
        values = value.copy()
        values[self.entries] = held[..., : self.size].reshape(*held.shape[:-1], *self.shape)
        return values

    def arrivals(self, instants: int, random: Generator) -> Array:
        """Return the events, ``(instants,)``; the first do not depend on how many there are."""
        flags, due = np.full(instants, NOTHING), self.clock.is_due(np.arange(instants))
        due[:1] = True
        flags[due] = CHANNEL_MEASURED
        if self.loses is not None:
            flags[np.flatnonzero(due)[self.loses.lost(int(due.sum()), random)]] = NOTHING
        flags[:1] = FIRST
        return flags


def depth_of(G: MatrixLieGroup) -> tuple[Part, ...]:
    """Return the last coordinate of the position in space as a part; none without a position."""
    if (whole := G.translation) is None:
        return ()
    (rows, columns), last = whole.entries, whole.axes.stop - 1
    entries = slice(rows.stop - 1, rows.stop), columns
    return (replace(whole, name="depth", axes=slice(last, last + 1), entries=entries),)


def channels(
    G: MatrixLieGroup, signals: Mapping[str, tuple[Sensor, ...]], control: vehicle_parts.Sampling
) -> Iterator[Channel]:
    """Yield the channels of the parts of pose and velocity that have sensors, in order.

    Parameters
    ----------
    signals
        Sensors of the pose and of the velocity.
    control
        Tick of the loop and clock of the law.
    """
    for signal, sensors in signals.items():
        for part in depth_of(G) if signal == "depth" else G.parts:
            measuring = [sensor for sensor in sensors if sensor.of in (None, part.name)]
            if not measuring:
                continue
            timing: dict[str, Any] = dict.fromkeys(TIMING)
            for sensor in measuring:
                own_timing = {name: getattr(sensor, name) for name in TIMING}
                timing |= {name: value for name, value in own_timing.items() if value is not None}
            clock = control.clock_of(timing["period"], timing["offset"])
            delay = control.ticks_of(timing["delay"] or 0)
            loses = next((sensor for sensor in measuring if sensor.loses), None)
            is_late = bool(delay) or loses is not None
            holds = is_late or timing["period"] is not None or not clock.acts_always
            entries = G.identity[part.entries] if signal in FIXES else G.basis[part.axes, 0, 0]
            yield Channel(signal, part, entries.shape, clock, delay, loses, holds)
