"""One answer over all points of a sweep: `eqt compare --pooled`.

The ratio of two laws over all points p and runs r is the geometric mean of the paired ratios,
``exp(θ)`` with ``θ`` the mean of ``d_pr = ln(a_pr / b_pr)``. Run r starts from the same state at
every point, so the runs are drawn, not the pairs: runs are resampled, each with all its points, as
for `compare`. Points that a design draws at random are drawn, too: the interval is Student's with
the variance over runs and that over points (Welch and Satterthwaite's degrees of freedom). Points
of a grid are the question itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import (
    FEWEST,
    NEGLIGIBLE,
    RESOLUTION,
    Interval,
    Resampling,
    Word,
    intervals_of_means,
    resolved_differences,
)
from eqt_cli.analysis.maps import compare_map
from eqt_cli.base import purposes, yaml_source
from eqt_cli.base.arrays import Array
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.reporting import Block, TextTable, count_of, fixed
from eqt_cli.results.conclusion import conclusion_of
from eqt_cli.results.quantity import Plain, Quantity
from eqt_cli.results.result import Result
from eqt_cli.results.summary import compared_first

DRAWN = ("random", "lhs", "sobol")
"""Designs whose points are drawn."""


@dataclass(frozen=True)
class Pooled:
    """A law against the first one, over all points and runs.

    Attributes
    ----------
    metric
        Name of the number.
    law, first
        Labels of the law and of the one with which it is compared.
    ratio, low, high
        Geometric mean of the paired ratios of the law to the first one, and its interval; NaN
        without pairs, or with too few.
    pairs, failed
        Pairs with both numbers, and runs of the law and of the first one that failed.
    points
        In how many points the law is better, worse, not different, and undecided, by the rule of
        `--table points`.
    failed_points
        In how many points a run of one of the two failed.
    word
        What the interval says of the law.
    """

    metric: str
    law: str
    first: str
    ratio: float
    low: float
    high: float
    pairs: int
    failed: tuple[int, int]
    points: dict[str, int]
    failed_points: int
    word: Word


def interval(logs: Array, how: Resampling, *, drawn: bool) -> Interval:
    """Return the mean of ``d_pr`` over all pairs with its interval.

    Parameters
    ----------
    logs : (points, runs)
        Logarithms of the paired ratios; NaN where a pair has none.
    drawn
        Whether the points are a random sample, too.

    Returns
    -------
    Interval
        Over runs, the wider of Student's and that of `intervals_of_means` at each end, since few
        skewed runs are covered too rarely by either (0.92 of 0.95 was measured). Over runs and
        points, Student's with the sum of both variances. The ends are NaN for fewer than `FEWEST`
        runs, or drawn points.
    """
    finite = np.isfinite(logs)
    if not finite.any():
        return Interval(math.nan, math.nan, math.nan)
    mean = float(logs[finite].mean())
    off = np.where(finite, logs - mean, 0.0)
    parts = []
    for axis in (0, 1):
        used = finite.any(axis=axis)
        # What each run, or point, adds to the mean.
        parts.append(used.sum() * off.sum(axis=axis)[used] / finite.sum())
    parts = parts if drawn else parts[:1]
    if min(map(len, parts)) < FEWEST:
        return Interval(mean, math.nan, math.nan)
    from scipy.special import stdtrit  # slow to import

    variances = [float(np.var(part, ddof=1)) / len(part) for part in parts]
    if not any(variances):
        return Interval(mean, mean, mean)
    pairs = zip(variances, parts, strict=True)
    freedom = sum(variances) ** 2 / sum(x**2 / (len(part) - 1) for x, part in pairs)
    half = float(stdtrit(freedom, (1 + how.confidence) / 2)) * math.sqrt(sum(variances))
    if drawn:
        return Interval(mean, mean - half, mean + half)
    over = intervals_of_means(parts[0][:, None], how)
    low, high = min(-half, float(over.low[0])), max(half, float(over.high[0]))
    return Interval(mean, mean + low, mean + high)


def word_of(ratio: Interval, quantity: Quantity, negligible: float = NEGLIGIBLE) -> Word:
    """Return what the interval of a ratio says of the law."""
    low, high = ratio.low - 1, ratio.high - 1
    if not (math.isfinite(low) and math.isfinite(high)):
        return Word.UNDECIDED
    if max(abs(low), abs(high)) <= negligible:
        return Word.ALIKE
    if quantity.better == "neither" or not (low > RESOLUTION or high < -RESOLUTION):
        return Word.UNDECIDED
    return Word.BETTER if (high < 0) == (quantity.better == "lower") else Word.WORSE


def logs_of(result: Result, metric: str, law: int, first: int) -> Array:
    """Return the logarithms of the paired ratios, ``(points, runs)``; NaN where one has no number.

    Raises
    ------
    EqtError
        If a number is not positive, so that there is no ratio.
    """
    quantity = result.quantity(metric)
    values = result.counted(metric)[:, [law, first]].astype(float)
    if quantity.counts or np.nanmin(values, initial=np.inf) < 0:
        raise result.error(
            f"--pooled needs a positive number, of which there are ratios, and {metric} is "
            f"{'a share of runs' if quantity.counts else 'negative in some runs'}; choose another "
            "one by --metric"
        )
    a, b = values[:, 0], values[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.where(resolved_differences(a, b) == 0, 0.0, np.log(a) - np.log(b))
    zero = np.isfinite(a) & np.isfinite(b) & ~np.isfinite(logs)
    if zero.any():
        raise result.error(f"--pooled needs ratios, and {metric} is 0 in {zero.sum()} runs")
    return np.where(np.isfinite(a) & np.isfinite(b), logs, np.nan)


def is_drawn(result: Result) -> bool:
    """Whether a design of the sweep draws its points at random."""
    config = yaml_source.load(str(result.attributes["config"]), "config").data

    def within(section: Any) -> bool:
        if isinstance(section, list):
            return any(map(within, section))
        if not isinstance(section, dict):
            return False
        return any(key in DRAWN or within(inner) for key, inner in section.items())

    return within(config.get("sweep"))


def pooled(
    result: Result, metric: str, labels: Sequence[str], how: Resampling, negligible: float
) -> list[Pooled]:
    """Compare all laws with the first one over all points of a sweep."""
    places = [result.labels.index(label) for label in labels]
    quantity, good, answers = result.quantity(metric), result.good, list[Pooled]()
    drawn = is_drawn(result)
    for place in places[1:]:
        logs = logs_of(result, metric, place, places[0])
        on_logs = interval(logs, how, drawn=drawn)
        of = Interval(*map(math.exp, on_logs))
        failed = ~good[:, [place, places[0]]]
        lost = int(failed[:, 0].sum()), int(failed[:, 1].sum())
        word = word_of(of, quantity, negligible)
        ahead, behind = lost if word is Word.BETTER else lost[::-1]
        if word in (Word.BETTER, Word.WORSE) and ahead > behind:
            word = Word.UNDECIDED  # it is ahead among the runs that it does not lose
        points = dict.fromkeys(("better", "worse", "no difference", "undecided"), 0)
        if quantity.better != "neither":
            cells = compare_map(result, metric, how, [places[0], place], intervals=False).cells
            for cell in cells:
                names = {0: "worse", 1: "better"}
                name = names.get(cell.winner, "no difference" if cell.alike else "undecided")
                points[name] += 1
        failed_points = int(failed.any(axis=(1, 2)).sum())
        pair = result.labels[place], labels[0]
        answers.append(
            Pooled(
                metric, *pair, *of, int(np.isfinite(logs).sum()), lost, points, failed_points, word
            )
        )
    return answers


@purposes.compare_pooled
def answer(
    result: Result,
    how: Resampling,
    write: Plain,
    metrics: Sequence[str],
    laws: Sequence[str],
    negligible: float = NEGLIGIBLE,
) -> tuple[dict[str, Any], list[dict[str, Any]], list[TextTable], list[str]]:
    """Return the findings over all points, with remarks, for `eqt compare --pooled`."""
    if not result.is_sweep:
        raise result.error("--pooled is about all points of a sweep, and this is one experiment")
    conclusion_of(result).compared(result)  # which may refuse
    labels = [result.label_of(name) for name in laws] or list(result.labels)
    if len(labels) < 2:
        raise result.error("--pooled compares laws, and here is one")
    for metric in metrics:
        result.quantity(metric)
    records, tables = [], []
    drawn = is_drawn(result)
    for metric in metrics or compared_first(result)[:1]:
        rows = pooled(result, metric, labels, how, negligible)
        records += [asdict(row) | {"word": str(row.word)} for row in rows]
        tables.append(_table(result, rows, how, write, drawn=drawn))
    document: dict[str, Any] = {"pooled": records, "points_drawn": drawn}
    between = [
        words for tell in functions_for(purposes.remarks_on_a_result) for words in tell(result)
    ]
    if between:
        document["between"] = between
    return document, records, tables, between


def beside_1(ratio: float) -> str:
    """Format a ratio with the digits that tell it from 1, which decides a verdict; at least 3."""
    return next((x for k in range(3, 16) if float(x := fixed(ratio, k)) != 1), fixed(ratio, 3))


def _table(
    result: Result, rows: Sequence[Pooled], how: Resampling, write: Plain, *, drawn: bool
) -> TextTable:
    name = write.name(result.quantity(rows[0].metric))
    first = result.title_of[rows[0].first]
    header = ["law", f"ratio to {first}", f"{100 * how.confidence:g} % interval", ""]
    header += ["better", "worse", "same", "undecided", "failed"]
    body = []
    for row in rows:
        ends = f"{beside_1(row.low)} to {beside_1(row.high)}" if math.isfinite(row.low) else "-"
        body.append(
            [
                write.text(result.title_of[row.law]),
                fixed(row.ratio, 3) if math.isfinite(row.ratio) else "-",
                ends,
                str(row.word),
                *map(str, row.points.values()),
                str(row.failed_points),
            ]
        )
    over = "runs and points" if drawn else "runs"
    notes = [
        "Ratio: geometric mean of the paired ratios of all runs at all points. Its interval is "
        f"over {over}: run k starts from the same state at every point"
        f"{', and the design drew the points' if drawn else ''}.",
        "The last columns count points: where the law is better or worse by the rule of --table "
        "points, and where a run of one of the two failed. Failed runs have no ratio.",
    ]
    for row in rows:
        if any(row.failed):
            lost = f"{count_of(row.failed[0], 'run')} of {result.title_of[row.law]} failed"
            notes.append(f"{lost}, {row.failed[1]} of {first}.")
    caption = f"{name}: each law against {first}, over {count_of(result.points, 'point')}"
    return TextTable("pooled", caption, header, [Block("", body)], notes)
