"""The first screen of a report: what was found, in sentences and as intervals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.comparison import Comparison, Level, Pair
from eqt_cli.analysis.comparison_tables import (
    count_of_tests,
    headline,
    laws_of,
    mean_in_words,
    name_of,
    runs_each,
    runs_enough,
    settling_of,
    too_few,
)
from eqt_cli.analysis.intervals import FEWEST, Word
from eqt_cli.analysis.maps import Map
from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import MARKS, count_of, fixed, listed, significant
from eqt_cli.cli.result_tables import IN_WORDS
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import PerRun, Result
from eqt_cli.results.summary import compared_first, unit_in_words

_MOST_NAMED = 3
"""Most laws that a sentence names, the first by the error."""
_SPIKE = 3.0
"""Multiple of the median reach of the intervals beyond which one does not set the scale."""
_MARGIN = 0.04
"""Share of a scale that is left free at both ends."""
_LETTER = 9.0
"""Width of a letter below the narrowest panel, in per cent of the scale."""
_TICKS = 4
"""Most parts of a scale."""


@dataclass(frozen=True)
class Mark:
    """A law on the scale of a panel; places are in per cent of the width.

    Attributes
    ----------
    law
        Its label.
    title
        Its name, with an asterisk if its gains are not matched.
    text, says
        Its numbers, and the sentence that they stand for.
    word
        The word of the comparison, ``base`` for the law that the others are compared with.
    at, low, high
        Its median difference and interval; NaN where there is none.
    beyond
        Where the interval leaves the scale: ``low``, ``high``, both or nothing.
    """

    law: str
    title: str
    text: str
    says: str
    word: str
    at: float = math.nan
    low: float = math.nan
    high: float = math.nan
    beyond: str = ""


@dataclass(frozen=True)
class Panel:
    """A number of all laws: its name, its scale, its ticks by their places, and its marks."""

    name: str
    scale: str
    ticks: dict[float, str]
    zero: float
    marks: list[Mark]


@dataclass(frozen=True)
class Opening:
    """What the first screen says.

    Attributes
    ----------
    finding
        The sentences of the finding.
    panels
        The intervals: of the errors, the costs and the runs that settle.
    notes
        What dots, lines and asterisks mean.
    """

    finding: list[str]
    panels: list[Panel]
    notes: list[str]


def opening(comparison: Comparison, base: str) -> Opening | None:
    """Return the first screen of a comparison with a law; of a single law, what it reaches."""
    laws = {law: of for law, of in laws_of(comparison, base).items() if headline(of)}
    failures = _failures(comparison)
    if all(count == comparison.runs for count in comparison.failed.values()):
        return Opening([f"All {count_of(comparison.runs, 'run')} of each law failed."], [], [])
    if not laws:
        return Opening([*_alone(comparison, base), *failures], [], [])
    order = sorted(laws, key=lambda law: _rank(headline(laws[law])[0]))
    shown = dict[int, PerRun]()
    for law in order:
        pairs = [*headline(laws[law]), *settling_of(laws[law], comparison.levels)]
        shown |= {id(pair.measured): pair.measured for pair in pairs}
    panels = [_panel(comparison, base, measured, laws, order) for measured in shown.values()]
    finding = [*_finding(comparison, base, laws, order), *failures]
    return Opening(finding, panels, _notes(comparison, base))


def _alone(comparison: Comparison, law: str) -> list[str]:
    """Say what a law reaches that is compared with none."""
    levels = [x for x in comparison.levels if x.measured.quantity.better != "neither"]
    shown = [x for x in [*headline(levels), *settling_of(levels, levels)] if x.controller == law]
    reached = [
        f"{_plain(level.measured, comparison)} {_with_interval(level)}"
        for level in dict.fromkeys(shown)
        if math.isfinite(level.mean)
    ]
    alike = [f"{too_few(comparison).capitalize()}."] if comparison.identical else []
    return [f"{comparison.titles[law]}: {', '.join(reached)}.", *alike]


def _with_interval(level: Level) -> str:
    """``36.5 ± 8.0 deg``, and ``4 of 20``."""
    if level.measured.quantity.counts:
        return mean_in_words(level)
    cells = Plain()
    number = cells.spread(level.mean, level.low, level.high)
    return f"{number} {cells.unit(level.measured.unit)}".rstrip()


def _rank(pair: Pair) -> float:
    """Return the place of a law: the error that is least, as it differs from the base, first."""
    value = pair.median if math.isfinite(pair.median) else pair.relative
    return math.inf if math.isnan(value) else value


def _starred(comparison: Comparison, law: str) -> str:
    return f"{comparison.titles[law]}{'*' if law in comparison.not_matched else ''}"


# The finding in words -----------------------------------------------------------------------------


def _finding(
    comparison: Comparison, base: str, laws: dict[str, list[Pair]], order: Sequence[str]
) -> list[str]:
    """Say which laws have less of the error than the base, and what the best one costs."""
    first = {law: headline(laws[law])[0] for law in order}
    measured, against = first[order[0]].measured, comparison.titles[base]
    name = _plain(measured, comparison)
    less, more = ("Smaller", "Larger")
    if measured.quantity.better == "higher":
        less, more = more, less
    least = less.replace("er", "est")
    described = {
        law: f"{_starred(comparison, law)} ({_numbers(pair, comparison)})"
        for law, pair in first.items()
    }
    of_word = {word: [law for law in order if first[law].word is word] for word in Word}
    better, worse = of_word[Word.BETTER], [*reversed(of_word[Word.WORSE])]
    sentences = []
    if better:
        sentences.append(f"{less} {name} than {against}: {_few(better, described)}.")
    if worse:
        sentences.append(
            f"{more}{'' if better else f' {name} than {against}'}: {_few(worse, described)}."
        )
    if alike := of_word[Word.ALIKE]:
        within = f"within ±{100 * comparison.negligible:g} %"
        names = {law: _starred(comparison, law) for law in alike}
        sentences.append(f"No difference from {against}, {within}: {_few(alike, names)}.")
    undecided = of_word[Word.UNDECIDED]
    leader = (better or undecided or order)[0]
    if comparison.identical:
        smallest = leader if _rank(first[leader]) < 0 else base
        named = described.get(smallest, against)
        return [f"{too_few(comparison).capitalize()}.", f"{least} {name}: {named}."]
    if undecided and not better and not worse:
        within = f"less than {100 * comparison.negligible:g} %"
        is_close = max(abs(_rank(pair)) for pair in first.values()) < comparison.negligible
        smallest = described[leader] if _rank(first[leader]) < 0 else against
        seen = f"the laws differ by {within}" if is_close else f"the {least.lower()}: {smallest}"
        words = "No other difference" if alike else "No difference"
        words += f" in {name} is decided with {runs_each(comparison)}"
        sentences.insert(0, f"{words}; {seen}.")
        if is_close:
            return sentences
    elif undecided:
        names = {law: _starred(comparison, law) for law in undecided}
        sentences.append(f"Undecided: {_few(undecided, names)}.")
    costs = [pair for pair in headline(laws[leader]) if pair.measured.quantity.role == "cost"]
    if costs and (leader in better or _rank(first[leader]) < 0):
        cost = costs[0]
        what = _plain(cost.measured, comparison)
        what = f"{what[0].upper()}{what[1:]} of {_starred(comparison, leader)}"
        sentences.append(f"{what}: {_numbers(cost, comparison)}, {cost.word}.")
    return sentences


def _plain(measured: PerRun, comparison: Comparison) -> str:
    """Return the name of a number without symbols, as ``rms position error``."""
    name = name_of(measured, comparison)
    for symbol, plain in IN_WORDS.items():
        name = name.replace(symbol, plain)
    return name


def _few(laws: Sequence[str], described: dict[str, str]) -> str:
    """Name the first laws, and count the others."""
    named = [described[law] for law in laws[:_MOST_NAMED]]
    others = len(laws) - len(named)
    return listed([*named, f"{others} more"] if others else named)


def _failures(comparison: Comparison) -> list[str]:
    failed = [
        f"{comparison.titles[law]} in {count} of {comparison.runs}"
        for law, count in comparison.failed.items()
        if count
    ]
    return [f"Runs failed: {listed(failed)}."] if failed else []


def _numbers(pair: Pair, comparison: Comparison) -> str:
    """``−14 % [−35, −6]``, or the difference of the means where there is no interval."""
    if math.isfinite(pair.low) or not math.isfinite(pair.relative):
        return pair.percent.replace("points", "pp")
    return f"{fixed(100 * pair.relative, 0, signed=True).replace('-', '−')} %"


def _notes(comparison: Comparison, base: str) -> list[str]:
    against, confidence = comparison.titles[base], 100 * comparison.how.confidence
    notes = [f"{line[0].upper()}{line[1:].rstrip('.')}." for line in comparison.between]
    if comparison.runs >= FEWEST and not comparison.identical:
        tests = count_of_tests(comparison, base) * comparison.points
        notes.append(
            f"{runs_each(comparison)}, from the same starts. Dots and lines: the median difference "
            f"from {against}, run by run, with its {confidence:g} % interval; {against}: the mean. "
            f"Filled: {MARKS['better']} better or {MARKS['worse']} worse in most runs, by a sign "
            f"test corrected for {tests} tests. Hollow: undecided, or within "
            f"±{100 * comparison.negligible:g} %."
        )
        if comparison.runs < (enough := runs_enough(comparison, base)):
            too = f"{comparison.runs} runs cannot decide any of {tests} tests; {enough} can."
            notes.append(too)
    elif not comparison.identical:
        notes.append(f"{too_few(comparison).partition(';')[0]}.")
    if comparison.not_matched:
        notes.append("* Gains are not matched with those of the others.")
    return notes


def points_won(wins: Map) -> str:
    """Say how many points of a sweep each law wins by a number, the one with most first."""
    name, points = Plain().name(wins.quantity), len(wins.cells)
    counts = [(title, wins.wins(law)) for law, title in enumerate(wins.titles)]
    won = sorted((x for x in counts if x[1]), key=lambda x: -x[1])
    if not won:
        fewest = f"; {wins.fewest} or more can decide" if wins.has_too_few_runs else ""
        runs = f"With {wins.runs} runs at each point"
        return f"{runs}, no law wins any of {points} points by its {name}{fewest}."
    first = f"{won[0][0]} wins {won[0][1]} of {points} points by its {name}"
    others = [f"{title} {count}" for title, count in won[1:]]
    none = [f"{count} {word}" for word, count in wins.without_winners().items() if count]
    return ", ".join([first, *others, *none]) + "."


# The intervals ------------------------------------------------------------------------------------


def extremes(result: Result) -> str:
    """Say where in a sweep the only law has its least and its greatest mean error."""
    name = compared_first(result)[0]
    means, quantity = result.means(name)[:, 0], Plain().name(result.quantity(name))
    if not np.isfinite(means).any():
        return f"At each point of the sweep, runs of {result.titles[0]} failed."
    unit = Plain().unit(unit_in_words(result, name))
    least, greatest = (
        f"{significant(means[point])} {unit}".rstrip() + f" at {result.point_name(int(point))}"
        for point in (np.nanargmin(means), np.nanargmax(means))
    )
    return f"{result.titles[0]}: least {quantity} {least}; greatest {greatest}."


def _panel(
    comparison: Comparison,
    base: str,
    measured: PerRun,
    laws: dict[str, list[Pair]],
    order: Sequence[str],
) -> Panel:
    """Return the panel of a number, its laws in the order of the first panel."""
    levels = {x.controller: x for x in comparison.levels if x.measured is measured}
    pairs = {law: pair for law in order for pair in laws[law] if pair.measured is measured}
    ends = [_ends(pair) for pair in pairs.values()]
    there = np.array([end for end in ends if np.isfinite(end).any()])
    low, high = _bounds(there, 100 * comparison.negligible)

    def place(value: float) -> float:
        return round(100 * (min(max(value, low), high) - low) / (high - low), 2)

    ahead = sum(_rank(headline(laws[law])[0]) < 0 for law in order)
    marks = []
    for law in [*order[:ahead], base, *order[ahead:]]:
        title, mean = _starred(comparison, law), mean_in_words(levels[law])
        if law == base:
            marks.append(Mark(law, title, mean, f"{title}: mean {mean}", "base", place(0.0)))
        elif law not in pairs:
            marks.append(Mark(law, title, "–", f"{title}: not compared", ""))
        else:
            pair, text = pairs[law], _numbers(pairs[law], comparison)
            middle, *around = _ends(pair)
            outside = {"low": around[0] < low, "high": around[1] > high}
            at = place(middle) if low <= middle <= high else math.nan
            says = f"{title}: {text}, {pair.word}; mean {mean}"
            beyond = " ".join(end for end, is_out in outside.items() if is_out)
            line = place(around[0]), place(around[1])
            marks.append(Mark(law, title, text, says, str(pair.word), at, *line, beyond))
    ticks = _labelled({place(tick): tick for tick in _ticks(low, high)})
    scale = f"{'points' if measured.is_share else '%'} from {comparison.titles[base]}"
    return Panel(name_of(measured, comparison), scale, ticks, place(0.0), marks)


def _ends(pair: Pair) -> tuple[float, float, float]:
    """Return the median and the ends of its interval, in per cent or points."""
    middle = pair.median if math.isfinite(pair.median) else pair.relative
    low = pair.median_low if math.isfinite(pair.median_low) else middle
    high = pair.median_high if math.isfinite(pair.median_high) else middle
    return 100 * middle, 100 * low, 100 * high


def _bounds(ends: Array, least: float) -> tuple[float, float]:
    """Return the ends of a scale that shows the bulk of the intervals, and `least` beside 0."""
    finite = ends[np.isfinite(ends)] if ends.size else np.zeros(1)
    low, high = min(0.0, float(finite.min(initial=0.0))), max(0.0, float(finite.max(initial=0.0)))
    if ends.size:
        reaches = np.nanmax(np.abs(np.where(np.isfinite(ends), ends, np.nan)), axis=1)
        most = _SPIKE * float(np.nanmedian(reaches))
        if most > 0:
            low, high = max(low, -most), min(high, most)
    low, high = min(low, -least), max(high, least)
    margin = _MARGIN * (high - low)
    return low - margin, high + margin


def _labelled(ticks: dict[float, float]) -> dict[float, str]:
    """Return the texts of ticks by place, empty where they would overlap in a narrow panel."""
    texts = {x: f"{tick:+g}".replace("-", "−") if tick else "0" for x, tick in ticks.items()}
    shown: list[float] = []
    for place in sorted(ticks, key=lambda x: -abs(ticks[x]) if ticks[x] else -math.inf):
        apart = (abs(place - x) / (len(texts[place]) + len(texts[x]) + 1) for x in shown)
        if min(apart, default=math.inf) >= _LETTER / 2:
            shown.append(place)
    return {place: text if place in shown else "" for place, text in texts.items()}


def _ticks(low: float, high: float) -> list[float]:
    """Return round numbers on a scale, 0 among them."""
    rough = (high - low) / _TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(k * power for k in (1, 2, 2.5, 5, 10) if k * power >= rough)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [round(k * step, 10) + 0.0 for k in range(first, last + 1)]
