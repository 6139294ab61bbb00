"""Pareto fronts on held-out runs, and the differences between laws at equal cost."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from eqt_cli.analysis.comparison.intervals import Resampling, relative_difference
from eqt_cli.analysis.comparison.notation import Plain, significant
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.core.arrays import Array
from eqt_cli.results.origin import law_title
from eqt_cli.results.result import Result
from eqt_cli.tuning.ranking import front

Record = Mapping[str, Any]

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
        Labels of the laws.
    cost
        Mean cost of both.
    error, other_error
        Mean errors of the better and the worse law.
    relative, low, high
        Reduction of the error as a share of the worse law's error, with its interval.
    smallest, largest
        Smallest and largest reduction between the front of any search for one law and that of any
        search for the other, on the runs of the search; NaN where no search reaches this cost.
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

    @property
    def over_searches(self) -> str:
        """The range of the reduction over all pairs of searches, in percent."""
        if math.isnan(self.smallest):
            return "-"
        ends = dict.fromkeys(f"{100 * end:.1f}" for end in (self.smallest, self.largest))
        return f"{' to '.join(ends)} %"

    @property
    def lead(self) -> str:
        """The reduction with its interval: ``3.1 % [1.0, 5.2]``."""
        return f"{100 * self.relative:.1f} % [{100 * self.low:.1f}, {100 * self.high:.1f}]"


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
    """Compare all pairs of laws at several costs that both fronts reach."""
    places = []
    for one, other in combinations(fronts, 2):
        low = max(one.span[0], other.span[0])
        high = min(one.span[1], other.span[1])
        if low < high:
            log = low > 0
            costs = [low * (high / low) ** x if log else low + x * (high - low) for x in shares]
            places += [(one, other, cost) for cost in costs]
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
    """Compare all pairs of laws in the middle of their common range of costs, in words."""
    cost, error = map(result.quantity, record["objectives"])
    write = Plain()
    unit = write.unit(result.units(cost.name))
    more = "more" if error.better == "higher" else "less"
    lines = []
    for pair in at_equal_cost(fronts(result, record), how, (0.5,)):
        better, worse = law_title(pair.better), law_title(pair.worse)
        at = f"At equal {write.name(cost)} of {abs(pair.cost):.3g}{f' {unit}' if unit else ''}"
        what = f"has {pair.lead} {more} {write.name(error)} than {worse}."
        if not pair.low > 0:
            what = (
                f"and {worse} differ in {write.name(error)} by less than these runs can resolve "
                f"({pair.lead})."
            )
        lines.append(f"{at}, {better} {what}")
    return lines


def equal_cost_table(result: Result, record: Record, write: Plain, how: Resampling) -> TextTable:
    """Return the table of all pairs of laws at several costs that both fronts reach."""
    cost, error = record["objectives"]
    rows = [
        [
            write.text(f"{law_title(pair.better)}, {law_title(pair.worse)}"),
            significant(abs(pair.cost)),
            *(significant(abs(x)) for x in (pair.error, pair.other_error)),
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
        "Between two neighbours on a front, costs and errors are interpolated. Each interval is "
        "that of a paired difference; it does not include how close the search came to the true "
        "front. Over searches: the same between the fronts of single searches, on the runs of the "
        "search."
    )
    header = [
        *("laws, the better first", "cost", "error", "error of the other"),
        *("less by", "over searches"),
    ]
    notes = [write.text(text) for text in (*sentences(result, record, how), note)]
    return TextTable("fronts", caption, header, [Block("", rows)] if rows else [], notes)
