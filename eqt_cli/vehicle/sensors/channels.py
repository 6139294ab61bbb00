"""Measurement channels: when parts of pose and velocity are measured, and when that arrives.

A part without a clock of its own, a delay or a dropout is measured at the instants of the law. A
channel knows no law or engine.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array, less, where
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.vehicle.sampling import ALWAYS, Clock, Sampling
from eqt_cli.vehicle.sensors.base import Sensor

NOTHING, MEASURED, FIRST = 0.0, 1.0, 2.0
"""Events of a channel at a tick; the first measurement is there from the start."""

TIMING = ("period", "offset", "delay", "dropout")
"""Options that the entries of one part share."""


class Errors(NamedTuple):
    """Measurement errors at the ticks of a loop, with runs and instants along leading axes.

    Attributes
    ----------
    pose : (..., d, d)
        E with Q_m = Q E.
    velocity : (..., m)
        b with V_m = V + b.
    arrived : (..., channels)
        `NOTHING`, `MEASURED` or `FIRST` for each channel that holds.
    bias : (..., m)
        Part of b that is a bias, for an estimator to find; ``(0,)`` without an estimator.
    """

    pose: Array
    velocity: Array
    arrived: Array
    bias: Array = np.empty(0)

    def of(self, *places: Any) -> "Errors":
        """Return the errors of some runs, or at some instants."""
        return Errors(*(part[places] for part in self.of_runs))

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
        ``"pose"`` or ``"velocity"``.
    shape
        Shape of the block of a pose, or of the coordinates of a velocity.
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
    clock: Clock = ALWAYS
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
        return (..., *self.part.entries) if self.signal == "pose" else (..., self.part.axes)

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
        last = held[..., -self.size :]
        fresh = less(0.5 * MEASURED, arrived[..., None])
        first = less(0.5 * (MEASURED + FIRST), arrived[..., None])
        waiting = [held[..., k : k + self.size] for k in range(self.size, self.states, self.size)]
        kept = [where(first, now, entry) for entry in waiting]
        return np.concatenate([*kept, where(fresh, now, last)], axis=-1)

    def read(self, value: Array, held: Array) -> Array:
        """Return the value with the part as it has arrived."""
        values = value.copy()
        values[self.entries] = held[..., : self.size].reshape(*held.shape[:-1], *self.shape)
        return values

    def arrivals(self, instants: int, random: np.random.Generator) -> Array:
        """Return the events, ``(instants,)``; the first do not depend on how many there are."""
        flags, due = np.full(instants, NOTHING), self.clock.is_due(np.arange(instants))
        due[:1] = True
        flags[due] = MEASURED
        if self.loses is not None:
            flags[np.flatnonzero(due)[self.loses.lost(int(due.sum()), random)]] = NOTHING
        flags[:1] = FIRST
        return flags


def channels(
    G: MatrixLieGroup, signals: Mapping[str, tuple[Sensor, ...]], control: Sampling
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
        for part in G.parts:
            own = [sensor for sensor in sensors if sensor.of in (None, part.name)]
            if not own:
                continue
            given: dict[str, Any] = dict.fromkeys(TIMING)
            for sensor in own:
                known = ((name, getattr(sensor, name)) for name in TIMING)
                given |= {name: value for name, value in known if value is not None}
            clock = control.clock_of(given["period"], given["offset"])
            delay = control.ticks_of(given["delay"] or 0)
            loses = next((sensor for sensor in own if sensor.loses), None)
            holds = given["period"] is not None or not clock.acts_always
            holds = holds or bool(delay) or loses is not None
            block = G.identity[part.entries] if signal == "pose" else G.basis[part.axes, 0, 0]
            yield Channel(signal, part, block.shape, clock, delay, loses, holds)
