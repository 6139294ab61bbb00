"""A comparison as records for JSON and CSV, and as text tables."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

from eqt_cli.analysis.comparison import ClaimVerdict, Comparison, Judgement
from eqt_cli.analysis.intervals import FEWEST, POWER, Level, Pair, Word
from eqt_cli.analysis.verdict import Answer, answers, runs_each, sources, too_few, unsettled
from eqt_cli.base.reporting import Block, TextTable, percent
from eqt_cli.results.origin import law_title
from eqt_cli.results.quantity import NO_SYMBOL, Plain, Window
from eqt_cli.results.result import PerRun

Record = dict[str, Any]


def records(comparison: Comparison, *against: str) -> dict[str, list[Record]]:
    """Return all tables by name, with a record per answer, measure and controller, pair or claim.

    Differences are first minus second: the one of `against`, or that stands first in the result.
    """
    of_level = "controller runs failed undefined censored mean low high standard_deviation median"
    return {
        "verdict": [_answer(answer) for answer in answers(comparison, *against[:1])],
        "controllers": [_record(x.measured, x, of_level) for x in comparison.levels],
        "pairs": [
            _pair(pair)
            | {"runs_to_decide": pair.runs_to_decide, "word": str(pair.word(comparison.negligible))}
            for pair in comparison.against(*against)
        ],
        "claims": [_judgement(judgement) for judgement in comparison.judgements],
    }


def rows_of(comparison: Comparison) -> list[Record]:
    """Return the records of the pairs; of the laws where there is but one.

    Those of pairs with the first law also have the answer and its p-value.
    """
    tables = records(comparison)
    pairs = zip(comparison.against(), tables["pairs"], strict=True)
    rows = {(id(pair.measured), pair.first, pair.second): row for pair, row in pairs}
    for answer in answers(comparison):
        pair, word = answer.pair, answer.word if answer.decided else Word.UNDECIDED
        row = rows[id(pair.measured), pair.first, pair.second]
        row |= {"answer": str(word), "adjusted_p": answer.p_value}
    return tables["pairs"] or tables["controllers"]


def _record(measured: PerRun, row: Level | Pair | Judgement, fields: str) -> Record:
    """Return the number that was measured, and these fields of a row about it."""
    return {
        "metric": measured.quantity.name,
        "window_start": measured.seen.start,
        "window_stop": measured.seen.stop,
        "units": measured.unit,
        **{name: getattr(row, name) for name in fields.split()},
    }


def _pair(pair: Pair) -> Record:
    counts = "first second pairs failed undefined censored"
    numbers = "difference low high relative relative_low relative_high cohen_d first_better"
    record = _record(pair.measured, pair, f"{counts} {numbers} p_value")
    names = ("median", "median_low", "median_high")
    return record | dict(zip(names, pair.medians[0], strict=True))


def _answer(answer: Answer) -> Record:
    pair = answer.pair
    return {
        "metric": pair.measured.quantity.name,
        "window_start": pair.measured.window.start,
        "window_stop": pair.measured.window.stop,
        "controller": pair.first,
        "against": pair.second,
        "word": str(answer.word),
        "decided": answer.decided,
        "p_value": answer.p_value,
    }


def _judgement(judgement: Judgement) -> Record:
    common = {
        "source": judgement.source,
        "claim": judgement.says,
        "verdict": str(judgement.verdict),
        "runs_to_decide": judgement.runs_to_decide,
    }
    if judgement.pair is not None:
        return common | {"statement": "first is less than second"} | _pair(judgement.pair)
    assert judgement.measured is not None
    return {
        **common,
        "statement": judgement.statement,
        **_record(judgement.measured, judgement, ""),
        "first": judgement.controller,
        "pairs": judgement.runs,
        "held": judgement.held,
        "low": judgement.low,
    }


FEW = 20
"""Pairs below which coverage falls short of the confidence (docs/explanation/statistics.md)."""


def text_tables(
    comparison: Comparison,
    notation: Plain,
    against: Sequence[str] = (),
    *,
    laws_as_rows: bool = False,
) -> dict[str, TextTable]:
    """Return all tables that have rows, by name.

    Parameters
    ----------
    against
        Show only pairs with one of these controllers; all if empty.
    laws_as_rows
        Whether the table of means has a row for each controller instead of each measure.
    """
    whole = notation.window(Window(0.0, comparison.horizon))
    means = _controllers(comparison, notation, whole)
    if laws_as_rows and means.blocks:
        [measures, *laws] = (list(column) for column in zip(means.header, *means.rows, strict=True))
        means = replace(means, header=["controller", *measures[1:]], blocks=[Block("", laws)])
    pairs = _pairs(comparison, notation, against, whole)
    return {
        table.name: replace(table, notes=[notation.text(note) for note in table.notes])
        for table in (pairs, means, _claims(comparison, notation))
        if table.blocks
    }


def _controllers(comparison: Comparison, write: Plain, whole: str) -> TextTable:
    rows, notes, titles = [], list[str](), comparison.titles
    for _, group in groupby(comparison.levels, key=lambda level: id(level.measured)):
        levels = list(group)
        measured = levels[0].measured
        name = _measure(measured, write, whole)
        if measured.quantity.counts:
            name += write.text(", % of runs")
        rows.append([name, *_values(levels, write)])
        notes += _notes_on(levels, titles)
    if len(titles) > 1:
        notes.append(f"{write.best_is}: the best mean.")
    if any("lyapunov" in level.measured.quantity.signals for level in comparison.levels):
        notes += _functions(comparison)
    if unmatched := ", ".join(titles[label] for label in comparison.not_matched):
        notes.append(f"Gains not matched: {unmatched}.")
    if failed := _counted(comparison.failed, titles):
        notes.append(f"Failed runs, left out: {failed}.")
    if any(level.measured.quantity.counts for level in comparison.levels):
        notes.append(f"Shares of runs: with {100 * comparison.confidence:g} % Wilson intervals.")
    caption = f"Means over {whole} where no time is named, and {runs_each(comparison)}"
    intervals = (x for x in comparison.levels if not x.measured.quantity.counts)
    if any(math.isfinite(level.low) for level in intervals):
        caption += f"; {write.plus_minus} half the {_level_name(comparison, write)} interval"
    laws = [write.text(titles[label]) for label in comparison.labels]
    blocks = [Block("", rows)] if rows else []
    return TextTable("controllers", caption, ["measure", *laws], blocks, notes)


def _notes_on(levels: Sequence[Level], titles: Mapping[str, str]) -> Iterator[str]:
    """Note what the means of a number leave out, and their error by the distance of samples."""
    measured = levels[0].measured
    name, end = measured.quantity.described, f"{measured.window.stop:g} s"
    if censored := _counted({level.controller: level.censored for level in levels}, titles):
        yield (
            f"{name}: runs still unsettled at {end} count as {end} ({censored}), so this is "
            "the mean time restricted to the horizon."
        )
    least = min(min(1e-3 * abs(x.mean), (x.high - x.low) / 10) for x in levels)
    yield from measured.sampling_note(least, Plain().unit(measured.unit))
    if undefined := _counted({level.controller: level.undefined for level in levels}, titles):
        rate = measured.quantity.name == "decay_rate"
        why = " (log L has no slope, or the law has no L that falls)" if rate else ""
        yield f"{name}: good runs without a value: {undefined}{why}."


def _counted(runs: Mapping[str, int], titles: Mapping[str, str]) -> str:
    return ", ".join(f"{titles[label]} {count}" for label, count in runs.items() if count)


def _values(levels: Sequence[Level], write: Plain) -> Iterator[str]:
    """Yield the means, the best of them marked."""
    quantity = levels[0].measured.quantity
    written = write.interval if quantity.counts else write.spread
    best = min((quantity.cost(level.mean) for level in levels), default=0.0)
    factor = 100 if quantity.counts else 1
    for level in levels:
        cell = written(*(factor * number for number in (level.mean, level.low, level.high)))
        ranked = quantity.better != "neither" and quantity.cost(level.mean) == best
        yield write.best(cell) if ranked and len(levels) > 1 else cell


def _functions(comparison: Comparison) -> Iterator[str]:
    """Note the functions L of the laws if they differ."""
    laws: dict[str, list[str]] = {}
    for label, function in comparison.lyapunov_functions.items():
        laws.setdefault(function, []).append(comparison.titles[label])
    if laws:
        functions = [f"{function} of {', '.join(names)}" for function, names in laws.items()]
        yield (
            f"L is each law's own function: {'; '.join(functions)}. Different functions are not "
            "compared by it."
        )


def _pairs(comparison: Comparison, write: Plain, against: Sequence[str], whole: str) -> TextTable:
    def names(pair: Pair) -> tuple[str, str]:
        return pair.second, pair.first

    def order(pair: Pair) -> list[int]:
        return list(map([*against, *comparison.labels].index, names(pair)))

    every = sorted(comparison.against(*against), key=order)
    shown = [p for p in every if not against or set(names(p)) & set(against)]
    blocks = []
    for (second, first), group in groupby(shown, key=names):
        rows = [_pair_row(comparison, pair, write, whole) for pair in group]
        titles = [comparison.titles[label] for label in (first, second, second)]
        blocks.append(Block(write.text("{} against {}, in % of {}".format(*titles)), rows))
    caption = "Paired differences from the same initial states"
    if comparison.between:
        caption = "Differences, run by run"
    header = ["measure", "difference", "median", "verdict", "better in", "runs to decide"]
    spare = ("runs to decide", "difference", "better in")
    if not any(math.isfinite(pair.low) for pair in shown):
        table = TextTable("pairs", caption, header, blocks, [too_few(comparison)], spare)
        return table.without(header[3:])
    level = _level_name(comparison, write)
    caption += f" over {whole} where no time is named, with {level} intervals"
    return TextTable("pairs", caption, header, blocks, _pair_notes(comparison, shown), spare)


def _pair_row(comparison: Comparison, pair: Pair, write: Plain, whole: str) -> list[str]:
    return [
        _measure(pair.measured, write, whole),
        write.interval(pair.difference, pair.low, pair.high),
        write.text(pair.percent),
        str(pair.word(comparison.negligible)) if math.isfinite(pair.low) else "-",
        write.text(_better_in(pair, comparison.titles)),
        _runs(pair.runs_to_decide),
    ]


def _better_in(pair: Pair, titles: Mapping[str, str]) -> str:
    """Return in how many runs the law that is better more often is: ``EqT 15 of 20``."""
    if not pair.runs or pair.measured.quantity.better == "neither":
        return "-"
    if pair.ties == pair.runs:
        return f"equal in {pair.pairs}"
    first, second = pair.better_in
    if first == second:
        return f"each {first} of {pair.runs}"
    label, most = (pair.first, first) if first > second else (pair.second, second)
    return f"{titles[label]} {most} of {pair.runs}"


def _pair_notes(comparison: Comparison, shown: Sequence[Pair]) -> list[str]:
    notes = [
        "difference: of the means; median: over runs, relative to the other law.",
        f"runs to decide: the number of runs with which the interval of the mean excludes 0 with "
        f"probability {POWER:g}, if mean and spread stay as measured.",
        "Verdicts follow from the median of each row alone, uncorrected, and from the side of the "
        f"mean; within ±{100 * comparison.negligible:g} % is no difference.",
    ]
    failed = max((pair.failed for pair in shown), default=0)
    if failed:
        notes.append(f"Runs in which a controller failed are no part of means (at most {failed}).")
    fewest = min((pair.pairs for pair in shown if pair.pairs), default=FEW)
    if fewest < FEW:
        notes.append(
            f"From fewer than {FEW} pairs (here {fewest}), the interval of a mean may hold less "
            f"often than its confidence says; from fewer than {FEWEST}, there is none."
        )
    return notes


def _claims(comparison: Comparison, write: Plain) -> TextTable:
    blocks = []
    for says, group in groupby(comparison.judgements, key=lambda judgement: judgement.says):
        judgements = list(group)
        rows = [_claim_row(comparison, judgement, write) for judgement in judgements]
        absent = ", ".join(map(law_title, judgements[0].absent))
        without = f" (here without {absent})" if absent else ""
        blocks.append(Block(write.text(f"“{says}”{without}"), rows))
    about = f"Claims of {write.text(sources(comparison))}, tested on this experiment"
    caption = f"{about}, at {runs_each(comparison)}"
    header = ["measured", "window", "found", "verdict", "runs to decide"]
    notes = [
        "Differences below 0 support a claim: supported if the intervals of the mean and of the "
        "median lie below 0, not supported if they lie above, else undecided. A claim about every "
        "run is supported only if no run violates it and the runs are enough to speak for 95 % of "
        "all initial states."
    ]
    if comparison.departures:
        notes = [f"not covered: beyond the theorems of these claims are {comparison.departures}."]
    if any(row.verdict is ClaimVerdict.NOT_COMPARABLE for row in comparison.judgements):
        notes.append(
            "not comparable: the two laws have not one stiffness and damping where they flew."
        )
    notes += [f"{late}: where they end, these runs do not show." for late in unsettled(comparison)]
    return TextTable("claims", caption, header, blocks, notes, (header[-1],))


def _claim_row(comparison: Comparison, judgement: Judgement, write: Plain) -> list[str]:
    if judgement.pair is None:
        assert judgement.measured is not None
        law = comparison.titles.get(judgement.controller, judgement.controller)
        what = write.text(f"{law}: {judgement.statement}")
        outcome = f"in {judgement.held} of {judgement.runs} runs"
        window = write.window(judgement.measured.window)
    else:
        pair = judgement.pair
        laws = f"{comparison.titles[pair.first]} − {comparison.titles[pair.second]}"
        what = f"{write.name(pair.measured.quantity)}: {write.text(laws)}"
        interval = write.interval(pair.difference, pair.low, pair.high)
        outcome = " ".join(filter(None, [interval, write.unit(pair.measured.unit)]))
        share = percent(pair.relative, signed=True).replace("-", "−")
        outcome += write.text(f" ({share})")
        window = write.window(pair.measured.seen)
    return [what, window, outcome, str(judgement.verdict), _runs(judgement.runs_to_decide)]


def _measure(measured: PerRun, write: Plain, whole: str) -> str:
    """Return name, window unless it is that of most rows, and unit, in a cell."""
    name = write.name(replace(measured.quantity, formula=NO_SYMBOL))
    row = [name, write.window(measured.seen), write.unit(measured.unit)]
    return ", ".join(word for word in row if word not in ("", whole))


def _level_name(comparison: Comparison, write: Plain) -> str:
    return write.text(f"{100 * comparison.confidence:g} % bootstrap")


def _runs(runs: int | None) -> str:
    return "-" if runs is None else str(runs) if runs <= 10_000 else "> 10,000"
