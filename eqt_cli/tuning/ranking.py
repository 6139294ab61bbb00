"""Ranks scored points: feasible points first, then by objectives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.results.result import Result, mean_over_runs


@dataclass(frozen=True)
class Scores:
    """The scores of several points.

    Attributes
    ----------
    objectives : (points, objectives)
        Lower is better; NaN where no run has a value.
    violation : (points,)
        Violations of the constraints as shares of their bounds, plus the share of failed runs; 0
        where the point is feasible.
    failed, unsettled : (points,)
        Numbers of runs at each point that failed, and that did not settle.
    """

    objectives: Array
    violation: Array
    failed: Array
    unsettled: Array

    def __len__(self) -> int:
        return len(self.violation)

    @property
    def feasible(self) -> Array:
        """Whether each point violates nothing."""
        return self.violation == 0

    def at(self, points: Array) -> Scores:
        """Return the scores of selected points."""
        return Scores(*(getattr(self, field.name)[points] for field in fields(self)))

    @classmethod
    def joined(cls, *several: Scores) -> Scores:
        """Concatenate scores."""
        names = (field.name for field in fields(cls))
        return cls(*(np.concatenate([getattr(one, name) for one in several]) for name in names))

    @classmethod
    def over_cases(cls, cases: Sequence[Scores], *, worst: bool) -> Scores:
        """Combine the scores of the same points in several cases: mean or worst objectives.

        Violations are averaged, so that a point is feasible only if it is feasible in every case.
        """
        objectives = np.stack([case.objectives for case in cases])
        return cls(
            objectives.max(axis=0) if worst else objectives.mean(axis=0),
            np.mean([case.violation for case in cases], axis=0),
            np.sum([case.failed for case in cases], axis=0),
            np.sum([case.unsettled for case in cases], axis=0),
        )


def best_of(scores: Scores) -> int:
    """Return the best point by the rules of Deb (2000).

    A feasible point is better than an infeasible one. Feasible points are ordered by their first
    objective, infeasible ones by their violation. Among equal points the first one wins.
    """
    least = np.where(scores.feasible, scores.objectives[:, 0], np.inf)
    return int(np.lexsort((least, scores.violation))[0])


def first_front(scores: Scores) -> Array:
    """Return the feasible non-dominated points, by the first objective; of equals the first."""
    feasible = np.flatnonzero(scores.feasible)
    objectives = scores.objectives[feasible]
    return feasible[front(objectives[:, 0], objectives[:, -1])]


def front(cost: Array, error: Array) -> Array:
    """Return the Pareto front by increasing cost; points with NaN are left out."""
    order = np.lexsort((error, cost))
    order = order[np.isfinite(cost[order]) & np.isfinite(error[order])]
    least = np.minimum.accumulate(error[order])
    strictly = np.ones(len(order), dtype=bool)
    strictly[1:] = least[1:] < least[:-1]
    return order[strictly]


def dominates(one: Scores, other: Scores) -> Array:
    """Whether the points of `one` dominate those of `other`, pairwise by broadcasting ``(…,)``.

    Constrained dominance after Deb (2000): a feasible point dominates an infeasible one, a smaller
    violation dominates a larger one, and among feasible points a point dominates another if it is
    no worse in every objective and better in at least one.
    """
    both = one.feasible & other.feasible
    less = np.all(one.objectives <= other.objectives, axis=-1) & np.any(
        one.objectives < other.objectives, axis=-1
    )
    return np.where(both, less, one.violation < other.violation)


def ranks(scores: Scores) -> Array:
    """Return the front of each point: 0 if non-dominated, 1 for the next front, and so on."""
    size = len(scores)
    rows, columns = np.divmod(np.arange(size * size), max(size, 1))
    beats = dominates(scores.at(rows), scores.at(columns)).reshape(size, size)
    assigned = np.full(size, -1)
    for rank in range(size):
        left = assigned < 0
        if not left.any():
            break
        assigned[left & ~(beats & left[:, None]).any(axis=0)] = rank
    return assigned


def crowding(objectives: Array) -> Array:
    """Return the crowding distance of each point (Deb et al. 2002)."""
    distances = np.zeros(len(objectives))
    for values in objectives.T:
        order = np.argsort(values, kind="stable")
        sorted_ = values[order]
        span = sorted_[-1] - sorted_[0]
        gaps = np.full(len(values), np.inf)
        if span > 0:
            gaps[1:-1] = (sorted_[2:] - sorted_[:-2]) / span
        distances[order] += gaps
    return distances


def survivors(points: Scores, tried: Scores) -> Array:
    """Return the indices of the survivors among the points followed by the trials.

    Trial k competes with point k, and the number of points stays the same. With one objective, the
    better survives, and the trial if they are equal. With several, both survive where neither
    dominates (GDE3, Kukkonen and Lampinen 2005), and the last front is then thinned where it is
    crowded.
    """
    size = len(points)
    lost = dominates(points, tried)
    if points.objectives.shape[1] == 1:
        return np.where(lost, np.arange(size), size + np.arange(size))
    won = dominates(tried, points)
    kept = np.concatenate([np.flatnonzero(~won), size + np.flatnonzero(~lost)])
    scores = Scores.joined(points, tried).at(kept)
    ranked = ranks(scores)
    chosen: list[int] = []
    for rank in range(int(ranked.max()) + 1):
        alike = np.flatnonzero(ranked == rank)
        while len(chosen) + len(alike) > size:
            alike = np.delete(alike, np.argmin(crowding(scores.objectives[alike])))
        chosen += alike.tolist()
    return kept[np.array(chosen)]


@dataclass(frozen=True)
class Constraint:
    """A bound on a metric.

    Attributes
    ----------
    metric, bound
        Name of the metric, and its bound.
    above
        Whether the bound is an upper bound; else it is a lower bound.
    every_run
        Whether the bound applies to every run; else to the mean.
    """

    metric: str
    bound: float
    above: bool
    every_run: bool

    def __str__(self) -> str:
        who = "in every run" if self.every_run else "in the mean"
        return f"{self.metric} {'≤' if self.above else '≥'} {self.bound:g} {who}"


def scores(result: Result, objectives: Sequence[str], constraints: Sequence[Constraint]) -> Scores:
    """Return the scores of all points of a sweep with one law.

    A run that failed or has no value is left out of the means, and the share of such runs is added
    to the violation. A run whose time is beyond the horizon counts with the horizon.
    """
    good = result.good[:, 0]
    values = {
        name: result.counted(name)[:, 0]
        for name in {*objectives, *(bound.metric for bound in constraints)}
    }
    missing = ~good
    for each in values.values():
        missing = missing | ~np.isfinite(each)
    violation = missing.mean(axis=1)
    for bound in constraints:
        violation = violation + excess(bound, values[bound.metric])
    means = [QUANTITIES[name].cost(mean_over_runs(values[name])) for name in objectives]
    costs = np.stack(means, axis=1)
    settling = result.metric("settling_time")[:, 0]
    return Scores(costs, violation, (~good).sum(axis=1), (good & np.isnan(settling)).sum(axis=1))


def excess(bound: Constraint, values: Array) -> Array:
    """Return the violation of a bound at each point as a share of the bound; 0 where it holds."""
    if bound.every_run:
        reduced = np.nanmax if bound.above else np.nanmin
        measured = np.array([reduced(row) if np.isfinite(row).any() else np.nan for row in values])
    else:
        measured = mean_over_runs(values)
    over = (measured - bound.bound) * (1 if bound.above else -1) / (abs(bound.bound) or 1.0)
    return np.where(np.isfinite(over), np.maximum(over, 0.0), 1.0)
