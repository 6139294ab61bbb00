"""What a result shows of each requirement: a table that stands first, and a document."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import Block, TextTable, count_of, significant
from eqt_cli.base.version import GROWN_FROM
from eqt_cli.extensions.requirements import shares
from eqt_cli.extensions.requirements.errors import (
    between_samples,
    largest_changes,
    samples_of,
    share_within,
)
from eqt_cli.extensions.requirements.keys import NamedWindow, Requirement
from eqt_cli.extensions.requirements.margins import STORED
from eqt_cli.extensions.requirements.reading import (
    ANGLE,
    MARGINS,
    is_peak,
    limit_of,
    required,
    window_of,
)
from eqt_cli.results.conclusion import conclusion_of, words_of
from eqt_cli.results.quantity import WHOLE, Window
from eqt_cli.results.result import Result
from eqt_cli.results.result import window_of as window_of_metrics

WORDS = ("meets", "fails", "not shown")

MOST_POINTS = 20
"""Points of a sweep that have rows of their own."""

OF = {"ensemble": "runs", "mixed": "time over all runs"}


class Finding(NamedTuple):
    """What a result shows of a requirement and a law.

    Attributes
    ----------
    requirement, law
        Its words, and the label of the law.
    seen
        What was counted.
    statement
        What this shows.
    why
        Why it is not shown, or what would show it; "" where nothing is to be said.
    about
        The requirement, for programs.
    """

    requirement: str
    law: str
    seen: str
    statement: shares.Statement
    why: str
    about: Requirement

    @property
    def said(self) -> str:
        """The verdict, and why."""
        word = self.statement.word
        return f"{word}: {self.why}" if self.why else word

    def record(self) -> dict[str, Any]:
        """Return it for programs."""
        of = self.about.model_dump(exclude_none=True, exclude={"looks"})
        numbers = {key: value for key, value in self.statement._asdict().items() if key != "word"}
        finite = {key: value if math.isfinite(value) else None for key, value in numbers.items()}
        return {
            "controller": self.law,
            "verdict": self.statement.word,
            **of,
            **finite,
            "seen": self.seen,
            "why": self.why,
        }


@purposes.answers_of_a_result
def answers(result: Result) -> tuple[dict[str, Any], list[TextTable]] | None:
    """Return what a result shows of the requirements in its configuration; None without any."""
    config = words_of(result)
    if not config.get("require"):
        return None
    requirements, windows = required(config)
    shown = range(result.points if result.is_sweep else 1)
    at = {point: result.point(point) if result.is_sweep else result for point in shown}
    by_point = {point: list(findings(one, requirements, windows)) for point, one in at.items()}
    records = [
        ({"point": point} if result.is_sweep else {}) | finding.record()
        for point, of_point in by_point.items()
        for finding in of_point
    ]
    confidences = {requirement.confidence for requirement in requirements}
    note = _CONFIDENCE.format(*(f"{100 * level:g} %" for level in confidences))
    note = note if len(confidences) == 1 else _OWN_CONFIDENCE
    table = _table(result, by_point)
    return {"requirements": records}, [replace(table, notes=[*table.notes, note])]


def _table(result: Result, by_point: dict[int, list[Finding]]) -> TextTable:
    """Return a row per finding, below its requirement where several rows are about one."""
    by_requirement: dict[str, list[list[str]]] = {}
    many, swept = len(result.labels) > 1, result.is_sweep
    for point, of_point in by_point.items():
        for finding in of_point:
            place = [result.point_name(point)] if swept else []
            law = [result.title_of[finding.law]] if many else []
            row = [*place, *law, finding.seen, finding.said]
            by_requirement.setdefault(finding.requirement, []).append(row)
    if len(by_point) > MOST_POINTS:
        return _counted(result, by_point)
    header = [*(["point"] if swept else []), *(["law"] if many else []), "seen", "verdict"]
    words = [finding.statement.word for of_point in by_point.values() for finding in of_point]
    if many or swept:
        blocks = [Block(name, rows) for name, rows in by_requirement.items()]
    else:
        header = ["requirement", *header]
        rows = [[name, *row] for name, of_it in by_requirement.items() for row in of_it]
        blocks = [Block("", rows)]
    keys = max(1, len(header) - 2)
    return TextTable("requirements", _answer(words), header, blocks, keys=keys)


_CONFIDENCE = (
    "Verdicts are one-sided at {}, by exact tests that assume no distribution; a failed run keeps "
    "no bound."
)
_OWN_CONFIDENCE = _CONFIDENCE.format("the confidence of their requirement")


def _counted(result: Result, by_point: dict[int, list[Finding]]) -> TextTable:
    """Return a row per requirement and law, with the number of points of each verdict."""
    words: dict[str, dict[str, list[str]]] = {}
    for of_point in by_point.values():
        for finding in of_point:
            of_law = words.setdefault(finding.requirement, {})
            of_law.setdefault(finding.law, []).append(finding.statement.word)
    blocks = [
        Block(
            name,
            [
                [result.title_of[law], *(str(heard.count(word)) for word in WORDS)]
                for law, heard in of_it.items()
            ],
        )
        for name, of_it in words.items()
    ]
    every = [word for of_it in words.values() for heard in of_it.values() for word in heard]
    note = f"Numbers of points, of {len(by_point)}; --json and --point N have those of a point."
    return TextTable("requirements", _answer(every), ["law", *WORDS], blocks, [note])


def _answer(words: Sequence[str]) -> str:
    """Say how many requirements are met, over all laws."""
    counts = {word: words.count(word) for word in WORDS}
    if len(words) == counts["meets"]:
        return "Requirements: all are met" if len(words) > 1 else "The requirement is met"
    said = {"meets": "met", "fails": "failed", "not shown": "not shown"}
    listed = ", ".join(f"{count} {said[word]}" for word, count in counts.items() if count)
    return f"Requirements: {listed}, of {len(words)}"


def findings(
    result: Result, requirements: list[Requirement], windows: dict[str, NamedWindow]
) -> Iterator[Finding]:
    """Yield what a result of one experiment shows, by requirement and law."""
    further = conclusion_of(result).further  # such as what other training samples gave
    for requirement in requirements:
        over = window_of(requirement, windows)
        for row, law in enumerate(result.labels):
            if law in further:
                continue
            if requirement.metric in MARGINS:
                yield _of_margin(result, requirement, law)
            else:
                yield _of_runs(result, requirement, over, law, row)


def in_words(requirement: Requirement, bound: str, over: Window | None) -> str:
    """Return a requirement in words: ``attitude_angle ≤ 0.05 deg in 99.7 % of runs``."""
    sign = "≤" if requirement.min is None else "≥"
    relative = f" within {requirement.relative:g} s" if requirement.relative else ""
    words = f"{requirement.metric}{relative} {sign} {bound}"
    if requirement.share is not None:
        percent = f"{100 * requirement.share:.6g} %"
        of = OF.get(requirement.of, "")
        if requirement.of_runs is not None:
            of = f"the time in {100 * requirement.of_runs:.6g} % of runs"
        words += f" in {percent} of {of}"
    if isinstance(requirement.window, str):
        words += f", {requirement.window}"
    elif over is not None:
        words += f", {over} s"
    return words


def _bound(requirement: Requirement, limit: float, unit: str) -> str:
    """Return the bound as the user wrote it, with its unit."""
    for written in (requirement.max, requirement.min):
        if isinstance(written, str):
            return " ".join(written.split())
    return f"{limit:.6g} {'' if unit == '1' else unit}".strip()


def _of_margin(result: Result, requirement: Requirement, law: str) -> Finding:
    """Judge a margin of the linear loop, which is one number."""
    unit, _ = MARGINS[requirement.metric]
    limit = limit_of(requirement, unit)
    name = in_words(requirement, _bound(requirement, limit, unit), None)
    stored = json.loads(str(result.attributes.get(STORED, "{}")))
    of_law = stored.get(law, stored.get("", "is not stored; run the experiment with --force"))
    blank = shares.Statement("not shown", math.nan, math.nan)
    if result.out_of:
        of_law = "a sweep stores no margins; run this point by itself"
    if isinstance(of_law, str):
        return Finding(name, law, "", blank, of_law, requirement)
    if of_law["stable"] is False and not of_law["indicative"]:
        return Finding(name, law, "unstable", blank._replace(word="fails"), "", requirement)
    value = of_law[requirement.metric]
    if value is None or not (of_law["stable"] or of_law["indicative"]):
        why = "the loop is not shown to be stable, or the law has no such margin; see eqt margins"
        return Finding(name, law, "", blank, why, requirement)
    if of_law["indicative"]:
        why = "the loop changes with time, or leaves out what could matter; see eqt margins"
        seen = f"{significant(value, 4)} {'' if unit == '1' else unit}".strip()
        return Finding(name, law, f"about {seen}", blank, why, requirement)
    keeps = value >= limit if requirement.max is None else value <= limit
    seen = f"{significant(value, 4)} {'' if unit == '1' else unit}".strip()
    seen = seen if 0 < value < math.inf else "any"
    word: shares.Word = "meets" if keeps else "fails"
    return Finding(name, law, seen, blank._replace(word=word), "", requirement)


def _of_runs(
    result: Result, requirement: Requirement, over: Window | None, law: str, row: int
) -> Finding:
    """Judge a requirement by the runs of one law."""
    assert requirement.share is not None
    level, good = 1 - requirement.confidence, result.good[row]
    unit, limit, sure, possible, apart = _bounds_kept(result, requirement, over, row)
    name = in_words(
        requirement, _bound(requirement, limit, unit), over or _window_of(result, requirement)
    )
    earlier = tuple(result.provenance.get(GROWN_FROM, ()))
    sure, possible = np.where(good, sure, 0.0), np.where(good, possible, 0.0)
    n = len(good)
    share = requirement.of_runs or requirement.share

    def judged(sure: Array, possible: Array) -> shares.Statement:
        if requirement.of == "mixed":
            return shares.share_of_time(sure, possible, share, level)
        return shares.share_of_runs(
            sure > 0, possible > 0, share, level, earlier, requirement.looks
        )

    seen = f"{100 * sure.mean():.5g} % of the time"
    if requirement.of != "mixed":
        if requirement.of_runs is not None:
            sure, possible = sure >= requirement.share, possible >= requirement.share
        seen = f"{np.count_nonzero(sure)}/{n} runs"
    statement = judged(sure, possible)
    why = ""
    if statement.word == "not shown":
        finer = [judged(x, x) for x in (sure, possible)]
        is_coarse = any(one.word != "not shown" or one.needed for one in finer)
        is_coarse = is_coarse and bool((sure != possible).any())
        why = _why(statement, requirement, n, is_coarse, apart)
    else:
        shown = statement.low if statement.word == "meets" else statement.high
        way = "at least" if statement.word == "meets" else "at most"
        why = f"{way} {_percent(shown, up=statement.word == 'fails')} %"
    return Finding(name, law, seen, statement, why, requirement)


def _window_of(result: Result, requirement: Requirement) -> Window | None:
    """Return the window that `measure`, or the metric itself, gives; None for whole runs."""
    quantity = result.comparable.get(requirement.metric)
    window = quantity.window if quantity else window_of_metrics(result)
    return None if window == WHOLE else window.within(result.times)


def _percent(share: float, *, up: bool) -> str:
    """Round a share so that what is said stays true."""
    places = max(1, 1 - math.floor(math.log10(max(1 - share, 1e-6))) - 2)
    scale = 10**places
    rounded = (math.ceil if up else math.floor)(100 * share * scale) / scale
    return f"{rounded:.{places}f}"


def _why(
    statement: shares.Statement, requirement: Requirement, n: int, is_coarse: bool, apart: float
) -> str:
    if is_coarse:
        return f"samples are {apart:.3g} s apart, and the error may be larger between them"
    if not statement.needed:
        low, high = _percent(statement.low, up=False), _percent(statement.high, up=True)
        return f"{low} to {high} % is shown"
    other = "a" if statement.high >= 1 else "another"
    return f"{count_of(statement.needed, 'run')} without {other} failure would do"


def _error_of(result: Result, name: str) -> float:
    """Return the relative error of a metric by the distance of samples, if it was told."""
    is_of_it = result.attributes.get("row_metric") == name
    return float(result.attributes["row_error"]) if is_of_it else 0.0


def _bounds_kept(
    result: Result, requirement: Requirement, over: Window | None, row: int
) -> tuple[str, float, Array, Array, float]:
    """Return unit, bound, what runs keep for sure and what they may keep, and the sampling time.

    Of an ensemble, these are 1 or 0 of a run; else shares of time.
    """
    name, is_upper = requirement.metric, requirement.min is None
    quantity = result.comparable.get(name)
    signal = quantity.signals[0] if quantity and is_peak(quantity) else name
    times = result.times - result.times[0]
    apart = float(np.diff(times).max(initial=0.0))
    is_signal = result.is_over_time(signal) and len(result.stored_runs) == result.runs
    if quantity and not (is_peak(quantity) and is_signal):
        numbers = result.per_run(quantity, over)
        limit, x = limit_of(requirement, numbers.unit), numbers.values[row]
        with np.errstate(invalid="ignore"):
            keeps = np.where(numbers.censored[row], False, x <= limit if is_upper else x >= limit)
            more = abs(x) * _error_of(result, name)  # by samples that are far apart
            sure = keeps & (x + more <= limit if is_upper else x - more >= limit)
        return numbers.unit, limit, sure * 1.0, keeps * 1.0, apart
    if not is_signal:
        raise result.error(f"needs samples of all runs for '{name}'; set store.trajectories to all")
    window = (over or window_of_metrics(result)).within(result.times)
    inside = (times >= window.start - 1e-9) & (times <= window.stop + 1e-9)
    unit, (_, factor) = result.units(signal), result.shown_in(signal, result.units(signal))
    limit = limit_of(requirement, unit)
    is_relative = requirement.relative and name == ANGLE
    before = samples_of(requirement.relative, times) if requirement.relative and is_relative else 0
    inside[:] = inside & (np.cumsum(inside) > before)  # an exposure lies in the window
    pairs = inside[1:] & inside[:-1]
    if not pairs.any():
        raise result.error(f"holds too few samples between {window} s; raise time.samples")
    if is_relative:
        x = largest_changes(result, row, before)
    else:
        x = result.read(signal, controller=row) * factor
    x = np.nan_to_num(x, nan=np.inf if is_upper else -np.inf)
    more = between_samples(x) if signal not in result.described.holds else np.zeros_like(x[:, 1:])
    x, more = x[:, inside], more[:, pairs]
    if requirement.of != "ensemble":
        sure = share_within(x, limit, more, upper=is_upper)
        return unit, limit, sure, share_within(x, limit, 0 * more, upper=is_upper), apart
    if not is_upper:
        x, limit_above = -x, -limit
    else:
        limit_above = limit
    ends = np.maximum(x[:, 1:], x[:, :-1])
    sure, possible = (ends + more).max(axis=1) <= limit_above, ends.max(axis=1) <= limit_above
    return unit, limit, sure * 1.0, possible * 1.0, apart
