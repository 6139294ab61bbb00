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
from eqt_cli.analysis.intervals import FEWEST, SHARE, Pair, Word, holm
from eqt_cli.base.reporting import count_of, fixed, listed, percent, significant
from eqt_cli.results.quantity import LAST_RESORT, Plain

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
        Of the test that neither law is better in more than half of the runs (sign test; McNemar's
        for shares of runs), adjusted after Holm (1979) for all answers.
    contradicted
        Why the word does not stand although a law is better in most runs.
    decided
        Whether the word may stand beside the others: for *better* and *worse*, the adjusted test
        must say so, too.
    """

    pair: Pair
    word: Word
    p_value: float
    decided: bool
    contradicted: str = ""


def answers(comparison: Comparison, against: str = "") -> list[Answer]:
    """Return what is known of all other laws against one, by default the first.

    Of two results, each law of the second is compared with its base in the first.
    """
    base = against or comparison.labels[0]
    bases = comparison.bases or dict.fromkeys(comparison.labels, base)
    pairs = [
        pair
        for pair in comparison.against(base)
        if pair.second == bases.get(pair.first) and pair.measured.quantity.better != "neither"
    ]
    conclusions, p_values = [], np.array([pair.p_value for pair in pairs])
    adjusted = np.minimum(1.0, comparison.points * holm(p_values))
    for pair, p_value in zip(pairs, adjusted.tolist(), strict=True):
        word, against, decided = pair.word(comparison.negligible), "", False
        if word is Word.ALIKE:
            decided = True
        elif p_value <= 1 - comparison.confidence:
            against = _contradicted(pair, comparison.failed)
            decided = word is not Word.UNDECIDED and not against
        decided &= not unresolved(pair, comparison.resolution)
        conclusions.append(Answer(pair, word, p_value, decided, against))
    return conclusions


def _contradicted(pair: Pair, failed: Mapping[str, int]) -> str:
    """Say what speaks against the law that is better in most runs; as on maps."""
    first, second = failed[pair.first], failed[pair.second]
    if (first > second) if np.subtract(*pair.better_in) > 0 else (second > first):
        return "with more failed runs"
    return "not in the mean" if pair.means_contradict else ""


STATE_UNITS = ("1", "rad", "deg", "m", "rad/s", "m/s")
"""Units of errors of poses and velocities, to which error estimates apply."""


def unresolved(pair: Pair, resolution: float) -> bool:
    """Whether both means are errors of a state that are within their error estimate."""
    quantity, of_state = pair.measured.quantity, pair.measured.unit in STATE_UNITS
    is_error = any("_error" in name or "attitude_angle" in name for name in quantity.signals)
    is_least = 0 < max(pair.mean_first, pair.mean_second) <= resolution
    return is_error and of_state and not quantity.counts and is_least


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
    conclusions, titles, runs = answers(comparison, against), comparison.titles, comparison.runs
    alike = [too_few(comparison)] * comparison.identical
    sentences, undecided = [*comparison.between, *alike, *_gains(comparison)], list[str]()
    for label in comparison.labels:
        of_law = [answer for answer in conclusions if answer.pair.first == label]
        if not of_law:
            continue
        sentences.append(f"{titles[label]} against {titles[of_law[0].pair.second]}")
        headline = [*_headline(of_law, "error"), *_headline(of_law, "cost")] or of_law[:1]
        sentences += [f"  {_in_full(answer, comparison)}" for answer in headline]
        others = [answer for answer in of_law if answer not in headline]
        for word in (Word.BETTER, Word.WORSE, Word.ALIKE):
            decided = [answer for answer in others if answer.decided and answer.word is word]
            if decided:
                sentences.append(f"  also {word}: {', '.join(_names(decided, comparison))}")
        if names := _undecided(others, comparison):
            undecided.append(f"{titles[label]}: {names}")
    untold = (label for label in comparison.not_matched if label not in comparison.gains)
    if alone := ", ".join(titles[label] for label in untold):
        tuning = "`eqt tune CONFIG` tunes all laws alike"
        sentences.append(f"gains are not tuned alike: {alone}; {tuning}")
    if undecided:
        sentences.append(f"undecided: {'; '.join(undecided)}")
    sentences += _within(conclusions, comparison)
    failed = [f"{titles[k]} {count} of {runs}" for k, count in comparison.failed.items() if count]
    if failed:
        sentences.append(f"failed runs, no part of means: {', '.join(failed)}")
    sentences += unsettled(comparison)
    if claims and comparison.judgements and not comparison.departures:
        counts = Counter(finding.verdict for finding in findings(comparison))
        verdicts = "; ".join(f"{count} {verdict}" for verdict, count in counts.items())
        sentences.append(f"claims of {sources(comparison)}: {verdicts}")
    tested = sum(answer.p_value >= 0 for answer in conclusions)
    return [*sentences, *(_meaning(comparison, tested) if tested else ())]


def _gains(comparison: Comparison) -> Iterator[str]:
    """Name the laws that fly with other gains, before any verdict."""
    laws = dict[str, list[str]]()
    for label, words in comparison.gains.items():
        laws.setdefault(words, []).append(comparison.titles[label])
    for words, titles in laws.items():
        yield f"gains are not matched: {', '.join(titles)}: {words}"


def _within(conclusions: Sequence[Answer], comparison: Comparison) -> Iterator[str]:
    """Name the errors that are within their estimate."""
    within = [x for x in conclusions if unresolved(x.pair, comparison.resolution)]
    if names := ", ".join(dict.fromkeys(_names(within, comparison))):
        estimate = f"the error estimate of {comparison.resolution:.1g}"
        yield f"not judged, as both are within {estimate}: {names}"


def _headline(conclusions: Sequence[Answer], role: Literal["error", "cost"]) -> list[Answer]:
    """Return the answers about the errors, or the costs, by which laws are compared first."""

    def rank(answer: Answer) -> int:
        return answer.pair.measured.quantity.rank

    of_role = [x for x in conclusions if x.pair.measured.quantity.role == role]
    ranked = sorted(of_role, key=rank)
    ranked = [x for x in ranked if rank(x) < LAST_RESORT] or ranked
    return [x for x in ranked if x.pair.measured.window == ranked[0].pair.measured.window]


def _undecided(conclusions: Sequence[Answer], comparison: Comparison) -> str:
    """Return the names of the undecided numbers, the first `MOST_NAMES` of them."""
    if comparison.identical or comparison.runs < FEWEST:
        return ""
    undecided = [x for x in conclusions if not x.decided and x.pair.ties < x.pair.runs]
    if undecided and len(undecided) == len(conclusions):
        return "all else"
    names = _names(undecided, comparison)
    if len(names) > MOST_NAMES:
        names[MOST_NAMES:] = [f"{len(names) - MOST_NAMES} more"]
    return ", ".join(names)


def _in_full(answer: Answer, comparison: Comparison) -> str:
    """``better in 167 of 200 (p<1e-20): mean attitude error, median −16 % [−19, −13]``.

    Without an interval, ``mean attitude error +38 % (4.437 against 3.216 deg)``.
    """
    pair, word = answer.pair, answer.word if answer.decided else Word.UNDECIDED
    name, middle = pair.measured.quantity.plain, "" if pair.measured.quantity.counts else ", median"
    if not math.isfinite(pair.low):
        means = {x.controller: x.mean for x in comparison.levels if x.measured is pair.measured}
        both = " against ".join(significant(means[law]) for law in (pair.first, pair.second))
        return f"{name}{_times(pair)} ({both} {Plain().unit(pair.measured.unit)}".rstrip() + ")"
    what = f"{name}{middle} {pair.percent}"
    if word is Word.ALIKE:
        return f"{word}: {what}"
    first, second = pair.better_in
    side, ahead = ("worse", second) if second > first else ("better", first)
    digits = 2 if answer.p_value > 0.01 else 1  # 0.052 is not 0.05
    p_value = "p<1e-20" if answer.p_value < 1e-20 else f"p={answer.p_value:.{digits}g}"
    most = f"{side} in {ahead} of {pair.runs} ({p_value})"
    if word is Word.UNDECIDED:
        most = f"{word}, {most}" + f", but {answer.contradicted}" * bool(answer.contradicted)
    return f"{most}: {what}"


def _times(pair: Pair) -> str:
    """Return the relative difference of the means; in times where it is more than double."""
    if pair.measured.is_share or not math.isfinite(pair.relative):
        return ""
    if pair.relative > 1:
        return f" {1 + pair.relative:.3g} times"
    return f" {fixed(100 * pair.relative, 0, signed=True).replace('-', '−')} %"


def _names(conclusions: Sequence[Answer], comparison: Comparison) -> list[str]:
    """Return the numbers, each with its window unless that is the whole run."""
    names = []
    for measured in (answer.pair.measured for answer in conclusions):
        window, name = measured.seen, measured.quantity.plain
        whole = math.isclose(window.stop - window.start, comparison.horizon)
        names.append(name if whole else f"{name} {Plain().window(window)}")
    return names


def _meaning(comparison: Comparison, count: int) -> Iterator[str]:
    """Say of how many runs, and what the words mean."""
    if comparison.identical:
        return
    if comparison.runs < FEWEST:
        yield too_few(comparison)
        return
    # Each of n runs the same way has p = 2/2^n, of which Holm's smallest is `count` times as much.
    tests = count * comparison.points
    enough = math.ceil(math.log2(2 * tests / (1 - comparison.confidence)))
    if comparison.runs < enough:
        yield (
            f"{comparison.runs} runs are too few to call any of {count} numbers better or worse: "
            f"take {enough} or more (`ensemble.runs`), or fewer numbers (`--metric`)"
        )
    starts = "" if comparison.between else " from the same starts"
    sure, none = f"{100 * comparison.confidence:g} %", f"±{100 * comparison.negligible:g} %"
    yield (
        f"{runs_each(comparison)}{starts}; better or worse: in most runs, by a sign test (p, "
        f"corrected for {count_of(tests, 'test')}); no difference: the median is within {none}; "
        f"brackets: {sure} intervals of the median"
    )


def runs_each(comparison: Comparison) -> str:
    """Return how many runs each law has, in words."""
    return f"{count_of(comparison.runs, 'run')} per law"


def too_few(comparison: Comparison) -> str:
    """Say that there are no statistics."""
    if comparison.identical:
        runs = f"all {comparison.runs} runs of each law are identical"
        return f"{runs}, so there is nothing to estimate: no intervals and no p"
    return f"{runs_each(comparison)}: too few for statistics; `ensemble.runs` sets how many"


def unsettled(comparison: Comparison) -> Iterator[str]:
    """Say which laws did not settle, in how many runs, if any."""
    titles, alike = comparison.titles, comparison.runs if comparison.identical else 1
    late = [
        f"{titles[x.controller]} {round((1 - x.mean) * x.runs * alike)} of {x.runs * alike}"
        for x in comparison.levels
        if x.measured.quantity.name == "settled" and x.mean < 1
    ]
    if late:
        yield f"runs that did not settle, by law: {', '.join(late)}"


# The claims of papers, each in a sentence ---------------------------------------------------------


PARTLY = "partly"
"""Prefix of a verdict that only some rows of a claim have."""


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
    titles, verdicts = comparison.titles, {row.verdict for row in rows}
    verdict = str(ClaimVerdict.NOT_SUPPORTED)
    if len(verdicts) == 1:
        verdict = str(*verdicts)
    elif ClaimVerdict.NOT_COMPARABLE in verdicts:
        verdict = str(ClaimVerdict.NOT_COMPARABLE)
    elif ClaimVerdict.SUPPORTED in verdicts:
        verdict = f"{PARTLY} {ClaimVerdict.SUPPORTED}"
    in_every_run = [row for row in rows if row.pair is None]
    compared = [row for row in rows if row.pair is not None]
    words = [*_in_every_run(comparison, in_every_run), *_compared(compared, titles)]
    absent = [titles.get(kind, kind) for kind in rows[0].absent]
    return Finding(verdict, says, "; ".join(words) + ".", listed(absent) if absent else "")


def _in_every_run(comparison: Comparison, rows: Sequence[Judgement]) -> Iterator[str]:
    """Yield each statement and the number of runs in which it held; equal counts are grouped."""
    for count, group in groupby(rows, key=lambda row: (row.statement, row.held, row.runs)):
        statement, held, runs = count
        first, *others = group  # alike in the rest, too
        needed = f", and {100 * SHARE:g} % is needed"
        more = needed if first.verdict is ClaimVerdict.UNDECIDED else ""
        laws = listed([comparison.titles[row.controller] for row in (first, *others)])
        yield (
            f"{statement}: {held} of {runs} runs under {laws}, so it holds for at least "
            f"{100 * first.low:.1f} % of all initial states ({100 * comparison.confidence:g} % "
            f"confidence){more}"
        )


def _compared(rows: Sequence[Judgement], titles: Mapping[str, str]) -> Iterator[str]:
    """Yield the differences; of several, the number that agree and those that do not."""
    unlike = [row for row in rows if row.verdict is ClaimVerdict.NOT_COMPARABLE]
    for row in unlike:
        if row.pair:
            yield f"{titles[row.pair.first]} has {row.statement} of {titles[row.pair.second]}"
    rows = [row for row in rows if row not in unlike]
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
    write, measured = Plain(), pair.measured
    what = f"{write.name(measured.quantity)} over {write.window(measured.seen)}"
    if measured.quantity.counts:
        what = f"share of runs {what}"
    number = f"{write.interval(pair.difference, pair.low, pair.high)} {write.unit(measured.unit)}"
    first, second, word = titles[pair.first], titles[pair.second], pair.word()
    if word in (Word.ALIKE, Word.UNDECIDED) and math.isfinite(pair.low):
        return f"{word} between {first} and {second}: {what} ({number.rstrip()})"
    share = f"{percent(abs(pair.relative))} " if math.isfinite(pair.relative) else ""
    more = "more" if pair.difference > 0 else "less"
    return f"{first} has {share}{more} {what} than {second} ({number.rstrip()})"
