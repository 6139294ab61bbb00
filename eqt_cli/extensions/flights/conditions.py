"""Laws against one law over conditions, such as winds or speeds: ratios, and where they differ."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.analysis.intervals import FEWEST, Interval, Word, holm
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import Block, TextTable, fixed, significant
from eqt_cli.extensions.flights.flights import Flown
from eqt_cli.extensions.flights.judging import CONFIDENCE
from eqt_cli.extensions.flights.one_look import RESAMPLES, difference, permutation_test
from eqt_cli.extensions.logs.logs import QUANTITIES

OVER, MARKS = "all", {Word.BETTER: "✓", Word.WORSE: "✗", Word.ALIKE: "=", Word.UNDECIDED: "?"}
"""The name of all conditions together, and the marks of words."""

Cells = Sequence[tuple[Array, Array]]
"""Logarithms of the errors of two laws in each condition."""


# Statistics ---------------------------------------------------------------------------------------


def over_conditions(cells: Cells, confidence: float) -> tuple[Interval, float]:
    """Return the mean over conditions of differences of means, with its interval and p-value.

    Conditions have equal weights. With two flights of both laws in each, they are the question
    itself: the variance is that of flights, with the degrees of freedom of Welch (1947) and
    Satterthwaite, and the permutation test deals flights out within conditions. Otherwise they
    are pairs, a sample of conditions that may come: Student's interval of their differences, and
    the swaps of `permutation_test`.
    """
    if min(len(part) for cell in cells for part in cell) < 2:
        means = np.array([[part.mean() for part in cell] for cell in cells])
        ends, _ = difference(means[:, 0], means[:, 1], True, confidence)
        return ends, float(permutation_test(means[:, 0], means[:, 1], True))
    weights = [np.full(len(cells), 1 / len(cells))]
    ((ends, _),) = _contrasts(cells, weights, confidence)
    drawn, rng = np.zeros(RESAMPLES + 1), np.random.default_rng(0)
    for x, y in cells:
        both = np.tile(np.r_[x, y], (RESAMPLES + 1, 1))
        both[1:] = rng.permuted(both[1:], axis=1)
        drawn += (both[:, : len(x)].mean(axis=1) - both[:, len(x) :].mean(axis=1)) / len(cells)
    further = np.count_nonzero(abs(drawn) >= abs(drawn[0]) * (1 - 1e-12))
    return ends, further / len(drawn)


def interactions(cells: Cells) -> list[tuple[float, float]]:
    """Return by how much the difference in each condition is off that in the others, and p-values.

    By Student's t with the variance of flights, after Holm; none without two flights of both laws
    in each condition.
    """
    count = len(cells)
    if count < 2 or min(len(part) for cell in cells for part in cell) < 2:
        return []
    weights = [np.where(np.arange(count) == k, 1.0, -1 / (count - 1)) for k in range(count)]
    contrasts = [*_contrasts(cells, weights, CONFIDENCE)]
    adjusted = holm(np.array([p for _, p in contrasts])).tolist()
    return [(ends.value, p) for (ends, _), p in zip(contrasts, adjusted, strict=True)]


def _contrasts(
    cells: Cells, weights: Sequence[Array], confidence: float
) -> Iterator[tuple[Interval, float]]:
    """Yield weighted sums of the differences in conditions, with intervals and p-values."""
    from scipy.special import stdtr, stdtrit  # slow to import

    values = np.array([x.mean() - y.mean() for x, y in cells])
    parts = np.array([[part.var(ddof=1) / len(part) for part in cell] for cell in cells])
    freedoms = np.array([[len(part) - 1 for part in cell] for cell in cells])
    for weight in weights:
        squares = parts * weight[:, None] ** 2
        value, error = float(weight @ values), math.sqrt(squares.sum())
        if not error:
            yield Interval(value, value, value), 0.0 if value else 1.0
            continue
        freedom = squares.sum() ** 2 / (squares**2 / freedoms).sum()
        half = float(stdtrit(freedom, (1 + confidence) / 2)) * error
        p = float(2 * stdtr(freedom, -abs(value) / error))
        yield Interval(value, value - half, value + half), p


# The table ----------------------------------------------------------------------------------------


class Cell(NamedTuple):
    """A law against the base, in a condition or over all.

    Attributes
    ----------
    metric, law, condition
        The quantity, the law, and the condition, or `OVER`.
    flights, against
        Numbers of flights of both.
    ratio, low, high
        Of the geometric means, with the 95 % interval; NaN for too few flights.
    p, word
        Of the permutation test, after Holm for all laws of the table, and in conditions for all its
        cells, and what both say.
    """

    metric: str
    law: str
    condition: str
    flights: int
    against: int
    ratio: float
    low: float
    high: float
    p: float
    word: Word

    def __str__(self) -> str:
        """``−19 % [−30, −6] ✓``."""
        value, *ends = (fixed(100 * x - 100, 0, signed=True) for x in self[5:8])
        text = f"{value} %".replace("-", "−")
        if math.isnan(self.low):
            return text
        return f"{text} [{', '.join(ends)}] {MARKS[self.word]}".replace("-", "−")


class ConditionTable(NamedTuple):
    """Laws against one law over conditions.

    Attributes
    ----------
    base, by, conditions
        The law that others are compared with, the column of the list, and its texts.
    cells
        A cell for each quantity, law and condition, and for each law over all of them.
    notes
        Where a ratio differs from those in other conditions, and what the numbers are.
    """

    base: str
    by: str
    conditions: list[str]
    cells: list[Cell]
    notes: list[str]

    @property
    def document(self) -> dict[str, Any]:
        """The numbers, for programs."""
        return self._asdict() | {"cells": self.records}

    @property
    def records(self) -> list[dict[str, Any]]:
        """A row for each cell."""
        return [cell._asdict() for cell in self.cells]

    def table(self) -> TextTable:
        """Return a row for each law, and a column for each condition."""
        at = {(x.metric, x.law, x.condition): x for x in self.cells}
        header = ["error", "law", OVER, "p", *self.conditions]
        rows = []
        for metric, law in dict.fromkeys((x.metric, x.law) for x in self.cells):
            over, *rest = (at[metric, law, name] for name in (OVER, *self.conditions))
            rows.append([metric, law, f"{over}", significant(over.p, 2), *map(str, rest)])
        caption = f"errors against {self.base}, by {self.by}"
        return TextTable("conditions", caption, header, [Block("", rows)], self.notes, keys=2)


def condition_table(
    flights: Sequence[Flown],
    conditions: Sequence[str],
    base: str,
    by: str,
    metrics: Sequence[str],
    negligible: float,
) -> ConditionTable:
    """Compare each law with one, by the quantities that all flights have.

    Parameters
    ----------
    flights, conditions
        The flights, whose side is their law, and the condition of each.

    Raises
    ------
    EqtError
        If a law was not flown in a condition, or flights share no quantity.
    """
    names = [*dict.fromkeys(conditions)]
    laws = [law for law in dict.fromkeys(x.side for x in flights) if law != base]
    shared = [q for q in metrics or QUANTITIES if all(q in x.errors for x in flights)]
    if not shared:
        raise EqtError("no quantity that all flights have; choose flights, or --metric")
    if len(names) < 2:
        raise EqtError(f"by: expected two conditions in column {by}, got {', '.join(names)}")

    def cell(law: str, name: str, metric: str) -> Array:
        pairs = zip(flights, conditions, strict=True)
        numbers = [x.errors[metric] for x, where in pairs if (x.side, where) == (law, name)]
        if not numbers:
            advice = "leave out its rows, or fly it"
            raise EqtError(
                f"by: {law} was not flown in condition {name}, and others were; {advice}"
            )
        return np.log(numbers)

    cells, notes = list[Cell](), list[str]()
    for metric in shared:
        raw: list[tuple[Any, ...]] = []
        for law in laws:
            both = [(cell(law, name, metric), cell(base, name, metric)) for name in names]
            counts = [sum(map(len, side)) for side in zip(*both, strict=True)]
            raw.append((law, OVER, *counts, *over_conditions(both, CONFIDENCE)))
            for name, (x, y) in zip(names, both, strict=True):
                ends, _ = difference(x, y, False, CONFIDENCE)
                raw.append((law, name, len(x), len(y), ends, float(permutation_test(x, y, False))))
            notes += _differing(law, names, interactions(both), metric if len(shared) > 1 else "")
        cells += _judged(metric, raw, negligible)
    is_sample = min(x.flights for x in cells) < 2 or min(x.against for x in cells) < 2
    over = "conditions as pairs, by Student's t" if is_sample else "flights, by Welch's t"
    notes.append(
        f"errors against {base}: ratios of geometric means; {OVER}: mean over conditions of equal "
        f"weight, 95 % interval over {over} of logarithms; ✓ better, ✗ worse, = no difference, ? "
        "undecided"
    )
    least = math.ceil(math.log2(2 * len(laws) / (1 - CONFIDENCE)))
    if is_sample and len(names) < least:
        notes.insert(0, f"{len(names)} conditions: {least} are the least for better or worse")
    if not is_sample and min(min(x.flights, x.against) for x in cells) < FEWEST:
        notes.append(
            f"no interval and no word in conditions with fewer than {FEWEST} flights of each"
        )
    return ConditionTable(base, by, names, cells, notes)


def _judged(metric: str, raw: Sequence[tuple[Any, ...]], negligible: float) -> Iterator[Cell]:
    """Yield cells with their words; p-values are adjusted over laws, and over all other cells."""
    of_all = [row[1] == OVER for row in raw]
    p = np.array([row[5] for row in raw])
    for those in (np.array(of_all), ~np.array(of_all)):
        p[those] = holm(p[those])
    for (law, name, n, m, ends, _), value in zip(raw, p.tolist(), strict=True):
        word = Word.UNDECIDED
        if max(-math.expm1(ends.low), math.expm1(ends.high)) <= negligible:
            word = Word.ALIKE
        elif value <= 1 - CONFIDENCE and (ends.high < 0 or ends.low > 0):
            word = Word.BETTER if ends.high < 0 else Word.WORSE
        ratio, low, high = map(math.exp, ends)
        yield Cell(metric, law, name, n, m, ratio, low, high, value, word)


def _differing(
    law: str, names: Sequence[str], off: Sequence[tuple[float, float]], metric: str
) -> Iterator[str]:
    for name, (value, p) in zip(names, off, strict=False):
        if p <= 1 - CONFIDENCE:
            change = f"{100 * math.expm1(value):+.0f}".replace("-", "−")
            of = f", {metric}" if metric else ""
            where = f"interaction: {law} in {name}{of}"
            yield f"{where}: {change} % against its ratio elsewhere, p {p:.2g}"
