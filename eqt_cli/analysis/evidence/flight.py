"""Runs of a loop that is not ideal, with the random numbers that they drew."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from eqt_cli.analysis.evidence.second_sensors import configured_deviation
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Problem
from eqt_cli.ensemble.seeds import Stream, generator_at

SLACK = 1e-9
"""Tolerance for a time at a control instant, as a share of a period."""


@dataclass(frozen=True)
class VehicleRuns:
    """Good runs of one law.

    Attributes
    ----------
    problem
        The problem that the engine solved.
    states : (runs, samples, n)
        Flat states.
    seed
        Seed of the experiment.
    numbers : (runs,)
        Numbers of the runs.
    """

    problem: Problem
    states: Array
    seed: int
    numbers: Array

    @property
    def loop(self) -> ClosedLoop:
        """The loop with the numbers of every run, for states ``(runs, samples, n)``."""
        return self.problem.batched_loop(extra_axes=1)

    def at_samples(self, samples: Array) -> "VehicleRuns":
        """Return the runs at some of the samples."""
        problem = replace(self.problem, times=self.problem.times[samples])
        return replace(self, problem=problem, states=self.states[:, samples])

    @property
    def period(self) -> float:
        """Control period, s; infinite if the law acts continuously."""
        control = self.problem.loop.vehicle.control
        return math.inf if control is None else control.period

    @property
    def periods(self) -> Array:
        """Number of the control period that contains or starts at each sample."""
        return np.floor(self.problem.times / self.period + SLACK).astype(int)

    @property
    def within(self) -> Array:
        """Indices of samples (but the last) after which no command arrives before the next one."""
        ends = np.ceil(self.problem.times[1:] / self.period - SLACK).astype(int)
        return np.flatnonzero(ends == self.periods[:-1] + 1)

    def white_noise(self) -> Iterator[Array]:
        """Yield the white noise of each sensor in each run, ``(runs, instants, n)``, of variance 1.

        This is the noise divided by its configured standard deviation. Axes without noise are left
        out.
        """
        problem, vehicle = self.problem, self.problem.loop.vehicle
        G = problem.loop.group
        for place, sensor, every, _, axes in vehicle.drawings(G):
            count, period, found = -(-problem.control_instants // every), every * self.period, []
            for run in self.numbers.tolist():
                random = generator_at(self.seed, Stream.VEHICLE, run, place)
                own = sensor.drawn(random)
                deviation = own.white_deviation(G, period)
                if deviation is None:
                    break
                again = generator_at(self.seed, Stream.VEHICLE, run, place)
                size = sensor.coordinates(G)
                configured = configured_deviation(sensor, size, period, again)
                if configured is not None:  # else the sensor of a plugin, which reports its own
                    deviation = configured
                errors, deviation = own.errors(G, count, period, random)[:, axes], deviation[axes]
                found.append(errors[:, deviation > 0] / deviation[deviation > 0])
            if len(found) == len(self.numbers) and found and found[0].size:
                yield np.array(found)
