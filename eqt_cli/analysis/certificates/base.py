"""What a certificate is: a statement of the paper that a numerical check can confirm or refute."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Literal

from eqt_cli.analysis.bounded import discrepancy
from eqt_cli.analysis.certificates.runs import Runs
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.analysis.certificates.setting import Setting
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array

Kind = Literal["identity", "trajectory", "hypothesis"]


class Verdict(StrEnum):
    """What a certificate finds."""

    HOLDS = "holds"
    FAILS = "FAILS"
    UNDECIDED = "undecided"
    UNCLAIMED = "unclaimed"
    MORSE_BOTT = "Morse-Bott"
    GROWING = "growing"
    VIOLATED = "violated"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Row:
    """The outcome of one check.

    Attributes
    ----------
    name, statement, kind
        Of the certificate.
    controller
        The label of the law it is about; empty where it is about none.
    measured, bound
        What was found and what it must not exceed (for a definiteness, fall below); None where
        the check has no such number.
    """

    name: str
    statement: str
    kind: Kind
    controller: str
    measured: float | None
    bound: float | None
    verdict: Verdict
    remark: str = ""


class Certificate(ABC):
    """A statement of the paper with the numbers that decide it.

    Attributes
    ----------
    name
        What it says, in a few words.
    statement
        Where the paper says it: ``Theorem 4.1``.
    section
        Of the paper, for the order of rows.
    kind
        Identities and trajectories can fail; hypotheses are reported.
    """

    name: ClassVar[str]
    statement: ClassVar[str]
    section: ClassVar[float]
    kind: ClassVar[Kind]

    def row(
        self,
        verdict: Verdict,
        measured: float | None = None,
        bound: float | None = None,
        remark: str = "",
        controller: str = "",
    ) -> Row:
        """A row of this certificate."""
        return Row(
            self.name, self.statement, self.kind, controller, measured, bound, verdict, remark
        )


class Identity(Certificate):
    """An equation that holds at every state, up to the rounding of its two sides.

    Attributes
    ----------
    per_law
        Whether it is about a control law, or about the group and the inertia only.
    """

    kind: ClassVar[Kind] = "identity"
    per_law: ClassVar[bool] = False

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether it says anything about this closed loop."""
        return True

    @abstractmethod
    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The left and the right side of its equations, at random states; none: no claim."""

    def check(self, sample: Sample) -> list[Row]:
        """The largest difference of two sides against the bound of their rounding errors."""
        label = sample.label if self.per_law else ""
        try:
            found = [discrepancy(left, right) for left, right in self.sides(sample)]
        except Exception as error:  # a law of the user's, on numbers it was not written for
            reason = f"cannot be evaluated on symbols: {type(error).__name__}: {error}"
            return [self.row(Verdict.UNDECIDED, remark=reason, controller=label)]
        if not found:
            return []
        measured, bound = max(found, key=_excess)
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        return [self.row(verdict, measured, bound, controller=label)]


class TrajectoryCheck(Certificate):
    """A statement about solutions, checked on the runs of a law."""

    kind: ClassVar[Kind] = "trajectory"

    @abstractmethod
    def check(self, runs: Runs) -> Row:
        """What the runs say."""


class Hypothesis(Certificate):
    """What the theorems assume of group, gains, inertia and reference."""

    kind: ClassVar[Kind] = "hypothesis"

    @abstractmethod
    def check(self, setting: Setting) -> list[Row]:
        """What is true of the setting; no row where it says nothing."""


def _excess(pair: tuple[float, float]) -> float:
    difference, bound = pair
    if difference == 0:
        return 0.0
    return difference / bound if bound else float("inf")
