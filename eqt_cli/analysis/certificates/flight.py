"""Checks the sampled loop between law and plant: hold, actuators and noise."""

from abc import abstractmethod
from collections.abc import Iterator
from itertools import combinations
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.evidence.flight import VehicleRuns
from eqt_cli.analysis.evidence.runs import STATES_PER_RTOL, Runs
from eqt_cli.closed_loop.law_input import LawInput
from eqt_cli.core.arrays import Array
from eqt_cli.vehicle.sensors.channels import Errors

ROUNDING = 1e-12
"""Tolerance relative to the largest command or 1, for a law evaluated compiled and by NumPy."""

DEVIATIONS = 5.0
"""Allowed deviation of a mean in standard errors; one mean in a million exceeds it."""

RARE = 3e-7
"""Probability that a normal number exceeds this on one side."""


class FlightCheck(TrajectoryCheck):
    """A statement about a loop whose law is sampled."""

    def applies(self, runs: Runs) -> bool:
        """Whether the law is sampled and the check concerns the loop."""
        flight = runs.flight
        return flight is not None and np.isfinite(flight.period) and self.is_about(flight)

    def is_about(self, flight: VehicleRuns) -> bool:
        """Whether the check concerns this loop."""
        return True

    def check(self, runs: Runs) -> Row:
        """Judge the number with the largest ratio to its bound."""
        flight = runs.flight
        if flight is None or not len(flight.states):
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=runs.label)
        found = self.measured(flight, runs.rtol)
        if not found:
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=runs.label)
        measured, bound = max(found, key=lambda pair: pair[0] / pair[1])
        return self.compared(float(measured), float(bound), runs.remark, runs.label)

    @abstractmethod
    def measured(self, flight: VehicleRuns, rtol: float) -> list[tuple[float, float]]:
        """Return numbers with the bounds that they must not exceed."""


class Hold(FlightCheck):
    """The command is the law's output at an instant, held until the next instant."""

    name: ClassVar[str] = "command is computed at instants and held"
    statement: ClassVar[str] = "zero-order hold"
    section: ClassVar[float] = 9.1

    def measured(self, flight: VehicleRuns, rtol: float) -> list[tuple[float, float]]:
        """Measure the largest difference to the law, and between samples of one period."""
        loop, times = flight.loop, flight.problem.times
        s = loop.tracking(times, flight.states)
        command, periods = loop.command(s), flight.periods
        same = np.flatnonzero(np.diff(periods) == 0)
        # The last sample is the state before its instant.
        same = same[same + 1 < len(times) - 1]
        found = [np.abs(command[:, same + 1] - command[:, same])]
        if not s.memory:  # with memory, the command used the memory before the instant
            found.append(np.abs(_law_torque(flight) - command)[:, _at_instants(flight)])
        measured = max((float(part.max()) for part in found if part.size), default=0.0)
        return [(measured, ROUNDING * max(1.0, float(np.abs(command).max())))]


def _at_instants(flight: VehicleRuns) -> Array:
    off = np.abs(flight.problem.times - flight.periods * flight.period)
    return np.flatnonzero(off[:-1] <= 1e-9 * flight.period)


def _law_torque(flight: VehicleRuns) -> Array:
    """Return the law's torque at every sample, with the measurement errors of its period."""
    loop = flight.loop
    s = inputs_at_samples(flight).tracking(loop.group, loop.inertia, loop.gains, {})
    return loop.controller.torque(s) + 0.0 * s.P


def inputs_at_samples(flight: VehicleRuns) -> LawInput:
    """Return the law's inputs at every sample, with the measurement errors of its period."""
    problem, errors = flight.problem, flight.problem.errors
    if errors is not None:
        k = np.minimum(flight.periods, problem.control_instants - 1)
        errors = Errors(*(part[:, k] for part in errors))
    return flight.loop.told(problem.times, flight.states, errors)


class ActuatorsInClosedForm(FlightCheck):
    """The states of an actuator follow its closed form for a held command up to the next sample."""

    name: ClassVar[str] = "actuator follows its closed form"
    statement: ClassVar[str] = "lag: u + (x − u) e^(−t/T)"
    section: ClassVar[float] = 9.2

    def is_about(self, flight: VehicleRuns) -> bool:
        """Whether the first actuator with rates has a closed form, and periods contain samples."""
        first = flight.problem.loop.vehicle.first_moving
        return first is not None and first.has_closed_form and bool(len(flight.within))

    def measured(self, flight: VehicleRuns, rtol: float) -> list[tuple[float, float]]:
        """The largest difference."""
        loop, times = flight.loop, flight.problem.times
        start = flight.within
        here = loop.tracking(times[start], flight.states[:, start])
        later = loop.tracking(times[start + 1], flight.states[:, start + 1])
        vehicle, duration = loop.vehicle, np.diff(times)[start][:, None]
        expected, found = vehicle.first_moving_after(
            loop.group, here.vehicle, later.vehicle, duration
        )
        return [(np.abs(expected - found).max(), STATES_PER_RTOL * rtol)]


class NoiseCovariance(FlightCheck):
    """White noise of sensors has the configured covariance."""

    name: ClassVar[str] = "noise has its covariance"
    statement: ClassVar[str] = "mean of n nᵀ over runs and instants"
    section: ClassVar[float] = 9.3

    def is_about(self, flight: VehicleRuns) -> bool:
        """Whether a sensor has white noise."""
        return any(True for _ in flight.white_noise())

    def measured(self, flight: VehicleRuns, rtol: float) -> list[tuple[float, float]]:
        """Measure the entries of covariance − I for noise divided by its configured deviation."""
        return [
            pair
            for values in flight.white_noise()
            for pair in _off_identity(values.reshape(-1, values.shape[-1]))
        ]


def rare_mean_squares(n: float) -> tuple[float, float]:
    """Between which the mean of n squares of normals lies, but for one time in a million."""
    from scipy.special import gammaincinv  # slow to import

    low, high = (float(2 * gammaincinv(n / 2, p) / n) for p in (RARE, 1 - RARE))
    return low, high


def _off_identity(z: Array) -> Iterator[tuple[float, float]]:
    """Yield the deviations of the covariance of rows from I, with their bounds.

    A variance is distributed as χ²/n, whose quantiles are positive. So noise of 0 always exceeds
    the lower bound, however few rows there are.
    """
    n, axes = z.shape
    low, high = rare_mean_squares(n)
    covariance = z.T @ z / n
    for variance in np.diag(covariance).tolist():
        yield abs(variance - 1), 1 - low if variance < 1 else high - 1
    for off in covariance[np.triu_indices(axes, 1)].tolist():
        yield abs(off), DEVIATIONS * np.sqrt(2 / n)  # products of normals have long tails


class StreamsApart(FlightCheck):
    """Sensors and runs draw from separate streams: their noise is not correlated."""

    name: ClassVar[str] = "streams of noise are not correlated"
    statement: ClassVar[str] = "of sensors, and of neighbouring runs"
    section: ClassVar[float] = 9.4

    def is_about(self, flight: VehicleRuns) -> bool:
        """Whether there are at least two streams."""
        found = list(flight.white_noise())
        return len(found) > 1 or (bool(found) and len(found[0]) > 1)

    def measured(self, flight: VehicleRuns, rtol: float) -> list[tuple[float, float]]:
        """Measure the largest correlation of the same axis at the same instant."""
        found = list(flight.white_noise())
        pairs = [(values[1:], values[:-1]) for values in found if len(values) > 1]
        pairs += [
            (one[:, :count, :axes], other[:, :count, :axes])
            for one, other in combinations(found, 2)
            for _, count, axes in [np.minimum(one.shape, other.shape).tolist()]
        ]
        return [
            (np.abs(_correlation(one, other)).max(), DEVIATIONS / np.sqrt(one[..., 0].size))
            for one, other in pairs
        ]


def _correlation(one: Array, other: Array) -> Array:
    """Return the correlation along every axis over runs and instants; 0 for zero noise."""
    a, b = one.reshape(-1, one.shape[-1]), other.reshape(-1, other.shape[-1])
    sizes: Array = np.sqrt((a * a).sum(axis=0) * (b * b).sum(axis=0))
    found: Array = (a * b).sum(axis=0) / np.where(sizes > 0, sizes, 1.0)
    return found
