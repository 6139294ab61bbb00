"""The runs of one law as certificates read them, and the setting that all laws share."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Problem
from eqt_cli.ensemble.spread import Stream, generator_at

ENERGY_PER_RTOL = 100.0
"""Allowed error of L per unit of `rtol`. There are hundreds of steps with errors of about rtol, and
damping removes most of them (measured over all groups and laws: 0.2 to 3)."""

STATES_PER_RTOL = 1000.0
"""Allowed error of states per unit of `rtol`, as in the cross-check. Trajectories amplify errors:
190 times for a run of nog in the paper's ensemble that was solved alone."""


@dataclass(frozen=True)
class VehicleRuns:
    """Good runs of one law in a loop that is not ideal.

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
    windows
        Some of the runs at other times, over which momentum is balanced; None without good runs.
    """

    problem: Problem
    states: Array
    seed: int
    numbers: Array
    windows: "VehicleRuns | None" = None

    @property
    def loop(self) -> ClosedLoop:
        """The loop with the numbers of every run, for states ``(runs, samples, n)``."""
        return self.problem.batched_loop(extra_axes=1)

    def white_noise(self) -> Iterator[Array]:
        """Yield the white noise of each sensor in each run, ``(runs, instants, n)``, of variance 1.

        This is the noise divided by its configured standard deviation. Axes without noise are left
        out.
        """
        problem, vehicle = self.problem, self.problem.loop.vehicle
        G = problem.loop.group
        for place, sensor, clock, _, axes in vehicle.drawings(G):
            count = int(clock.numbers(problem.control_instants)[-1]) + 1
            period, whitened = clock.every * vehicle.tick, []
            for run in self.numbers.tolist():
                random = generator_at(self.seed, Stream.VEHICLE, run, place)
                own = sensor.drawn(random)
                deviation = own.white_deviation(G, period)
                if deviation is None:
                    break
                errors, deviation = own.errors(G, count, period, random)[:, axes], deviation[axes]
                whitened.append(errors[:, deviation > 0] / deviation[deviation > 0])
            if len(whitened) == len(self.numbers) and whitened and whitened[0].size:
                yield np.array(whitened)


@dataclass(frozen=True)
class Runs:
    """Metrics and trajectories of the good runs of one controller.

    Attributes
    ----------
    label
        Label of the controller.
    claims_decrease
        Whether L is claimed to decrease; None if the law makes no statement.
    rtol
        Relative tolerance of the runs.
    threshold
        Pose error below which a run counts as settled; with thresholds by part, their norm.
    times : (samples,)
        Sample times, s.
    lyapunov : (runs, samples) or None
        L; None without trajectories.
    energy_residual, group_drift, final_pose_error, final_velocity_error : (runs,)
        Metrics as in a result.
    failed
        Number of failed runs.
    departures
        Parts of the loop that the theorems do not cover, in words.
    vehicle
        The runs of a loop that is not ideal; None for an ideal one.
    energy, theorem
        Name of the function L, and the source of its decrease.
    pose_error, velocity_error : (runs, samples) or None
        Errors over time of the runs with stored trajectories; None without trajectories.
    settled : (runs,) or None
        Whether each run has settled, if there are thresholds by part.
    desired_speed
        Largest ‖V_d‖.
    rate
        Rate at which small errors decay, from the linearised loop, 1/s; None if not known.
    estimate
        Signals by which a filter with a covariance judges itself, ``(runs, samples)`` by name;
        empty without trajectories, None without such a filter.
    """

    label: str
    claims_decrease: bool | None
    rtol: float
    threshold: float
    times: Array
    lyapunov: Array | None
    energy_residual: Array
    group_drift: Array
    final_pose_error: Array
    final_velocity_error: Array
    failed: int = 0
    departures: str = ""
    vehicle: VehicleRuns | None = None
    energy: str = Controller.energy
    theorem: str = Controller.theorem
    pose_error: Array | None = None
    velocity_error: Array | None = None
    settled: Array | None = None
    desired_speed: float = 0.0
    rate: float | None = None
    estimate: dict[str, Array] | None = None

    @property
    def own_function(self) -> str:
        """Name of the function L if it is not the paper's."""
        return "" if self.energy == Controller.energy else f"L = {self.energy}"

    @property
    def count(self) -> int:
        """Number of good runs."""
        return len(self.energy_residual)

    @property
    def remark(self) -> str:
        """Number of failed runs in words; empty if there are none."""
        plural = "" if self.failed == 1 else "s"
        return f"{self.failed} run{plural} failed" if self.failed else ""

    def decay_rate(self) -> float:
        """Return the median decay rate of log L, fitted over the second half of the horizon.

        It is positive if L falls, and NaN if there is nothing to fit.
        """
        if self.lyapunov is None or not len(self.lyapunov):
            return float("nan")
        later = self.times >= (self.times[0] + self.times[-1]) / 2
        t, L = self.times[later], self.lyapunov[:, later]
        usable = (L > 0).all(axis=1)
        if later.sum() < 2 or not usable.any():
            return float("nan")
        slopes = np.polyfit(t, np.log(L[usable]).T, 1)[0]
        return float(-np.median(slopes))


@dataclass(frozen=True)
class Setting:
    """The assumptions of an experiment.

    Attributes
    ----------
    loops
        Closed loops by label, which differ only in the controller.
    times : (samples,)
        Sample times, s.
    desired_pose, desired_velocity : (samples, …)
        Q_d and V_d at these times.
    rigid
        Whether the inertia is declared to be that of a rigid body.
    """

    loops: dict[str, ClosedLoop]
    times: Array
    desired_pose: Array
    desired_velocity: Array
    rigid: bool = True

    @property
    def loop(self) -> ClosedLoop:
        """Any of the loops, for their common parts."""
        return next(iter(self.loops.values()))

    @property
    def inside(self) -> ClosedLoop:
        """The loop of the attitude, of a cascade."""
        return self.loop.inside


def largest(values: Array) -> float:
    """Return the largest number; NaN counts as larger than any other."""
    return float(np.max(values))
