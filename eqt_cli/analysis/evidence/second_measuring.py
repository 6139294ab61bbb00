"""Second, independent form of the measurements of one run: their times, delays and errors."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.analysis.evidence import second_sensors
from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle import Vehicle


@dataclass(frozen=True)
class SecondMeasuring:
    """The sensors of one run at control instants.

    Attributes
    ----------
    instants
        Number of control instants.
    random
        Returns the generator of the part at a place.
    """

    G: MatrixLieGroup
    vehicle: Vehicle
    instants: int
    random: Callable[[str], np.random.Generator]

    def sensors(self, signal: str) -> list[Any]:
        """Return the sensors of the pose or of the velocity."""
        vehicle = self.vehicle
        return list(vehicle.pose_sensors if signal == "pose" else vehicle.velocity_sensors)

    def agreed(self, signal: str, part: str, option: str) -> Any:
        """Return an option that any sensor of a part sets; None if none does."""
        values = [getattr(s, option) for s in self.sensors(signal) if s.of is None or s.of == part]
        return next((value for value in values if value is not None), None)

    def every(self, signal: str, part: str) -> int:
        """Return the number of control periods between two measurements."""
        own, control = self.agreed(signal, part, "period"), self.vehicle.control
        return 1 if own is None or control is None else int(own / control.period + 0.5)

    def total(self, signal: str) -> Array | None:
        """Return the errors at every instant, ``(instants, m)``; None without a second form.

        Between two measurements of a part, the errors of the last one hold.
        """
        found = np.zeros((self.instants, self.G.dimension))
        for k, sensor in enumerate(self.sensors(signal)):
            for part in self.G.parts:
                if sensor.of is not None and sensor.of != part.name:
                    continue
                axes = np.arange(self.G.dimension)[part.axes]
                every, control = self.every(signal, part.name), self.vehicle.control
                assert control is not None
                errors = second_sensors.second_errors(
                    sensor,
                    self.G.dimension if sensor.of is None else len(axes),
                    (self.instants + every - 1) // every,
                    every * control.period,
                    self.random(f"sensors.{signal}[{k}]"),
                )
                if errors is None:
                    return None
                for tick in range(self.instants):
                    drawn = errors[tick // every]
                    found[tick, axes] += drawn[axes] if sensor.of is None else drawn
        return found

    def held(self) -> Iterator[tuple[str, Any, int, list[int]]]:
        """Yield signal, part and delay of held measurements, and their instants."""
        for signal in ("pose", "velocity"):
            for part in self.G.parts:
                options = {
                    name: self.agreed(signal, part.name, name)
                    for name in ("period", "delay", "dropout")
                }
                own = [s for s in self.sensors(signal) if s.of is None or s.of == part.name]
                loses = any(sensor.loses for sensor in own)
                if options["period"] is None and not options["delay"] and not loses:
                    continue
                every, random = (
                    self.every(signal, part.name),
                    self.random(f"measured_{signal}_{part.name}.arrived"),
                )
                measured = []
                for tick in range(0, self.instants, every):
                    lost = random.random() < (options["dropout"] or 0.0)
                    if tick == 0 or not lost:
                        measured.append(tick)
                yield signal, part, options["delay"] or 0, measured
