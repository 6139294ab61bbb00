"""Solves a few runs of each controller again by another engine, and compares."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, frobenius, norm
from eqt_cli.core.errors import TraceError
from eqt_cli.engines import Engine, Problem
from eqt_cli.ensemble.seeds import Stream, generator
from eqt_cli.execution.batches import Batch, batches
from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.study import Study
from eqt_cli.results.result import CrossCheck

BOUND_PER_RTOL = 1000.0
"""Allowed difference per unit of `rtol`: what the trajectories themselves amplify (up to 70 times
in the paper's ensemble, near the unstable equilibria) with room to spare."""

MOST_SPANS = 200
"""From one known instant to the next, that an engine in Python redoes. Each takes it a step of its
own at least, some milliseconds: all of a motion through thousands of waypoints would take minutes,
and show no other fault than its beginning."""


@lru_cache(maxsize=8)
def chosen_entries(study: Study) -> Array:
    """Which runs of each controller are redone, counted over all points.

    A fixed function of the seed and of the number of runs.
    """
    entries, base = study.plan.entries, study.base
    count = min(base.solver.judgement.cross_check, entries)
    random = generator(base.config.ensemble.seed, Stream.CROSS_CHECK, entries)
    return np.sort(random.choice(entries, size=count, replace=False))


def cross_check(study: Study, found: Mapping[str, Sequence[Array]]) -> CrossCheck | None:
    """Solve the chosen runs again and compare; None where none are chosen.

    Parameters
    ----------
    found
        For each controller the states that were found for its chosen runs, some at a time.
    """
    chosen = chosen_entries(study)
    if not len(chosen):
        return None
    groups = _by_kind(study, chosen, found)
    _, method = _another_way(study.base)
    try:
        differences, until = _differences(groups, _another_way)
    except TraceError:  # the results do not depend on what another engine cannot compile
        _, method = _tighter(study.base)
        differences, until = _differences(groups, _tighter)
    if until < study.base.times[-1]:
        method = f"{method} over the first {until:.3g} s"
    largest = float(differences.max()) if len(differences) else float("nan")
    bound = BOUND_PER_RTOL * study.base.engine.rtol
    return CrossCheck(method, len(chosen), largest, bound)


def together(checks: Sequence[CrossCheck | None]) -> CrossCheck | None:
    """The checks of several pieces as one: all of their runs, and the worst of the differences."""
    done = [check for check in checks if check is not None]
    if not done:
        return None
    worst = max(done, key=lambda check: np.nan_to_num(check.difference / check.bound, nan=-1.0))
    return replace(worst, runs=sum(check.runs for check in done))


def _differences(
    groups: list[list[tuple[Batch, Array]]], way: Callable[[Experiment], tuple[Engine, str]]
) -> tuple[Array, float]:
    """How far another way comes from each of the runs that did not fail, and until when it goes."""
    found, until = [], np.inf
    for group in groups:
        engine, _ = way(group[0][0].experiment)
        problem = Problem.joined([batch.problem for batch, _ in group])
        if not engine.threads:
            problem = _beginning(problem)
        until = min(until, float(problem.times[-1]))
        states = np.concatenate([states for _, states in group])[:, : len(problem.times)]
        again = engine.solve(problem, lambda runs: None)
        loop = problem.batched_loop(extra_axes=1)
        with np.errstate(all="ignore"):  # runs that failed are NaN, or large
            distances = distance(loop, problem.times, states, again.states)
        good = np.isfinite(states).all(axis=(1, 2))
        found.append(np.nan_to_num(distances[good], nan=np.inf))
    return np.concatenate(found), until


def _beginning(problem: Problem) -> Problem:
    """As many of its samples as `MOST_SPANS` reach, and no fewer than two."""
    if len(problem.spans) <= MOST_SPANS:
        return problem
    reached = np.searchsorted(problem.times, problem.spans[MOST_SPANS].start, side="right")
    return replace(problem, times=problem.times[: max(int(reached), 2)])


def _by_kind(
    study: Study, chosen: Array, found: Mapping[str, Sequence[Array]]
) -> list[list[tuple[Batch, Array]]]:
    """What one vectorised solve can take together, of all controllers and points."""
    groups: dict[Hashable, list[tuple[Batch, Array]]] = {}
    for label in study.base.loops:
        states = np.concatenate(found[label])
        for batch in batches(study, label, chosen):
            groups.setdefault(batch.kind, []).append((batch, states[batch.rows]))
    return list(groups.values())


def distance(loop: ClosedLoop, times: Array, one: Array, other: Array) -> Array:
    """The difference of poses and velocities of states, ``(runs, samples, n) -> (runs,)``."""
    a, b = loop.tracking(times, one), loop.tracking(times, other)
    return difference(a.Q - b.Q, a.V - b.V)


def difference(pose: Array, velocity: Array) -> Array:
    """max over samples of max(‖ΔQ‖_F, ‖ΔV‖), ``(runs,)``."""
    return np.maximum(frobenius(pose), norm(velocity)).max(axis=-1)


def _another_way(experiment: Experiment) -> tuple[Engine, str]:
    other = experiment.solver.other
    if other is not None:
        return other.sized(1, 0), f"engine {other.name}"
    return _tighter(experiment)


def _tighter(experiment: Experiment) -> tuple[Engine, str]:
    engine = experiment.engine.tightened(0.01)
    return engine, f"engine {engine.name}, tolerances / 100"
