"""Sweeps: which law wins at each point, which points dominate, where the runs settle."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.analysis.intervals import (
    NEGLIGIBLE,
    RESOLUTION,
    Interval,
    Resampling,
    Word,
    intervals_of_means,
    median_difference,
    resolved_differences,
    shares,
    sign_test,
)
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import Block, TextTable, count_of, fixed, reporter, significant, step
from eqt_cli.results.quantity import Measure, Plain
from eqt_cli.results.result import Result, mean_over_runs
from eqt_cli.results.summary import (
    compared_first,
    key_in_words,
    not_shared,
    repeats,
    settles,
    unit_in_words,
)

# Compares laws at every point of a sweep, with p-values adjusted for the number of points ---------
#
# The tables of a sweep are here, too: who wins where, and the best and the worst points.


NOBODY = -1

UNDECIDED, TOO_FEW_RUNS, IDENTICAL = "undecided", "too few runs", "identical runs"
"""Verdicts without a winner; the others where no law could win with such runs."""

RULE = (
    "better in more than half of all runs, by sign tests on the same initial states, and in the "
    "mean of these runs"
)
"""When a law wins, in words; `decide` tests it."""

SETTLING = 0.9
"""Share of runs that a law must bring to an end to be ranked; see `compare_map`."""

_NUMBERS = 10_000_000
"""Largest number of resampled means in memory."""


@dataclass(frozen=True)
class Cell:
    """One point of a sweep.

    Attributes
    ----------
    point
        Number of the point.
    best
        Index of the law with the best mean among the laws with the fewest failed runs.
    runner_up
        Index of the next best law.
    winner
        Index of the law, which is then the best, that is better than every other law in more than
        half of the runs, after the adjustment for all points, and in the mean; else `NOBODY`.
    in_most_runs
        Index of the law that is better than every other one in more than half of the runs; it does
        not win if its mean is not the better one. `NOBODY` if the runs do not decide.
    p_value
        P-value of the sign test behind this, adjusted for the number of points; NaN if the runs are
        too few.
    difference
        Paired difference best minus next, with an unadjusted interval.
    lead
        Median over runs of the difference relative to the next law, with its interval.
    alike
        Whether a law that would win differs from another one by no more than `NEGLIGIBLE`.
    failed, censored : tuple of int
        Numbers of runs of each law that failed, and whose value lies beyond the horizon.
    unranked
        Whether each law is not ranked.
    """

    point: int
    best: int
    runner_up: int
    winner: int
    in_most_runs: int
    p_value: float
    difference: Interval
    lead: Interval
    alike: bool
    failed: tuple[int, ...]
    censored: tuple[int, ...]
    unranked: tuple[bool, ...]


@dataclass(frozen=True)
class Map:
    """The comparison of laws by a metric at every point.

    Attributes
    ----------
    quantity, unit
        The metric and its unit.
    labels, titles
        Labels and display names of the laws.
    runs
        Number of runs of each law at each point.
    means : (points, laws)
        Means over the runs that did not fail. A value beyond the horizon counts as the horizon.
    cells
        The comparison at each point.
    fewest
        Number of runs with which a law could win at a point; with fewer, none wins.
    without_winner
        What points without a winner are called: `UNDECIDED`, or `TOO_FEW_RUNS`.
    confidence
        Confidence of each interval, and 1 minus the allowed probability of any false win.
    settling
        Share of runs by which laws are ranked.
    """

    quantity: Measure
    unit: str
    labels: list[str]
    titles: list[str]
    runs: int
    means: Array
    cells: list[Cell]
    fewest: int
    without_winner: str
    confidence: float
    settling: float

    @property
    def has_too_few_runs(self) -> bool:
        """Whether no law could win at any point."""
        return self.without_winner == TOO_FEW_RUNS

    def verdict(self, cell: Cell) -> str:
        """Return the winner of a point, or why there is none."""
        if cell.winner != NOBODY:
            return self.titles[cell.winner]
        if cell.alike:
            return str(Word.ALIKE)
        if cell.in_most_runs in (NOBODY, cell.best):
            return self.without_winner
        most, best = self.titles[cell.in_most_runs], self.titles[cell.best]
        if cell.failed[cell.in_most_runs] > cell.failed[cell.best]:
            return f"{most} in most runs, but {best} fails less"
        return f"{most} in most runs, {best} in the mean"

    def wins(self, law: int) -> int:
        """Return the number of points that a law wins."""
        return sum(cell.winner == law for cell in self.cells)

    def without_winners(self) -> dict[str, int]:
        """Return the number of points that no law wins, by word."""
        alike = sum(cell.winner == NOBODY and cell.alike for cell in self.cells)
        words = {str(Word.ALIKE): alike} if alike else {}
        return {**words, self.without_winner: self.wins(NOBODY) - alike}


def compare_map(
    result: Result,
    metric: str,
    how: Resampling,
    laws: Sequence[int] | None = None,
    *,
    intervals: bool = True,
    settling: float = SETTLING,
) -> Map:
    """Compare the laws of a sweep at each of its points, run by run on the same initial states.

    A law wins at a point if it is better than every other law in more than half of the runs there,
    and in the mean, and the median difference is not within `NEGLIGIBLE`: the rule of `compare`.
    More than half is tested by the sign test, which is exact for any number of runs and any
    distribution; a run that failed is worse than one that did not. The largest p-value over the
    other laws counts: a win is false if it is false for any other law (intersection-union test,
    Berger 1982). It is multiplied by the number of points (Bonferroni), as for one point alone. A
    law with more failed runs than another cannot win, because its other runs are a biased
    sample. A law is not ranked where more than 1 − `settling` of its runs failed, or where fewer
    than that settled and another law settled in at least `settling` of them; then it counts as
    failed. What fails in fewer than 3/n of the runs is not in the data of n runs, so no test of
    them excludes it.

    Parameters
    ----------
    result
        An open result of a sweep.
    metric
        A stored number per run.
    how
        Settings of the intervals; the confidence also holds for the map.
    laws
        Indices of the laws to compare; all if None.
    intervals
        Whether differences have intervals, which take most of the time.
    settling
        Share of runs by which laws are ranked.

    Raises
    ------
    EqtError
        If there are fewer than two laws, or no such metric.
    """
    chosen = list(range(len(result.labels))) if laws is None else list(laws)
    if len(chosen) < 2:
        raise result.error(
            "a map needs at least two laws, and this result has one; `eqt plot --figure settled` "
            "draws its points"
        )
    quantity = result.quantity(metric)
    if quantity.better == "neither":
        raise EqtError(f"{metric}: is neither better low nor better high, so no law can win")
    censored = result.censored(metric)[:, chosen]
    values = result.counted(metric)[:, chosen]
    if repeats(result):
        values = values[..., :1]
    failed = result.runs - np.count_nonzero(result.good[:, chosen], axis=-1)
    means = mean_over_runs(values)
    costs = quantity.cost(means)
    failing, idle = failed / result.runs > 1 - settling + RESOLUTION, np.zeros(failed.shape, bool)
    if (settled := settles(result)) is not None:
        arrived = settled[:, chosen].mean(axis=-1)
        idle = (arrived < 1 - settling) & (arrived.max(axis=-1, keepdims=True) >= settling)
    lost = np.where(idle, result.runs, failed)
    # Laws with more failed runs come last: their other runs are a biased sample.
    order = np.lexsort((np.where(np.isfinite(costs), costs, np.inf), lost), axis=-1)
    points = np.arange(len(values))
    counted = np.where(idle[..., None], np.nan, quantity.cost(values))
    decision = decide(counted, lost, how.confidence, counts=quantity.counts)
    # The law that is better in most runs is the best one, unless the means contradict.
    agrees = (decision.winner != NOBODY) & ~failing[points, decision.winner]
    moved = np.argsort(order != decision.winner[:, None], axis=-1, kind="stable")
    order = np.where(agrees[:, None], np.take_along_axis(order, moved, -1), order)
    best, runner_up = order[:, 0], order[:, 1]
    lacks = ~result.good[:, chosen, : values.shape[-1]]
    leads = [
        [
            median_difference(quantity, values[pair], lacks[pair], how.confidence)
            for pair in ((point, [best[point], other]) for other in order[point, 1:])
        ]
        for point in points
    ]
    alike = [any(max(-x.low, x.high) <= NEGLIGIBLE for x in of_point) for of_point in leads]
    differences = resolved_differences(values[points, best], values[points, runner_up])
    ends = _intervals(differences, how) if intervals else np.full((len(points), 3), np.nan)
    cells = [
        Cell(
            point=point,
            best=int(best[point]),
            runner_up=int(runner_up[point]),
            winner=int(best[point]) if agrees[point] and not alike[point] else NOBODY,
            in_most_runs=int(decision.in_most_runs[point]),
            p_value=float(decision.p_values[point]),
            difference=Interval(*ends[point].tolist()),
            lead=leads[point][0],
            alike=alike[point],
            failed=tuple(map(int, failed[point])),
            censored=tuple(map(int, np.count_nonzero(censored[point], axis=-1))),
            unranked=tuple((failing | idle)[point].tolist()),
        )
        for point in points.tolist()
    ]
    labels, titles = ([names[k] for k in chosen] for names in (result.labels, result.titles))
    about, kind = (result.units(metric), labels, titles, result.runs, means, cells), decision[-2:]
    if repeats(result):
        kind = decision.fewest, IDENTICAL
    return Map(quantity, *about, *kind, how.confidence, settling)


class Decision(NamedTuple):
    """Which laws win at several points.

    Attributes
    ----------
    winner, in_most_runs : (points,)
        The law that wins, and the one that is better than all others in more than half of the runs;
        `NOBODY` where the runs decide neither.
    p_values : (points,)
        P-values of the sign tests, times the points; NaN if the runs are too few.
    fewest
        Number of runs with which a law could win.
    without_winner
        What points without a winner are called: `TOO_FEW_RUNS` where there are fewer runs.
    """

    winner: Array
    in_most_runs: Array
    p_values: Array
    fewest: int
    without_winner: str


def decide(costs: Array, failed: Array, confidence: float, *, counts: bool = False) -> Decision:
    """Return the winners among laws at several points, as `compare_map` defines them.

    Parameters
    ----------
    costs : (points, laws, runs)
        Less is better; NaN for a run that failed.
    failed : (points, laws)
        Numbers of failed runs.
    counts
        Whether a cost is 0 or 1, so that runs without a difference are left out (McNemar's test).
    """
    points, _, runs = costs.shape
    fewest = math.ceil(1 - math.log2((1 - confidence) / points))  # 2^(1-n) ≤ (1 - c)/points
    ahead, raw = _better_in_most_runs(costs, counts=counts)
    adjusted = np.minimum(1.0, points * raw) if runs >= fewest else np.full(points, np.nan)
    most = np.where(adjusted <= 1 - confidence, ahead, NOBODY)
    # No more failed runs than any other, and the smaller paired means
    at = np.arange(points), most
    means = mean_over_runs(resolved_differences(costs[at][:, None], costs))
    means[at] = -np.inf
    # Of a law that failed in every run in which the other one did not, no mean is left.
    agrees = (failed[at] == failed.min(axis=-1)) & ~(means >= 0).any(axis=-1)
    winner = np.where(agrees, most, NOBODY)
    return Decision(winner, most, adjusted, fewest, UNDECIDED if runs >= fewest else TOO_FEW_RUNS)


def _intervals(rows: Array, how: Resampling) -> Array:
    """Return mean, lower and upper end of each row, with the same resamples for all rows."""
    at_once = max(1, _NUMBERS // how.resamples)
    parts = []
    with step("intervals", len(rows)):
        for start in range(0, len(rows), at_once):
            some = rows[start : start + at_once]
            parts.append(intervals_of_means(some.T, how))
            reporter().advance(len(some))
    columns = [np.stack([part.mean, part.low, part.high], axis=-1) for part in parts]
    return np.concatenate(columns)


def _better_in_most_runs(costs: Array, *, counts: bool) -> tuple[Array, Array]:
    """Return the law that is better than all others in most runs, and the p-value of sign tests.

    Without such a law at a point, it is `NOBODY`, and its p-value is 1.

    Parameters
    ----------
    costs : (points, laws, runs)
        Less is better; NaN for a run that failed.
    """
    points, laws, _ = costs.shape
    costs = np.where(np.isnan(costs), np.inf, costs)
    ahead, p_values = np.full(points, NOBODY), np.ones(points)
    for law in range(laws):
        others = np.delete(costs, law, axis=1)
        with np.errstate(invalid="ignore"):
            raw = costs[:, [law]] - others  # infinite where one of both failed, NaN where both did
        differences = np.where(np.isfinite(raw), resolved_differences(costs[:, [law]], others), raw)
        better, worse = ((differences * sign > 0).sum(axis=-1) for sign in (-1, 1))
        compared = better + worse if counts else (~np.isnan(raw)).sum(axis=-1)
        p = sign_test(better, compared).max(axis=-1)
        leads = (better > worse).all(axis=-1)
        ahead[leads], p_values[leads] = law, p[leads]
    return ahead, p_values


MOST_POINTS = 60
"""Largest number of points listed one by one; with more points, wins are only counted."""


def map_tables(wins: Map, result: Result, write: Plain, *, whole: bool = False) -> list[TextTable]:
    """Return the table of wins of each law, and the table of points.

    Parameters
    ----------
    whole
        Whether to list all points, however many there are.
    """
    name = write.name(wins.quantity)
    unit = write.unit(wins.unit)
    points = len(wins.cells)
    counted = []
    for law, title in enumerate(wins.titles):
        won, largest = [cell for cell in wins.cells if cell.winner == law], ["-", ""]
        if won:
            most = max(won, key=lambda cell: abs(cell.lead.value))
            at = write.text(f"point {most.point}, {result.point_name(most.point)}")
            largest = [_difference(wins, most, write), at]
        counted.append([write.text(title), str(len(won)), *largest])
    counted += [[word, str(count), "", ""] for word, count in wins.without_winners().items()]
    of_point = f"{count_of(wins.runs, 'run')} each"
    caption = f"Which law has the better {name}, at {points} points of {of_point}"
    heading = write.text("largest median difference, % of the other law")
    header = ["law", "points won", heading, "at"]
    inner = dict(zip(wins.titles, map(result.described.inner.get, wins.labels), strict=True))
    notes = [write.text(note) for note in [*not_shared(inner), *_notes(wins)]]
    summary = TextTable("winners", caption, header, [Block("", counted)], notes)
    if points > MOST_POINTS and not whole:
        more = f"{points} points are not listed; a table of all comes with --table points."
        return [replace(summary, notes=[*summary.notes, more])]
    rows = []
    for cell in wins.cells:
        place = [str(cell.point), write.text(result.point_name(cell.point))]
        counts = zip(cell.failed, cell.censored, strict=True)
        means = [_mean(wins.means[cell.point, law], *lost) for law, lost in enumerate(counts)]
        p_value = "-" if math.isnan(cell.p_value) else f"{cell.p_value:.2g}"
        winner = write.text(wins.verdict(cell))
        rows.append([*place, *means, winner, _difference(wins, cell, write), p_value])
    difference = write.text("median difference, % of the second")
    caption = f"Mean {name} at each point" if not name.startswith("mean") else f"{name}, each point"
    header = ["point", "at", *map(write.text, wins.titles), "winner", difference, "adjusted p"]
    caption += f", {unit}" if unit else ""
    spare = "adjusted p", difference
    table = TextTable("points", caption, header, [Block("", rows)], spare=spare, keys=2)
    return [summary, table]


def _notes(wins: Map) -> list[str]:
    share = f"{100 * (1 - wins.confidence):g} %"
    notes = [
        f"A law wins at a point where, against every other one, it is {RULE}. The largest p-value "
        "over the other laws counts, times the number of points: with probability "
        f"{share} at most, any law wins that is not better in more than half of all runs. A median "
        f"within ±{100 * NEGLIGIBLE:g} % is no difference. Failures rarer than 3/n of the runs, "
        f"here {300 / wins.runs:.2g} %, are not excluded."
    ]
    if wins.without_winner == IDENTICAL:
        notes.append(f"All {wins.runs} runs of a law are identical, so no test can decide.")
    elif wins.has_too_few_runs:
        notes.append(
            f"Too few to show a win at one of {len(wins.cells)} points: "
            f"{count_of(wins.runs, 'run')}; use {wins.fewest} or more (ensemble.runs)."
        )
    elif any(cell.winner == NOBODY for cell in wins.cells):
        notes.append("More runs decide more points (ensemble.runs).")
    if split := sum(cell.in_most_runs not in (NOBODY, cell.best) for cell in wins.cells):
        notes.append(
            f"At {split} of {len(wins.cells)} points a law is better in most runs, but fails more "
            "often or is worse in the mean; no law wins there."
        )
    failed, censored = (
        [sum(getattr(cell, name)[law] for cell in wins.cells) for law in range(len(wins.labels))]
        for name in ("failed", "censored")
    )
    if any(failed):
        notes.append(
            f"Failed runs: {_listed(wins, failed)}. A law of which more runs failed than of "
            "another cannot win at that point."
        )
    notes += [f"{said}." for said in _unranked(wins)]
    if any(censored):
        notes.append(f"Runs beyond the horizon, which count with it: {_listed(wins, censored)}.")
    return notes


def _unranked(wins: Map) -> Iterator[str]:
    """Say which laws are not ranked at some points, and why."""
    points = np.sum([cell.unranked for cell in wins.cells], axis=0).tolist()
    if any(points):
        some, most = (f"{100 * share:.3g} %" for share in (1 - wins.settling, wins.settling))
        yield (
            f"Points at which a law is not ranked, and loses: {_listed(wins, points)}; more than "
            f"{some} of its runs fail, or fewer settle where another law settles in {most}"
        )


def _listed(wins: Map, counts: list[int]) -> str:
    return ", ".join(f"{title} {n}" for title, n in zip(wins.titles, counts, strict=True) if n)


def _mean(mean: float, failed: int, censored: int) -> str:
    """Format a mean with the numbers of failed and unsettled runs."""
    counts = {"failed": failed, "unsettled": censored}
    marks = (f" ({count} {what})" for what, count in counts.items() if count)
    return significant(mean) + "".join(marks)


def _difference(wins: Map, cell: Cell, write: Plain) -> str:
    """``EqT − GT: -5.3 [-7.1, -2.9]``, the best law against the next one, in percent of that."""
    if not cell.difference.value or not all(map(isfinite, cell.lead)):
        return "-"
    laws = write.text(" − ".join(wins.titles[law] for law in (cell.best, cell.runner_up)))
    middle, low, high = (fixed(100 * share, 1) for share in cell.lead)
    return f"{laws}: {write.number(f'{middle} [{low}, {high}]')}"


def map_records(wins: Map, result: Result) -> list[dict[str, Any]]:
    """Return one record per point with full precision."""
    named = dict(enumerate(wins.labels))  # without NOBODY
    return [
        {
            "metric": wins.quantity.name,
            "units": wins.unit,
            "point": cell.point,
            **{key.key: key.value(cell.point) for key in result.swept_keys},
            "winner": named.get(cell.winner),
            "in_most_runs": named.get(cell.in_most_runs),
            "too_few_runs": wins.has_too_few_runs,
            "best": wins.labels[cell.best],
            "next": wins.labels[cell.runner_up],
            **dict(zip(("difference", "low", "high"), cell.difference, strict=True)),
            **dict(zip(("median", "median_low", "median_high"), cell.lead, strict=True)),
            "p_adjusted": cell.p_value,
            **{
                f"{name} of {label}": value
                for name, values in (
                    ("mean", wins.means[cell.point].tolist()),
                    ("failed", cell.failed),
                    ("censored", cell.censored),
                )
                for label, value in zip(wins.labels, values, strict=True)
            },
        }
        for cell in wins.cells
    ]


def extreme_points(result: Result, names: Sequence[str]) -> TextTable:
    """Return the points with the smallest and largest means for each controller and metric."""
    blocks = []
    for name in names:
        means = result.means(name).T
        unit = unit_in_words(result, name).replace("^2", "²")
        title = result.quantity(name).described + (f", {unit}" if unit else "")
        blocks.append(Block(title, _ends(result, means, means, significant)))
    if result.has("settled"):
        settled = np.moveaxis(shares(result.metric("settled")), 1, 0)
        rows = _ends(result, -settled[..., 0], settled, lambda share: Plain().interval(*share))
        blocks.append(Block("share of settled runs, with its 95 % interval", rows))
    caption = "Points with the best and the worst mean over runs, among points without failed runs"
    keys = [", ".join(filter(None, key_in_words(result, key))) for key in result.swept_keys]
    header = ["law", "which", "point", *keys, "mean"]
    return TextTable("best", caption, header, blocks)


def _ends(
    result: Result, costs: Array, values: Array, write: Callable[[Any], str]
) -> list[list[str]]:
    """Return the points with the least and the largest cost ``(laws, points)``, and the values."""
    rows = []
    for title, column, of_law in zip(result.titles, costs, values.tolist(), strict=True):
        if np.isfinite(column).any():
            for end, point in (("best", np.nanargmin(column)), ("worst", np.nanargmax(column))):
                keys = (key.named(int(point)) for key in result.swept_keys)
                at = (value if isinstance(value, str) else f"{value:.4g}" for value in keys)
                rows.append([title, end, str(point), *at, write(of_law[point])])
    return rows


def sweep_tables(result: Result, more: Sequence[str] = ()) -> list[TextTable]:
    """The best and the worst points, and which law wins how many.

    Of scenarios, such as ideal, a limit and a lag, none is a choice, so that none is best: a table
    has the means of the laws in each.
    """
    named = all(not key.is_number for key in result.swept_keys)
    if named and len(result.labels) > 1 and result.points <= MOST_POINTS:
        return [
            map_tables(compare_map(result, name, Resampling()), result, Plain())[1]
            for name in compared_first(result)
        ]
    further = [part for name in more if result.has(name) for part in result.in_parts(name)]
    table = extreme_points(result, [*compared_first(result), *further])
    return [replace(table, notes=[*table.notes, *map(_won, winners(result))])]


def winners(result: Result) -> list[Map]:
    """Which law wins where, by each metric, without intervals; nothing where there is one law."""
    names = compared_first(result) if len(result.labels) > 1 else []
    return [compare_map(result, name, Resampling(), intervals=False) for name in names]


def _won(wins: Map) -> str:
    """As in ``Points won by mean ‖I − Q_E‖: EqT 3, GT 12, undecided 5``."""
    counts = {title: wins.wins(law) for law, title in enumerate(wins.titles)}
    counts |= wins.without_winners()
    points = ", ".join(f"{name} {count}" for name, count in counts.items())
    few = f" (ensemble.runs: {wins.fewest} or more)" if wins.has_too_few_runs else ""
    won = f"Points won by {Plain().name(wins.quantity)}: {points}{few}"
    return ". ".join([won, *_unranked(wins), ""]).rstrip()


def front(cost: Array, error: Array) -> Array:
    """Return the Pareto front by increasing cost; points with NaN are left out."""
    order = np.lexsort((error, cost))
    order = order[np.isfinite(cost[order]) & np.isfinite(error[order])]
    least = np.minimum.accumulate(error[order])
    return order[np.diff(least, prepend=np.inf) < 0]
