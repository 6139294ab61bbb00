"""The claims of papers, and what the runs of a result say of them."""

from __future__ import annotations

from abc import ABC
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, ClassVar

import numpy as np

from eqt_cli.analysis.comparison import ClaimVerdict, Comparison, Judgement, Numbers, Pair
from eqt_cli.analysis.intervals import SHARE, runs_without_exception
from eqt_cli.base.registry import Registry
from eqt_cli.results.metrics import EARLY
from eqt_cli.results.quantity import WHOLE, Measure, Window
from eqt_cli.results.result import Result, by_parts, covers

# Base classes of claims. Does not know how claims are tested --------------------------------------


@dataclass(frozen=True)
class Less:
    """One law has less of something than another, on average over initial states.

    Attributes
    ----------
    lesser, greater
        Kinds of controllers, as in a configuration: ``eqt``.
    measure
        Name of a measure. If its parts have different units, each part is tested.
    window
        Window over which it is taken.
    rotation_only
        Whether the claim concerns only the orientation; then other parts of the pose are not
        tested.
    """

    lesser: str
    greater: str
    measure: str
    window: Window = WHOLE
    rotation_only: bool = False

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the controllers of the claim."""
        return (self.lesser, self.greater)


@dataclass(frozen=True)
class AtMost:
    """In every run, a measure stays at or below a bound.

    Attributes
    ----------
    kind
        Kind of the controller.
    measure
        Name of a measure.
    bound
        Bound in the unit of the measure.
    statement
        The claim in words.
    """

    kind: str
    measure: str
    bound: float
    statement: str

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of the controller of the claim."""
        return (self.kind,)


@dataclass(frozen=True)
class Claim:
    """A sentence, and the rows by which it is measured.

    Attributes
    ----------
    says
        The claim in the words of its source.
    rows
        Statements that are tested separately; the claim is supported as far as they are.
    """

    says: str
    rows: tuple[Less | AtMost, ...]


class ClaimSet(ABC):
    """The claims of one source.

    Attributes
    ----------
    name
        Short name for tables and messages.
    source
        Reference of the source.
    claims
        Claims in the order of the source.
    experiment
        Sections of the configuration of the source. `compare` judges the claims unasked where a
        result has these, and all laws of the claims.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    claims: ClassVar[tuple[Claim, ...]]
    experiment: ClassVar[Mapping[str, Any]] = {}


claim_sets = Registry("claim set", "claims", ClaimSet, ("analysis.claims",))


NEVER_RISES = 1e-6
"""Bound relative to L(0): far above solver errors, and far below any visible rise."""


class Hampsey2025(ClaimSet):
    """Hampsey, van Goor, Banavar, Mahony (2025), section 7."""

    name: ClassVar[str] = "hampsey2025"
    source: ClassVar[str] = "Hampsey et al. (2025), section 7"
    experiment: ClassVar[Mapping[str, Any]] = {
        "group": "SO3",
        "reference": {
            "kind": "torque",
            "torque": ["cos(t)", "sin(t)", "cos(t)*sin(t)"],
            "pose": "identity",
            "velocity": [0.0, 0.0, 0.0],
        },
    }
    claims: ClassVar[tuple[Claim, ...]] = (
        Claim(
            "All four of these controls are stabilising",
            tuple(
                AtMost(kind, "lyapunov_rise", NEVER_RISES, "L does not rise between samples")
                for kind in ("eqt", "gt", "nog", "asym")
            ),
        ),
        Claim(
            "the EqT control requires less control action for large error (the first 5 seconds of "
            "the response)",
            (Less("eqt", "gt", "mean_torque", EARLY),),
        ),
        Claim(
            "[EqT] leads to slightly slower attitude tracking than the GT control",
            (Less("gt", "eqt", "mean_pose_error", rotation_only=True),),
        ),
        Claim(
            "The EqT and GT controls appear to be superior to the two approximations",
            tuple(
                Less(lesser, greater, measure, rotation_only=measure == "mean_pose_error")
                for measure in ("mean_pose_error", "mean_torque")
                for lesser in ("eqt", "gt")
                for greater in ("nog", "asym")
            ),
        ),
    )


# What is measured of claims, and the verdicts -----------------------------------------------------


@dataclass(frozen=True)
class Test:
    """A row of a claim about controllers that a result has, and the measure that tests it."""

    source: type[ClaimSet]
    claim: Claim
    row: Less | AtMost
    measure: Measure
    window: Window


def tests_of(result: Result, kinds: Mapping[str, str]) -> Iterator[Test]:
    """Yield the tests of the rows of claims about controllers of these kinds."""
    for source in claim_sets.all():
        for claim in source.claims:
            for row in claim.rows:
                if set(row.kinds) <= set(kinds):
                    for measure in _measures(result, row):
                        window = row.window if isinstance(row, Less) else WHOLE
                        yield Test(source, claim, row, measure, window)


def _measures(result: Result, row: Less | AtMost) -> list[Measure]:
    """Return the measures that test a row; empty if the result cannot test it."""
    if isinstance(row, AtMost):
        measures = result.comparable
        return [measures[row.measure]] if row.measure in measures else []
    return [
        measure
        for measure in by_parts(result, row.measure)
        if covers(result, measure, row.window)
        and (_is_rotation(result, measure) or not row.rotation_only)
    ]


def _is_rotation(result: Result, measure: Measure) -> bool:
    """Whether a measure of the pose error concerns only the orientation."""
    if measure.signals and measure.signals[0].startswith("pose_error_rotation"):
        return True
    whole = result.units("mean_pose_error") if result.has("mean_pose_error") else ""
    return whole == "1" and not (measure.parted and result.parts(measure.signals[0]))


def judged(
    result: Result, test: Test, kinds: Mapping[str, str], numbers: Numbers, k: int
) -> Judgement:
    """Judge a row of a claim by the number of this position.

    Parameters
    ----------
    kinds
        Label of the first law of each kind.
    """
    claim, row, sections = test.claim, test.row, test.source.experiment.items()
    if isinstance(row, AtMost):
        judgement = judge_at_most(row, numbers, k, kinds[row.kind])
    else:
        first, second = kinds[row.lesser], kinds[row.greater]
        judgement, small = judge_less(numbers.pair(k, first, second)), result.described.small_errors
        if first in small and second in small and small[first].differs_from(small[second]):
            incomparable = ClaimVerdict.NOT_COMPARABLE
            judgement = replace(judgement, verdict=incomparable, runs_to_decide=None)
    if result.described.departures:
        judgement = replace(judgement, verdict=ClaimVerdict.NOT_COVERED, runs_to_decide=None)
    mentioned = dict.fromkeys(kind for other in claim.rows for kind in other.kinds)
    laws = {kind for other in test.source.claims for row in other.rows for kind in row.kinds}
    return replace(
        judgement,
        source=test.source.source,
        says=claim.says,
        absent=tuple(kind for kind in mentioned if kind not in kinds),
        is_at_home=laws <= set(kinds) and all(result.config.get(x) == y for x, y in sections),
    )


def judge_less(pair: Pair) -> Judgement:
    """Judge a claim that the first of a pair has less than the second.

    It is supported if the intervals of the mean and of the median lie below 0, not supported if
    neither holds less, and undecided otherwise.
    """
    verdict = ClaimVerdict.UNDECIDED
    if pair.high < 0 and pair.median_high < 0:
        verdict = ClaimVerdict.SUPPORTED
    elif pair.low >= 0 and pair.median_low >= 0 and not pair.low == pair.high == 0:
        verdict = ClaimVerdict.NOT_SUPPORTED
    return Judgement(pair.measured, verdict, pair.runs_to_decide, pair=pair)


def judge_at_most(row: AtMost, numbers: Numbers, k: int, label: str) -> Judgement:
    """Judge a claim that a bound holds in every run.

    One exception makes it not supported. It is supported if the runs without exception show that at
    least 95 % of all initial states have none (exact binomial interval of Clopper and Pearson).
    """
    from scipy.special import betaincinv  # slow to import

    confidence, measured = numbers.how.confidence, numbers.measured[k]
    values = measured.values[numbers.laws.index(label)]
    values = values[np.isfinite(values)]
    held, runs = int(np.count_nonzero(values <= row.bound)), len(values)
    low = float(betaincinv(held, runs - held + 1, 1 - confidence)) if held else 0.0
    verdict = ClaimVerdict.NOT_SUPPORTED
    if held == runs:
        verdict = ClaimVerdict.SUPPORTED if low >= SHARE else ClaimVerdict.UNDECIDED
    return Judgement(
        measured,
        verdict,
        runs_without_exception(confidence),
        controller=label,
        statement=row.statement,
        held=held,
        runs=runs,
        low=low,
    )


# A verdict on each claim --------------------------------------------------------------------------


def by_claim(comparison: Comparison) -> list[tuple[str, list[Judgement]]]:
    """Return the rows of each claim after the verdict on it, which is *partly* that of some."""
    claims = []
    for _, group in groupby(comparison.judgements, key=lambda row: row.says):
        rows = list(group)
        verdicts = {row.verdict for row in rows}
        verdict = str(ClaimVerdict.NOT_SUPPORTED)
        if len(verdicts) == 1:
            verdict = str(*verdicts)
        elif ClaimVerdict.NOT_COMPARABLE in verdicts:
            verdict = str(ClaimVerdict.NOT_COMPARABLE)
        elif ClaimVerdict.SUPPORTED in verdicts:
            verdict = f"partly {ClaimVerdict.SUPPORTED}"
        claims.append((verdict, rows))
    return claims


def sources(comparison: Comparison) -> str:
    """Return the sources of the claims."""
    return "; ".join(dict.fromkeys(row.source for row in comparison.judgements))
