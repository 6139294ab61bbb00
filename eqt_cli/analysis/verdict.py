"""A comparison in sentences: which law is better, how surely, what is open, which claims hold."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal

import numpy as np

from eqt_cli.analysis.comparison import ClaimVerdict, Comparison, Judgement
from eqt_cli.analysis.intervals import FEWEST, SHARE, Level, Pair, Word, holm
from eqt_cli.base.reporting import (
    BETTER_MARK,
    WORSE_MARK,
    Block,
    TextTable,
    count_of,
    fixed,
    listed,
    percent,
    significant,
)
from eqt_cli.results.metrics import AXIS
from eqt_cli.results.quantity import LAST_RESORT, Plain
from eqt_cli.results.result import PerRun

SETTLING = ("settled", "settling_time")
"""The share of runs that settle, and the time that they take."""


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


def lines(comparison: Comparison, against: str = "") -> list[str]:
    """Return the whole answer, the rows of `matrix` as sentences."""
    table = matrix(comparison, against)
    rows = [
        f"{law}: {', '.join(map(' '.join, zip(table.header[1:], cells, strict=True)))}"
        for law, *cells in table.rows
    ]
    return [*premises(comparison), *rows, *remarks(comparison, against), *table.notes]


def premises(comparison: Comparison) -> list[str]:
    """Return what a reader must know before any verdict."""
    alike, laws = [too_few(comparison)] * comparison.identical, dict[str, list[str]]()
    for label, words in comparison.gains.items():
        laws.setdefault(words, []).append(comparison.titles[label])
    gains = [f"gains are not matched: {', '.join(who)}: {words}" for words, who in laws.items()]
    return [*comparison.between, *alike, *gains]


def matrix(comparison: Comparison, against: str = "", *, whole: bool = False) -> TextTable:
    """Return a row per law, with its error, its cost and how many of its runs settle.

    Of the law that the others are compared with, the means; of the others, the median difference
    and its interval, marked where the answer is *better* or *worse*.

    Parameters
    ----------
    against
        Label of the law that all others are compared with; the first one if empty.
    whole
        Whether all numbers have a column.
    """
    titles, rows, shown = comparison.titles, list[list[str]](), list[PerRun]()
    laws, bases = _by_law(comparison, against), set[str]()
    levels = {(id(x.measured), x.controller): x for x in comparison.levels}
    for _, of_law in laws:
        first = of_law if whole else [*_headline(of_law), *_settling(of_law, comparison)]
        numbers = [answer.pair.measured for answer in first]
        shown += [x for x in numbers if not any(x is one for one in shown)]
    for law, of_law in laws:
        base, by_number = of_law[0].pair.second, {id(x.pair.measured): x for x in of_law}
        if base not in bases:
            rows.append([titles[base], *(_mean(levels[id(number), base]) for number in shown)])
        bases.add(base)
        label = of_law[0].pair.first
        cells = (  # a number of L is not compared with that of another function L
            _cell(by_number[id(x)], levels[id(x), label]) if id(x) in by_number else "-"
            for x in shown
        )
        rows.append([law, *cells])
    header = ["law", *names_of(shown, comparison)]
    blocks = [Block("", rows)] if rows else []
    return TextTable("verdict", "", header, blocks, list(_meaning(comparison, against)))


def _settling(of_law: Sequence[Answer], comparison: Comparison) -> list[Answer]:
    """Return the share of runs that settle; where all do, the time that they take."""
    share, time = SETTLING
    levels = (x.mean for x in comparison.levels if x.measured.quantity.name == share)
    shown = time if min(levels, default=1.0) == 1.0 else share
    return [x for x in of_law if x.pair.measured.quantity.name == shown]


def _cell(answer: Answer, level: Level) -> str:
    """``−14 % [−15, −11] ▲``; of a law with no interval, the difference of the means."""
    pair = answer.pair
    text = _times(pair) or _mean(level)
    if math.isfinite(pair.low):
        text = pair.percent.replace("points", "pp")
    marks = {Word.BETTER: f" {BETTER_MARK}", Word.WORSE: f" {WORSE_MARK}"}
    return text + marks.get(answer.word, "") * answer.decided


def _mean(level: Level) -> str:
    """``32.9 deg``; of runs that settle, how many; ``-`` where all runs failed."""
    if not math.isfinite(level.mean):
        return "-"
    if level.measured.quantity.counts:
        return f"{round(level.mean * level.runs)} of {level.runs}"
    return f"{significant(level.mean)} {Plain().unit(level.measured.unit)}".rstrip()


def remarks(comparison: Comparison, against: str = "", *, whole: bool = False) -> list[str]:
    """Return what `matrix` leaves open: what else differs, failures, and the claims of papers."""
    conclusions, titles, runs = answers(comparison, against), comparison.titles, comparison.runs
    also, open_ = dict[str, list[str]](), list[str]()
    for law, of_law in _by_law(comparison, against):
        for words in () if whole else _also(of_law, comparison):
            also.setdefault(words, []).append(law)
        for pair, against_it in ((x.pair, x.contradicted) for x in _headline(of_law)):
            if against_it:
                better, worse = pair.better_in
                side = f"better in {better}" if better >= worse else f"worse in {worse}"
                what = pair.measured.quantity.plain
                open_.append(f"{law}: {what} {side} of {pair.runs}, but {against_it}")
    sentences = [f"{listed(laws)} also {words}" for words, laws in also.items()] + open_
    untold = (label for label in comparison.not_matched if label not in comparison.gains)
    if alone := ", ".join(titles[label] for label in untold):
        tuning = "`eqt tune CONFIG` tunes all laws alike"
        sentences.append(f"gains are not tuned alike: {alone}; {tuning}")
    within = [x.pair.measured for x in conclusions if unresolved(x.pair, comparison.resolution)]
    if names := ", ".join(dict.fromkeys(names_of(within, comparison))):
        estimate = f"the error estimate of {comparison.resolution:.1g}"
        sentences.append(f"not judged, as both are within {estimate}: {names}")
    failed = [f"{titles[k]} {count} of {runs}" for k, count in comparison.failed.items() if count]
    if failed:
        sentences.append(f"failed runs, no part of means: {', '.join(failed)}")
    home = replace(comparison, judgements=[x for x in comparison.judgements if x.is_at_home])
    if home.judgements and not home.departures:
        counts = Counter(finding.verdict for finding in findings(home))
        verdicts = "; ".join(f"{count} {verdict}" for verdict, count in counts.items())
        sentences.append(f"claims of {sources(home)}: {verdicts} (`--table claims`)")
    return sentences


def _by_law(comparison: Comparison, against: str) -> list[tuple[str, list[Answer]]]:
    """Return the title and the answers of each law but those that it is compared with."""
    conclusions = answers(comparison, against)
    by_law = (
        (comparison.titles[label], [x for x in conclusions if x.pair.first == label])
        for label in comparison.labels
    )
    return [(title, of_law) for title, of_law in by_law if of_law]


def _also(of_law: Sequence[Answer], comparison: Comparison) -> Iterator[str]:
    """Name the decided numbers that do not repeat those of the matrix, by word."""
    headline = _headline(of_law)
    marked = {(_topic(x), x.word) for x in headline if x.decided}
    for word in (Word.BETTER, Word.WORSE):
        others = [
            x.pair.measured
            for x in of_law
            if x.decided and x.word is word and x not in headline
            if (_topic(x), word) not in marked and x.pair.measured.quantity.name not in SETTLING
        ]
        if others:
            yield f"{word} in {', '.join(names_of(others, comparison))}"


def _topic(answer: Answer) -> str:
    """Return what a number is about: errors of attitude and position are all about the pose."""
    [signal, *_] = answer.pair.measured.quantity.signals or ("",)
    is_of_pose = signal.startswith(("pose_error", "attitude_angle", "position_error", AXIS))
    return "pose" if is_of_pose else signal.partition("_norm")[0]


def _headline(conclusions: Sequence[Answer]) -> list[Answer]:
    """Return the answers by which a law is compared first; without one, the first."""
    return [*_of_role(conclusions, "error"), *_of_role(conclusions, "cost")] or [*conclusions[:1]]


def _of_role(conclusions: Sequence[Answer], role: Literal["error", "cost"]) -> list[Answer]:
    """Return the answers about the errors, or the costs, by which laws are compared first."""

    def rank(answer: Answer) -> int:
        return answer.pair.measured.quantity.rank

    of_role = [x for x in conclusions if x.pair.measured.quantity.role == role]
    ranked = sorted(of_role, key=rank)
    ranked = [x for x in ranked if rank(x) < LAST_RESORT] or ranked
    return [x for x in ranked if x.pair.measured.window == ranked[0].pair.measured.window]


def _times(pair: Pair) -> str:
    """Return the relative difference of the means; in times where it is more than double."""
    if pair.measured.is_share or not math.isfinite(pair.relative):
        return ""
    if pair.relative > 1:
        return f"{1 + pair.relative:.3g} times"
    return f"{fixed(100 * pair.relative, 0, signed=True).replace('-', '−')} %"


def names_of(numbers: Sequence[PerRun], comparison: Comparison) -> list[str]:
    """Return the numbers, each with its window unless that is the whole run."""
    names = []
    for measured in numbers:
        window, name = measured.seen, measured.quantity.plain
        whole = math.isclose(window.stop - window.start, comparison.horizon)
        names.append(name if whole else f"{name} {Plain().window(window)}")
    return names


def _meaning(comparison: Comparison, against: str) -> Iterator[str]:
    """Say of how many runs, and what the marks mean."""
    if comparison.identical:
        return
    if comparison.runs < FEWEST:
        yield too_few(comparison)
        return
    # Each of n runs the same way has p = 2/2^n, of which Holm's smallest is `count` times as much.
    count = sum(answer.p_value >= 0 for answer in answers(comparison, against))
    if not (tests := count * comparison.points):
        return
    enough = math.ceil(math.log2(2 * tests / (1 - comparison.confidence)))
    if comparison.runs < enough:
        yield (
            f"{comparison.runs} runs are too few to call any of {count} numbers better or worse: "
            f"take {enough} or more (`ensemble.runs`), or fewer numbers (`--metric`)"
        )
    starts = "" if comparison.between else " from the same starts"
    first, it = comparison.titles[against or comparison.labels[0]], "it"
    if comparison.bases:
        first, it = "the laws of the first result", "them"
    sure, none = f"{100 * comparison.confidence:g} %", f"±{100 * comparison.negligible:g} %"
    marks = f"{BETTER_MARK} better, {WORSE_MARK} worse: in most runs"
    yield (
        f"{runs_each(comparison)}{starts}; of {first}, the means; of the others, median "
        f"differences from {it}, with {sure} intervals; {marks}, by a sign test, corrected for "
        f"{count_of(tests, 'test')}; no mark: undecided, or within {none}"
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
