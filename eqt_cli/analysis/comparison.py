"""The table of a comparison: a row for each number of a law, and of a law against another one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import combinations
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import (
    FEWEST,
    NEGLIGIBLE,
    UNKNOWN,
    Interval,
    Resampling,
    Word,
    difference_of_shares,
    holm,
    intervals_of_means,
    median_difference,
    relative_difference,
    resolved_differences,
    runs_alone,
    runs_to_decide,
    shares,
    sign_test,
)
from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import InNotebook, fixed
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import PerRun

Record = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Level:
    """A measure of one law.

    Attributes
    ----------
    measured, controller
        The measure, and the label of the controller.
    runs
        Number of good runs with a value.
    failed, undefined
        Numbers of failed runs, and of good runs without a value.
    censored
        Number of runs whose value lies beyond the horizon and counts as the horizon.
    mean, low, high
        Mean over runs and its interval. For counts of runs: the share and its Wilson interval.
    standard_deviation, median
        Standard deviation and median over runs.
    """

    measured: PerRun
    controller: str
    runs: int
    failed: int
    undefined: int
    censored: int
    mean: float
    low: float
    high: float
    standard_deviation: float
    median: float


@dataclass(frozen=True, eq=False)
class Pair:
    """A measure of a law against another one, run by run on the same initial states.

    Attributes
    ----------
    measured, first, second
        The measure, and the labels of the controllers. Differences are first minus second.
    values : (2, pairs)
        Values of both in the runs in which both have one.
    pairs, failed, undefined
        Number of these runs, and of those left out because one of the two failed, or has no value.
    censored
        Number of pairs with at least one value beyond the horizon, which counts as the horizon.
    difference, low, high
        Mean difference and its interval; for shares of runs the interval of Newcombe.
    relative, relative_low, relative_high
        `relative_difference`; of shares, the difference itself.
    cohen_d
        Mean divided by standard deviation of the differences.
    first_better
        Share of pairs in which the first is better; ties count half.
    p_value
        P-value of `sign_test` in these runs; of shares of runs, where the two differ (McNemar).
    median, median_low, median_high
        `median_difference`, of which the words are about.
    runs_to_decide
        Number of runs that would decide the sign (`runs_to_decide`); None for fewer than `FEWEST`
        pairs, whose spread is too uncertain.
    better_in
        In how many runs the first law is better, and the second; a run that failed is worse.
    runs
        Number of runs behind `better_in`, in which both have a value or only one failed.
    word, adjusted_p
        What most runs say of the first law, and the p-value, adjusted after Holm (1979) for all
        numbers of all laws against the second (`Comparison.rows`).
    contradicted
        Why the word is *undecided* although a law is better in most runs.
    """

    measured: PerRun
    first: str
    second: str
    values: Array
    pairs: int
    failed: int
    undefined: int
    censored: int
    difference: float
    low: float
    high: float
    relative: float
    relative_low: float
    relative_high: float
    cohen_d: float
    first_better: float
    p_value: float
    median: float
    median_low: float
    median_high: float
    runs_to_decide: int | None
    better_in: tuple[int, int]
    runs: int
    word: Word = Word.UNDECIDED
    adjusted_p: float = math.nan
    contradicted: str = ""

    @property
    def differences(self) -> Array:
        """First minus second, ``(pairs,)``."""
        return resolved_differences(*self.values)

    def __repr__(self) -> str:
        """The difference with its interval, in a line."""
        write = Plain()
        interval = write.interval(self.difference, self.low, self.high)
        measured = f"{self.measured.quantity.name} {write.window(self.measured.seen)}"
        value = " ".join(filter(None, [interval, write.unit(self.measured.unit)]))
        return f"Pair({self.first} − {self.second}, {measured}: {value}, {self.pairs} pairs)"

    @property
    def percent(self) -> str:
        """The median as ``−16 % [−19, −13]``; of shares in points of 100."""
        values = [100 * x for x in (self.median, self.median_low, self.median_high)]
        if not math.isfinite(values[0]):
            return "-"
        half = (values[2] - values[1]) / 2  # of rounding alone below 1e-9
        digits = min(max(0, -math.floor(math.log10(half / 2))), 2) if 1e-9 < half < math.inf else 0
        middle, *ends = (fixed(value, digits, signed=True).replace("-", "−") for value in values)
        unit = "points" if self.measured.is_share else "%"
        return f"{middle} {unit} [{', '.join(ends)}]" if math.isfinite(half) else f"{middle} {unit}"


_COLUMNS = {
    Level: "controller runs failed undefined censored mean low high standard_deviation median",
    Pair: "first second pairs failed undefined censored difference low high relative relative_low "
    "relative_high cohen_d first_better p_value median median_low median_high runs_to_decide word "
    "adjusted_p",
}


def record(measured: PerRun, row: Level | Pair | None = None) -> Record:
    """Return a number, and what a row of the table says of it, for programs."""
    columns = _COLUMNS[type(row)].split() if row else []
    return {
        "metric": measured.quantity.name,
        "window_start": measured.seen.start,
        "window_stop": measured.seen.stop,
        "units": measured.unit,
        **{name: getattr(row, name) for name in columns},
    }


class Numbers:
    """Numbers of every run of several laws, from which the rows of a table follow.

    All means are resampled together: resample k draws the same runs for all numbers. Shares of runs
    have intervals in closed form.

    Parameters
    ----------
    laws
        Labels of the laws.
    good : (laws, runs)
        Whether each run succeeded.
    measured
        The numbers, of these laws and runs.
    how
        Settings of the intervals.
    """

    def __init__(
        self, laws: Sequence[str], good: Array, measured: Sequence[PerRun], how: Resampling
    ) -> None:
        self.laws, self.good, self.measured = list(laws), good, list(measured)
        self._rows: dict[tuple[int, ...], Pair] = {}
        columns: dict[tuple[int, ...], Array] = {}
        for k, s in enumerate(self.measured):
            if not s.quantity.counts:
                columns |= {(k, a): values for a, values in enumerate(s.values)}
                for a, b in combinations(range(len(laws)), 2):
                    columns[k, a, b] = resolved_differences(s.values[a], s.values[b])
        table = np.stack([*columns.values()], axis=1) if columns else np.empty((good.shape[1], 0))
        means = intervals_of_means(table, how)
        ends = map(Interval, means.mean.tolist(), means.low.tolist(), means.high.tolist())
        self._means = dict(zip(columns, ends, strict=True))
        self.how = replace(how, resamples=means.resamples)

    def level(self, k: int, a: int) -> Level:
        """Return number k of law a."""
        s = self.measured[k]
        values = s.values[a][np.isfinite(s.values[a])]
        failed = int(np.count_nonzero(~self.good[a, : s.runs]))
        if s.quantity.counts:
            interval = Interval(*shares(s.values[a], self.how.confidence))
        else:
            interval = self._means[k, a]
        if s.runs == 1:
            interval = UNKNOWN._replace(value=interval.value)
        return Level(
            s,
            self.laws[a],
            runs=len(values),
            failed=failed,
            undefined=s.runs - failed - len(values),
            censored=int(np.count_nonzero(s.censored[a])),
            **dict(zip(("mean", "low", "high"), interval, strict=True)),
            standard_deviation=_deviation(values),
            median=float(np.median(values)) if len(values) else math.nan,
        )

    def pair(self, k: int, first: str, second: str) -> Pair:
        """Return number k of a law against another one, without a word."""
        a, b = self.laws.index(first), self.laws.index(second)
        if (k, a, b) not in self._rows:
            self._rows[k, a, b] = self._pair(k, a, b)
        return self._rows[k, a, b]

    def _pair(self, k: int, a: int, b: int) -> Pair:
        s, confidence, counts = (
            self.measured[k],
            self.how.confidence,
            self.measured[k].quantity.counts,
        )
        values, lost = s.values[[a, b]], ~self.good[[a, b], : s.values.shape[1]]
        both = np.isfinite(values).all(axis=0)
        differences = resolved_differences(*values[:, both])
        if counts:
            interval, _ = difference_of_shares(values[0], values[1], confidence)
        elif a < b:
            interval = self._means[k, a, b]
        else:
            mean, low, high = self._means[k, b, a]
            interval = Interval(-mean, -high, -low)
        share = (
            interval
            if s.is_share
            else relative_difference(differences, values[1][both], confidence, self.how.sequential)
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            cohen_d = float(np.float64(interval.value) / _deviation(differences))
        costs = s.quantity.cost(differences)
        alone = np.zeros(2, dtype=int) if counts else runs_alone(values, lost)
        ahead = np.count_nonzero([costs < 0, costs > 0], axis=-1) + alone
        failed, runs = (
            int(np.count_nonzero(lost[:, : s.runs].any(axis=0))),
            int(both.sum() + alone.sum()),
        )
        tested = ahead.sum() if counts else runs
        median = median_difference(s.quantity, values, lost, confidence, self.how.sequential)
        return Pair(
            s,
            self.laws[a],
            self.laws[b],
            values[:, both],
            len(differences),
            failed,
            s.runs - failed - len(differences),
            int(np.count_nonzero(s.censored[[a, b]].any(axis=0) & both)),
            *interval,
            *share,
            cohen_d,
            float(np.mean((costs < 0) + (costs == 0) / 2)) if len(costs) else math.nan,
            float(sign_test(ahead.max(), tested, self.how.sequential)) if runs else math.nan,
            *median,
            runs_to_decide(cohen_d, confidence) if both.sum() >= FEWEST else None,
            (int(ahead[0]), int(ahead[1])),
            runs,
        )


def _deviation(values: Array) -> float:
    with np.errstate(over="ignore"):
        return float(np.std(values, ddof=1)) if len(values) > 1 else math.nan


class ClaimVerdict(StrEnum):
    """The verdict on a claim."""

    SUPPORTED = "supported"
    NOT_SUPPORTED = "not supported"
    UNDECIDED = "undecided"
    NOT_COVERED = "not covered"
    NOT_COMPARABLE = "not comparable"


@dataclass(frozen=True)
class Judgement:
    """A row of a claim, measured.

    Attributes
    ----------
    measured
        The measure.
    verdict
        Verdict for the available runs.
    runs_to_decide
        Number of runs that would decide if all stays as measured; None if no number would.
    source, says
        Source of the claim, and its words.
    pair
        The difference of two controllers, for a claim that one has less than the other.
    controller, statement
        For a claim about every run: the label of the controller, and the claim in words.
    held, runs
        Number of runs in which it held, and of runs with a value.
    low
        Lower end of the one-sided interval for the share of runs in which it holds.
    absent
        Kinds of controllers that the claim mentions and the result does not have.
    is_at_home
        Whether the result is the experiment of the source, so that the verdict is told unasked.
    """

    measured: PerRun
    verdict: ClaimVerdict
    runs_to_decide: int | None
    source: str = ""
    says: str = ""
    pair: Pair | None = None
    controller: str = ""
    statement: str = "first is less than second"
    held: int = 0
    runs: int = 0
    low: float = float("nan")
    absent: tuple[str, ...] = ()
    is_at_home: bool = True


@dataclass(frozen=True, repr=False)
class Comparison(InNotebook):
    """The outcome of `compare`.

    Attributes
    ----------
    title, group, labels, runs
        Title, group and labels of the result, and its runs per law.
    titles
        Display name of each controller, by label.
    kinds
        Kind of each controller, by label.
    failed
        Number of failed runs of each controller, by label.
    horizon
        Duration of the runs, s.
    numbers, shown
        The numbers of all runs, and how many of them are shown; the others are of claims.
    negligible
        Relative difference within which there is none.
    judgements
        One row per claim and measure; empty if no claim applies.
    departures
        How the loop departs from that of the claims, in words; then no claim is judged.
    lyapunov_functions
        Name of each law's function L, by label; empty if it is the same for all.
    not_matched
        Labels of laws whose gains are not matched to those of the others.
    gains
        How stiffness and damping of laws, at the poses that they flew, are not those of their gains
        or of the law that they are compared with, by label.
    resolution
        Largest error estimate of the runs; 0 where none is known. Smaller errors are not judged.
    missing
        Sentences about numbers that could not be computed.
    sentences
        What says in words which law is better.
    points
        Number of points of the sweep of which this is one; tests are corrected for them, too.
    identical
        Whether all runs of every law are identical; then there are no statistics.
    bases
        Of two results: the law of the first with which each law of the second is compared.
    between
        Sentences on two results: whether their runs are pairs, and what differs.
    gate
        Of two results: a finding for each rule and law; None without a gate.
    """

    title: str
    group: str
    labels: list[str]
    titles: dict[str, str]
    runs: int
    kinds: dict[str, str]
    failed: dict[str, int]
    horizon: float
    numbers: Numbers
    shown: int
    missing: list[str]
    sentences: Callable[[Comparison], list[str]]
    negligible: float = NEGLIGIBLE
    judgements: Sequence[Judgement] = ()
    departures: str = ""
    lyapunov_functions: Mapping[str, str] = field(default_factory=dict)
    not_matched: Sequence[str] = ()
    gains: Mapping[str, str] = field(default_factory=dict)
    resolution: float = 0.0
    points: int = 1
    identical: bool = False
    bases: Mapping[str, str] = field(default_factory=dict)
    between: Sequence[str] = ()
    gate: Sequence[Any] | None = None

    @property
    def how(self) -> Resampling:
        """Settings of the intervals, with the number of resamples that were drawn."""
        return self.numbers.how

    @property
    def levels(self) -> list[Level]:
        """A row for each measure and controller."""
        laws = range(len(self.labels))
        return [self.numbers.level(k, law) for k in range(self.shown) for law in laws]

    def rows(self, against: str = "") -> list[Pair]:
        """Return all numbers of all other laws against one, by default the first, with their words.

        Of two results, each law of the second is compared with its base in the first. A word counts
        runs: *better* and *worse* need the sign test, adjusted for all these numbers and for the
        points of a sweep, and *no difference* an interval of the median within `negligible`.
        """
        bases = self.bases or dict.fromkeys(self.labels, against or self.labels[0])
        pairs = [
            self.numbers.pair(k, law, bases[law])
            for k, measured in enumerate(self.numbers.measured[: self.shown])
            for law in self.labels
            if bases.get(law, law) != law and self._is_same(measured, law, bases[law])
        ]
        judged = [pair.measured.quantity.better != "neither" for pair in pairs]
        p_values = np.where(judged, [pair.p_value for pair in pairs], np.nan)
        adjusted = np.minimum(1.0, self.points * holm(p_values))
        return [self._judged(*row) for row in zip(pairs, adjusted.tolist(), strict=True)]

    def _is_same(self, measured: PerRun, law: str, other: str) -> bool:
        """Whether the number means the same for both laws: each may have its own L."""
        functions = self.lyapunov_functions
        is_of_function = "lyapunov" in measured.quantity.signals
        return not is_of_function or functions.get(law) == functions.get(other)

    def _judged(self, pair: Pair, p_value: float) -> Pair:
        better, word, against = pair.measured.quantity.better, Word.UNDECIDED, ""
        by_newcombe = self.how.sequential and pair.measured.quantity.counts  # holds for one look
        if not by_newcombe and max(abs(pair.median_low), abs(pair.median_high)) <= self.negligible:
            word = Word.ALIKE
        elif p_value <= 1 - self.how.confidence:
            against = self._contradicted(pair)
            if not against and (pair.median_low > 0 or pair.median_high < 0):
                is_better = (pair.median_high < 0) == (better == "lower")
                word = Word.BETTER if is_better else Word.WORSE
        if self.unresolved(pair):
            word = Word.UNDECIDED
        return replace(pair, word=word, adjusted_p=p_value, contradicted=against)

    def _contradicted(self, pair: Pair) -> str:
        """Say what speaks against the law that is better in most runs; as on maps."""
        more = self.failed[pair.first] - self.failed[pair.second]
        if more * (pair.better_in[0] - pair.better_in[1]) > 0:
            return "with more failed runs"
        return "not in the mean" if pair.difference * pair.median <= 0 else ""

    def unresolved(self, pair: Pair) -> bool:
        """Whether both means are errors of a state that are within their error estimate."""
        quantity, of_state = pair.measured.quantity, pair.measured.unit in STATE_UNITS
        is_error = any("_error" in name or "attitude_angle" in name for name in quantity.signals)
        largest = float(pair.values.mean(axis=-1).max()) if pair.pairs else 0.0
        return is_error and of_state and not quantity.counts and 0 < largest <= self.resolution

    def against(self, *bases: str) -> list[Pair]:
        """Return every pair against the law that stands first of both, after these."""
        if self.bases:
            return self.rows()
        order = list(dict.fromkeys([*bases, *self.labels]))
        later = {base: set(order[k:]) - {base} for k, base in enumerate(order)}
        pairs = [pair for base in order for pair in self.rows(base) if pair.first in later[base]]
        number = {id(measured): k for k, measured in enumerate(self.numbers.measured)}
        return sorted(pairs, key=lambda pair: number[id(pair.measured)])

    @property
    def pairs(self) -> list[Pair]:
        """Every law against each that stands before it, with the words of `rows`."""
        return self.against()

    def answer(self) -> list[str]:
        """Return the experiment, and then what `eqt compare` prints first, in words."""
        about = f"{self.title} on {self.group}: {self.runs} runs of each law"
        return [about, *self.sentences(self)]

    def records(self) -> list[Record]:
        """Return a record per metric and pair of laws; per metric of a law that is alone."""
        return [record(row.measured, row) for row in self.pairs or self.levels]


STATE_UNITS = ("1", "rad", "deg", "m", "rad/s", "m/s")
"""Units of errors of poses and velocities, to which error estimates apply."""
