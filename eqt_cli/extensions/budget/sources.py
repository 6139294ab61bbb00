"""What makes an error: the imperfections of a vehicle, and the vehicle without some of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator

from eqt_cli.base.arrays import Array
from eqt_cli.components.actuators import PassThrough
from eqt_cli.components.forces import ConstantForce, Force
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia, InertiaLaw
from eqt_cli.components.sensors import TIMING as TIMED
from eqt_cli.components.sensors import Sensor
from eqt_cli.components.vehicle import ACTUATORS, DEPTH, FELT, FLUX, FORCES, INERTIA, POSE, VELOCITY
from eqt_cli.components.vehicle_parts import ConstantInertia, RelativeInertia, TrueInertia
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.leaves import STRUCTURE, with_fields


class Source(NamedTuple):
    """One imperfection.

    Attributes
    ----------
    key
        Its place in the configuration.
    words
        What it is.
    """

    key: str
    words: str


@dataclass(frozen=True)
class Silent(Sensor):
    """A sensor that an estimator believes as noisy as before, without its errors."""

    name: ClassVar[str] = "silent"
    departs: ClassVar[str] = ""

    sensor: Any = field(metadata=STRUCTURE)

    @classmethod
    def of_sensor(cls, sensor: Sensor) -> Sensor:
        """Return the sensor without errors, at the same times."""
        timing = {name: getattr(sensor, name) for name in ("of", *TIMED)}
        return cls(sensor, **timing)

    def errors(self, G: MatrixLieGroup, instants: int, period: float, random: Generator) -> Array:
        """Return 0."""
        return np.zeros((instants, self.coordinates(G)))

    def white_deviation(self, G: MatrixLieGroup, period: float) -> Array | None:
        """Return that of the sensor."""
        return self.sensor.drawn(None).white_deviation(G, period)

    def bias_deviation(self, G: MatrixLieGroup) -> tuple[Array, Array] | None:
        """Return that of the sensor."""
        return self.sensor.bias_deviation(G)


class Ideal(PassThrough):
    """An actuator that delivers what it is told."""

    name: ClassVar[str] = "ideal"
    departs: ClassVar[str] = ""


def _without_force(part: Force) -> Force:
    """Return no force; of one whose numbers tell its program, the same program."""
    if isinstance(part, ConstantForce) and isinstance(part.force, list):
        return with_fields(part, force=[0.0] * len(part.force))
    return ConstantForce(0.0)


def _as_believed(true: TrueInertia | None, model: InertiaLaw) -> TrueInertia | None:
    """Return the inertia that the law believes; where numbers tell it, by the same program."""
    if isinstance(true, RelativeInertia):
        return with_fields(true, relative=0.0)
    plain = isinstance(model, Inertia) and model.added is model.change is None and not model.leaves
    if isinstance(true, ConstantInertia) and isinstance(model, Inertia) and plain:
        return with_fields(true, matrix=model.matrix.tolist())
    return None


_OFF: dict[str, Callable[[Any], Any]] = {
    FORCES: _without_force,
    ACTUATORS: lambda part: Ideal(),
    **dict.fromkeys((POSE, VELOCITY, FLUX, FELT, DEPTH), Silent.of_sensor),
}
"""What takes the place of a part that is switched off, so that the places of others stay."""

TIMING = {"delay": "late measurements", "dropout": "lost measurements"}


def sources_of(loop: ClosedLoop) -> Iterator[Source]:
    """Yield the imperfections of a loop that can be switched off, in the order of its parts."""
    vehicle = loop.vehicle.configured or loop.vehicle
    timing = dict[str, Source]()
    for place, part in vehicle.parts.items():
        kind = place.partition("[")[0]
        is_known = kind == FORCES and loop.known_forces
        is_commanded = kind == ACTUATORS and part.takes != "torque"
        if kind in (INERTIA, *_OFF) and not (is_known or is_commanded):
            signal = kind.removeprefix("sensors.")
            words = f"{part.name} of {signal}" if isinstance(part, Sensor) else part.departs
            yield Source(place, words)
        if isinstance(part, Sensor):
            for option, words in TIMING.items():
                if getattr(part, option):
                    key = f"{kind}.{option}"
                    timing[key] = Source(key, f"{words} of {kind.removeprefix('sensors.')}")
    yield from timing.values()
    if vehicle.control and vehicle.control.delay:
        yield Source("control.delay", "late commands")


def without(loop: ClosedLoop, keys: Collection[str]) -> ClosedLoop:
    """Return the loop without some of its sources; draws and starts of the others stay."""
    vehicle = loop.vehicle.configured or loop.vehicle

    def left(kind: str, parts: tuple[Any, ...]) -> tuple[Any, ...]:
        off = _OFF[kind]
        first = vehicle.inner if kind == ACTUATORS else 0
        parts = tuple(off(x) if f"{kind}[{k - first}]" in keys else x for k, x in enumerate(parts))
        late = {option: None for option in TIMING if f"{kind}.{option}" in keys}
        return tuple(with_fields(part, **late) for part in parts) if late else parts

    control = vehicle.control
    if control and "control.delay" in keys:
        control = replace(control, delay=0)
    flux, felt, depth = vehicle.more_sensors
    changed = replace(
        vehicle,
        inertia=_as_believed(vehicle.inertia, loop.inertia) if INERTIA in keys else vehicle.inertia,
        forces=left(FORCES, vehicle.forces),
        actuators=left(ACTUATORS, vehicle.actuators),
        pose_sensors=left(POSE, vehicle.pose_sensors),
        velocity_sensors=left(VELOCITY, vehicle.velocity_sensors),
        more_sensors=(left(FLUX, flux), left(FELT, felt), left(DEPTH, depth)),
        control=control,
    )
    return replace(loop, vehicle=changed.of_run(loop.group))


def without_all(loop: ClosedLoop, filtered: bool, sampled: bool) -> ClosedLoop:
    """Return the loop without sensors and estimator, and without a clock unless it is `sampled`.

    Of a loop that is `filtered`, the estimator and its sensors stay, without errors.
    """
    vehicle = without(loop, {source.key for source in sources_of(loop)}).vehicle.configured
    assert vehicle is not None
    if not filtered:
        vehicle = replace(
            vehicle, estimator=None, pose_sensors=(), velocity_sensors=(), more_sensors=((),) * 3
        )
    if not sampled:
        vehicle = replace(vehicle, control=None)
    return replace(loop, vehicle=vehicle.of_run(loop.group))
