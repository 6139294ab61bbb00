"""Claims against measurements; it knows no single claim and no table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from eqt_cli.analysis.comparison.claims import AtMost, Claim, ClaimSet, Less
from eqt_cli.analysis.comparison.pairs import Pair
from eqt_cli.analysis.comparison.runs_needed import SHARE, runs_without_exception
from eqt_cli.results.quantity import Quantity
from eqt_cli.results.result import PerRun, Result
from eqt_cli.results.time_windows import Window


class ClaimVerdict(StrEnum):
    """What the runs say of a claim."""

    SUPPORTED = "supported"
    SEEN = "seen, not all settled"
    NOT_SUPPORTED = "not supported"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Settled:
    """How many runs of a law end within the settling threshold.

    Attributes
    ----------
    controller
        The label of the law.
    count, runs
        Runs that settled, of those that did not fail.
    """

    controller: str
    count: int
    runs: int


@dataclass(frozen=True)
class Judgement:
    """A row of a claim, measured.

    Attributes
    ----------
    source, says
        Who says it, in which words.
    pair
        The controllers and the differences, for a claim that one has less than the other.
    measured, controller
        The number and whose it is, for a claim on every run.
    statement
        Such a claim in words.
    held, runs
        Runs in which it held, of those with a value.
    low
        Lower end of the one-sided interval for the share of runs in which it holds.
    verdict
        For the number of runs at hand.
    runs_to_decide
        Runs that would decide, if all stays as measured; None where no number would.
    absent
        Kinds of controllers that the sentence is also about and that are not there.
    settled
        Runs that settled, of each law of the row; empty where nothing that is stored tells.
    """

    source: str
    says: str
    verdict: ClaimVerdict
    runs_to_decide: int | None
    pair: Pair | None = None
    measured: PerRun | None = None
    controller: str = ""
    statement: str = ""
    held: int = 0
    runs: int = 0
    low: float = float("nan")
    absent: tuple[str, ...] = ()
    settled: tuple[Settled, ...] = ()

    def with_settled(self, settled: Sequence[Settled]) -> Judgement:
        """The same, and no longer supported where a run of its laws did not settle.

        A claim about a controller is one about runs that arrive: of others, this horizon does not
        show the end.
        """
        late = any(law.count < law.runs for law in settled)
        seen = late and self.verdict is ClaimVerdict.SUPPORTED
        verdict = ClaimVerdict.SEEN if seen else self.verdict
        return replace(self, verdict=verdict, settled=tuple(settled))


def applicable(sets: Sequence[type[ClaimSet]], kinds: Sequence[str]) -> Iterator[tuple[str, Claim]]:
    """Every claim with at least one row about controllers that are there, and its source."""
    for found in sets:
        for claim in found.claims:
            if any(set(row.kinds) <= set(kinds) for row in claim.rows):
                yield found.source, claim


def measured_by(result: Result, row: Less) -> list[tuple[Quantity, Window]]:
    """The numbers that a row needs of a result; nothing if it cannot be tested there."""
    return [
        (quantity, row.window)
        for quantity in result.by_parts(row.measure)
        if result.covers(quantity, row.window)
        and not (row.rotation_only and not _is_rotation(result, quantity))
    ]


def _is_rotation(result: Result, quantity: Quantity) -> bool:
    """Whether a number from the pose error is about orientation alone."""
    if quantity.signals and quantity.signals[0].startswith("pose_error_rotation"):
        return True
    whole = result.units("mean_pose_error") if result.has("mean_pose_error") else ""
    return whole == "1" and not (quantity.parted and result.parts(quantity.signals[0]))


def judge_less(source: str, says: str, pair: Pair) -> Judgement:
    """Whether the first of a pair has less than the second.

    Supported where the whole interval lies below 0, not supported where none of it does, and
    undecided between.
    """
    if pair.high < 0:
        verdict = ClaimVerdict.SUPPORTED
    elif pair.low >= 0 and not pair.low == pair.high == 0:
        verdict = ClaimVerdict.NOT_SUPPORTED
    else:
        verdict = ClaimVerdict.UNDECIDED
    return Judgement(source, says, verdict, pair.runs_to_decide, pair=pair)


def judge_at_most(
    source: str, says: str, row: AtMost, measured: PerRun, index: int, label: str, confidence: float
) -> Judgement:
    """Whether a bound holds in every run.

    Not supported by a single exception; supported when the runs without one are enough to say that
    at least 95 % of all initial states have none (exact binomial interval of Clopper and Pearson).
    """
    from scipy.special import betaincinv  # slow to import

    values = measured.values[index]
    values = values[np.isfinite(values)]
    held, runs = int(np.count_nonzero(values <= row.bound)), len(values)
    low = float(betaincinv(held, runs - held + 1, 1 - confidence)) if held else 0.0
    if held < runs:
        verdict = ClaimVerdict.NOT_SUPPORTED
    else:
        verdict = ClaimVerdict.SUPPORTED if low >= SHARE else ClaimVerdict.UNDECIDED
    needed = runs_without_exception(confidence)
    return Judgement(
        source,
        says,
        verdict,
        needed,
        measured=measured,
        controller=label,
        statement=row.statement,
        held=held,
        runs=runs,
        low=low,
    )
