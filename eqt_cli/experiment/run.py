"""Runs an experiment: draws initial states, integrates, measures, and hands over a table.

The runs of a controller pass through in chunks, so that memory is bounded whatever their number;
what is kept of each is decided by the `store` section.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.analysis.metrics import METRICS
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.signals import compute
from eqt_cli.core.arrays import Array, frobenius, norm
from eqt_cli.engines import Problem, Solution, Status
from eqt_cli.ensemble.initial import draw_initial_states
from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.gather import Chunk, Gathered
from eqt_cli.store.variables import Table

Progress = Callable[[float], None]

CHUNK_BYTES = 64 * 2**20
"""Size of the states of the runs that are in memory at once; signals take a few times as much."""

ENERGY_SCALE = 1.0
"""J; energy residuals are relative to L(0), but never to less than this (see `headline`)."""


def simulate(experiment: Experiment, progress: Progress = lambda runs: None) -> Table:
    """Integrate every run of every controller and gather what is to be stored.

    `progress` is told how many more runs are done, in fractions; the total is
    controllers × runs.
    """
    with threadpool_limits(1):  # results must not depend on how a library splits a product
        return _simulate(experiment, progress)


def _simulate(experiment: Experiment, progress: Progress) -> Table:
    runs = experiment.config.ensemble.runs
    Q, V = draw_initial_states(
        experiment.group,
        experiment.poses,
        experiment.velocities,
        Qd=experiment.initial_pose,
        Vd=experiment.initial_velocity,
        seed=experiment.config.ensemble.seed,
        runs=range(runs),
    )
    gathered = Gathered(experiment)
    for index, loop in enumerate(experiment.loops.values()):
        for chunk in _chunks(experiment, loop, Q, V, progress):
            gathered.add(index, chunk)
    desired = _desired(experiment)
    return gathered.table(Q, V, desired)


def _chunks(
    experiment: Experiment, loop: ClosedLoop, Q: Array, V: Array, progress: Progress
) -> Iterator[Chunk]:
    times = experiment.times
    states = loop.initial_state(Q, V, experiment.initial_pose, experiment.initial_velocity)
    problem = Problem(loop, states, times)
    size = experiment.engine.runs_at_once(CHUNK_BYTES // (8 * len(times) * loop.state_length))
    for start in range(0, len(states), size):
        runs = slice(start, min(start + size, len(states)))
        part = problem.select(runs)
        solution = experiment.engine.solve(part, progress)
        with np.errstate(all="ignore"):  # runs that failed are NaN, or large
            yield _measured(experiment, part, runs, solution)


def _measured(
    experiment: Experiment, problem: Problem, runs: slice, solution: Solution
) -> Chunk:
    loop, times = problem.batched_loop(extra_axes=1), problem.times
    found = compute(loop, times, solution.states)
    balance = found.pop("energy_balance")
    initial = found["lyapunov"][:, :1]
    if loop.controller.dissipation(loop.tracking(times[0], problem.states[:1])) is None:
        balance = np.full_like(balance, np.nan)
    threshold = experiment.config.settling_threshold
    metrics = {metric.name: metric.of(times, found, threshold) for metric in METRICS}
    metrics |= {
        "steps": solution.steps,
        "group_drift": experiment.group.drift(found["pose"]).max(axis=-1),
        "energy_residual": (
            np.abs(balance - initial).max(axis=-1) / np.maximum(initial[:, 0], ENERGY_SCALE)
        ),
        "error_estimate": _error_estimate(experiment, problem, solution, found),
    }
    _judge(experiment, solution, metrics["error_estimate"])
    return Chunk(runs, solution, found, metrics)


def _error_estimate(
    experiment: Experiment, problem: Problem, solution: Solution, found: dict[str, Array]
) -> Array:
    """max over samples of max(‖ΔQ‖_F, ‖ΔV‖) against a solve at a tenth of the tolerance."""
    if not experiment.solver.judgement.error_estimate:
        return np.full(problem.runs, np.nan)
    tighter = experiment.engine.tightened(0.1).solve(problem, lambda runs: None)
    loop = problem.batched_loop(extra_axes=1)
    other = loop.tracking(problem.times, tighter.states)
    difference = np.maximum(frobenius(other.Q - found["pose"]), norm(other.V - found["velocity"]))
    estimate: Array = difference.max(axis=-1)
    return estimate


def _judge(experiment: Experiment, solution: Solution, estimate: Array) -> None:
    """Give runs whose error estimate exceeds `max_error` a status of their own."""
    limit = experiment.solver.judgement.max_error
    if limit is None:
        return
    for run in np.flatnonzero((solution.status == Status.OK) & (estimate > limit)):
        solution.status[run] = Status.ACCURACY
        solution.messages[run] = (
            f"error estimate {estimate[run]:.2g} exceeds solver.max_error = {limit:g}"
        )


def _desired(experiment: Experiment) -> dict[str, Array]:
    """The reference by itself: the closed loop started on it, where every error is 0."""
    loop = next(iter(experiment.loops.values()))
    Qd, Vd = experiment.initial_pose[None], experiment.initial_velocity[None]
    problem = Problem(loop, loop.initial_state(Qd, Vd, Qd, Vd), experiment.times)
    solution = experiment.engine.solve(problem, lambda runs: None)
    s = loop.tracking(experiment.times, solution.states[0])
    return {"desired_pose": s.Qd, "desired_velocity": s.Vd, "desired_torque": s.tau_d}
