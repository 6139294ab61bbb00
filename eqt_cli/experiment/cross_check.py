"""A few runs of each controller, redone another way: the check that every result carries."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, frobenius, norm
from eqt_cli.core.errors import TraceError
from eqt_cli.engines import Engine, Problem
from eqt_cli.ensemble.seeds import Stream, generator
from eqt_cli.experiment.build import Experiment

BOUND_PER_RTOL = 1000.0
"""Allowed difference per unit of `rtol`: what the trajectories themselves amplify (up to 70 times
in the paper's ensemble, near the unstable equilibria) with room to spare."""


@dataclass(frozen=True)
class CrossCheck:
    """The outcome of a cross-check.

    Attributes
    ----------
    method
        What redid the runs.
    runs
        How many runs of each controller.
    difference
        Largest max(‖ΔQ‖_F, ‖ΔV‖) over samples and over the runs that did not fail; inf where one
        of these fails when it is redone, NaN where all failed.
    bound
        What it should not exceed.
    """

    method: str
    runs: int
    difference: float
    bound: float

    @property
    def holds(self) -> bool:
        """Whether the difference is within the bound."""
        return not self.difference > self.bound


def chosen_runs(experiment: Experiment) -> Array:
    """Which runs are redone: a fixed function of the seed and the number of runs."""
    runs = experiment.config.ensemble.runs
    count = min(experiment.solver.judgement.cross_check, runs)
    random = generator(experiment.config.ensemble.seed, Stream.CROSS_CHECK, runs)
    return np.sort(random.choice(runs, size=count, replace=False))


def cross_check(experiment: Experiment, compared: dict[str, tuple[Problem, Array]]) -> CrossCheck:
    """Solve the chosen runs again and compare.

    Parameters
    ----------
    compared
        For each controller its chosen runs as a problem, and the states that were found for them.
    """
    engine, method = _another_way(experiment)
    try:
        differences = _differences(engine, compared)
    except TraceError:  # the results do not depend on what another engine cannot compile
        engine, method = _tighter(experiment)
        differences = _differences(engine, compared)
    largest = float(differences.max()) if len(differences) else float("nan")
    runs = next(iter(compared.values()))[0].runs
    bound = BOUND_PER_RTOL * experiment.engine.rtol
    return CrossCheck(method, runs, largest, bound)


def _differences(engine: Engine, compared: dict[str, tuple[Problem, Array]]) -> Array:
    """How far the engine comes from each of the runs that did not fail."""
    found = []
    for group in _by_structure(compared):
        problem = Problem.joined([problem for problem, _ in group])
        states = np.concatenate([states for _, states in group])
        again = engine.solve(problem, lambda runs: None)
        loop = problem.batched_loop(extra_axes=1)
        with np.errstate(all="ignore"):  # runs that failed are NaN, or large
            difference = distance(loop, problem.times, states, again.states)
        good = np.isfinite(states).all(axis=(1, 2))
        found.append(np.nan_to_num(difference[good], nan=np.inf))
    return np.concatenate(found)


def _by_structure(compared: dict[str, tuple[Problem, Array]]) -> list[list[tuple[Problem, Array]]]:
    """Controllers that one vectorised solve can take together; all else is the same for all."""
    groups: dict[Hashable, list[tuple[Problem, Array]]] = {}
    for problem, states in compared.values():
        groups.setdefault(problem.loop.controller.structure, []).append((problem, states))
    return list(groups.values())


def distance(loop: ClosedLoop, times: Array, one: Array, other: Array) -> Array:
    """max over samples of max(‖ΔQ‖_F, ‖ΔV‖), ``(runs, samples, n) -> (runs,)``."""
    a, b = loop.tracking(times, one), loop.tracking(times, other)
    largest: Array = np.maximum(frobenius(a.Q - b.Q), norm(a.V - b.V)).max(axis=-1)
    return largest


def reference_distance(loop: ClosedLoop, times: Array, states: Array, reference: Array) -> Array:
    """Like `distance`, between the reference within each run and the one solved by itself."""
    a, b = loop.tracking(times, states), loop.tracking(times, reference)
    largest: Array = np.maximum(frobenius(a.Qd - b.Qd), norm(a.Vd - b.Vd)).max(axis=-1)
    return largest


def _another_way(experiment: Experiment) -> tuple[Engine, str]:
    other = experiment.solver.other
    if other is not None:
        return other.sized(1, 0), f"engine {other.name}"
    return _tighter(experiment)


def _tighter(experiment: Experiment) -> tuple[Engine, str]:
    engine = experiment.engine.tightened(0.01)
    return engine, f"engine {engine.name}, tolerances / 100"
