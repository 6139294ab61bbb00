"""A budget in words: the answer first, then a table of its sources, then quantiles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from eqt_cli.base.reporting import Block, TextTable, count_of, fixed, percent
from eqt_cli.base.units import factor
from eqt_cli.extensions.budget.budget import Budget, LawBudget, Row
from eqt_cli.extensions.budget.quantiles import Interval
from eqt_cli.results.quantity import Window

WORDS = {
    "attitude_angle": "attitude error",
    "pointing_error": "pointing error",
    "position_error": "position error",
    "heading_error": "heading error",
}

_FINER = {"deg": (("arcsec", 0.03), ("deg", np.inf)), "m": (("mm", 0.1), ("m", np.inf))}
"""Units by the largest number that they serve."""


class BudgetInWords:
    """Writes the numbers of a budget in a unit in which they are not small."""

    def __init__(self, budget: Budget) -> None:
        self.budget = budget
        largest = max(law.total.value for law in budget.laws)
        self.unit = next(unit for unit, most in _FINER[budget.unit] if largest < most)
        self.scale = factor(budget.unit, self.unit) or 1.0
        largest *= self.scale
        self.digits = max(0, 3 - math.floor(math.log10(largest))) if largest else 0

    def number(self, value: float) -> str:
        """Return a number in the unit, without it, to a thousandth of the largest total."""
        return fixed(value * self.scale, self.digits).replace("-", "−")

    def interval(self, x: Interval) -> str:
        """Return ``8.6 [8.1, 9.2]``, or how many runs would show the ends."""
        if x.needed:
            return f"{self.number(x.value)} [not shown: needs {x.needed:,} runs]"
        return f"{self.number(x.value)} [{self.number(x.low)}, {self.number(x.high)}]"

    def answer(self, law: LawBudget) -> Iterator[str]:
        """Yield what a law's budget says, in sentences."""
        budget = self.budget
        yield (
            f"{law.title}: {WORDS[budget.error]} {self.interval(law.total)} {self.unit} rms "
            f"{over_window(budget.window)}, {count_of(law.runs, 'run')}"
            + (f" ({law.failed} left out, which fail in some variant)" if law.failed else "")
        )
        if not law.rows:
            return
        first = max(law.rows, key=lambda row: row.alone.value)
        share = (first.alone.value / law.total.value) ** 2
        where = f" ({first.source.key})" if first.source.key else ""
        yield (
            f"most of it: {first.source.words}{where}, {self.number(first.alone.value)} "
            f"{self.unit} alone, which is {percent(share)} of the mean square"
        )

    def sources(self, law: LawBudget) -> TextTable:
        """Return the table of the sources of a law."""
        total = law.total.value
        rows = [self._row(row, total) for row in law.rows]
        summed = law.root_sum_square
        ends = [
            ["root of the sum of squares", "", self.number(summed), "", _share(summed, total)],
            ["with all of them", "", self.interval(law.total), "", ""],
            ["left over", "", self.number(law.left_over), "", _share(law.left_over, total)],
        ]
        return TextTable(
            "sources",
            f"Sources of the {WORDS[self.budget.error]} of {law.title}",
            ["source", "key", f"alone, {self.unit}", f"with the others, {self.unit}", "share"],
            [Block("", rows), Block("", ends)],
            [
                f"alone, {self.unit}: root mean square that the source adds to the loop without "
                "others, with its interval of 95 %; negative where it lowers the error",
                f"with the others, {self.unit}: what goes if it alone is left out",
                "share: of the mean square, alone",
            ],
            spare=(f"with the others, {self.unit}",),
            keys=2,
        )

    def _row(self, row: Row, total: float) -> list[str]:
        beside = "" if row.beside is None else self.interval(row.beside)
        shares = _share(row.alone.value, total)
        return [row.source.words, row.source.key, self.interval(row.alone), beside, shares]

    def quantiles(self) -> TextTable:
        """Return the table of the quantiles of all laws."""
        blocks = [
            Block(
                f"{law.title}: largest {self.number(law.peak)}",
                [
                    [
                        f"{100 * quantile.share:g} %",
                        self.interval(quantile.mixed),
                        self.interval(quantile.ensemble),
                        self.interval(quantile.temporal),
                        self.number(quantile.worst),
                    ]
                    for quantile in law.quantiles
                ],
            )
            for law in self.budget.laws
        ]
        return TextTable(
            "quantiles",
            f"Quantiles of the {WORDS[self.budget.error]}, {self.unit}",
            ["quantile", "mixed", "ensemble", "temporal", "temporal, worst run"],
            blocks,
            [
                "mixed: of all runs and samples in time, weighted equally (ECSS-E-ST-60-10C)",
                "ensemble: of runs, by the largest error of each",
                "temporal: of the samples in time, of the median run",
            ],
            spare=("temporal, worst run",),
        )


def over_window(window: Window) -> str:
    """Return a window in words."""
    if math.isinf(window.stop):
        return f"from {window.start:g} s on" if window.start else "over the whole time"
    return f"from {window.start:g} to {window.stop:g} s"


def in_latex(table: TextTable) -> TextTable:
    """Return a table whose cells LaTeX reads: a bare % would begin a comment and lose the row."""
    special = str.maketrans({"%": r"\%", "_": r"\_", "−": "$-$"})
    blocks = [
        Block(block.title, [[cell.translate(special) for cell in row] for row in block.rows])
        for block in table.blocks
    ]
    return replace(table, blocks=blocks)


def _share(value: float, total: float) -> str:
    return percent(value * abs(value) / total**2).replace("-", "−")
