"""Solves a few runs of each controller again by another engine, and compares."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop, OwnStarts
from eqt_cli.closed_loop.own_starts import STARTS
from eqt_cli.config.schema import Judgement
from eqt_cli.core.arrays import Array, maximum, sqrt, stack
from eqt_cli.core.errors import TraceError
from eqt_cli.core.over_time import OverTime, Samples
from eqt_cli.core.reporting import reporter
from eqt_cli.engines import Engine, Problem
from eqt_cli.engines.problem import Progress
from eqt_cli.ensemble.seeds import Stream, generator
from eqt_cli.execution.batches import Batch, batches
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.study import Study
from eqt_cli.results.origin import CrossCheck

Recomputation = Callable[[Experiment], tuple[Engine, str]]
"""The engine that redoes the runs of an experiment, and its name."""

BOUND_PER_RTOL = 1000.0
"""Allowed difference per unit of `rtol`: what the trajectories themselves amplify (190 times
for a run of nog in the paper's ensemble that is solved alone) with room to spare."""

MOST_SPANS = 200
"""From one known instant to the next, that an engine in Python redoes. Each takes it a step of its
own at least, some milliseconds: all of a motion through thousands of waypoints would take minutes,
and show no other fault than its beginning."""

SHARE = 0.1
"""Of the work of the runs: what the check may cost where as many runs are checked as by default."""

FREE = 15_000
"""Compiled steps of a run, a twentieth of a second, which the check may cost however short the runs
are: a tenth of what any experiment takes to begin."""

EVALUATION = 40
"""Compiled steps of a run that take as long as one evaluation of a vectorised law in Python: 125 µs
and, with all that is measured of a run, 3 µs were measured. The check is cut by counts, so that it
is the same on every machine."""

EVALUATIONS = 28
"""In Python, to come as far as one compiled step (2,820 and 100 in 20 s of the paper's runs)."""

TIGHTER = 2
"""Times as many evaluations at a hundredth of the tolerances, at an order of 8."""

BLOCK = 200
"""Runs that share the evaluations of an engine in Python."""

SAME = 1e-9
"""What rates of a piece may differ by, relative and in SI units, when others are beside it."""

MOST_PIECES = 16
"""Of the horizon, which such an engine redoes side by side, each from the state that was found
there: all of it is seen in as many evaluations as one piece takes."""


@lru_cache(maxsize=8)
def chosen_entries(study: Study) -> Array:
    """Which runs of each controller are redone, counted over all points.

    A fixed function of the seed and of the number of runs.
    """
    entries, base = study.plan.entries, study.base
    count = min(base.solver.judgement.cross_check, entries)
    random = generator(base.config.ensemble.seed, Stream.CROSS_CHECK, entries)
    return np.sort(random.choice(entries, size=count, replace=False))


def cross_check(
    study: Study,
    found: Mapping[str, Sequence[Array]],
    work: Mapping[str, Sequence[Array]],
) -> CrossCheck | None:
    """Solve the chosen runs again and compare; None where none are chosen.

    Parameters
    ----------
    found
        For each controller the states that were found for its chosen runs, some at a time.
    work
        For each controller the work of all of its runs, as the engine counts it, some at a time.
    """
    chosen = chosen_entries(study)
    if not len(chosen):
        return None
    groups = _by_kind(study, chosen, found)
    steps = {label: np.concatenate(own) for label, own in work.items()}
    way = _another_way
    try:
        differences, redone = _differences(study, groups, way, steps)
    except TraceError:  # the results do not depend on what another engine cannot compile
        way = _tighter
        differences, redone = _differences(study, groups, way, steps)
    _, method = way(study.base)
    method = " ".join(filter(None, (method, redone.words(study.base.times))))
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


def _affordable(study: Study, way: Recomputation, groups: int, steps: Mapping[str, Array]) -> float:
    """How much of the horizon the check can redo for `SHARE` of the work of the runs, or `FREE`.

    All of it by a compiled engine, whose time is that of compiling; and where a number of runs is
    asked for that is not the default.
    """
    base = study.base
    engine, _ = way(base)
    if engine.threads or base.solver.judgement.cross_check != Judgement.cross_check:
        return 1.0
    counted = [np.nan_to_num(own) for own in steps.values()]
    longest = max((float(own.max(initial=0.0)) for own in counted), default=0.0)
    if base.engine.threads:
        solves = 2 if base.solver.estimates_errors else 1
        work = solves * sum(float(own.sum()) for own in counted)
        cost = groups * longest * EVALUATIONS * EVALUATION
    else:
        blocks = [own.mean() * -(-own.size // BLOCK) for own in counted if own.size]
        work = EVALUATION * float(sum(blocks))
        cost = groups * longest * TIGHTER * EVALUATION
    budget = max(SHARE * work, FREE / len(study.shapes))
    return min(1.0, budget / cost) if cost else 1.0


@dataclass(frozen=True)
class _Pieces:
    """The pieces of the horizon that are redone, each from the state that was found at its start.

    Attributes
    ----------
    starts
        The samples at which they begin.
    length
        How many samples each has, with its first.
    """

    starts: tuple[int, ...]
    length: int

    @staticmethod
    def of(problem: Problem, engine: Engine, part: float) -> _Pieces:
        """As many pieces as make the whole horizon affordable, or less of it where they do not.

        They share the evaluations of one block of the engine. Where it solves runs one by one, or
        the vector field changes at known instants, there is one piece, as far as `MOST_SPANS` go.
        """
        steps, side_by_side = len(problem.times) - 1, engine.runs_at_once(1) // problem.runs
        number = min(steps, MOST_PIECES, int(np.ceil(1 / part)), max(1, side_by_side))
        if len(problem.spans) > 1 or number == 1:
            return _Pieces.beginning(problem, part)
        length = min(-(-steps // number), int(np.ceil(part * steps)))
        starts = np.linspace(0, steps - length, number).round().astype(int)
        return _Pieces(tuple(starts.tolist()), length + 1)

    @staticmethod
    def beginning(problem: Problem, part: float) -> _Pieces:
        """The beginning of the horizon, as far as `MOST_SPANS` reach; two samples at least."""
        times = problem.times
        end = times[0] + part * (times[-1] - times[0])
        if len(problem.spans) > MOST_SPANS:
            end = min(end, problem.spans[MOST_SPANS].start)
        reached = int(np.searchsorted(times, end, side="right"))
        return _Pieces((0,), len(times) if end >= times[-1] else max(reached, 2))

    def can_share_evaluations(self, whole: Problem, states: Array) -> bool:
        """Whether the field gives each piece its own time: a user's part may take one time only."""
        if len(self.starts) == 1:
            return True
        t, together = float(whole.times[0]), self.problem(whole, states)
        loop, alone = whole.batched_loop(), []
        with np.errstate(all="ignore"):
            try:
                rates = together.batched_loop().vector_field(t, together.states)
            except Exception:
                return False
            for start in self.starts:
                t = float(whole.times[start])
                alone.append(loop.holding(t).vector_field(t, states[:, start]))
        expected = np.concatenate(alone)
        return rates.shape == expected.shape and np.allclose(rates, expected, SAME, SAME)

    def problem(self, whole: Problem, states: Array) -> Problem:
        """All pieces of all runs as one problem; `states` are those that were found."""
        times = whole.times[: self.length]
        if len(self.starts) == 1:
            return replace(whole, times=times)
        number = len(self.starts)
        varying = {name: np.concatenate([own] * number) for name, own in whole.varying.items()}
        later = whole.times[list(self.starts)] - whole.times[0]
        return Problem(
            OwnStarts.of(whole.loop),
            np.concatenate([states[:, start] for start in self.starts]),
            times,
            varying | {STARTS: np.repeat(later, whole.runs)[:, None]},
        )

    def differences(self, whole: Problem, states: Array, again: Array) -> Array:
        """For each run the sum of the differences of its pieces."""
        loop, total = whole.batched_loop(extra_axes=1), np.zeros(whole.runs)
        for start, redone in zip(self.starts, np.split(again, len(self.starts)), strict=True):
            samples = slice(start, start + self.length)
            total += distance(loop, whole.times[samples], states[:, samples], redone)
        return total

    def reach(self) -> int:
        """From how many samples to the next it is redone."""
        return len(self.starts) * (self.length - 1)

    def words(self, times: Array) -> str:
        """What is redone of the horizon; empty where it is all, at once."""
        seconds = f"{times[self.length - 1] - times[0]:.3g} s"
        if len(self.starts) > 1:
            return f"in {len(self.starts)} pieces of {seconds}"
        return f"over the first {seconds}" if self.length < len(times) else ""


def _differences(
    study: Study,
    groups: list[list[tuple[Batch, Array]]],
    way: Recomputation,
    steps: Mapping[str, Array],
) -> tuple[Array, _Pieces]:
    """How far another way comes from each of the runs that did not fail, and what it redoes."""
    part, found, redone = _affordable(study, way, len(groups), steps), [np.empty(0)], []
    everything = _Pieces((0,), len(study.base.times))
    for group in groups:
        engine, _ = way(group[0][0].experiment)
        problem = Problem.joined([batch.problem for batch, _ in group])
        pieces = everything if engine.threads else _Pieces.of(problem, engine, part)
        states = np.concatenate([states for _, states in group])
        good = np.flatnonzero(np.isfinite(states).all(axis=(1, 2)))
        reporter().advance(problem.runs - len(good))
        if not len(good):
            continue
        whole, states = problem.select(good), states[good]
        if not pieces.can_share_evaluations(whole, states):
            pieces = _Pieces.beginning(problem, part)
        redone.append(pieces)
        counted = _counted(1 / len(pieces.starts))
        again = engine.solve(pieces.problem(whole, states), progress=counted)
        with np.errstate(all="ignore"):  # where the other engine failed, or came far
            distances = pieces.differences(whole, states, again.states)
        found.append(np.nan_to_num(distances, nan=np.inf))
    return np.concatenate(found), min(redone, key=_Pieces.reach, default=everything)


def _counted(share: float) -> Progress:
    """Counts a piece of a run as this share of it."""
    told = reporter()
    return lambda pieces: told.advance(share * pieces)


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
    """max over samples of max(‖ΔQ‖_F, ‖ΔV‖) between states, ``(runs, samples, n) -> (runs,)``."""
    a, b = loop.tracking(times, one), loop.tracking(times, other)
    found: Array = largest(Samples(times), squares(a.Q - b.Q, a.V - b.V))
    return found


def squares(pose: Array, velocity: Array) -> Array:
    """‖ΔQ‖_F² and ‖ΔV‖² at every sample, ``(..., 2)``, of floats or symbols."""
    return stack([(pose * pose).sum(axis=(-2, -1)), (velocity * velocity).sum(axis=-1)])


def largest(over: OverTime, squares: Array) -> Any:
    """The root of the largest over all samples."""
    return sqrt(over.largest(maximum(squares[..., 0], squares[..., 1])))


def _another_way(experiment: Experiment) -> tuple[Engine, str]:
    other = experiment.solver.other
    if other is not None:
        return other.sized(1, 0), f"engine {other.name}"
    return _tighter(experiment)


def _tighter(experiment: Experiment) -> tuple[Engine, str]:
    engine = experiment.engine.tightened(0.01)
    return engine, f"engine {engine.name}, tolerances / 100"
