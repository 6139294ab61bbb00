"""Lays out a comparison as text tables: pairs, controllers, claims."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby

from eqt_cli.analysis.comparison.compare import Comparison
from eqt_cli.analysis.comparison.intervals import FEWEST, POWER
from eqt_cli.analysis.comparison.notation import Plain, percent
from eqt_cli.analysis.comparison.pairs import LEAST_SEEN, Level, Pair
from eqt_cli.analysis.comparison.records import sources
from eqt_cli.analysis.comparison.verdicts import Judgement
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.results.origin import law_title
from eqt_cli.results.result import PerRun

IN_FULL = ("d", "runs to decide")
"""Columns of the table of pairs that its brief form leaves out."""

_KEYS = 3
"""Number of leading columns that identify a row: measure, window, unit."""

FEW = 20
"""Pairs below which coverage falls short of the confidence (docs/explanation/statistics.md)."""


def text_tables(
    comparison: Comparison,
    notation: Plain,
    against: Sequence[str] = (),
    *,
    laws_as_rows: bool = False,
    brief: bool = False,
) -> dict[str, TextTable]:
    """Return all tables that have rows, by name.

    Parameters
    ----------
    against
        Show only pairs with one of these controllers; all if empty.
    laws_as_rows
        Whether the table of means has a row for each controller instead of each measure.
    brief
        Whether the table of pairs is to fit 80 columns, without what only some readers need.
    """
    means = _controllers(comparison, notation)
    made = [
        _pairs(comparison, notation, against, brief),
        _with_laws_as_rows(means) if laws_as_rows and means.blocks else means,
        _claims(comparison, notation),
    ]
    return {table.name: table for table in made if table.blocks}


def _controllers(comparison: Comparison, write: Plain) -> TextTable:
    rows = []
    notes = []
    titles = comparison.titles
    for _, found in groupby(comparison.levels, key=lambda level: id(level.measured)):
        levels = list(found)
        here = levels[0].measured
        name, end = here.quantity.described, f"{here.window.stop:g} s"
        rows.append([*_measure(here, write), *(_value(level, write) for level in levels)])
        censored = [
            f"{titles[level.controller]} {level.censored}" for level in levels if level.censored
        ]
        if censored:
            notes.append(
                f"{name}: runs still unsettled at {end} count as {end} ({', '.join(censored)}), so "
                "this is the mean time restricted to the horizon."
            )
        undefined = [
            f"{titles[level.controller]} {level.undefined}" for level in levels if level.undefined
        ]
        if undefined:
            notes.append(f"{name}: good runs without a value: {', '.join(undefined)}.")
    if any("lyapunov" in level.measured.quantity.signals for level in comparison.levels):
        notes += _functions(comparison)
    if comparison.not_matched:
        listed = ", ".join(titles[label] for label in comparison.not_matched)
        notes.append(f"Gains not matched: {listed}.")
    failed = [f"{titles[label]} {count}" for label, count in comparison.failed.items() if count]
    if failed:
        notes.append(f"Failed runs, left out: {', '.join(failed)}.")
    if any(level.measured.quantity.counts for level in comparison.levels):
        notes.append(f"Shares of runs: with {100 * comparison.confidence:g} % Wilson intervals.")
    caption = f"Means over {_runs_each(comparison)}"
    intervals = (x for x in comparison.levels if not x.measured.quantity.counts)
    if any(math.isfinite(level.low) for level in intervals):
        caption += f"; {write.plus_minus} half the {_level_name(comparison, write)} interval"
    laws = [write.text(titles[label]) for label in comparison.labels]
    header = ["measure", "window", "unit", *laws]
    blocks = [Block("", rows)] if rows else []
    return TextTable("controllers", caption, header, blocks, _plain(notes, write), keys=_KEYS)


def _with_laws_as_rows(table: TextTable) -> TextTable:
    """A column for each measure, with its window and unit in the heading."""
    across = list(zip(table.header, *table.rows, strict=True))
    measures, windows, units = (column[1:] for column in across[:_KEYS])
    said = [
        f"{measure}, {window}{f' ({unit})' if unit else ''}"
        for measure, window, unit in zip(measures, windows, units, strict=True)
    ]
    rows = [list(column) for column in across[_KEYS:]]
    return replace(table, header=["controller", *said], blocks=[Block("", rows)], keys=1)


def _value(level: Level, write: Plain) -> str:
    written = write.interval if level.measured.quantity.counts else write.spread
    return written(level.mean, level.low, level.high)


def _functions(comparison: Comparison) -> list[str]:
    """Note the functions L of the laws if they differ."""
    if not comparison.lyapunov_functions:
        return []
    by_function: dict[str, list[str]] = {}
    for label, function in comparison.lyapunov_functions.items():
        by_function.setdefault(function, []).append(comparison.titles[label])
    listed = "; ".join(f"{function} of {', '.join(of)}" for function, of in by_function.items())
    return [f"L is each law's own function: {listed}. Different functions are not compared by it."]


def _pairs(comparison: Comparison, write: Plain, against: Sequence[str], brief: bool) -> TextTable:
    position = {label: index for index, label in enumerate(comparison.labels)}

    def names(pair: Pair) -> tuple[str, str]:
        return pair.first, pair.second

    def order(pair: Pair) -> tuple[int, int]:
        return position[pair.first], position[pair.second]

    def key(pair: Pair) -> list[str]:
        name, window, unit = _measure(pair.measured, write)
        named = filter(None, [pair.measured.quantity.plain, window, unit])
        return [", ".join(named)] if brief else [name, window, unit]

    shown = [p for p in comparison.pairs if not against or set(names(p)) & set(against)]
    blocks = []
    for (first, second), found in groupby(sorted(shown, key=order), key=names):
        rows = [[*key(pair), *_pair_row(comparison, pair, write)] for pair in found]
        blocks.append(Block(write.text(_difference(comparison, first, second)), rows))
    caption = "Paired differences from the same initial states"
    if any(math.isfinite(pair.low) for pair in shown):
        caption += f", with {_level_name(comparison, write)} intervals"
    keys = ["measure"] if brief else ["measure", "window", "unit"]
    header = [*keys, "difference", "better in", "relative", *IN_FULL]
    notes = _plain(_pair_notes(comparison, shown), write)
    spare = ("runs to decide", "d", "relative", "better in")
    table = TextTable("pairs", caption, header, blocks, notes, spare, len(keys))
    return table.without(IN_FULL) if brief else table


def _difference(comparison: Comparison, first: str, second: str) -> str:
    return f"{comparison.titles[first]} − {comparison.titles[second]}"


def _pair_row(comparison: Comparison, pair: Pair, write: Plain) -> list[str]:
    return [
        write.interval(pair.difference, pair.low, pair.high),
        write.text(_better_in(pair, comparison.titles)),
        _relative(pair, write),
        "-" if pair.measured.quantity.counts else write.number(_two(pair.cohen_d)),
        _runs(pair.runs_to_decide),
    ]


def _better_in(pair: Pair, titles: Mapping[str, str]) -> str:
    """Return in how many runs the law that is better more often is: ``EqT 15 of 20``."""
    if not pair.pairs or pair.measured.quantity.better == "neither":
        return "-"
    if pair.ties == pair.pairs:
        return f"equal in {pair.pairs}"
    first = round(pair.first_better * pair.pairs - pair.ties / 2)
    second = pair.pairs - pair.ties - first
    if first == second:
        return f"each {first} of {pair.pairs}"
    label, most = (pair.first, first) if first > second else (pair.second, second)
    return f"{titles[label]} {most} of {pair.pairs}"


def _pair_notes(comparison: Comparison, shown: Sequence[Pair]) -> list[str]:
    notes = [
        "d: mean over standard deviation of the paired differences (Cohen).",
        f"runs to decide: the number of runs with which an interval excludes 0 with probability "
        f"{POWER:g}, if mean and spread stay as measured.",
        *_of_shares(comparison, shown),
    ]
    if any(math.isfinite(pair.low) for pair in shown):
        notes.append("Intervals are not corrected for multiple comparisons.")
    failed = max((pair.failed for pair in shown), default=0)
    if failed:
        notes.append(f"Runs in which either controller failed are left out (at most {failed}).")
    fewest = min((pair.pairs for pair in shown if pair.pairs), default=FEW)
    if fewest < FEW:
        notes.append(
            f"From fewer than {FEW} pairs (here {fewest}), an interval may hold less often than "
            f"its confidence says; from fewer than {FEWEST}, there is none."
        )
    return notes


def _of_shares(comparison: Comparison, shown: Sequence[Pair]) -> list[str]:
    """Note the method for shares of runs, with the p-values."""
    tested = [pair for pair in shown if pair.p_value is not None]
    if not tested:
        return []
    found = "; ".join(
        f"{pair.measured.quantity.plain}, {_difference(comparison, pair.first, pair.second)}: "
        f"p = {pair.p_value:.2g}"
        for pair in tested
    )
    level = f"{100 * comparison.confidence:g} %"
    return [
        f"Shares of runs: with {level} paired intervals of Newcombe. McNemar's exact test: {found}."
    ]


def _claims(comparison: Comparison, write: Plain) -> TextTable:
    blocks = []
    for says, found in groupby(comparison.judgements, key=lambda judgement: judgement.says):
        judgements = list(found)
        rows = [_claim_row(comparison, judgement, write) for judgement in judgements]
        absent = ", ".join(map(law_title, judgements[0].absent))
        without = f" (here without {absent})" if absent else ""
        blocks.append(Block(write.text(f"“{says}”{without}"), rows))
    about = f"Claims of {write.text(sources(comparison))}, tested on this experiment"
    caption = f"{about}, at {_runs_each(comparison)}"
    header = ["measured", "window", "found", "verdict", "runs to decide"]
    notes = [
        "Differences below 0 support a claim: supported if the whole interval lies below 0, not "
        "supported if it lies above, undecided if it contains 0. A claim about every run is "
        "supported only if no run violates it and the runs are enough to speak for 95 % of all "
        "initial states."
    ]
    if comparison.departures:
        notes = [f"not covered: beyond the theorems of these claims are {comparison.departures}."]
    laws = dict.fromkeys(law for row in comparison.judgements for law in row.settled)
    if any(law.count < law.runs for law in laws):
        counts = ", ".join(
            f"{comparison.titles[law.controller]} {law.count} of {law.runs}" for law in laws
        )
        notes.append(
            f"Settled at {comparison.horizon:g} s: {counts}. A claim about laws of which not all "
            "runs settled is at most seen, since these runs do not show where the others end."
        )
    return TextTable("claims", caption, header, blocks, _plain(notes, write), (header[-1],))


def _claim_row(comparison: Comparison, judgement: Judgement, write: Plain) -> list[str]:
    if judgement.pair is None:
        assert judgement.measured is not None
        law = comparison.titles.get(judgement.controller, judgement.controller)
        what = write.text(f"{law}: {judgement.statement}")
        found = f"in {judgement.held} of {judgement.runs} runs"
        window = write.window(judgement.measured.window)
    else:
        pair = judgement.pair
        symbol = write.name(pair.measured.quantity)
        what = f"{symbol}: {write.text(_difference(comparison, pair.first, pair.second))}"
        interval = write.interval(pair.difference, pair.low, pair.high)
        found = " ".join(filter(None, [interval, write.unit(pair.measured.unit)]))
        found += f" ({_relative(pair, write)})"
        window = write.window(pair.measured.window)
    return [what, window, found, str(judgement.verdict), _runs(judgement.runs_to_decide)]


def _measure(measured: PerRun, write: Plain) -> list[str]:
    return [write.name(measured.quantity), write.window(measured.window), write.unit(measured.unit)]


def _relative(pair: Pair, write: Plain) -> str:
    if pair.relative != pair.relative:
        return "-"
    if abs(pair.relative) < LEAST_SEEN and not pair.differs:
        return "no difference seen"
    number, _, sign = percent(pair.relative, signed=True).partition(" ")
    return f"{write.number(number)} {write.text(sign)}"


def _level_name(comparison: Comparison, write: Plain) -> str:
    return write.text(f"{100 * comparison.confidence:g} % bootstrap")


def _runs_each(comparison: Comparison) -> str:
    return f"{comparison.runs} run{'s' if comparison.runs > 1 else ''} per law"


def _two(value: float) -> str:
    return f"{value:.2f}" if value == value else "-"


def _runs(runs: int | None) -> str:
    return "-" if runs is None else str(runs) if runs <= 10_000 else "> 10,000"


def _plain(notes: Sequence[str], write: Plain) -> list[str]:
    return [write.text(note) for note in notes]
