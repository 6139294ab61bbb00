"""Finds the range of a swept number in which enough runs of each law settle."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from eqt_cli.analysis.comparison.intervals import share
from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.results.result import Result
from eqt_cli.results.swept_key import SweptKey


@dataclass(frozen=True)
class Tested:
    """A tested value for one law.

    Attributes
    ----------
    value
        Value of the swept number.
    settled, runs
        Number of runs that settled, and of all runs. A failed run has not settled.
    low, high
        Ends of the Wilson interval of the share.
    """

    value: float
    settled: int
    runs: int
    low: float
    high: float


@dataclass(frozen=True)
class Reach:
    """The range of values around the easiest one at which enough runs of a law settle.

    Attributes
    ----------
    law, other
        Label of the law, and value of the other swept key, if there is one.
    values
        All tested values in increasing order.
    easiest
        The value at which most runs of all laws settle.
    lowest, highest
        Ends of the range around the easiest value in which every tested value has a lower bound of
        at least the required share; NaN if the easiest value has not.
    """

    law: str
    other: str
    values: list[Tested]
    easiest: Tested
    lowest: float
    highest: float

    def holds_at(self, value: float) -> bool:
        """Whether a value is within the range."""
        return self.lowest <= value <= self.highest

    def beyond(self, *, above: bool) -> Tested | None:
        """Return the first tested value outside the range; None if there is none."""
        if above:
            return next((each for each in self.values if each.value > self.highest), None)
        return next((each for each in reversed(self.values) if each.value < self.lowest), None)


def reaches(result: Result, wanted: float, confidence: float) -> tuple[SweptKey, list[Reach]]:
    """Return the swept number, and the range of each law along it.

    The easiest value is the one at which most runs of all laws settle; among equals, the one
    nearest to 0. It is 0 for a delay, and the largest value for a limit.

    Parameters
    ----------
    result
        An open result of a sweep over one number and at most one other key.
    wanted
        Share of runs that must settle, by the lower bound of its Wilson interval.
    confidence
        Confidence of these intervals.

    Raises
    ------
    EqtError
        If the sweep is over something else.
    """
    if not 0 < wanted < 1:
        raise EqtError(f"share {wanted:g}: expected a number between 0 and 1, as 0.9")
    if (keys := result.number_and_other()) is None:
        listed = ", ".join(key.key for key in result.swept_keys) or "none"
        raise result.error(
            "robustness needs a sweep over a number and at most one other key; this result sweeps: "
            f"{listed}"
        )
    across, other = keys
    settled = result.metric("settled") > 0  # NaN (a failed run) is not settled
    reached = []
    for level in np.unique(other.values) if other else [0.0]:
        points = np.flatnonzero(other.values == level) if other else np.arange(result.points)
        points = points[np.argsort(across.values[points], kind="stable")]
        values, counts = across.values[points], settled[points].sum(axis=-1)
        total = counts.sum(axis=-1)
        easiest = int(np.lexsort((np.abs(values), -total))[0])
        name = f"{other.key} {other.at(int(points[0]))}" if other else ""
        for law, label in enumerate(result.labels):
            tested = [
                Tested(value, n, result.runs, *share(n, result.runs, confidence)[1:])
                for value, n in zip(values.tolist(), counts[:, law].tolist(), strict=True)
            ]
            holds = np.array([each.low >= wanted for each in tested])
            ends = _around(values, holds, easiest)
            reached.append(Reach(label, name, tested, tested[easiest], *ends))
    return across, reached


def _around(values: Array, holds: Array, start: int) -> tuple[float, float]:
    """Return the ends of the range around `start` in which all values hold; NaN if it does not."""
    if not holds[start]:
        return math.nan, math.nan
    fails = np.flatnonzero(~holds)
    before, after = fails[fails < start], fails[fails > start]
    last = after.min(initial=len(values)) - 1
    return float(values[before.max(initial=-1) + 1]), float(values[last])


def robustness_table(
    result: Result, wanted: float, confidence: float, write: Plain
) -> tuple[TextTable, list[dict[str, Any]]]:
    """Return the range of each law as a table, and all tested values as plain data."""
    across, reached_by = reaches(result, wanted, confidence)
    needed = runs_to_show(wanted, confidence)
    blocks: dict[str, list[list[str]]] = {}
    for each in reached_by:
        row = [write.text(result.title_of[each.law]), *_ends(each, wanted, needed, write)]
        blocks.setdefault(each.other, []).append(row)
    runs = result.runs
    notes = [
        "Every tested value in the range of a law has a share of settled runs whose "
        f"{100 * confidence:g} % Wilson interval begins at {wanted:g} or above. A failed run has "
        "not settled. In parentheses: the first tested value outside the range, the share there, "
        "and its lower bound."
    ]
    if runs < needed:
        reached = share(runs, runs, confidence).low
        notes.append(
            f"{runs} runs cannot show {wanted:g}: even if all settle, the interval begins at "
            f"{reached:.2f}. Use {needed} runs or more (ensemble.runs), or a smaller --share."
        )
    table = TextTable(
        "robustness",
        f"Range of {across.key} in which {wanted:g} of the runs settle, at {runs} runs per value",
        ["law", "from", "to"],
        [Block(write.text(name), rows) for name, rows in blocks.items()],
        [write.text(note) for note in notes],
    )
    records = [
        {"law": each.law, "key": across.key, "other": each.other, **asdict(tested)}
        | {"within": each.holds_at(tested.value)}
        for each in reached_by
        for tested in each.values
    ]
    return table, records


def runs_to_show(wanted: float, confidence: float) -> int:
    """Return the fewest runs whose Wilson interval starts at `wanted` or above if all settle.

    For n runs that all settle, the interval starts at n / (n + z²).
    """
    from scipy.special import ndtri  # slow to import

    z = float(ndtri((1 + confidence) / 2))
    return math.ceil(z**2 * wanted / (1 - wanted))


def _ends(each: Reach, wanted: float, needed: int, write: Plain) -> tuple[str, str]:
    """Format both ends of the range; without one, whether the runs decide this or are too few."""
    if each.holds_at(each.easiest.value):
        return _end(each, False, write), _end(each, True, write)
    easiest = each.easiest
    if easiest.high < wanted:
        return "nowhere", "-"
    if easiest.runs < needed:
        return write.text(f"undecided: {easiest.runs} runs, {needed} are needed"), "-"
    settled = easiest.settled / easiest.runs
    interval = f"{settled:.2f} [{easiest.low:.2f}, {easiest.high:.2f}]"
    return write.text(f"undecided: {interval} at {easiest.value:.4g}"), "-"


def _end(each: Reach, above: bool, write: Plain) -> str:
    """Format one end of the range, and the first tested value beyond it."""
    end = each.highest if above else each.lowest
    beyond = each.beyond(above=above)
    if beyond is None:
        return write.number(f"{end:.4g}") + write.text(" (all tested)")
    share_there = f"{beyond.settled / beyond.runs:.2f}, {beyond.low:.2f}"
    return write.number(f"{end:.4g}") + write.text(f" ({beyond.value:.4g}: {share_there})")
