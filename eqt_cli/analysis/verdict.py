"""The answer of a comparison: which law is better, by how much, how surely, and what is open."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from eqt_cli.analysis.compare import Comparison
from eqt_cli.analysis.comparison_tables import findings, sources
from eqt_cli.analysis.intervals import FEWEST, Pair, holm, sign_test
from eqt_cli.results.quantity import Plain

NEGLIGIBLE = 0.01
"""Relative difference that nobody minds; of shares of runs, one point of 100."""

ERRORS = ("position_rms", "mean_attitude_error", "mean_pose_error")
"""Errors by which laws are compared first; the first one that a result knows."""

COSTS = ("effort", "early_torque")
"""The same for what they cost."""


class Word(StrEnum):
    """What the interval of a relative difference says of a law against another one."""

    BETTER = "better"
    WORSE = "worse"
    ALIKE = "no difference"
    UNDECIDED = "undecided"


def word(pair: Pair, negligible: float = NEGLIGIBLE) -> Word:
    """Return the word for the first law of a pair against the second.

    *No difference* if the interval lies within ±`negligible`, else *better* or *worse* if it lies
    on one side of 0.
    """
    low, high = _relative(pair, pair.low), _relative(pair, pair.high)
    if max(abs(low), abs(high)) <= negligible:
        return Word.ALIKE
    if pair.measured.quantity.better == "neither" or not (low > 0 or high < 0):
        return Word.UNDECIDED
    less_is_better = pair.measured.quantity.better == "lower"
    return Word.BETTER if (high < 0) == less_is_better else Word.WORSE


def _relative(pair: Pair, value: float) -> float:
    """Return a difference over the mean of the second law; one of shares as it is."""
    of = 1.0 if pair.measured.quantity.counts else abs(pair.mean_second)
    return value / of if of else math.nan


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


def answers(
    comparison: Comparison, against: str = "", negligible: float = NEGLIGIBLE
) -> list[Answer]:
    """Return what is known of all other laws against one, by default the first.

    With probability `confidence`, none of the decided *better* and *worse* is false, if each run
    may as well have gone the other way.
    """
    base = against or comparison.labels[0]
    pairs = [
        pair if pair.second == base else pair.swapped()
        for pair in comparison.pairs
        if base in (pair.first, pair.second) and pair.measured.quantity.better != "neither"
    ]
    p_values = holm(np.array([_p_value(pair) for pair in pairs]))
    found = []
    for pair, p in zip(pairs, p_values, strict=True):
        said, (first, second) = word(pair, negligible), pair.better_in
        leads = first > second if said is Word.BETTER else second > first
        sure = said in (Word.BETTER, Word.WORSE) and leads and p <= 1 - comparison.confidence
        found.append(Answer(pair, said, float(p), bool(sure or said is Word.ALIKE)))
    return found


def _p_value(pair: Pair) -> float:
    if pair.p_value is not None:
        return pair.p_value
    return sign_test(*pair.better_in) if pair.pairs else math.nan


# The answer in words ------------------------------------------------------------------------------


def lines(
    comparison: Comparison,
    against: str = "",
    negligible: float = NEGLIGIBLE,
    *,
    claims: bool = False,
) -> list[str]:
    """Return the answer: for each other law its error, its cost and what else is decided.

    Then what is open, which laws failed or did not settle, and what the words mean.

    Parameters
    ----------
    against
        Label of the law that all others are compared with; the first one if empty.
    negligible
        Relative difference within which there is none.
    claims
        Whether to say how the claims of papers come out.
    """
    base = against or comparison.labels[0]
    found, titles = answers(comparison, base, negligible), comparison.titles
    made, undecided = list[str](), list[str]()
    for label in comparison.labels:
        of_law = [each for each in found if each.pair.first == label]
        first = [each for names in (ERRORS, COSTS) for each in _headline(of_law, names)]
        others = [each for each in of_law if each not in first]
        if of_law:
            made.append(f"{titles[label]} against {titles[base]}")
        made += [f"  {_in_full(each)}" for each in first]
        for said in (Word.BETTER, Word.WORSE, Word.ALIKE):
            of_word = [each for each in others if each.decided and each.word is said]
            made += [f"  also {said}: {_names(of_word, comparison.horizon)}"] * bool(of_word)
        if left := [each for each in others if not each.decided]:
            undecided.append(f"{titles[label]}: {_names(left, comparison.horizon)}")
    made += [f"undecided: {'; '.join(undecided)}"] * bool(undecided)
    made += _troubles(comparison)
    made += _claimed(comparison) if claims else ()
    return [*made, *_meaning(comparison, len(found), negligible)]


def _headline(found: Sequence[Answer], names: Sequence[str]) -> list[Answer]:
    """Return the answers about the first of these numbers that is known, by parts if it has any."""
    for name in names:
        of_name = [each for each in found if each.pair.measured.quantity.name.startswith(name)]
        if of_name:
            first = of_name[0].pair.measured
            return [each for each in of_name if each.pair.measured.window == first.window]
    return []


def _in_full(answer: Answer) -> str:
    """``better: mean attitude error −16 % [−19, −13], in 167 of 200 runs, p < 1e-20``."""
    pair, (first, second) = answer.pair, answer.pair.better_in
    said = answer.word if answer.decided else Word.UNDECIDED
    if not math.isfinite(pair.low):
        return f"{pair.measured.quantity.plain} {_percent(pair)}"
    what = f"{said}: {pair.measured.quantity.plain} {_percent(pair)}"
    if said is Word.ALIKE:
        return what
    ahead = max(first, second) if said is Word.UNDECIDED else (first, second)[said is Word.WORSE]
    p = "p < 1e-20" if answer.p_value < 1e-20 else f"p = {answer.p_value:.1g}"
    return f"{what}, in {ahead} of {pair.pairs} runs, {p}"


def _percent(pair: Pair) -> str:
    """``−16 % [−19, −13]``; a difference of shares of runs is in points of 100."""
    unit = "points" if pair.measured.quantity.counts else "%"
    values = [100 * _relative(pair, x) for x in (pair.difference, pair.low, pair.high)]
    if not math.isfinite(values[0]):
        return "(no share of 0)"
    half = (values[2] - values[1]) / 2
    digits = min(max(0, -math.floor(math.log10(half / 2))), 2) if half > 0 else 0
    mean, *ends = (f"{value:+.{digits}f}".replace("-", "−") for value in values)
    return f"{mean} {unit} [{', '.join(ends)}]" if math.isfinite(half) else f"{mean} {unit}"


def _names(found: Sequence[Answer], horizon: float) -> str:
    def name(pair: Pair) -> str:
        window = pair.measured.window
        whole = math.isclose(window.stop - window.start, horizon)
        return pair.measured.quantity.plain + ("" if whole else f" {Plain().window(window)}")

    return ", ".join(name(each.pair) for each in found)


def _troubles(comparison: Comparison) -> Iterator[str]:
    """Say which laws failed, and which did not settle, in how many runs."""
    titles, runs = comparison.titles, comparison.runs
    failed = [f"{titles[k]} {count} of {runs}" for k, count in comparison.failed.items() if count]
    settled = [each for each in comparison.levels if each.measured.quantity.name == "settled"]
    late = [
        f"{titles[each.controller]} {round((1 - each.mean) * each.runs)} of {each.runs}"
        for each in settled
        if each.mean < 1
    ]
    if failed:
        yield f"failed runs, left out: {', '.join(failed)}"
    if late:
        yield f"not settled at the end: {', '.join(late)}"
    if comparison.not_matched:
        laws = ", ".join(titles[label] for label in comparison.not_matched)
        yield f"gains are not tuned alike: {laws}; eqt tune does that"


def _claimed(comparison: Comparison) -> Iterator[str]:
    """Say how many claims have which verdict."""
    if comparison.judgements and not comparison.departures:
        counts = Counter(each.verdict for each in findings(comparison))
        verdicts = "; ".join(f"{count} {each}" for each, count in counts.items())
        yield f"claims of {sources(comparison)}: {verdicts}"


def records(
    comparison: Comparison, against: str = "", negligible: float = NEGLIGIBLE
) -> list[dict[str, Any]]:
    """Return the answers for programs."""
    return [
        {
            "metric": each.pair.measured.quantity.name,
            "window_start": each.pair.measured.window.start,
            "window_stop": each.pair.measured.window.stop,
            "controller": each.pair.first,
            "against": each.pair.second,
            "word": str(each.word),
            "decided": each.decided,
            "p_value": each.p_value,
        }
        for each in answers(comparison, against, negligible)
    ]


def _meaning(comparison: Comparison, count: int, negligible: float) -> Iterator[str]:
    """Say of how many runs, and what the words mean."""
    runs = f"{comparison.runs} runs" if comparison.runs > 1 else "one run"
    if not count:
        return
    if comparison.runs < FEWEST:
        yield f"{runs} per law: too few for statistics; `ensemble.runs` sets how many"
        return
    sure, none = f"{100 * comparison.confidence:g} %", f"±{100 * negligible:g} %"
    yield (
        f"{runs} per law from the same starts; better or worse by intervals of {sure} and sign "
        f"tests (Holm, {count} numbers); within {none} is no difference"
    )
