"""A comparison in words: the answer with what it leaves open, and tables of the numbers behind."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import TypeVar

from eqt_cli.analysis.claims import by_claim, sources
from eqt_cli.analysis.comparison import (
    ClaimVerdict,
    Comparison,
    Judgement,
    Level,
    Pair,
    Record,
    record,
)
from eqt_cli.analysis.intervals import FEWEST, POWER, Word
from eqt_cli.base.reporting import (
    MARKS,
    Block,
    TextTable,
    count_of,
    fixed,
    listed,
    percent,
    significant,
)
from eqt_cli.results.metrics import AXIS
from eqt_cli.results.origin import law_title
from eqt_cli.results.quantity import LAST_RESORT, NO_SYMBOL, WHOLE, Plain, Window
from eqt_cli.results.result import PerRun

SETTLING = ("settled", "settling_time")
"""The share of runs that settle, and the time that they take."""

FEW = 20
"""Pairs below which coverage falls short of the confidence (docs/explanation/statistics.md)."""

# The answer ---------------------------------------------------------------------------------------


def answer_lines(comparison: Comparison) -> list[str]:
    """Return the whole answer, the rows of `matrix` as sentences."""
    table = matrix(comparison)
    rows = [
        f"{law}: {', '.join(map(' '.join, zip(table.header[1:], cells, strict=True)))}"
        for law, *cells in table.rows
    ]
    return [*premises(comparison), *rows, *remarks(comparison), *table.notes]


def premises(comparison: Comparison) -> list[str]:
    """Return what a reader must know before any word."""
    laws = dict[str, list[str]]()
    for label, words in comparison.gains.items():
        laws.setdefault(words, []).append(comparison.titles[label])
    gains = [f"gains are not matched: {', '.join(who)}: {words}" for words, who in laws.items()]
    alike = [too_few(comparison)] if comparison.identical else []
    return [*comparison.between, *alike, *gains]


def matrix(comparison: Comparison, against: str = "", *, whole: bool = False) -> TextTable:
    """Return a row per law, with its error, its cost and how many of its runs settle.

    Of the law that the others are compared with, the means; of the others, the median difference
    and its interval, marked by the word.

    Parameters
    ----------
    against
        Label of the law that all others are compared with; the first one if empty.
    whole
        Whether all numbers have a column.
    """
    laws, levels = laws_of(comparison, against), comparison.levels
    shown = dict[int, PerRun]()
    for of_law in laws.values():
        first = of_law if whole else [*headline(of_law), *settling_of(of_law, levels)]
        shown |= {id(pair.measured): pair.measured for pair in first}
    level_of = {(id(level.measured), level.controller): level for level in levels}
    rows = dict[str, list[str]]()
    for law, of_law in laws.items():
        base, by_number = of_law[0].second, {id(pair.measured): pair for pair in of_law}
        if base not in rows:
            rows[base] = [mean_in_words(level_of[number, base]) for number in shown]
        rows[law] = [  # a number of L is not compared with that of another function L
            _cell(by_number[number], level_of[number, law]) if number in by_number else "-"
            for number in shown
        ]
    titled = [[comparison.titles[law], *cells] for law, cells in rows.items()]
    header = ["law", *_names([*shown.values()], comparison)]
    notes = list(_meaning(comparison, against))
    return TextTable("verdict", "", header, [Block("", titled)] if titled else [], notes)


def laws_of(comparison: Comparison, against: str) -> dict[str, list[Pair]]:
    """Return the rows of each law whose numbers may be better or worse, by label."""
    laws = dict[str, list[Pair]]()
    for pair in comparison.rows(against):
        if pair.measured.quantity.better != "neither":
            laws.setdefault(pair.first, []).append(pair)
    return laws


_Row = TypeVar("_Row", Pair, Level)


def headline(pairs: Sequence[_Row]) -> list[_Row]:
    """Return the rows by which a law is compared first, errors and costs; without one, the first.

    The rest of a role are those of its least rank and window.
    """
    first: list[_Row] = []
    for role in ("error", "cost"):
        of_role = [pair for pair in pairs if pair.measured.quantity.role == role]
        of_role.sort(key=lambda pair: pair.measured.quantity.rank)
        usual = [pair for pair in of_role if pair.measured.quantity.rank < LAST_RESORT]
        of_role = usual or of_role
        first += [x for x in of_role if x.measured.window == of_role[0].measured.window]
    return first or list(pairs[:1])


def settling_of(pairs: Sequence[_Row], levels: Sequence[Level]) -> list[_Row]:
    """Return the share of runs that settle; where all do, the time that they take."""
    share, time = SETTLING
    shares = [level.mean for level in levels if level.measured.quantity.name == share]
    shown = time if min(shares, default=1.0) == 1.0 else share
    return [pair for pair in pairs if pair.measured.quantity.name == shown]


def _cell(pair: Pair, level: Level) -> str:
    """``−14 % [−15, −11] ✓``; of a law with no interval, the difference of the means."""
    if math.isfinite(pair.low):
        return f"{pair.percent.replace('points', 'pp')} {MARKS[pair.word]}"
    if pair.measured.is_share or not math.isfinite(pair.relative):
        return mean_in_words(level)
    if pair.relative > 1:
        return f"{1 + pair.relative:.3g} times"
    return f"{fixed(100 * pair.relative, 0, signed=True).replace('-', '−')} %"


def mean_in_words(level: Level) -> str:
    """``32.9 deg``; of runs that settle, how many; ``-`` where all runs failed."""
    if not math.isfinite(level.mean):
        return "-"
    if level.measured.quantity.counts:
        return f"{round(level.mean * level.runs)} of {level.runs}"
    return f"{significant(level.mean)} {Plain().unit(level.measured.unit)}".rstrip()


def _meaning(comparison: Comparison, against: str) -> Iterator[str]:
    """Say of how many runs, and what the marks mean."""
    if comparison.identical:
        return
    if comparison.runs < FEWEST:
        yield too_few(comparison)
        return
    count, confidence = count_of_tests(comparison, against), comparison.how.confidence
    if not (tests := count * comparison.points):
        return
    if comparison.runs < (enough := runs_enough(comparison, against)):
        yield (
            f"{comparison.runs} runs cannot decide any of the {count_of(tests, 'comparison')}. Use "
            f"{enough} or more (`--set ensemble.runs={enough}`), or fewer metrics (`--metric`)."
        )
    first, starts = comparison.titles[against or comparison.labels[0]], " from the same starts"
    paired = ", run by run"
    if comparison.bases:
        first, starts, paired = "the first result", " per law", ""
    better, worse, alike, undecided = MARKS.values()
    yield (
        f"{first}: means of {count_of(comparison.runs, 'run')}{starts}. Others: median differences "
        f"from {first}{paired} [{100 * confidence:g} % interval]. {better}/{worse}: "
        f"better/worse in most runs (sign test, corrected for {count_of(tests, 'comparison')}). "
        f"{alike}: no difference, within ±{100 * comparison.negligible:g} %. "
        f"{undecided}: undecided."
    )


def count_of_tests(comparison: Comparison, against: str = "") -> int:
    """Return how many numbers of the other laws are tested against one."""
    return sum(pair.adjusted_p >= 0 for pair in comparison.rows(against))


def runs_enough(comparison: Comparison, against: str = "") -> int:
    """Return with how many runs, all the same way, a number can be called better or worse."""
    # Each of n runs the same way has p = 2/2^n, of which Holm's smallest is `tests` times as much.
    tests = max(1, count_of_tests(comparison, against) * comparison.points)
    return math.ceil(math.log2(2 * tests / (1 - comparison.how.confidence)))


def remarks(comparison: Comparison, against: str = "", *, whole: bool = False) -> list[str]:
    """Return what `matrix` leaves open: what else differs, failures, and the claims of papers."""
    titles, runs, laws = comparison.titles, comparison.runs, laws_of(comparison, against)
    also, open_ = dict[str, list[str]](), list[str]()
    for law, of_law in laws.items():
        if not whole:
            for words in _also(of_law, comparison):
                also.setdefault(words, []).append(titles[law])
        for pair in headline(of_law):
            if pair.contradicted:
                better, worse = pair.better_in
                side = f"better in {better}" if better >= worse else f"worse in {worse}"
                what = f"{titles[law]}: {pair.measured.quantity.plain} {side} of {pair.runs}"
                open_.append(f"{what}, but {pair.contradicted}")
    sentences = [f"{listed(who)} also {words}" for words, who in also.items()] + open_
    untold = (label for label in comparison.not_matched if label not in comparison.gains)
    if alone := ", ".join(titles[label] for label in untold):
        tuning = "`eqt tune CONFIG` tunes all laws alike"
        sentences.append(f"gains are not tuned alike: {alone}; {tuning}")
    every = [pair for of_law in laws.values() for pair in of_law]
    within = [pair.measured for pair in every if comparison.unresolved(pair)]
    if names := ", ".join(dict.fromkeys(_names(within, comparison))):
        estimate = f"the error estimate of {comparison.resolution:.1g}"
        sentences.append(f"not judged, as both are within {estimate}: {names}")
    failed = [f"{titles[k]} {count} of {runs}" for k, count in comparison.failed.items() if count]
    if failed:
        sentences.append(f"failed runs, no part of means: {', '.join(failed)}")
    home = replace(comparison, judgements=[x for x in comparison.judgements if x.is_at_home])
    if home.judgements and not home.departures:
        counts = Counter(verdict for verdict, _ in by_claim(home))
        verdicts = "; ".join(f"{count} {verdict}" for verdict, count in counts.items())
        sentences.append(f"claims of {sources(home)}: {verdicts} (`--table claims`)")
    return sentences


def _also(of_law: Sequence[Pair], comparison: Comparison) -> Iterator[str]:
    """Name the better and worse numbers that do not repeat those of the matrix, by word."""
    first = headline(of_law)
    marked = {(_topic(pair), pair.word) for pair in first}
    for word in (Word.BETTER, Word.WORSE):
        others = [
            pair.measured
            for pair in of_law
            if pair.word is word and pair not in first
            if (_topic(pair), word) not in marked and pair.measured.quantity.name not in SETTLING
        ]
        if others:
            yield f"{word} in {', '.join(_names(others, comparison))}"


def _topic(pair: Pair) -> str:
    """Return what a number is about: errors of attitude and position are all about the pose."""
    [signal, *_] = pair.measured.quantity.signals or ("",)
    is_of_pose = signal.startswith(("pose_error", "attitude_angle", "position_error", AXIS))
    return "pose" if is_of_pose else signal.partition("_norm")[0]


def _names(numbers: Sequence[PerRun], comparison: Comparison) -> list[str]:
    """Return the numbers, each with its window unless that is the whole run."""
    return [name_of(measured, comparison) for measured in numbers]


def name_of(measured: PerRun, comparison: Comparison, write: Plain | None = None) -> str:
    """Return the name of a number with its window, unless that is the whole run or in the name.

    In the cells of a table, `write` adds the unit.
    """
    cells, window = write or Plain(), measured.seen
    name = cells.name(replace(measured.quantity, formula=NO_SYMBOL, window=WHOLE))
    is_whole = math.isclose(window.stop - window.start, comparison.horizon)
    is_named = is_whole or "window_s" in measured.quantity.choices
    parts = [
        name,
        "" if is_named else cells.window(window),
        cells.unit(measured.unit) if write else "",
    ]
    return (", " if write else " ").join(filter(None, parts))


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


# Records ------------------------------------------------------------------------------------------


def records(comparison: Comparison, *against: str) -> dict[str, list[Record]]:
    """Return all tables by name, with a record per measure and controller, pair or claim.

    Differences are first minus second: the one of `against`, or that stands first in the result.
    """
    return {
        "controllers": [record(level.measured, level) for level in comparison.levels],
        "pairs": [record(pair.measured, pair) for pair in comparison.against(*against)],
        "claims": [_claim_record(judgement) for judgement in comparison.judgements],
    }


def _claim_record(judgement: Judgement) -> Record:
    verdict = {"verdict": str(judgement.verdict), "runs_to_decide": judgement.runs_to_decide}
    common = {"source": judgement.source, "claim": judgement.says, **verdict}
    common["statement"] = judgement.statement
    if judgement.pair is None:
        of_run = (
            record(judgement.measured),
            {"first": judgement.controller, "pairs": judgement.runs},
        )
        return {**common, **of_run[0], **of_run[1], "held": judgement.held, "low": judgement.low}
    of_pair = record(judgement.pair.measured, judgement.pair)
    return common | {k: v for k, v in of_pair.items() if k not in (*common, "word", "adjusted_p")}


# Tables -------------------------------------------------------------------------------------------


def text_tables(
    comparison: Comparison, write: Plain, against: Sequence[str] = (), *, laws_as_rows: bool = False
) -> dict[str, TextTable]:
    """Return all tables that have rows, by name.

    Parameters
    ----------
    against
        Show only pairs with one of these controllers; all if empty.
    laws_as_rows
        Whether the table of means has a row for each controller instead of each measure.
    """
    whole = write.window(Window(0.0, comparison.horizon))
    means = _controllers(comparison, write, whole)
    if laws_as_rows and means.blocks:
        [measures, *laws] = (list(column) for column in zip(means.header, *means.rows, strict=True))
        means = replace(means, header=["controller", *measures[1:]], blocks=[Block("", laws)])
    tables = _pairs(comparison, write, against, whole), means, _claims(comparison, write)
    return {
        table.name: replace(table, notes=[write.text(note) for note in table.notes])
        for table in tables
        if table.blocks
    }


def _controllers(comparison: Comparison, write: Plain, whole: str) -> TextTable:
    rows, notes, titles = [], list[str](), comparison.titles
    winners = _winners(comparison)
    for _, group in groupby(comparison.levels, key=lambda level: id(level.measured)):
        levels = list(group)
        percent_of_runs = write.text(", % of runs") if levels[0].measured.quantity.counts else ""
        name = name_of(levels[0].measured, comparison, write) + percent_of_runs
        winner = winners.get(id(levels[0].measured), "")
        rows.append([name, *_values(levels, winner, write)])
        notes += _notes_on(levels, titles)
    if winners:
        notes.append(f"{write.best_is}: better than every other law in most runs.")
    if any("lyapunov" in level.measured.quantity.signals for level in comparison.levels):
        notes += _functions(comparison)
    if unmatched := ", ".join(titles[label] for label in comparison.not_matched):
        notes.append(f"Gains not matched: {unmatched}.")
    if failed := _counted(comparison.failed, titles):
        notes.append(f"Failed runs, left out: {failed}.")
    if any(level.measured.quantity.counts for level in comparison.levels):
        level_of = f"{100 * comparison.how.confidence:g} %"
        notes.append(f"Shares of runs: with {level_of} Wilson intervals.")
    caption = f"Means over {whole} where no time is named, and {runs_each(comparison)}"
    intervals = (x for x in comparison.levels if not x.measured.quantity.counts)
    if any(math.isfinite(level.low) for level in intervals):
        caption += f"; {write.plus_minus} half the {_interval_name(comparison, write)} interval"
    laws = [write.text(titles[label]) for label in comparison.labels]
    blocks = [Block("", rows)] if rows else []
    return TextTable("controllers", caption, ["measure", *laws], blocks, notes)


def _winners(comparison: Comparison) -> dict[int, str]:
    """Return the law that is better than every other one, by the identity of a measure."""
    beats = defaultdict[int, Counter[str]](Counter)
    for pair in comparison.pairs:
        if pair.word in (Word.BETTER, Word.WORSE):
            winner = pair.first if pair.word == Word.BETTER else pair.second
            beats[id(pair.measured)][winner] += 1
    others = len(comparison.labels) - 1
    return {k: law for k, wins in beats.items() for law in wins if wins[law] == others}


def _values(levels: Sequence[Level], winner: str, write: Plain) -> Iterator[str]:
    """Yield the means, that of the winner marked."""
    counts = levels[0].measured.quantity.counts
    written, factor = (write.interval, 100) if counts else (write.spread, 1)
    for level in levels:
        cell = written(*(factor * number for number in (level.mean, level.low, level.high)))
        yield write.best(cell) if level.controller == winner else cell


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


def _functions(comparison: Comparison) -> Iterator[str]:
    """Note the functions L of the laws if they differ."""
    laws: dict[str, list[str]] = {}
    for label, function in comparison.lyapunov_functions.items():
        if function:
            laws.setdefault(function, []).append(comparison.titles[label])
    if laws:
        functions = [f"{function} of {', '.join(names)}" for function, names in laws.items()]
        yield (
            f"L is each law's own function: {'; '.join(functions)}. Different functions are not "
            "compared by it."
        )


def _pairs(comparison: Comparison, write: Plain, against: Sequence[str], whole: str) -> TextTable:
    titles, order = comparison.titles, [*against, *comparison.labels].index
    shown = [
        pair
        for pair in comparison.against(*against)
        if not against or {pair.first, pair.second} & set(against)
    ]
    shown.sort(key=lambda pair: (order(pair.second), order(pair.first)))
    blocks = []
    for (base, law), group in groupby(shown, key=lambda pair: (pair.second, pair.first)):
        about = f"{titles[law]} against {titles[base]}, in % of {titles[base]}"
        rows = [_pair_row(comparison, pair, write) for pair in group]
        blocks.append(Block(write.text(about), rows))
    caption = "Paired differences from the same initial states"
    if comparison.bases:
        caption = "Differences, run by run"
    header = ["measure", "difference", "median", "verdict", "better in", "runs to decide"]
    spare = ("runs to decide", "difference", "better in")
    if not any(math.isfinite(pair.low) for pair in shown):
        table = TextTable("pairs", caption, header, blocks, [too_few(comparison)], spare)
        return table.without(header[3:])
    level = _interval_name(comparison, write)
    caption += f" over {whole} where no time is named, with {level} intervals"
    return TextTable("pairs", caption, header, blocks, _pair_notes(comparison, shown), spare)


def _pair_row(comparison: Comparison, pair: Pair, write: Plain) -> list[str]:
    return [
        name_of(pair.measured, comparison, write),
        write.interval(pair.difference, pair.low, pair.high),
        write.text(pair.percent),
        str(pair.word) if math.isfinite(pair.low) else "-",
        write.text(_better_in(pair, comparison.titles)),
        _runs(pair.runs_to_decide),
    ]


def _better_in(pair: Pair, titles: Mapping[str, str]) -> str:
    """Return in how many runs the law that is better more often is: ``EqT 15 of 20``."""
    first, second = pair.better_in
    if not pair.runs or pair.measured.quantity.better == "neither":
        return "-"
    if not pair.differences.any() and pair.pairs == pair.runs:
        return f"equal in {pair.pairs}"
    if first == second:
        return f"each {first} of {pair.runs}"
    label, most = (pair.first, first) if first > second else (pair.second, second)
    return f"{titles[label]} {most} of {pair.runs}"


def _pair_notes(comparison: Comparison, shown: Sequence[Pair]) -> list[str]:
    count = max((count_of_tests(comparison, pair.second) for pair in shown), default=0)
    same = "" if comparison.bases else " against the same law"
    notes = [
        "difference: of the means; median: over runs, relative to the other law.",
        f"runs to decide: the number of runs with which the interval of the mean excludes 0 with "
        f"probability {POWER:g}, if mean and spread stay as measured.",
        "verdict: by a sign test of the runs, corrected for all "
        f"{count_of(count * comparison.points, 'test')}{same}, and by the side of the mean; "
        f"within ±{100 * comparison.negligible:g} % is no difference.",
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
    for verdict, rows in by_claim(comparison):
        absent = ", ".join(map(law_title, rows[0].absent))
        without = f" (here without {absent})" if absent else ""
        cells = [_claim_row(comparison, judgement, write) for judgement in rows]
        blocks.append(Block(write.text(f"“{rows[0].says}”{without}: {verdict}"), cells))
    about = f"Claims of {write.text(sources(comparison))}, tested on this experiment"
    caption = f"{about}, at {runs_each(comparison)}"
    header = ["measured", "window", "found", "verdict", "runs to decide"]
    notes = [
        "Differences below 0 support a claim: supported if the intervals of the mean and of the "
        "median lie below 0, not supported if they lie above, else undecided. A claim about every "
        "run is supported only if no run violates it and the runs are enough to speak for 95 % of "
        "all initial states. Found is the mean with its interval, or the median where it decides."
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
    measured, pair, titles = judgement.measured, judgement.pair, comparison.titles
    if pair is None:
        what = write.text(f"{titles[judgement.controller]}: {judgement.statement}")
        outcome = f"in {judgement.held} of {judgement.runs} runs"
        if judgement.held:
            outcome += write.text(f" (of all, {100 * judgement.low:.1f} % or more)")
    else:
        laws = write.text(f"{titles[pair.first]} − {titles[pair.second]}")
        what = f"{write.name(replace(measured.quantity, window=WHOLE))}: {laws}"
        interval = write.interval(pair.difference, pair.low, pair.high)
        outcome = " ".join(filter(None, [interval, write.unit(measured.unit)]))
        share = percent(pair.relative, signed=True).replace("-", "−")
        outcome += write.text(f" ({share})")
        if judgement.verdict is ClaimVerdict.UNDECIDED and pair.low * pair.high > 0:
            outcome = write.text(f"median {pair.percent}")  # which holds 0, or another sign
    cells = [what, write.window(measured.seen), outcome, str(judgement.verdict)]
    return [*cells, _runs(judgement.runs_to_decide)]


def _interval_name(comparison: Comparison, write: Plain) -> str:
    return write.text(f"{100 * comparison.how.confidence:g} % bootstrap")


def _runs(runs: int | None) -> str:
    return "-" if runs is None else str(runs) if runs <= 10_000 else "> 10,000"
