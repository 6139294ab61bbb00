"""What is between law and plant does what it says: the hold, actuators, noise."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.evidence.flight import Flight
from eqt_cli.analysis.evidence.runs import STATES_PER_RTOL, Runs
from eqt_cli.core.arrays import Array

ROUNDING = 1e-12
"""Relative to the largest command, or 1: a law by a compiler and by NumPy."""

DEVIATIONS = 5.0
"""So many standard errors a mean may be off: one in a million is."""


class FlightCheck(TrajectoryCheck):
    """A statement about a loop that is not ideal."""

    def applies(self, runs: Runs) -> bool:
        """To runs of a sampled law, or of a part that this is about."""
        return runs.flight is not None and runs.flight.problem.loop.vehicle.control is not None


class Hold(FlightCheck):
    """The command is what the law asks of what it is told at an instant, until the next one."""

    name: ClassVar[str] = "command is computed at instants and held"
    statement: ClassVar[str] = "zero-order hold"
    section: ClassVar[float] = 9.1

    def check(self, runs: Runs) -> Row:
        """The largest difference to the law, and between samples of one period."""
        flight, label = runs.flight, runs.label
        if flight is None or not len(flight.states):
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=label)
        loop, times = flight.loop, flight.problem.times
        s = loop.tracking(times, flight.states)
        command, periods = loop.command(s), flight.periods
        same = np.flatnonzero(np.diff(periods) == 0)
        # The last sample is the state before its instant.
        same = same[same + 1 < len(times) - 1]
        found = [np.abs(command[:, same + 1] - command[:, same])]
        if not s.memory:  # else the law was asked with the memory before the instant
            found.append(np.abs(_asked(flight) - command)[:, _at_instants(flight)])
        measured = max((float(part.max()) for part in found if part.size), default=0.0)
        bound = ROUNDING * max(1.0, float(np.abs(command).max()))
        return self.compared(measured, bound, runs.remark, label)


def _at_instants(flight: Flight) -> Array:
    control = flight.problem.loop.vehicle.control
    assert control is not None
    off = np.abs(flight.problem.times - flight.periods * control.period)
    return np.flatnonzero(off[:-1] <= 1e-9 * control.period)


def _asked(flight: Flight) -> Array:
    """What the law asks at every sample, told with the errors of its period."""
    loop, problem = flight.loop, flight.problem
    s = loop.tracking(problem.times, flight.states)
    if problem.errors is not None:
        pose, velocity = problem.errors
        k = np.minimum(flight.periods, problem.control_instants - 1)
        s = replace(s, Q=s.Q @ pose[:, k], P=s.inertia.momentum(s.V + velocity[:, k]))
    asked: Array = loop.controller.torque(s) + 0.0 * s.P
    return asked


class ActuatorsInClosedForm(FlightCheck):
    """An actuator with states is where its formula leads a held command by the next sample."""

    name: ClassVar[str] = "actuator follows its closed form"
    statement: ClassVar[str] = "lag: u + (x − u) e^(−t/T)"
    section: ClassVar[float] = 9.2

    def applies(self, runs: Runs) -> bool:
        """Where the first actuator that moves has a closed form, and samples lie in one period."""
        if not super().applies(runs):
            return False
        assert runs.flight is not None
        first = runs.flight.problem.loop.vehicle.first_moving
        return first is not None and first.has_closed_form and bool(len(runs.flight.within))

    def check(self, runs: Runs) -> Row:
        """The largest difference."""
        flight = runs.flight
        if flight is None or not len(flight.states):
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=runs.label)
        loop, times = flight.loop, flight.problem.times
        start = flight.within
        here = loop.tracking(times[start], flight.states[:, start])
        later = loop.tracking(times[start + 1], flight.states[:, start + 1])
        vehicle, duration = loop.vehicle, np.diff(times)[start][:, None]
        expected, found = vehicle.first_moving_after(
            loop.group, here.vehicle, later.vehicle, duration
        )
        measured = float(np.abs(expected - found).max())
        bound = STATES_PER_RTOL * runs.rtol
        return self.compared(measured, bound, runs.remark, runs.label)


class NoiseCovariance(FlightCheck):
    """White noise of sensors has the covariance that the configuration asks for."""

    name: ClassVar[str] = "noise has its covariance"
    statement: ClassVar[str] = "mean of n nᵀ over runs and instants"
    section: ClassVar[float] = 9.3

    def applies(self, runs: Runs) -> bool:
        """Where a sensor tells white noise."""
        return super().applies(runs) and any(True for _ in _noise(runs))

    def check(self, runs: Runs) -> Row:
        """The largest entry of covariance − I, of noise divided by its standard deviation."""
        largest = [
            (np.abs(z.T @ z / len(z) - np.eye(z.shape[1])).max(), DEVIATIONS * np.sqrt(2 / len(z)))
            for _, values in _noise(runs)
            for z in [values.reshape(-1, values.shape[-1])]
        ]
        measured, bound = max(largest, key=lambda pair: pair[0] / pair[1])
        return self.compared(float(measured), float(bound), runs.remark, runs.label)


class StreamsApart(FlightCheck):
    """Sensors and runs draw from streams of their own: their noise is not correlated."""

    name: ClassVar[str] = "streams of noise are not correlated"
    statement: ClassVar[str] = "of sensors, and of neighbouring runs"
    section: ClassVar[float] = 9.4

    def applies(self, runs: Runs) -> bool:
        """Where there are two of them."""
        found = list(_noise(runs)) if super().applies(runs) else []
        return len(found) > 1 or (bool(found) and len(found[0][1]) > 1)

    def check(self, runs: Runs) -> Row:
        """The largest correlation of the same axis at the same instant."""
        found = [values for _, values in _noise(runs)]
        pairs = [(values[1:], values[:-1]) for values in found if len(values) > 1]
        pairs += [
            (one[..., :axes], other[..., :axes])
            for one, other in combinations(found, 2)
            for axes in [min(one.shape[-1], other.shape[-1])]
        ]
        largest = [
            (np.abs(_correlation(one, other)).max(), DEVIATIONS / np.sqrt(one[..., 0].size))
            for one, other in pairs
        ]
        measured, bound = max(largest, key=lambda pair: pair[0] / pair[1])
        return self.compared(float(measured), float(bound), runs.remark, runs.label)


def _correlation(one: Array, other: Array) -> Array:
    """Along every axis, over runs and instants."""
    a, b = one.reshape(-1, one.shape[-1]), other.reshape(-1, other.shape[-1])
    sizes: Array = np.sqrt((a * a).sum(axis=0) * (b * b).sum(axis=0))
    return (a * b).sum(axis=0) / sizes


def _noise(runs: Runs) -> list[tuple[str, Array]]:
    assert runs.flight is not None
    return list(runs.flight.white_noise()) if len(runs.flight.numbers) else []
