"""Which of two scored points is better, and which of many survive: feasibility first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from eqt_cli.core.arrays import Array


@dataclass(frozen=True)
class Scores:
    """What was found at some points.

    Attributes
    ----------
    objectives : (points, objectives)
        The less the better; NaN where no run has a value.
    violation : (points,)
        By how much constraints are violated, in shares of their bounds, plus the share of runs
        that failed; 0 where the point is feasible.
    failed, unsettled : (points,)
        How many runs of each point.
    """

    objectives: Array
    violation: Array
    failed: Array
    unsettled: Array

    def __len__(self) -> int:
        return len(self.violation)

    @property
    def feasible(self) -> Array:
        """Which points violate nothing."""
        return self.violation == 0

    def at(self, points: Array) -> Scores:
        """Those of some points."""
        return Scores(*(getattr(self, field.name)[points] for field in fields(self)))

    @classmethod
    def joined(cls, *several: Scores) -> Scores:
        """Those of all points, one after the other."""
        names = (field.name for field in fields(cls))
        return cls(*(np.concatenate([getattr(one, name) for one in several]) for name in names))

    @classmethod
    def over_cases(cls, cases: Sequence[Scores], *, worst: bool) -> Scores:
        """Those of the same points over several cases: the mean objective, or the worst of them.

        Violations are the mean of all cases, so that a feasible point is feasible in each.
        """
        objectives = np.stack([case.objectives for case in cases])
        return cls(
            objectives.max(axis=0) if worst else objectives.mean(axis=0),
            np.mean([case.violation for case in cases], axis=0),
            np.sum([case.failed for case in cases], axis=0),
            np.sum([case.unsettled for case in cases], axis=0),
        )


def best_of(scores: Scores) -> int:
    """The point that no other betters by the rules of Deb (2000).

    Of two feasible points the one with the lesser objective is better, a feasible one is better
    than one that is not, and of two that are not the one that violates less. Of equals the first.
    """
    least = np.where(scores.feasible, scores.objectives[:, 0], np.inf)
    return int(np.lexsort((least, scores.violation))[0])


def first_front(scores: Scores) -> Array:
    """The feasible points that no other dominates, by the first objective; of equals the first."""
    feasible = np.flatnonzero(scores.feasible)
    objectives = scores.objectives[feasible]
    return feasible[front(objectives[:, 0], objectives[:, -1])]


def front(cost: Array, error: Array) -> Array:
    """The points that no other betters in both, by rising cost; NaN is bettered by all."""
    order = np.lexsort((error, cost))
    order = order[np.isfinite(cost[order]) & np.isfinite(error[order])]
    least = np.minimum.accumulate(error[order])
    strictly = np.ones(len(order), dtype=bool)
    strictly[1:] = least[1:] < least[:-1]
    return order[strictly]


def dominates(one: Scores, other: Scores) -> Array:
    """Whether points of one dominate those of the other, pairwise by broadcasting ``(…,)``.

    With constraints, after Deb (2000): the feasible before the others, those by their violation,
    and among feasible points one that is no worse in any objective and better in one.
    """
    both = one.feasible & other.feasible
    less = np.all(one.objectives <= other.objectives, axis=-1) & np.any(
        one.objectives < other.objectives, axis=-1
    )
    return np.where(both, less, one.violation < other.violation)


def ranks(scores: Scores) -> Array:
    """0 for the points that none dominates, 1 for those that only these dominate, and so on."""
    size = len(scores)
    rows, columns = np.divmod(np.arange(size * size), max(size, 1))
    beats = dominates(scores.at(rows), scores.at(columns)).reshape(size, size)
    found = np.full(size, -1)
    for rank in range(size):
        left = found < 0
        if not left.any():
            break
        found[left & ~(beats & left[:, None]).any(axis=0)] = rank
    return found


def crowding(objectives: Array) -> Array:
    """How far apart the neighbours of each point are along the objectives (Deb et al. 2002)."""
    found = np.zeros(len(objectives))
    for values in objectives.T:
        order = np.argsort(values, kind="stable")
        sorted_ = values[order]
        span = sorted_[-1] - sorted_[0]
        gaps = np.full(len(values), np.inf)
        if span > 0:
            gaps[1:-1] = (sorted_[2:] - sorted_[:-2]) / span
        found[order] += gaps
    return found


def survivors(points: Scores, tried: Scores) -> Array:
    """Which of points and trials, numbered one after the other, survive; as many as there were.

    Trial k stands against point k. Of one objective, the better survives, and of equals the trial.
    Of several, both may stay where neither dominates (GDE3, Kukkonen and Lampinen 2005); then the
    last front is thinned where it is dense.
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
