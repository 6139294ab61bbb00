"""Runs an experiment: draws initial states, integrates, measures, and hands over a table.

The runs of a controller pass through in chunks, so that memory is bounded whatever their number;
what is kept of each is decided by the `store` section.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.analysis.metrics import METRICS, energy_residual
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.signals import compute
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Engine, Problem, Solution, Status
from eqt_cli.ensemble.initial import draw_initial_states
from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.cross_check import (
    CrossCheck,
    chosen_runs,
    cross_check,
    distance,
    reference_distance,
)
from eqt_cli.experiment.gather import Chunk, Gathered
from eqt_cli.mechanics.critical_points import distance_to_unstable
from eqt_cli.store.variables import Table

Progress = Callable[[float], None]

CHUNK_BYTES = 64 * 2**20
"""Size of the states of the runs that are in memory at once; signals take a few times as much."""


@dataclass(frozen=True)
class Simulated:
    """What `simulate` found: the arrays to store, and how the cross-check went, if it was asked."""

    table: Table
    check: CrossCheck | None


def simulate(
    experiment: Experiment, progress: Progress = lambda runs: None, workers: int = 1
) -> Simulated:
    """Integrate every run of every controller and gather what is to be stored.

    `progress` is told how many more runs are done, in fractions; the total is
    controllers × runs.
    """
    with threadpool_limits(1):  # results must not depend on how a library splits a product
        return _Simulation(experiment, progress, workers).run()


class _Simulation:
    def __init__(self, experiment: Experiment, progress: Progress, workers: int) -> None:
        self.experiment, self.progress, self.workers = experiment, progress, workers
        runs = experiment.config.ensemble.runs
        loop = next(iter(experiment.loops.values()))
        self.engine: Engine = experiment.engine.sized(
            runs * len(experiment.loops), loop.state_length
        )
        self.Q, self.V = draw_initial_states(
            experiment.group,
            experiment.poses,
            experiment.velocities,
            Qd=experiment.initial_pose,
            Vd=experiment.initial_velocity,
            seed=experiment.config.ensemble.seed,
            runs=range(runs),
        )

    def run(self) -> Simulated:
        gathered = Gathered(self.experiment)
        chosen = chosen_runs(self.experiment)
        compared: dict[str, tuple[Problem, Array]] = {}
        reference, desired = self._desired()
        for index, (label, loop) in enumerate(self.experiment.loops.items()):
            problem = self._problem(loop)
            found = []
            for runs, solution in self._solve(problem):
                with np.errstate(all="ignore"):  # runs that failed are NaN, or large
                    part = problem.select(runs)
                    gathered.add(index, self._measured(part, runs, solution, reference))
                here = chosen[(chosen >= runs.start) & (chosen < runs.stop)]
                found.append(solution.states[here - runs.start])
            compared[label] = (problem.select(chosen), np.concatenate(found))
        check = cross_check(self.experiment, compared) if len(chosen) else None
        return Simulated(gathered.table(self.Q, self.V, desired), check)

    def _problem(self, loop: ClosedLoop) -> Problem:
        Qd, Vd = self.experiment.initial_pose, self.experiment.initial_velocity
        return Problem(loop, loop.initial_state(self.Q, self.V, Qd, Vd), self.experiment.times)

    def _solve(self, problem: Problem) -> Iterator[tuple[slice, Solution]]:
        """The solutions of all runs, as many at a time as fit in memory."""
        most = CHUNK_BYTES // (8 * len(problem.times) * problem.loop.state_length)
        size = self.engine.runs_at_once(most)
        for start in range(0, problem.runs, size):
            runs = slice(start, min(start + size, problem.runs))
            yield runs, self.engine.solve(problem.select(runs), self.progress, self.workers)

    def _measured(
        self, problem: Problem, runs: slice, solution: Solution, reference: Array
    ) -> Chunk:
        loop, times = problem.batched_loop(extra_axes=1), problem.times
        signals = compute(loop, times, solution.states)
        balance, s = signals.pop("energy_balance"), loop.tracking(times, solution.states)
        if loop.controller.dissipation(loop.tracking(times[0], problem.states[:1])) is None:
            balance = np.full_like(balance, np.nan)
        threshold = self.experiment.config.settling_threshold
        metrics = {metric.name: metric.of(times, signals, threshold) for metric in METRICS}
        metrics |= {
            "steps": solution.steps,
            "group_drift": problem.loop.group.drift(signals["pose"]).max(axis=-1),
            "energy_residual": energy_residual(signals["lyapunov"], balance),
            "unstable_distance": distance_to_unstable(loop.group, loop.gains.K, s.Q_E).min(axis=-1),
            "error_estimate": self._error_estimate(problem, solution),
            "reference_residual": reference_distance(loop, times, solution.states, reference),
        }
        self._judge(solution, metrics["error_estimate"])
        return Chunk(runs, solution, signals, metrics)

    def _error_estimate(self, problem: Problem, solution: Solution) -> Array:
        """The distance of every run to a solve at a tenth of the tolerance; NaN without one."""
        if not self.experiment.solver.estimates_errors:
            return np.full(problem.runs, np.nan)
        tighter = self.engine.tightened(0.1).solve(problem, lambda runs: None, self.workers)
        loop = problem.batched_loop(extra_axes=1)
        return distance(loop, problem.times, solution.states, tighter.states)

    def _judge(self, solution: Solution, estimate: Array) -> None:
        """Give runs whose error estimate exceeds `max_error` a status of their own."""
        limit = self.experiment.solver.judgement.max_error
        if limit is None:
            return
        for run in np.flatnonzero((solution.status == Status.OK) & (estimate > limit)):
            solution.status[run] = Status.ACCURACY
            solution.messages[run] = (
                f"error estimate {estimate[run]:.2g} exceeds solver.max_error = {limit:g}"
            )

    def _desired(self) -> tuple[Array, dict[str, Array]]:
        """The reference by itself: the closed loop started on it, where every error is 0.

        Returns its flat states ``(samples, n)``, and what of them is stored.
        """
        Qd, Vd = self.experiment.initial_pose[None], self.experiment.initial_velocity[None]
        for loop in self.experiment.loops.values():
            problem = Problem(loop, loop.initial_state(Qd, Vd, Qd, Vd), self.experiment.times)
            solution = self.engine.solve(problem, lambda runs: None)
            if solution.status[0] == Status.OK:
                break  # a law that fails even here must not harm the others
        states = solution.states[0]
        s = loop.tracking(problem.times, states)
        desired = {"desired_pose": s.Qd, "desired_velocity": s.Vd, "desired_torque": s.tau_d}
        return states, desired
