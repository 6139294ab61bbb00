"""Runs of a loop that is not ideal, as they were integrated, with all that they drew."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Problem
from eqt_cli.ensemble.seeds import Stream, generator_at

SLACK = 1e-9
"""Of a period: what a time that is meant to be an instant may be off."""


@dataclass(frozen=True)
class Flight:
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
        """What each sensor of white noise tells each run, ``(runs, instants, m)``, of variance 1.

        Along axes without noise it is left out.
        """
        G, count = self.problem.loop.group, self.problem.control_instants
        for place, sensor in self.problem.loop.vehicle.sensors().items():
            found = []
            for run in self.numbers.tolist():
                random = generator_at(self.seed, Stream.VEHICLE, run, place)
                own = sensor.of_run(random)
                deviation = own.white_deviation(G, self.period)
                if deviation is None:
                    break
                errors = own.errors(G, count, self.period, random)[:, deviation > 0]
                found.append(errors / deviation[deviation > 0])
            if len(found) == len(self.numbers) and found and found[0].size:
                yield np.array(found)
