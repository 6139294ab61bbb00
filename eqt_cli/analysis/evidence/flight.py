"""Runs of a loop that is not ideal, as they were integrated, with all that they drew."""

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
"""Of a period: what a time that is meant to be an instant may be off."""


@dataclass(frozen=True)
class VehicleRuns:
    """Good runs of one law.

    Attributes
    ----------
    problem
        As an engine was given it.
    states : (runs, samples, n)
    seed
        Of the experiment.
    numbers : (runs,)
        Which runs these are.
    """

    problem: Problem
    states: Array
    seed: int
    numbers: Array

    @property
    def loop(self) -> ClosedLoop:
        """With the numbers of every run, for states ``(runs, samples, n)``."""
        return self.problem.batched_loop(extra_axes=1)

    def at_samples(self, samples: Array) -> "VehicleRuns":
        """The same at some of the samples."""
        problem = replace(self.problem, times=self.problem.times[samples])
        return replace(self, problem=problem, states=self.states[:, samples])

    @property
    def period(self) -> float:
        """Of control, s; infinite where the law acts continuously."""
        control = self.problem.loop.vehicle.control
        return math.inf if control is None else control.period

    @property
    def periods(self) -> Array:
        """The number of the control period that begins at each sample or goes on there."""
        return np.floor(self.problem.times / self.period + SLACK).astype(int)

    @property
    def within(self) -> Array:
        """The samples from which to the next one no command arrives; not the last."""
        ends = np.ceil(self.problem.times[1:] / self.period - SLACK).astype(int)
        return np.flatnonzero(ends == self.periods[:-1] + 1)

    def white_noise(self) -> Iterator[Array]:
        """What each sensor of white noise tells each run, ``(runs, instants, n)``, of variance 1.

        That is its noise divided by the deviation that the configuration says, at each of its
        rates. Along axes without noise it is left out.
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
                if configured is not None:  # else a plugin's, which alone knows it
                    deviation = configured
                errors, deviation = own.errors(G, count, period, random)[:, axes], deviation[axes]
                found.append(errors[:, deviation > 0] / deviation[deviation > 0])
            if len(found) == len(self.numbers) and found and found[0].size:
                yield np.array(found)
