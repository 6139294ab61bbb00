"""The answer of a comparison: which law is better, by how much, how surely, and what is open."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.analysis.compare import Comparison
from eqt_cli.analysis.comparison_tables import findings, runs_each, sources, too_few, unsettled
from eqt_cli.analysis.intervals import FEWEST, Pair, Word, holm, sign_test
from eqt_cli.base.reporting import significant
from eqt_cli.results.quantity import Plain

ERRORS = ("position_rms", "mean_pointing_error", "mean_attitude_error"), ("mean_pose_error",)
"""Errors by which laws are compared first; the first of these of which a result knows any."""

COSTS = ("effort",), ("early_torque",)
"""The same for what they cost."""

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
        first = [each for names in (ERRORS, COSTS) for each in _headline(of_law, names)]
        first = first or of_law[:1]
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


def _headline(conclusions: Sequence[Answer], names: Sequence[tuple[str, ...]]) -> list[Answer]:
    """Return the answers about the first of these numbers that are known, by parts if any."""
    for some in names:
        of_some = [
            each
            for name in some
            for each in conclusions
            if each.pair.measured.quantity.name.startswith(name)
        ]
        if of_some:
            window = of_some[0].pair.measured.window
            return [each for each in of_some if each.pair.measured.window == window]
    return []


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


def records(comparison: Comparison, against: str = "") -> list[dict[str, Any]]:
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
        for each in answers(comparison, against)
    ]


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
