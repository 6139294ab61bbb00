"""Ratios of tuned laws, with what held-out runs and training samples leave open.

On each training sample s both laws are tuned, and ``L_s = ln(mean a / mean b)`` is their paired
ratio on the same held-out runs. The interval of the mean of ``L_s`` is Student's, with the variance
of the samples and that of the held-out runs, and Welch's and Satterthwaite's degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import FEWEST, NEGLIGIBLE, RESOLUTION, Interval, Word
from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import Block, TextTable, fixed, listed
from eqt_cli.extensions.search.exchanges import NOT_FINISHED, ending, unfinished
from eqt_cli.results.origin import law_title
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import Result

Record = Mapping[str, Any]

FEWEST_SAMPLES = 3
"""Number of training samples below which no law is called better."""


def joined(of_samples: Array, of_runs: Array, confidence: float) -> Interval:
    """Return the mean over samples, with Student's interval joined with that over runs.

    Parameters
    ----------
    of_samples : (samples,)
        A number on each training sample.
    of_runs : (runs,)
        What each held-out run adds to their mean, to first order; 0 in the mean.

    Returns
    -------
    Interval
        Of one sample, that over runs alone. The ends are NaN for fewer than `FEWEST` runs.
    """
    return joined_over([(of_samples, of_runs)], confidence)


def joined_over(tasks: Sequence[tuple[Array, Array]], confidence: float) -> Interval:
    """Return the mean over fixed tasks of what `joined` returns for one of them.

    Samples and runs of two tasks are counted as independent: their variances add.
    """
    from scipy.special import stdtrit  # slow to import

    mean, parts = float(np.mean([of_samples.mean() for of_samples, _ in tasks])), []
    for of_samples, of_runs in tasks:
        samples, runs, weight = len(of_samples), len(of_runs), len(tasks) ** -2
        if runs < FEWEST:
            return Interval(mean, math.nan, math.nan)
        parts.append((weight * float(np.var(of_runs, ddof=1)) / runs, runs - 1))
        if samples > 1:
            parts.append((weight * float(np.var(of_samples, ddof=1)) / samples, samples - 1))
    variance = sum(part for part, _ in parts)
    if variance == 0:
        return Interval(mean, mean, mean)
    freedom = variance**2 / sum(part**2 / degrees for part, degrees in parts)
    half = float(stdtrit(freedom, (1 + confidence) / 2)) * math.sqrt(variance)
    return Interval(mean, mean - half, mean + half)


@dataclass(frozen=True)
class Ratio:
    """A number of one tuned law over that of another.

    Attributes
    ----------
    first, second
        Labels of the laws.
    metric
        Name of the number.
    better
        Whether a law is better with a lower or a higher number.
    value, low, high
        Ratio of the means, the geometric mean over samples, and its interval; NaN if it has none.
    median
        The same of the median run: the middle paired ratio of a sample.
    ahead, runs
        Share of pairs of runs in which the first is better, and number of runs with both numbers.
    samples
        The training samples with gains of both.
    unfinished
        The laws whose search is not finished, so that nothing is said of them.
    """

    first: str
    second: str
    metric: str
    better: str
    value: float
    low: float
    high: float
    median: float
    ahead: float
    runs: int
    samples: int
    unfinished: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """The word for the first law, or that a search is not finished."""
        return NOT_FINISHED if self.unfinished and self.is_judged else str(self.word)

    @property
    def is_judged(self) -> bool:
        """Whether there are samples enough to call a law better."""
        return self.samples >= FEWEST_SAMPLES

    @property
    def word(self) -> Word:
        """The word for the first law: by the interval, and not with fewer than 3 samples."""
        low, high = self.low - 1, self.high - 1
        if self.samples < FEWEST_SAMPLES or not (math.isfinite(low) and math.isfinite(high)):
            return Word.UNDECIDED
        if max(abs(low), abs(high)) <= NEGLIGIBLE:
            return Word.ALIKE
        if not (low > RESOLUTION or high < -RESOLUTION):
            return Word.UNDECIDED
        return Word.BETTER if (high < 0) == (self.better != "higher") else Word.WORSE

    @property
    def disagrees(self) -> bool:
        """Whether the median run is on the other side of 1 than the ratio of means."""
        off = self.value - 1, self.median - 1
        return off[0] * off[1] < 0 and min(map(abs, off)) > NEGLIGIBLE

    @property
    def swapped(self) -> Ratio:
        """The same of the second law against the first."""
        return replace(
            self,
            first=self.second,
            second=self.first,
            value=1 / self.value,
            low=1 / self.high,
            high=1 / self.low,
            median=1 / self.median,
            ahead=1 - self.ahead,
        )

    @property
    def percent(self) -> str:
        """The difference as ``−16 % [−19, −13]``."""
        value, *ends = (100 * (x - 1) for x in (self.value, self.low, self.high))
        if not math.isfinite(value):
            return "-"
        half = (ends[1] - ends[0]) / 2
        digits = 1 if not math.isfinite(half) else 2 if half < 0.5 else 1 if half < 5 else 0
        number, *texts = (_signed(x, digits) for x in (value, *ends))
        return f"{number} % [{', '.join(texts)}]" if math.isfinite(half) else f"{number} %"


def _signed(value: float, digits: int) -> str:
    return fixed(value, digits, signed=True).replace("-", "−")


def rows_of(result: Result, law: Record) -> dict[int, int]:
    """Return the place in a result of a law's gains of each sample that has some."""
    labels = {search["sample"]: search["label"] for search in law["searches"]}
    return {s: result.labels.index(label) for s, label in labels.items() if label is not None}


def ratio(
    result: Result, one: Record, other: Record, metric: str, confidence: float = 0.95
) -> Ratio:
    """Return the ratio of a number of two tuned laws, over samples and held-out runs."""
    first, second = rows_of(result, one), rows_of(result, other)
    samples = sorted(first.keys() & second.keys())
    values, quantity = result.counted(metric), result.quantity(metric)
    a, b = (values[[rows[s] for s in samples]] for rows in (first, second))
    pair = paired(a, b, one["label"], other["label"], metric, quantity.better, confidence)
    names = [law["label"] for law in (one, other) if unfinished(gains_of(law))]
    return replace(pair, unfinished=tuple(names))


def gains_of(law: Record) -> list[float | None]:
    """Return what each search for a law gained in its last exchange; none of a law without keys."""
    return [search.get("gained") for search in law["searches"]] if law["over"] else []


def paired(
    a: Array, b: Array, first: str, second: str, metric: str, better: str, confidence: float = 0.95
) -> Ratio:
    """Return the ratio of the errors of two laws, ``(samples, runs)``, NaN where a run failed."""
    both = np.isfinite(a).all(axis=0) & np.isfinite(b).all(axis=0)
    a, b, about = a[:, both], b[:, both], (first, second, metric, better)
    samples, runs, nan = len(a), int(both.sum()), math.nan
    none = Ratio(*about, nan, nan, nan, nan, nan, runs, samples)
    if not samples or not runs or min(a.min(), b.min()) < 0:
        return none
    if min(a.mean(axis=1).min(), b.mean(axis=1).min()) <= 0:
        return none
    value, low, high = (math.exp(x) for x in joined(*logs_of(a, b), confidence))
    with np.errstate(divide="ignore", invalid="ignore"):
        of_pairs = np.where(a == b, 1.0, a / b)
    middle = np.median(of_pairs, axis=1)
    median = float(np.exp(np.log(middle).mean())) if (middle > 0).all() else math.nan
    less = ((a < b) + (a == b) / 2).mean()
    ahead = float(less if better != "higher" else 1 - less)
    return Ratio(*about, value, low, high, median, ahead, runs, samples)


def logs_of(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the logarithm of the ratio of means on each sample, and what each run adds to it.

    Both are 0 for one law, up to rounding.
    """
    mean_a, mean_b = a.mean(axis=1), b.mean(axis=1)
    of_runs = (a / mean_a[:, None] - b / mean_b[:, None]).mean(axis=0)
    logs = np.log(mean_a / mean_b)
    if np.abs(a - b).max() <= RESOLUTION * max(mean_a.max(), mean_b.max()):
        return 0 * logs, 0 * of_runs
    return logs, of_runs


def ratios(
    result: Result,
    record: Record,
    metrics: Sequence[str],
    laws: Sequence[str] = (),
    confidence: float = 0.95,
) -> list[Ratio]:
    """Return the ratios of all pairs of tuned laws, or of those of some laws."""
    tuned = [law for law in record["laws"] if law["winners"]]
    tuned = [law for law in tuned if not laws or law["label"] in laws]
    return [
        ratio(result, one, other, metric, confidence)
        for metric in metrics
        for other, one in combinations(tuned, 2)
    ]


def means(result: Result, law: Record, metric: str, confidence: float = 0.95) -> Interval:
    """Return the mean of a number of a tuned law over samples, with its joined interval."""
    values = result.counted(metric)[list(rows_of(result, law).values())]
    values = values[:, np.isfinite(values).all(axis=0)]
    if not values.size:
        return Interval(math.nan, math.nan, math.nan)
    of_samples = values.mean(axis=1)
    of_runs = (values - of_samples[:, None]).mean(axis=0)
    return joined(of_samples, of_runs, confidence)


# The tables ---------------------------------------------------------------------------------------


def ratio_table(result: Result, of_pairs: Sequence[Ratio], samples: int, write: Plain) -> TextTable:
    """Return the table of pairs of tuned laws."""
    blocks = []
    for metric in dict.fromkeys(pair.metric for pair in of_pairs):
        rows = [
            [
                write.text(f"{law_title(pair.first)} against {law_title(pair.second)}"),
                write.text(pair.percent),
                write.text(_percent(pair.median)),
                write.text(f"{100 * pair.ahead:.0f} %" if math.isfinite(pair.ahead) else "-"),
                pair.verdict if samples >= FEWEST_SAMPLES else "not judged",
            ]
            for pair in of_pairs
            if pair.metric == metric
        ]
        blocks.append(Block(write.name(result.quantity(metric)), rows))
    runs = min((pair.runs for pair in of_pairs), default=result.runs)
    caption = f"Tuned laws against each other, over {samples} training samples and {runs} runs"
    header = ["laws", "mean", "median run", "better in", "verdict"]
    return TextTable("pairs", caption, header, blocks, [write.text(x) for x in _notes(samples)])


def _percent(value: float) -> str:
    return f"{_signed(100 * (value - 1), 1)} %" if math.isfinite(value) else "-"


def _notes(samples: int) -> list[str]:
    if samples < FEWEST_SAMPLES:
        return [too_few(samples)]
    return [
        "mean: difference of the means, with the 95 % interval that holds what both training "
        "samples and held-out runs leave open; the verdict follows from it, for each pair alone",
        "median run: difference in the middle run; better in: share of the runs",
    ]


def too_few(samples: int) -> str:
    """Say why no law is called better."""
    trained = "one training sample does" if samples == 1 else f"{samples} training samples do"
    return (
        f"No law is called better: {trained} not show how far another one would change it. Set "
        f"tune.samples to {FEWEST_SAMPLES} or more."
    )


def sentences(result: Result, of_pairs: Sequence[Ratio], samples: int) -> list[str]:
    """Say which laws are better than which, and where mean and median run disagree."""
    if not of_pairs:
        return []
    if samples < FEWEST_SAMPLES:
        return [too_few(samples)]
    verdicts: dict[str, list[str]] = {}
    for pair in of_pairs:
        pair = pair.swapped if pair.verdict == Word.WORSE else pair
        one, other, word = law_title(pair.first), law_title(pair.second), pair.verdict
        if word == Word.BETTER:
            verdicts.setdefault(f"{one} is better than", []).append(f"{other} ({pair.percent})")
        else:
            verdicts.setdefault(f"{word}:", []).append(f"{one} – {other} ({pair.percent})")
    described = result.quantity(of_pairs[0].metric).described
    said = "; ".join(f"{verdict} {listed(laws)}" for verdict, laws in verdicts.items())
    lines = [f"By {described}: {said}."]
    for pair in of_pairs:
        if pair.disagrees:
            lines.append(
                f"Mean and median run disagree: {law_title(pair.first)} against "
                f"{law_title(pair.second)} has {_percent(pair.value)} in the mean, which was "
                f"tuned, and {_percent(pair.median)} in the median run."
            )
    return lines


def spending_table(result: Result, record: Record, write: Plain) -> TextTable:
    """Return the table of what the laws spend of that which is to be equal."""
    blocks = []
    for number, bound in enumerate(record["constraints"]):
        if not bound["equal"]:
            continue
        rows, metric = [], bound["metric"]
        for law in record["laws"]:
            spent = [
                search["measured"][number] / bound["bound"]
                for search in law["searches"]
                if search["label"] is not None
            ]
            if not spent:
                continue
            held = [x / bound["bound"] for x in means(result, law, metric)]
            ends = ""
            if math.isfinite(held[1]):
                ends = f" [{', '.join(fixed(x, 3) for x in held[1:])}]"
            trained = dict.fromkeys(fixed(end, 3) for end in (min(spent), max(spent)))
            rows.append(
                [
                    write.text(law_title(law["label"])),
                    write.text(" to ".join(trained)),
                    write.text(f"{fixed(held[0], 3)}{ends}"),
                    "yes" if spends(law, number, bound) else "no",
                ]
            )
        unit = write.unit(result.units(metric))
        title = f"{write.name(result.quantity(metric))} {bound['bound']:g} {unit}"
        blocks.append(Block(title.strip(), rows))
    caption = "What the tuned laws spend, as a share of what they should"
    header = ["law", "on the training runs", "on the held-out runs", "equal"]
    return TextTable("spent", caption, header, [block for block in blocks if block.rows])


EQUAL = 0.011
"""Largest difference of what a law spends on training runs: 1 %, and the rounding of a ratio."""


def spends(law: Record, number: int, bound: Record) -> bool:
    """Whether a law spends what it should, on every training sample."""
    measured = [x["measured"][number] for x in law["searches"] if x["label"] is not None]
    return all(abs(x / bound["bound"] - 1) <= EQUAL for x in measured)


def unequal(record: Record) -> list[str]:
    """Say which laws do not spend what they should."""
    lines = []
    for number, bound in enumerate(record["constraints"]):
        if not bound["equal"]:
            continue
        for law in record["laws"]:
            measured = [x["measured"][number] for x in law["searches"] if x["label"] is not None]
            if measured and not spends(law, number, bound):
                ends = [x / bound["bound"] for x in (min(measured), max(measured))]
                share = " to ".join(dict.fromkeys(fixed(end, 2) for end in ends))
                why = [_less(law)] if ends[0] < 1 - EQUAL else []
                if ends[1] > 1 + EQUAL:
                    why += ["no gains in its ranges spend less"]
                lines.append(
                    f"{law_title(law['label'])} spends {share} of {bound['metric']} "
                    f"{bound['bound']:g}: {'; on some samples '.join(why)}. It is compared at what "
                    "it spends."
                )
    return lines


def _less(law: Record) -> str:
    """Say why a law spends less than it may."""
    if unfinished(gains_of(law)):
        return "its search is not finished"
    tops = [
        key.rpartition(".")[2]
        for key, (_, high) in law["over"].items()
        if any(
            search["values"][key] >= (1 - AT_AN_END) * high * factor(search, key)
            for search in law["searches"]
            if search["label"] is not None
        )
    ]
    if tops:
        return f"its ranges hold no gains that spend more ({listed(tops)} at the upper end)"
    return "its error is no lower with more"


AT_AN_END = 0.01
"""Distance from an end of its range within which a value is at it, as a share of the end and of the
range: searches come about so close to a best value at an end."""


def factor(search: Record, key: str) -> float:
    """Return the number whose multiples the range of a key has; 1 for most."""
    return float(search.get("units", {}).get(key, 1.0))


def answer_record(of_pairs: Sequence[Ratio]) -> list[dict[str, Any]]:
    """Return the pairs for programs."""
    return [{**vars(pair), "verdict": pair.verdict} for pair in of_pairs]


def endings(record: Record) -> list[str]:
    """Say which searches are not finished, of samples enough for verdicts."""
    if record["samples"] < FEWEST_SAMPLES:
        return []
    laws = [law for law in record["laws"] if law["winners"]]
    said = [
        ending(law_title(x["label"]), gains_of(x), record["budget"], len(x["over"])) for x in laws
    ]
    return [f"{one[:1].upper()}{one[1:]}." for one in said if one]


def said_first(result: Result, record: Record) -> list[str]:
    """Return what is said before any verdict: that a search failed, or is not finished."""
    return [*worse_than_started(result, record), *endings(record)]


def worse_than_started(result: Result, record: Record) -> list[str]:
    """Say which tuned laws do worse on the held-out runs than at their starting gains."""
    (metric,), lines = record["objectives"], []
    values, quantity = result.counted(metric), result.quantity(metric)
    for law in record["laws"]:
        if not law["over"] or not law["winners"]:
            continue
        tuned = values[list(rows_of(result, law).values())]
        start = np.broadcast_to(values[result.labels.index(law["start"])], tuned.shape)
        pair = paired(tuned, start, law["label"], law["start"], metric, quantity.better)
        pair = pair if quantity.better != "higher" else pair.swapped
        if pair.value > 1 + NEGLIGIBLE and not pair.low <= 1:
            title = law_title(law["label"])
            lines.append(
                f"{title} is WORSE at its tuned gains than at its starting gains: {pair.percent} "
                f"of {metric} on the held-out runs{_spent_at_start(result, record, law)}."
            )
    return lines


def _spent_at_start(result: Result, record: Record, law: Record) -> str:
    """Say which bounds the starting gains do not keep on the held-out runs."""
    beyond = []
    for bound in record["constraints"]:
        mean = float(np.nanmean(result.counted(bound["metric"])[result.labels.index(law["start"])]))
        if mean > bound["bound"] if bound["above"] else mean < bound["bound"]:
            beyond.append(f"{bound['metric']} {mean:.3g} where {bound['bound']:g} is the bound")
    return f"; the starting gains have {listed(beyond)}" if beyond else ""
