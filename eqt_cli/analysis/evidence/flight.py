"""Runs of a loop that is not ideal, as they were integrated, with all that they drew."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

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
    def periods(self) -> Array:
        """The number of the control period that begins at each sample or goes on there."""
        control = self.problem.loop.vehicle.control
        assert control is not None
        return np.floor(self.problem.times / control.period + SLACK).astype(int)

    @property
    def within(self) -> Array:
        """The samples from which to the next one no command arrives; not the last."""
        control = self.problem.loop.vehicle.control
        assert control is not None
        ends = np.ceil(self.problem.times[1:] / control.period - SLACK).astype(int)
        return np.flatnonzero(ends == self.periods[:-1] + 1)

    def white_noise(self) -> Iterator[tuple[str, Array]]:
        """What each sensor of white noise tells each run, ``(runs, instants, m)``, of variance 1.

        Along axes without noise it is left out.
        """
        loop, vehicle = self.problem.loop, self.problem.loop.vehicle
        assert vehicle.control is not None
        G, period, count = loop.group, vehicle.control.period, self.problem.control_instants
        for place, sensor in vehicle.sensors().items():
            found = []
            for run in self.numbers.tolist():
                random = partial(generator_at, self.seed, Stream.VEHICLE, run)(place)
                own = sensor.of_run(random)
                deviation = own.white_deviation(G, period)
                if deviation is None:
                    break
                errors = own.errors(G, count, period, random)[:, deviation > 0]
                found.append(errors / deviation[deviation > 0])
            if len(found) == len(self.numbers) and found and found[0].size:
                yield place, np.array(found)
