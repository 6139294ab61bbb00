"""Judges claims by measurements. Does not know any particular claim."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from eqt_cli.analysis.comparison.claims import AtMost, Claim, ClaimSet, Less
from eqt_cli.analysis.comparison.intervals import SHARE, runs_without_exception
from eqt_cli.analysis.comparison.pairs import Pair
from eqt_cli.results.quantity import Quantity
from eqt_cli.results.result import PerRun, Result
from eqt_cli.results.time_windows import Window


class ClaimVerdict(StrEnum):
    """The verdict on a claim."""

    SUPPORTED = "supported"
    SEEN = "seen, not all settled"
    NOT_SUPPORTED = "not supported"
    UNDECIDED = "undecided"
    NOT_COVERED = "not covered"


@dataclass(frozen=True)
class Settled:
    """The number of runs of a law that end within the settling threshold.

    Attributes
    ----------
    controller
        Label of the law.
    count, runs
        Number of runs that settled, and of runs that did not fail.
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
        Source of the claim, and its words.
    verdict
        Verdict for the available runs.
    runs_to_decide
        Number of runs that would decide if all stays as measured; None if no number would.
    pair
        The difference of two controllers, for a claim that one has less than the other.
    measured, controller
        The measure and the controller, for a claim about every run.
    statement
        The claim about every run in words.
    held, runs
        Number of runs in which it held, and of runs with a value.
    low
        Lower end of the one-sided interval for the share of runs in which it holds.
    absent
        Kinds of controllers that the claim mentions and the result does not have.
    settled
        Numbers of settled runs of the laws of the row; empty if not stored.
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
        """Return the judgement with settled runs; if some did not settle, it is at most `SEEN`.

        A claim about a controller concerns runs that settle. This horizon does not show how the
        others end.
        """
        late = any(law.count < law.runs for law in settled)
        seen = late and self.verdict is ClaimVerdict.SUPPORTED
        verdict = ClaimVerdict.SEEN if seen else self.verdict
        return replace(self, verdict=verdict, settled=tuple(settled))


def applicable(sets: Sequence[type[ClaimSet]], kinds: Sequence[str]) -> Iterator[tuple[str, Claim]]:
    """Yield the source and the claim for claims with a row about controllers of the result."""
    for found in sets:
        for claim in found.claims:
            if any(set(row.kinds) <= set(kinds) for row in claim.rows):
                yield found.source, claim


def measured_by(result: Result, row: Less) -> list[tuple[Quantity, Window]]:
    """Return the measures that test a row; empty if the result cannot test it."""
    return [
        (quantity, row.window)
        for quantity in result.by_parts(row.measure)
        if result.covers(quantity, row.window)
        and not (row.rotation_only and not _is_rotation(result, quantity))
    ]


def _is_rotation(result: Result, quantity: Quantity) -> bool:
    """Whether a measure of the pose error concerns only the orientation."""
    if quantity.signals and quantity.signals[0].startswith("pose_error_rotation"):
        return True
    whole = result.units("mean_pose_error") if result.has("mean_pose_error") else ""
    return whole == "1" and not (quantity.parted and result.parts(quantity.signals[0]))


def judge_less(source: str, says: str, pair: Pair) -> Judgement:
    """Judge a claim that the first of a pair has less than the second.

    It is supported if the whole interval lies below 0, not supported if none of it does, and
    undecided otherwise.
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
    """Judge a claim that a bound holds in every run.

    One exception makes it not supported. It is supported if the runs without exception show that at
    least 95 % of all initial states have none (exact binomial interval of Clopper and Pearson).
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
