"""Which candidates are better: ranking, evolution, fronts, and runs that no search saw."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import Resampling, relative_difference
from eqt_cli.analysis.maps import NOBODY, RULE, decide, front
from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import Block, TextTable, fixed, significant
from eqt_cli.extensions.search.run_numbers import Numbers
from eqt_cli.results.metrics import quantity_of
from eqt_cli.results.origin import law_title
from eqt_cli.results.quantity import Measure, Plain, Window
from eqt_cli.results.result import PerRun, Result, mean_over_runs

# Ranks scored points: feasible points first, then by objectives -----------------------------------


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
    undominated = np.concatenate([np.flatnonzero(~won), size + np.flatnonzero(~lost)])
    scores = Scores.joined(points, tried).at(undominated)
    ranked = ranks(scores)
    chosen: list[int] = []
    for rank in range(int(ranked.max()) + 1):
        alike = np.flatnonzero(ranked == rank)
        while len(chosen) + len(alike) > size:
            alike = np.delete(alike, np.argmin(crowding(scores.objectives[alike])))
        chosen += alike.tolist()
    return undominated[np.array(chosen)]


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
    equal
        Whether it has to be met, as far as a law can.
    """

    metric: str
    bound: float
    above: bool
    every_run: bool
    equal: bool = False

    def __str__(self) -> str:
        who = "in every run" if self.every_run else "in the mean"
        sign = "=" if self.equal else "≤" if self.above else "≥"
        return f"{self.metric} {sign} {self.bound:g} {who}"


def scores(
    result: Result | Numbers,
    objectives: Sequence[str],
    constraints: Sequence[Constraint],
    allowed: float = 0.0,
) -> Scores:
    """Return the scores of all points of a sweep with one law.

    A run that failed or has no value is left out of the means, and the share of such runs beyond
    the allowed one is added to the violation. A run whose time is beyond the horizon counts with
    the horizon.
    """
    good = result.good[:, 0]
    values = {
        name: result.counted(name)[:, 0]
        for name in {*objectives, *(bound.metric for bound in constraints)}
    }
    complete = good & np.isfinite([*values.values()]).all(axis=0)
    violation = np.maximum((~complete).mean(axis=1) - allowed, 0.0)
    for bound in constraints:
        violation = violation + excess(bound, values[bound.metric])
    means = [quantity_of(name).cost(mean_over_runs(values[name])) for name in objectives]
    costs = np.stack(means, axis=1)
    settling = result.metric("settling_time")[:, 0]
    return Scores(costs, violation, (~good).sum(axis=1), (good & np.isnan(settling)).sum(axis=1))


def excess(bound: Constraint, values: Array) -> Array:
    """Return the violation of a bound at each point as a share of the bound; 0 where it holds.

    It is 1 where a run that counts has no value.
    """
    if bound.every_run:
        measured = (np.max if bound.above else np.min)(values, axis=-1)
    else:
        measured = mean_over_runs(values)
    over = (measured - bound.bound) * (1 if bound.above else -1) / (abs(bound.bound) or 1.0)
    return np.where(np.isfinite(over), np.maximum(over, 0.0), 1.0)


# Differential evolution in the unit cube. It proposes points; the caller scores them --------------
#
# The steps are those of `scipy.optimize.differential_evolution` (strategy best1bin with dither).
# They are written here for two reasons: the same loop serves one objective and Pareto fronts, and a
# generation depends only on a seed and on the scores of the generations before it, so that a search
# continues from stored generations bit for bit.


MUTATION = (0.5, 1.0)
"""Range from which each generation draws the weight of the differences."""

CROSSOVER = 0.7
"""Probability that a trial takes a coordinate from the mutant."""


@dataclass(frozen=True)
class Population:
    """The points that survive a generation.

    Attributes
    ----------
    shares : (points, dimensions)
        Coordinates in the unit cube.
    scores
        Scores of the points.
    """

    shares: Array
    scores: Scores

    @property
    def best(self) -> int:
        """Index of the best point by the rules of Deb (2000).

        A feasible point is better than an infeasible one. Feasible points are ordered by their
        first objective, infeasible ones by their violation. Among equal points the first one wins.
        """
        least = np.where(self.scores.feasible, self.scores.objectives[:, 0], np.inf)
        return int(np.lexsort((least, self.scores.violation))[0])

    @property
    def front(self) -> Array:
        """Indices of the feasible non-dominated points, by the first objective; of equals one."""
        feasible = np.flatnonzero(self.scores.feasible)
        objectives = self.scores.objectives[feasible]
        return feasible[front(objectives[:, 0], objectives[:, -1])]


def generator(seed: int, generation: int, axis: int = 0) -> np.random.Generator:
    """Return the random stream of a generation, of the first one for an axis.

    It is the same for all laws, whatever they and their keys are called.
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(generation, axis))
    return np.random.Generator(np.random.PCG64DXSM(sequence))


def first_points(count: int, axes: int, start: Sequence[float] | None, seed: int) -> Array:
    """Return a Latin hypercube whose first point is replaced by `start`, if there is one.

    Each axis has its own random stream, so that laws start from the same values of the keys that
    they share.

    Returns
    -------
    (count, axes)
    """
    from scipy.stats import qmc

    randoms = [generator(seed, 0, axis) for axis in range(axes)]
    strata = [qmc.LatinHypercube(1, rng=random).random(count) for random in randoms]
    points: Array = np.concatenate(strata, axis=1)
    if start is not None:
        points[0] = start
    return points


def trials(population: Population, random: np.random.Generator, keeps_ends: bool = False) -> Array:
    """Return one trial for each point: the mutant best + F (a − b), crossed with the point.

    Coordinates outside the cube are clipped to it if `keeps_ends`, else drawn again uniformly. With
    several objectives, `best` is a random point of the front for each trial.
    """
    shares = population.shares
    count, dimensions = shares.shape
    weight = random.uniform(*MUTATION)
    front = population.front
    leading = random.integers(len(front), size=count) if len(front) else np.zeros(count, dtype=int)
    several = population.scores.objectives.shape[1] > 1 and len(front) > 0
    best = shares[front[leading]] if several else shares[population.best]
    drawn = [random.permutation(count)[:3] for _ in range(count)]
    others = np.array([points[points != k][:2] for k, points in enumerate(drawn)])
    mutants = best + weight * (shares[others[:, 0]] - shares[others[:, 1]])
    crossed = random.random((count, dimensions)) < CROSSOVER
    crossed[np.arange(count), random.integers(dimensions, size=count)] = True
    outside = (mutants < 0) | (mutants > 1)
    anywhere = random.random((count, dimensions))
    mutants = np.where(outside, np.clip(mutants, 0, 1) if keeps_ends else anywhere, mutants)
    return np.where(crossed, mutants, shares)


def selected(population: Population, tried: Population) -> Population:
    """Return the survivors of a population and its trials; trial k competes with point k."""
    chosen = survivors(population.scores, tried.scores)
    shares = np.concatenate([population.shares, tried.shares])[chosen]
    return Population(shares, Scores.joined(population.scores, tried.scores).at(chosen))


# Combines the held-out runs of a tuning over cases into those of one experiment -------------------


Record = Mapping[str, Any]


def cases_of(result: Result, record: Record) -> dict[str, Result]:
    """Return the held-out runs in each case by name; without cases, the result itself."""
    return {name: result.point(k) for k, name in enumerate(record["cases"])} or {"": result}


def held_out(result: Result, record: Record) -> Result:
    """Return the held-out runs of a tuning as those of one experiment."""
    if not record["cases"]:
        return result
    return OverCases(cases_of(result, record), worst=record["over_cases"] == "worst")


class OverCases(Result):
    """A result whose run k combines run k of all cases, by the mean of its numbers.

    If the worst case counts, the numbers are those of the case with the worst mean over all runs,
    for each law and each number separately.
    """

    def __init__(self, cases: Mapping[str, Result], *, worst: bool) -> None:
        self._cases, self._worst = list(cases.values()), worst
        self.__dict__.update(vars(self._cases[0]))  # an open result with all other data

    @cached_property
    def status(self) -> Array:
        """Status as in `Result`; a run that fails in any case has failed."""
        return np.max([case.status for case in self._cases], axis=0)

    def metric(self, name: str, controller: int | None = None) -> Array:
        """Return the same as in `Result`, combined over the cases."""
        values = self._over(self.quantity(name), [case.metric(name) for case in self._cases])
        return values if controller is None else values[controller]

    def counted(self, name: str) -> Array:
        """Return the same as in `Result`, combined over the cases."""
        return self._over(self.quantity(name), [case.counted(name) for case in self._cases])

    def censored(self, name: str, controller: int | None = None) -> Array:
        """Return the same as in `Result`: censored in any case."""
        late: Array = np.any([case.censored(name) for case in self._cases], axis=0)
        return late if controller is None else late[controller]

    def per_run(self, quantity: Measure, window: Window | None = None) -> PerRun:
        """Return the same as in `Result`, combined over the cases."""
        per_case = [case.per_run(quantity, window) for case in self._cases]
        values = self._over(quantity, [one.values for one in per_case])
        censored = np.any([one.censored for one in per_case], axis=0)
        return replace(per_case[0], values=values, censored=censored)

    def _over(self, quantity: Measure, values: Sequence[Array]) -> Array:
        """Combine the numbers ``(controllers, runs)`` of all cases."""
        cases = np.stack(values)
        if not self._worst:
            return cases.mean(axis=0)
        costs = quantity.cost(mean_over_runs(cases))
        worst = np.where(np.isnan(costs), -np.inf, costs).argmax(axis=0)
        return cases[worst, np.arange(len(worst))]


# Pareto fronts on held-out runs, and the differences between laws at equal cost -------------------


SHARES = (0.25, 0.5, 0.75)
"""Positions within the common range of two fronts (logarithmic if costs are positive)."""


@dataclass(frozen=True)
class Front:
    """The winners of a law on held-out runs.

    Attributes
    ----------
    law
        Label of the law in the search.
    labels
        Labels of the winners, in the order of the search.
    cost, error : (winners, runs)
        The two objectives; NaN where a run failed.
    searches : list of (winners, 2)
        For each search, the mean objectives of its own front, on the runs of the search.
    """

    law: str
    labels: list[str]
    cost: Array
    error: Array
    searches: Sequence[Array] = ()

    @property
    def means(self) -> Array:
        """Mean cost and error, ``(winners, 2)``; NaN where a run failed."""
        return np.stack([self.cost.mean(axis=-1), self.error.mean(axis=-1)], axis=-1)

    @property
    def best(self) -> Array:
        """Winners that are also on the Pareto front of the held-out runs, by increasing cost."""
        return front(*self.means.T)

    def at(self, cost: float) -> Array:
        """Return the error of every run at a given mean cost, ``(runs,)``.

        Two neighbours on the front are mixed with the weight w that makes the mean cost `cost`:
        e = w e₁ + (1 − w) e₂. The slope of the front times the deviation of a run's cost from
        `cost` is subtracted. This term is 0 in the mean; it adds the uncertainty of w to the
        spread (delta method).
        """
        best = self.best
        costs, errors = self.means[best].T
        upper = int(np.clip(np.searchsorted(costs, cost), 1, len(best) - 1))
        one, other = best[upper - 1], best[upper]
        weight = (costs[upper] - cost) / (costs[upper] - costs[upper - 1])
        slope = (errors[upper] - errors[upper - 1]) / (costs[upper] - costs[upper - 1])
        mixed = [weight * x[one] + (1 - weight) * x[other] for x in (self.cost, self.error)]
        return mixed[1] - slope * (mixed[0] - cost)

    def of_searches(self, cost: float) -> Array:
        """Return the mean error at this cost on the front of each search that reaches it."""
        curves = [means.T for means in self.searches if len(means) > 1]
        return np.array([np.interp(cost, x, y) for x, y in curves if x[0] <= cost <= x[-1]])

    @property
    def span(self) -> tuple[float, float]:
        """Smallest and largest mean cost."""
        costs = self.means[self.best, 0]
        return float(costs[0]), float(costs[-1])


@dataclass(frozen=True)
class AtEqualCost:
    """Two laws at equal mean cost.

    Attributes
    ----------
    better, worse
        Labels of the laws, the smaller mean error first.
    cost
        Mean cost of both.
    error, other_error
        Mean errors of the better and the worse law.
    relative, low, high
        Reduction of the error as a share of the worse law's error, with its interval.
    smallest, largest
        Smallest and largest reduction between the front of any search for one law and that of any
        search for the other, on the runs of the search; NaN where no search reaches this cost.
    winner
        Label of the better law where it wins, as in a map; else what such points are called.
    p_value
        P-value of the sign test, adjusted for all compared costs; NaN if the runs are too few.
    """

    better: str
    worse: str
    cost: float
    error: float
    other_error: float
    relative: float
    low: float
    high: float
    smallest: float
    largest: float
    winner: str
    p_value: float

    @property
    def wins(self) -> bool:
        """Whether the better law wins."""
        return self.winner == self.better

    @property
    def over_searches(self) -> str:
        """The range of the reduction over all pairs of searches, in percent."""
        if math.isnan(self.smallest):
            return "-"
        ends = dict.fromkeys(fixed(100 * end, 1) for end in (self.smallest, self.largest))
        return f"{' to '.join(ends)} %"

    @property
    def lead(self) -> str:
        """The reduction with its interval: ``3.1 % [1.0, 5.2]``."""
        lead, *ends = (fixed(100 * x, 1) for x in (self.relative, self.low, self.high))
        return f"{lead} % [{', '.join(ends)}]"


def fronts(result: Result, record: Record) -> list[Front]:
    """Return the fronts on held-out runs of all laws with at least two points on the front."""
    cost, error = (result.quantity(m).cost(result.counted(m)) for m in record["objectives"])
    of_laws = []
    for law in record["laws"]:
        labels = [winner["label"] for winner in law["winners"]]
        rows = [result.labels.index(label) for label in labels]
        searches = [np.reshape(search["objectives"], (-1, 2)) for search in law["searches"]]
        front = Front(law["label"], labels, cost[rows], error[rows], searches)
        if len(front.best) > 1:
            of_laws.append(front)
    return of_laws


def at_equal_cost(
    fronts: Sequence[Front], how: Resampling, shares: Sequence[float] = SHARES
) -> list[AtEqualCost]:
    """Compare all pairs of laws at several costs that both fronts reach, each as in a map."""
    places: list[tuple[Front, Front, float]] = []
    for one, other in combinations(fronts, 2):
        low = max(one.span[0], other.span[0])
        high = min(one.span[1], other.span[1])
        if low < high:
            for share in shares:
                cost = low * (high / low) ** share if low > 0 else low + share * (high - low)
                better, worse = sorted((one, other), key=lambda law: float(law.at(cost).mean()))
                places.append((better, worse, cost))
    if not places:
        return []
    errors = np.array([[better.at(cost), worse.at(cost)] for better, worse, cost in places])
    decisions, pairs = decide(errors, np.zeros(errors.shape[:2]), how.confidence), []
    for k, (better, worse, cost) in enumerate(places):
        less, more = errors[k]
        saved = relative_difference(more - less, more, how.confidence)
        searched = product(better.of_searches(cost), worse.of_searches(cost))
        reductions = [1 - smaller / larger for smaller, larger in searched] or [math.nan]
        laws, means = (better.law, worse.law), (float(less.mean()), float(more.mean()))
        ends, p_value = (min(reductions), max(reductions)), float(decisions.p_values[k])
        winner = better.law if decisions.winner[k] != NOBODY else decisions.without_winner
        pairs.append(AtEqualCost(*laws, cost, *means, *saved, *ends, winner, p_value))
    return pairs


def sentences(result: Result, record: Record, pairs: Sequence[AtEqualCost]) -> list[str]:
    """Compare pairs of laws at equal cost, in words."""
    cost, error = map(result.quantity, record["objectives"])
    write = Plain()
    unit = write.unit(result.units(cost.name))
    more = "more" if error.better == "higher" else "less"
    lines = []
    for pair in pairs:
        better, worse = law_title(pair.better), law_title(pair.worse)
        at = f"At equal {write.name(cost)} of {abs(pair.cost):.3g}{f' {unit}' if unit else ''}"
        what = f"has {pair.lead} {more} {write.name(error)} than {worse}."
        if not pair.wins:
            what = f"and {worse}: {pair.winner} in {write.name(error)} ({pair.lead} {more})."
        lines.append(f"{at}, {better} {what}")
    return lines


def equal_cost_table(result: Result, record: Record, write: Plain, how: Resampling) -> TextTable:
    """Return the table of all pairs of laws at several costs that both fronts reach."""
    cost, error = record["objectives"]
    pairs = at_equal_cost(fronts(result, record), how)
    rows = [
        [
            write.text(f"{law_title(pair.better)}, {law_title(pair.worse)}"),
            significant(abs(pair.cost)),
            *(significant(abs(x)) for x in (pair.error, pair.other_error)),
            write.text(pair.lead),
            write.text(law_title(pair.better) if pair.wins else pair.winner),
            write.text(pair.over_searches),
        ]
        for pair in pairs
    ]
    unit = write.unit(result.units(cost))
    caption = (
        f"{write.name(result.quantity(error))} of two laws where both have the same "
        f"{write.name(result.quantity(cost))}{f', {unit}' if unit else ''}"
    )
    note = (
        f"A law is better where it is {RULE}, with p times the number of rows. Between two "
        "neighbours on a front, costs and errors are interpolated. Each interval is "
        "for a paired difference; it does not include how close the search came to the true "
        "front. Over searches: the same between the fronts of single searches, on the runs of the "
        "search."
    )
    header = [
        *("laws, the smaller mean first", "cost", "error", "error of the other"),
        *("less by", "better", "over searches"),
    ]
    middle = pairs[len(SHARES) // 2 :: len(SHARES)]
    notes = [write.text(text) for text in (*sentences(result, record, middle), note)]
    return TextTable("fronts", caption, header, [Block("", rows)] if rows else [], notes)
