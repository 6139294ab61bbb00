"""Fronts on held-out runs, and what laws differ by where they cost the same."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from eqt_cli.analysis.comparison.bootstrap import Resampling
from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.comparison.ratios import relative_difference
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.core.arrays import Array
from eqt_cli.results.origin import law_title
from eqt_cli.results.result import Result
from eqt_cli.tuning.ranking import front

Record = Mapping[str, Any]

SHARES = (0.25, 0.5, 0.75)
"""Where along the range that two fronts share, on a logarithmic scale, they are compared."""


@dataclass(frozen=True)
class Front:
    """The winners of a law on held-out runs.

    Attributes
    ----------
    law
        Its label in the search.
    labels
        Of the winners, in the order of the search.
    cost, error : (winners, runs)
        Both objectives; NaN where a run failed.
    searches : list of (winners, 2)
        The means of both on the runs of the search, of the front of each search by itself.
    """

    law: str
    labels: list[str]
    cost: Array
    error: Array
    searches: Sequence[Array] = ()

    @property
    def means(self) -> Array:
        """``(winners, 2)``; NaN where a run failed."""
        return np.stack([self.cost.mean(axis=-1), self.error.mean(axis=-1)], axis=-1)

    @property
    def best(self) -> Array:
        """The winners that are on the Pareto front of the held-out runs, too, by rising cost."""
        return front(*self.means.T)

    def at(self, cost: float) -> Array:
        """The error of every run where the mean cost is this, ``(runs,)``.

        Between two neighbours on the front, each has its share w of the runs, so that costs are
        `cost` in the mean: e = w e₁ + (1 − w) e₂. Of each run the slope of the front times what its
        cost lies beside `cost` is taken off, which is 0 in the mean, and carries to the spread what
        is not known of w (delta method).
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
        """The mean error at this cost on the front of each search that reaches it."""
        reach = [found.T for found in self.searches if len(found) > 1]
        return np.array([np.interp(cost, *two) for two in reach if two[0, 0] <= cost <= two[0, -1]])

    @property
    def span(self) -> tuple[float, float]:
        """The least and the largest mean cost."""
        costs = self.means[self.best, 0]
        return float(costs[0]), float(costs[-1])


@dataclass(frozen=True)
class AtEqualCost:
    """Two laws where both cost the same in the mean.

    Attributes
    ----------
    better, worse
        Their labels.
    cost
        The mean cost of both.
    error, other_error
        The mean errors of both.
    relative, low, high
        How much less the error of the better is, as a share of the other's, with an interval.
    least, most
        The same between the fronts of single searches on the runs of the search, any search of one
        law with any of the other; NaN where none reaches this cost.
    """

    better: str
    worse: str
    cost: float
    error: float
    other_error: float
    relative: float
    low: float
    high: float
    least: float
    most: float

    @property
    def over_searches(self) -> str:
        """By how much, from the least to the most of all pairs of searches."""
        if math.isnan(self.least):
            return "-"
        ends = dict.fromkeys(f"{100 * end:.1f}" for end in (self.least, self.most))
        return f"{' to '.join(ends)} %"

    @property
    def decided(self) -> bool:
        """Whether the interval leaves out 0."""
        return self.low > 0

    @property
    def lead(self) -> str:
        """By how much the one is better, with the interval: ``3.1 % [1.0, 5.2]``."""
        return f"{100 * self.relative:.1f} % [{100 * self.low:.1f}, {100 * self.high:.1f}]"


def fronts(result: Result, record: Record) -> list[Front]:
    """The fronts of a search on its held-out runs, of laws with two winners or more."""
    cost, error = (result.quantity(m).cost(result.counted(m)) for m in record["objectives"])
    found = []
    for law in record["laws"]:
        labels = [winner["label"] for winner in law["winners"]]
        rows = [result.labels.index(label) for label in labels]
        searches = [np.reshape(search["objectives"], (-1, 2)) for search in law["searches"]]
        front = Front(law["label"], labels, cost[rows], error[rows], searches)
        if len(front.best) > 1:
            found.append(front)
    return found


def at_equal_cost(
    found: Sequence[Front], how: Resampling, shares: Sequence[float] = SHARES
) -> list[AtEqualCost]:
    """Every two laws at some costs that both their fronts reach."""
    places = []
    for one, other in combinations(found, 2):
        low = max(one.span[0], other.span[0])
        high = min(one.span[1], other.span[1])
        if low < high:
            log = low > 0
            costs = [low * (high / low) ** x if log else low + x * (high - low) for x in shares]
            places += [(one, other, cost) for cost in costs]
    if not places:
        return []
    return [_compared(one, other, cost, how.confidence) for one, other, cost in places]


def _compared(one: Front, other: Front, cost: float, confidence: float) -> AtEqualCost:
    better, worse = sorted((one, other), key=lambda law: float(law.at(cost).mean()))
    less, more = better.at(cost), worse.at(cost)
    saved = relative_difference(more - less, more, confidence)
    means = float(less.mean()), float(more.mean())
    own, others = better.of_searches(cost), worse.of_searches(cost)
    shares = [1 - one / other for one in own for other in others] or [math.nan]
    return AtEqualCost(better.law, worse.law, cost, *means, *saved, min(shares), max(shares))


def sentences(result: Result, record: Record, how: Resampling) -> list[str]:
    """Every two laws in the middle of the range that both fronts reach, in words."""
    cost, error = map(result.quantity, record["objectives"])
    write = Plain()
    unit = write.unit(result.units(cost.name))
    more = "more" if error.better == "higher" else "less"
    told = []
    for pair in at_equal_cost(fronts(result, record), how, (0.5,)):
        better, worse = law_title(pair.better), law_title(pair.worse)
        at = f"At equal {write.name(cost)} of {abs(pair.cost):.3g}{f' {unit}' if unit else ''}"
        what = f"has {pair.lead} {more} {write.name(error)} than {worse}."
        if not pair.decided:
            what = (
                f"and {worse} do not differ in {write.name(error)} as far as these runs tell "
                f"({pair.lead})."
            )
        told.append(f"{at}, {better} {what}")
    return told


def equal_cost_table(result: Result, record: Record, write: Plain, how: Resampling) -> TextTable:
    """Every two laws at some costs that both fronts reach."""
    cost, error = record["objectives"]
    rows = [
        [
            write.text(f"{law_title(pair.better)}, {law_title(pair.worse)}"),
            f"{abs(pair.cost):.4g}",
            *(f"{abs(x):.4g}" for x in (pair.error, pair.other_error)),
            write.text(pair.lead),
            write.text(pair.over_searches),
        ]
        for pair in at_equal_cost(fronts(result, record), how)
    ]
    unit = write.unit(result.units(cost))
    caption = (
        f"{write.name(result.quantity(error))} of two laws where both have the same "
        f"{write.name(result.quantity(cost))}{f', {unit}' if unit else ''}"
    )
    note = (
        "Between two neighbours on a front, costs and errors are mixed. Intervals are of paired "
        "differences and hold one by one; how near the search came to a front is not in them. Over "
        "searches: the same between the fronts of single searches, on the runs of the search."
    )
    header = [
        *("laws, the better first", "cost", "error", "error of the other"),
        *("less by", "over searches"),
    ]
    notes = [write.text(text) for text in (*sentences(result, record, how), note)]
    return TextTable("fronts", caption, header, [Block("", rows)] if rows else [], notes)
