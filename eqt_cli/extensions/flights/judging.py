"""How two sides are judged: for one look or every look, in pairs or not, by a model or not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import FEWEST, Interval, runs_to_decide
from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import count_of
from eqt_cli.extensions.flights import every_look, one_look
from eqt_cli.extensions.flights.every_look import blocks_of, pairs, pairs_to_decide

CONFIDENCE = 0.95
"""Of intervals and words."""

Sizes = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Design:
    """What is done with the numbers of both sides.

    Attributes
    ----------
    paired
        Whether number k of both belong together; at every look, whether `blocks` were flown so.
    blocks
        Numbers of both sides in each block, in the order flown, to be judged at every look; None
        for one look at a number of flights that was planned.
    normal
        Whether looks rest on normal numbers, by `every_look.safe_t`.
    predictions
        Logarithms of what a model predicts, of both sides.
    """

    paired: bool = False
    blocks: Sizes | None = None
    normal: bool = False
    predictions: Sequence[Array] | None = None

    def used(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return the flights that count: at every look, those of whole blocks."""
        if self.blocks is None or (self.normal and not self.paired):
            return x, y
        n, m = np.sum(self.blocks, axis=0, dtype=int).tolist() if self.blocks else (0, 0)
        return x[:n], y[:m]

    def ends(self, x: Array, y: Array, confidence: float, logs: bool = True) -> Any:
        """Return the difference of A and B with its interval, and the spread of a difference."""
        if self.blocks is None:
            if self.predictions is None or min(map(len, (x, y))) < FEWEST:
                return one_look.difference(x, y, self.paired, confidence)
            of_x, of_y = self.predictions if logs else map(np.exp, self.predictions)
            return one_look.difference_by_model(x, y, of_x, of_y, self.paired, confidence)
        if self.normal:
            ends, _ = every_look.safe_t(x, y, self.paired, confidence)
            spread = (
                np.std(x - y, ddof=1) if self.paired else np.hypot(*(z.std(ddof=1) for z in (x, y)))
            )
        else:
            blocks = blocks_of(x, y, self.blocks)
            ends = every_look.interval(blocks, confidence)
            spread = np.std(blocks.differences[:, 0], ddof=1) if len(self.blocks) > 1 else 0
        return Interval(*map(float, ends)), float(spread) or math.inf

    def p(self, x: Array, y: Array) -> float:
        """Return the p-value that both sides are alike."""
        if self.blocks is None:
            if self.predictions is None or min(map(len, (x, y))) < FEWEST:
                return float(one_look.permutation_test(x, y, self.paired))
            of_x, of_y = self.predictions
            return one_look.permutation_test_by_model(x, y, of_x, of_y, self.paired)
        if self.normal:
            return float(every_look.safe_t(x, y, self.paired, CONFIDENCE)[1])
        return float(every_look.p_value(blocks_of(x, y, self.blocks)))

    def needed(self, effect: float, confidence: float) -> int | None:
        """Return the flights of a side, or pairs, that decide with probability 0.8."""
        if self.blocks is None:
            return runs_to_decide(effect, confidence)
        return pairs_to_decide(round(effect, 4), confidence, normal=self.normal)

    def least(self, tests: int) -> int:
        """Return the flights of a side, or pairs, below which so many tests decide nothing."""
        if self.blocks is None:
            return math.ceil(math.log2(2 * tests / (1 - CONFIDENCE))) if self.paired else FEWEST
        fewest = range(1, 100)
        if self.normal:
            return 2
        return next(
            n for n in fewest if every_look.p_value(pairs(np.ones(n))) * tests <= 1 - CONFIDENCE
        )

    def worth(self, x: Array, y: Array, confidence: float) -> float | None:
        """Return how many flights, or pairs, would say as much without the model."""
        if self.predictions is None or min(map(len, (x, y))) < FEWEST:
            return None
        plain, _ = replace(self, predictions=None).ends(x, y, confidence)
        ends, _ = self.ends(x, y, confidence)
        return min(map(len, (x, y))) * ((plain.high - plain.low) / (ends.high - ends.low)) ** 2

    def waiting(self, n: int, m: int) -> Iterator[str]:
        """Yield which flights do not count yet."""
        n_used, m_used = map(len, self.used(range(n), range(m)))
        for side, count in ("A", n - n_used), ("B", m - m_used):
            if count:
                advice = "the first of A counts with the first of B, and so on"
                yield f"{count_of(count, 'flight')} of {side} not counted yet: {advice}"

    @property
    def noun(self) -> str:
        """What is counted."""
        return "pair" if self.paired or (self.blocks is not None and not self.normal) else "flight"

    @property
    def words(self) -> str:
        """What the numbers are."""
        if self.blocks is None:
            by = "pairs, by Student's t" if self.paired else "flights, by Welch's t"
            less = ", less what the model explains" if self.predictions else ""
            return f"95 % intervals over {by} of logarithms{less}; p: exact test"
        by = "a t-test of normal logarithms" if self.normal else "bets on the signs of pairs"
        return f"95 % intervals and p by {by}: valid at every look"
