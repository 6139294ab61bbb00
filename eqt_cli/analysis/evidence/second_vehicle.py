"""Second, independent form of the vehicle of every run, from the configuration."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eqt_cli.analysis.evidence import second_actuators, second_forces
from eqt_cli.analysis.evidence.flight import VehicleRuns
from eqt_cli.analysis.evidence.numbers import floats, rate_of, with_rate
from eqt_cli.analysis.evidence.redrawn import number, tensor
from eqt_cli.analysis.evidence.running_error import lifted
from eqt_cli.analysis.evidence.second_actuators import SecondActuator
from eqt_cli.analysis.evidence.second_measuring import SecondMeasuring
from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.seeds import Stream, generator_at
from eqt_cli.mechanics.inertia import InertiaLaw
from eqt_cli.vehicle import Vehicle
from eqt_cli.vehicle.inertia import RelativeInertia, TrueInertia, VaryingInertia


@dataclass(frozen=True)
class SecondVehicle:
    """The vehicle of one run.

    Attributes
    ----------
    flight
        The runs.
    index
        Index of the run among them.
    """

    flight: VehicleRuns
    index: int

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle as configured, before numbers are drawn."""
        vehicle = self.flight.problem.loop.vehicle
        return vehicle.configured or vehicle

    @property
    def m(self) -> int:
        """Number of coordinates."""
        return self.flight.problem.loop.group.dimension

    def time(self, sample: int) -> float:
        """Return the time of a sample, s."""
        return float(self.flight.problem.times[sample])

    def random(self, place: str) -> np.random.Generator:
        """Return the generator of the part at a place."""
        run = int(self.flight.numbers[self.index])
        return generator_at(self.flight.seed, Stream.VEHICLE, run, place)

    def forces(self) -> Iterator[tuple[str, second_forces.Acting | None]]:
        """Yield every force in the body frame with its place; None if it has no second form."""
        G = self.flight.problem.loop.group
        for k, force in enumerate(self.vehicle.forces):
            place = f"plant.forces[{k}]"
            yield place, second_forces.second_force(G, force, self.random(place))

    def inertia(self, times: Array) -> tuple[Array, Array]:
        """Return the inertia of the plant and its rate, ``(samples, m, m)`` each."""
        model, true = self.flight.problem.loop.inertia, self.vehicle.inertia
        if true is None:
            return _moving(model, times)
        random = self.random("plant.inertia")
        if isinstance(true, VaryingInertia):
            return _moving(true.law, times)
        if isinstance(true, RelativeInertia):
            factor = 1 + _draw_until(lambda r: 1 + r > 0, true.relative, random)
            matrix, rate = _moving(model, times)
            return factor * matrix, factor * rate
        return _constant(true, self.m, random, len(times))

    @cached_property
    def actuators(self) -> list[SecondActuator | None]:
        """Actuators in the order of the command; None for one without a second form."""
        G = self.flight.problem.loop.group
        return [
            second_actuators.second_actuator(part, G, self.random(f"actuators[{k}]"))
            for k, part in enumerate(self.vehicle.actuators)
        ]

    @property
    def at_instants(self) -> int:
        """Number of actuators that act at control instants: those before the first with rates."""
        if self.vehicle.control is None:
            return 0
        moving = [part is not None and part.moves for part in self.actuators]
        return [*moving, True].index(True)

    @property
    def is_known(self) -> bool:
        """Whether all actuators have second forms."""
        return None not in self.actuators

    @property
    def lengths(self) -> dict[str, int]:
        """Number of entries of every state."""
        found = {}
        if self.vehicle.control is not None:
            found["commands"] = (self.vehicle.control.delay + 1) * self.m
            if self.at_instants:
                found["held"] = self.m
        for k, part in enumerate(self.actuators):
            if part is not None and part.states:
                found[f"actuators_{k}"] = part.states
        if self.vehicle.control is not None:
            G = self.measuring.G
            for signal, part, delay, _ in self.measuring.held():
                blocks = {
                    "pose": G.identity[part.entries],
                    "velocity": np.arange(self.m)[part.axes],
                }
                found[f"measured_{signal}_{part.name}"] = (delay + 1) * blocks[signal].size
        return found

    def chain(
        self, command: Array, states: dict[str, Array], parts: range, period: float | None = None
    ) -> tuple[Array, dict[str, Array]]:
        """Return the output of some actuators, and their next states or their rates."""
        found = {}
        for k in parts:
            part, place = self.actuators[k], f"actuators_{k}"
            assert part is not None
            x = states.get(place, command[..., :0])
            later, command = part.acts(command, x, period)
            if place in states:
                found[place] = later
        return command, found

    def torque(self, command: Array, states: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
        """Return the torque at any time, and the rates of the states."""
        first = self.at_instants
        if self.vehicle.control is not None:
            command = states["held"] if first else states["commands"][..., : self.m]
        return self.chain(command, states, range(first, len(self.actuators)))

    def after_instant(self, command: Array, states: dict[str, Array]) -> dict[str, Array]:
        """Return the states after an instant: the commands move up, and the first one is held."""
        control = self.vehicle.control
        assert control is not None
        waiting = np.concatenate([states["commands"], command], axis=-1)[..., self.m :]
        found = {**states, "commands": waiting}
        first, arrived = self.at_instants, waiting[..., : self.m]
        held, moved = self.chain(arrived, states, range(first), control.period)
        found |= moved | ({"held": held} if first else {})
        behind = self.actuators[first : first + 1]
        if any(part is not None and part.sampled for part in behind):
            _, moved = self.chain(held, states, range(first, first + 1), control.period)
            found |= moved
        return found

    def at_limit(self, command: Array, states: dict[str, Array]) -> Array:
        """Return where any actuator is at its limit."""
        if self.vehicle.control is not None:
            command = states["commands"][..., : self.m]
        found = np.zeros(command.shape[:-1], dtype=bool)
        for k in range(len(self.actuators)):
            given = command
            command, _ = self.chain(given, states, range(k, k + 1))
            found |= self.at_limit_of(k, given, states, command)
        return found

    def at_limit_of(self, k: int, given: Array, states: dict[str, Array], passed: Array) -> Array:
        """Return where an actuator is at its limit."""
        part = self.actuators[k]
        assert part is not None
        return part.at_limit(given, states.get(f"actuators_{k}", given[..., :0]), passed)

    @cached_property
    def measuring(self) -> SecondMeasuring:
        """The sensors of the run."""
        problem = self.flight.problem
        instants = problem.control_instants
        return SecondMeasuring(problem.loop.group, self.vehicle, instants, self.random)

    def measurement_errors(self) -> tuple[Array, Array] | None:
        """Return the errors n and b at every instant; None if a sensor has no second form."""
        n, b = self.measuring.total("pose"), self.measuring.total("velocity")
        return None if n is None or b is None else (n, b)


def second_vehicles(flight: VehicleRuns) -> list[SecondVehicle]:
    """Return the second form of the vehicle of every run."""
    return [SecondVehicle(flight, index) for index in range(len(flight.states))]


def _moving(law: InertiaLaw, times: Array) -> tuple[Array, Array]:
    """Return a tensor that is a function of time, and its exact derivative."""
    matrix = law.at(with_rate(lifted(times), 1.0)).matrix
    shape = len(times), *matrix.shape[-2:]
    return np.broadcast_to(floats(matrix), shape), np.broadcast_to(floats(rate_of(matrix)), shape)


def _constant(
    true: TrueInertia, m: int, random: np.random.Generator, samples: int
) -> tuple[Array, Array]:
    """Return a constant tensor and its rate 0, drawn until the tensor is positive definite."""
    given: Any = true
    matrix = _draw_until(_is_definite, given.matrix, random, lambda value: tensor(value, m))
    return np.broadcast_to(matrix, (samples, m, m)), np.zeros((samples, m, m))


def _is_definite(matrix: Array) -> bool:
    return bool(np.linalg.eigvalsh(matrix).min() > 0)


def _draw_until(
    fits: Any, value: Any, random: np.random.Generator, of: Any = lambda drawn: drawn
) -> Any:
    """Draw until a value fits."""
    while not fits(found := of(number(value, random))):
        pass
    return found
