"""A comparison in sentences: which law is better, how surely, what is open, which claims hold."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import numpy as np

from eqt_cli.analysis.comparison import ClaimVerdict, Comparison, Judgement
from eqt_cli.analysis.intervals import FEWEST, SHARE, Level, Pair, Word, holm, sign_test
from eqt_cli.base.reporting import count_of, listed, percent, significant
from eqt_cli.results.quantity import LAST_RESORT, Plain
from eqt_cli.results.result import PerRun

MOST_NAMES = 6
"""Most undecided numbers of a law that are named."""


@dataclass(frozen=True)
class Answer:
    """A number of two laws, in a word.

    Attributes
    ----------
    pair
        The difference from the law with which all are compared, which is the second.
    word
        The word for the first law, by the interval of this number alone.
    p_value
        Of the test that each law is better in half of the runs (sign test; McNemar's for shares of
        runs), adjusted after Holm (1979) for all answers.
    decided
        Whether the word may stand without the others: for *better* and *worse*, most runs and the
        adjusted test must say so, too.
    """

    pair: Pair
    word: Word
    p_value: float
    decided: bool


def answers(comparison: Comparison, against: str = "") -> list[Answer]:
    """Return what is known of all other laws against one, by default the first.

    Of two results, each law of the second is compared with its base in the first.

    With probability `confidence`, none of the decided *better* and *worse* is false, if each run
    may as well have gone the other way.
    """
    base = against or comparison.labels[0]
    bases = comparison.bases or dict.fromkeys(comparison.labels, base)
    pairs = [
        pair
        for pair in comparison.against(base)
        if pair.second == bases.get(pair.first) and pair.measured.quantity.better != "neither"
    ]
    p_values = holm(np.array([_p_value(pair) for pair in pairs]))
    conclusions = []
    for pair, p in zip(pairs, p_values, strict=True):
        said, (first, second) = pair.word(comparison.negligible), pair.better_in
        leads = first > second if said is Word.BETTER else second > first
        sure = said in (Word.BETTER, Word.WORSE) and leads and p <= 1 - comparison.confidence
        conclusions.append(Answer(pair, said, float(p), bool(sure or said is Word.ALIKE)))
    return conclusions


def _p_value(pair: Pair) -> float:
    if pair.p_value is not None:
        return pair.p_value
    return sign_test(*pair.better_in) if pair.pairs else math.nan


# The answer in words ------------------------------------------------------------------------------


def lines(comparison: Comparison, against: str = "", *, claims: bool = False) -> list[str]:
    """Return the answer: for each other law its error, its cost and what else is decided.

    Then what is open, which laws failed or did not settle, and what the words mean.

    Parameters
    ----------
    against
        Label of the law that all others are compared with; the first one if empty.
    claims
        Whether to say how the claims of papers come out.
    """
    conclusions, titles = answers(comparison, against), comparison.titles
    made, undecided = list[str](), list[str]()
    for label in comparison.labels:
        of_law = [each for each in conclusions if each.pair.first == label]
        first = [*_first(of_law, "error"), *_first(of_law, "cost")] or of_law[:1]
        others = [each for each in of_law if each not in first]
        if of_law:
            made.append(f"{titles[label]} against {titles[of_law[0].pair.second]}")
        made += [f"  {_in_full(each, comparison)}" for each in first]
        for said in (Word.BETTER, Word.WORSE, Word.ALIKE):
            of_word = [each for each in others if each.decided and each.word is said]
            made += [f"  also {said}: {_names(of_word, comparison.horizon)}"] * bool(of_word)
        left = [x for x in others if not x.decided and x.pair.ties < x.pair.pairs]
        if left and comparison.runs >= FEWEST:
            names = _names(left, comparison.horizon, MOST_NAMES)
            names = names if len(left) < len(others) else "all else"
            undecided.append(f"{titles[label]}: {names}")
    if alone := ", ".join(titles[label] for label in comparison.not_matched):
        made.append(f"gains are not tuned alike: {alone}; `eqt tune CONFIG` tunes all laws alike")
    made += [f"undecided: {'; '.join(undecided)}"] * bool(undecided)
    made += _troubles(comparison)
    made += _claimed(comparison) if claims else ()
    tested = sum(each.p_value >= 0 for each in conclusions)
    return [*comparison.between, *made, *_meaning(comparison, tested)]


def _first(conclusions: Sequence[Answer], role: Literal["error", "cost"]) -> list[Answer]:
    """Return the answers about the errors, or the costs, by which laws are compared first."""

    def rank(answer: Answer) -> int:
        return answer.pair.measured.quantity.rank

    of_role = [each for each in conclusions if each.pair.measured.quantity.role == role]
    ranked = sorted(of_role, key=rank)
    ranked = [each for each in ranked if rank(each) < LAST_RESORT] or ranked
    window = {each.pair.measured.window for each in ranked[:1]}
    return [each for each in ranked if each.pair.measured.window in window]


def _in_full(answer: Answer, comparison: Comparison) -> str:
    """``better: mean attitude error −16 % [−19, −13], in 167 of 200 runs, p < 1e-20``.

    Without an interval, ``mean attitude error +38 % (4.437 against 3.216 deg)``.
    """
    pair, (first, second) = answer.pair, answer.pair.better_in
    said = answer.word if answer.decided else Word.UNDECIDED
    if not math.isfinite(pair.low):
        means = {x.controller: x.mean for x in comparison.levels if x.measured is pair.measured}
        both = " against ".join(significant(means[law]) for law in (pair.first, pair.second))
        unit = Plain().unit(pair.measured.unit)
        return f"{pair.measured.quantity.plain} {pair.percent} ({both} {unit}".rstrip() + ")"
    what = f"{said}: {pair.measured.quantity.plain} {pair.percent}"
    if said is Word.ALIKE:
        return what
    ahead = max(first, second) if said is Word.UNDECIDED else (first, second)[said is Word.WORSE]
    p = "p < 1e-20" if answer.p_value < 1e-20 else f"p = {answer.p_value:.1g}"
    return f"{what}, in {ahead} of {pair.pairs} runs, {p}"


def _names(conclusions: Sequence[Answer], horizon: float, most: int | None = None) -> str:
    def name(pair: Pair) -> str:
        window = pair.measured.seen
        whole = math.isclose(window.stop - window.start, horizon)
        return pair.measured.quantity.plain + ("" if whole else f" {Plain().window(window)}")

    more = [] if most is None or len(conclusions) <= most else [f"{len(conclusions) - most} more"]
    return ", ".join([*(name(each.pair) for each in conclusions[:most]), *more])


def _troubles(comparison: Comparison) -> Iterator[str]:
    """Say which laws failed, and which did not settle, in how many runs."""
    titles, runs = comparison.titles, comparison.runs
    failed = [f"{titles[k]} {count} of {runs}" for k, count in comparison.failed.items() if count]
    if failed:
        yield f"failed runs, left out: {', '.join(failed)}"
    yield from unsettled(comparison)


def _claimed(comparison: Comparison) -> Iterator[str]:
    """Say how many claims have which verdict."""
    if comparison.judgements and not comparison.departures:
        counts = Counter(each.verdict for each in findings(comparison))
        verdicts = "; ".join(f"{count} {each}" for each, count in counts.items())
        yield f"claims of {sources(comparison)}: {verdicts}"


def _meaning(comparison: Comparison, count: int) -> Iterator[str]:
    """Say of how many runs, and what the words mean."""
    if not count:
        return
    if comparison.runs < FEWEST:
        yield too_few(comparison)
        return
    # Each of n runs the same way has p = 2/2^n, of which Holm's smallest is `count` times as much.
    enough = math.ceil(math.log2(2 * count / (1 - comparison.confidence)))
    if comparison.runs < enough:
        yield (
            f"{comparison.runs} runs are too few to call any of {count} numbers better or worse: "
            f"take {enough} or more (`ensemble.runs`), or fewer numbers (`--metric`)"
        )
    starts = "" if comparison.between else " from the same starts"
    sure, none = f"{100 * comparison.confidence:g} %", f"±{100 * comparison.negligible:g} %"
    yield (
        f"{runs_each(comparison)}{starts}; better or worse where {sure} intervals and sign tests "
        f"(Holm, {count} numbers) agree; within {none} is no difference"
    )


def runs_each(comparison: Comparison) -> str:
    """Return how many runs each law has, in words."""
    return f"{count_of(comparison.runs, 'run')} per law"


def too_few(comparison: Comparison) -> str:
    """Say that there are no statistics."""
    return f"{runs_each(comparison)}: too few for statistics; `ensemble.runs` sets how many"


def unsettled(comparison: Comparison) -> Iterator[str]:
    """Say which laws did not settle, in how many runs, if any."""
    late = [
        f"{comparison.titles[each.controller]} {round((1 - each.mean) * each.runs)} of {each.runs}"
        for each in comparison.levels
        if each.measured.quantity.name == "settled" and each.mean < 1
    ]
    if late:
        yield f"runs that did not settle, by law: {', '.join(late)}"


# The claims of papers, each in a sentence ---------------------------------------------------------


PARTLY = "partly"
"""Prefix of a verdict that only some rows of a claim have."""

_WRITE = Plain()


@dataclass(frozen=True)
class Finding:
    """A sentence about a claim.

    Attributes
    ----------
    verdict
        Verdict of the claim as in `ClaimVerdict`, after `PARTLY` if its rows differ.
    claim
        The claim in the words of its source; empty if all claims have this verdict.
    words
        The measured numbers in words.
    absent
        Laws that the claim mentions and the result does not have.
    """

    verdict: str
    claim: str
    words: str
    absent: str = ""


def findings(comparison: Comparison) -> list[Finding]:
    """Return one finding for each claim; a single one where the loop departs from all of them."""
    if comparison.judgements and comparison.departures:
        words = f"claims of {sources(comparison)}. Beyond their theorems: {comparison.departures}."
        return [Finding(str(ClaimVerdict.NOT_COVERED), "", words)]
    claimed = groupby(comparison.judgements, key=lambda judgement: judgement.says)
    return [_of_claim(comparison, says, list(rows)) for says, rows in claimed]


def sources(comparison: Comparison) -> str:
    """Return the sources of the claims."""
    return "; ".join(dict.fromkeys(row.source for row in comparison.judgements))


def _of_claim(comparison: Comparison, says: str, rows: Sequence[Judgement]) -> Finding:
    verdict, titles = _together({row.verdict for row in rows}), comparison.titles
    in_every_run = [row for row in rows if row.pair is None]
    compared = [row for row in rows if row.pair is not None]
    words = [*_in_every_run(comparison, in_every_run), *_compared(compared, titles)]
    absent = [titles.get(kind, kind) for kind in rows[0].absent]
    return Finding(verdict, says, "; ".join(words) + ".", listed(absent) if absent else "")


def _together(verdicts: set[ClaimVerdict]) -> str:
    """Combine the verdicts of the rows of a claim."""
    if len(verdicts) == 1:
        return str(*verdicts)
    supported = ClaimVerdict.SUPPORTED
    return f"{PARTLY} {supported}" if supported in verdicts else str(ClaimVerdict.NOT_SUPPORTED)


def _in_every_run(comparison: Comparison, rows: Sequence[Judgement]) -> Iterator[str]:
    """Yield each statement and the number of runs in which it held; equal counts are grouped."""
    for (statement, held, runs, low, open_), alike in groupby(
        rows,
        key=lambda row: (
            *(row.statement, row.held, row.runs, row.low),
            row.verdict is ClaimVerdict.UNDECIDED,
        ),
    ):
        more = f", and {100 * SHARE:g} % is needed" if open_ else ""
        laws = listed([comparison.titles[row.controller] for row in alike])
        yield (
            f"{statement}: {held} of {runs} runs under {laws}, so it holds for at least "
            f"{100 * low:.1f} % of all initial states ({100 * comparison.confidence:g} % "
            f"confidence){more}"
        )


def _compared(rows: Sequence[Judgement], titles: Mapping[str, str]) -> Iterator[str]:
    """Yield the differences; of several, the number that agree and those that do not."""
    if len(rows) < 2:
        yield from (_difference_in_words(row.pair, titles) for row in rows if row.pair)
        return
    counts = Counter(row.verdict for row in rows)
    against, open_ = counts[ClaimVerdict.NOT_SUPPORTED], counts[ClaimVerdict.UNDECIDED]
    others = f", {open_} {'is' if open_ == 1 else 'are'} undecided" if open_ else ""
    yield f"{counts[ClaimVerdict.SUPPORTED]} of {len(rows)} comparisons agree with it{others}"
    verdict = ClaimVerdict.NOT_SUPPORTED if against or open_ else ClaimVerdict.SUPPORTED
    pairs = [row.pair for row in rows if row.verdict is verdict]
    yield from (_difference_in_words(pair, titles) for pair in pairs if pair)


def _difference_in_words(pair: Pair, titles: Mapping[str, str]) -> str:
    """``EqT has 13.5 % less mean ‖τ‖ over 0–5 s than GT (−0.283 [−0.346, −0.219] N m)``."""
    first, second = titles[pair.first], titles[pair.second]
    what = _measure_in_words(pair.measured)
    number = _number(pair, pair.difference)
    word = pair.word()
    if word in (Word.ALIKE, Word.UNDECIDED) and math.isfinite(pair.low):
        return f"{word} between {first} and {second}: {what} ({number})"
    share = f"{percent(abs(pair.relative))} " if math.isfinite(pair.relative) else ""
    more = "more" if pair.difference > 0 else "less"
    return f"{first} has {share}{more} {what} than {second} ({number})"


def _measure_in_words(measured: PerRun) -> str:
    of = "share of runs " if measured.quantity.counts else ""
    return f"{of}{_WRITE.name(measured.quantity)} over {_WRITE.window(measured.seen)}"


def _number(row: Pair | Level, value: float) -> str:
    unit = _WRITE.unit(row.measured.unit)
    return " ".join(filter(None, [_WRITE.interval(value, row.low, row.high), unit]))
