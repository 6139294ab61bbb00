"""What a certificate is: a statement of the paper that a numerical check can confirm or refute."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from math import ceil, floor, log10
from typing import Any, ClassVar, Literal

from eqt_cli.analysis.evidence.exact import NotRationalError
from eqt_cli.analysis.evidence.exact_states import ExactStates
from eqt_cli.analysis.evidence.proof import Refutation, UnprovableError, prove, written
from eqt_cli.analysis.evidence.running_error import discrepancy
from eqt_cli.analysis.evidence.runs import Runs, Setting
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller
from eqt_cli.core.arrays import Array
from eqt_cli.core.error_origin import described, place_of
from eqt_cli.mechanics.tracking import Tracking

Kind = Literal["identity", "trajectory", "hypothesis", "oracle", "code"]


class Verdict(StrEnum):
    """What a certificate finds."""

    HOLDS = "holds"
    PROVED = "proved"
    FAILS = "FAILS"
    UNDECIDED = "undecided"
    UNCLAIMED = "unclaimed"
    NOT_COVERED = "not covered"
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
    degree, points, probability
        Of a proof: the degree of what was 0 at so many exact states, and a bound of the probability
        of that if it is not 0 everywhere; None where there is no proof.
    not_proved
        Why there is none, where one was asked for.
    difference
        Left − right at an exact state, as a fraction, where the sides differ.
    """

    name: str
    statement: str
    kind: Kind
    controller: str
    measured: float | None
    bound: float | None
    verdict: Verdict
    remark: str = ""
    degree: int | None = None
    points: int | None = None
    probability: float | None = None
    not_proved: str = ""
    difference: str = ""


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

    def compared(
        self, measured: float, bound: float, remark: str = "", controller: str = ""
    ) -> Row:
        """A row that holds where what was measured is within its bound, and else fails."""
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        return self.row(verdict, measured, bound, remark, controller)


class Identity(Certificate):
    """An equation that holds at every state, up to the rounding of its two sides.

    Attributes
    ----------
    per_law
        Whether it is about a control law, or about the group and the inertia only.
    not_rational
        Why its sides are no rational functions of the state, where that is known beforehand.
    """

    kind: ClassVar[Kind] = "identity"
    per_law: ClassVar[bool] = False
    not_rational: ClassVar[str] = ""

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether it says anything about this closed loop."""
        return True

    @abstractmethod
    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The left and the right side of its equations, at random states; none: no claim."""

    def check(self, sample: Sample) -> list[Row]:
        """The sides by their rounding bounds, and where exact states are given, by a proof."""
        rows = self._within_rounding(sample)
        return rows if sample.exact is None else [self._exactly(row, sample.exact) for row in rows]

    def _within_rounding(self, sample: Sample) -> list[Row]:
        """The largest difference of two sides against the bound of their rounding errors."""
        label = sample.label if self.per_law else ""
        try:
            found = [discrepancy(left, right) for left, right in self.sides(sample)]
        except Exception as error:  # a law of the user's, on numbers it was not written for
            reason = f"cannot be evaluated on symbols: {type(error).__name__}: {error}"
            return [self.row(Verdict.UNDECIDED, remark=reason, controller=label)]
        if not found:
            return []
        return [self.compared(*max(found, key=_excess), controller=label)]

    def _exactly(self, row: Row, states: ExactStates) -> Row:
        """The row with what exact numbers say; without a word from them it stays as it is."""
        try:
            reason = self.not_rational or states.obstacle
            found = None if reason else prove(self.sides, states)
        except Exception as error:
            found, reason = None, _reason(error)
        if isinstance(found, Refutation):
            remark = f"left − right = {written(found.difference)}{found.place}"
            return replace(
                row, verdict=Verdict.FAILS, remark=remark, difference=str(found.difference)
            )
        if found is None:
            remark = _joined(row.remark, f"not proved: {reason}")
            return replace(row, remark=remark, not_proved=reason)
        shown = f"degree {found.degree}, {found.points} states, p {_at_most(found.probability)}"
        if found.functions:
            shown = f"{shown}; {found.functions}"
        return replace(
            row,
            verdict=Verdict.PROVED if row.verdict is Verdict.HOLDS else row.verdict,
            degree=found.degree,
            points=found.points,
            probability=found.probability,
            remark=_joined(row.remark, shown),
        )


class LiteralForm(Identity):
    """A registered law against its source's formula, written out as the source does.

    It is asked of every law that claims to be this one, by its registered name and whatever its
    numbers are; so a law whose numbers are changed fails it.

    Attributes
    ----------
    law
        The registered name of the law.
    """

    per_law: ClassVar[bool] = True
    law: ClassVar[str]

    def applies(self, loop: ClosedLoop) -> bool:
        """To the law of this name, where the formula is written for the rest of the loop."""
        return registered_name(loop.controller) == self.law and self.is_written_for(loop)

    def is_written_for(self, loop: ClosedLoop) -> bool:
        """Whether the formula is for this group, and for an inertia of this kind."""
        return True

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The law's torque against the formula, with the experiment's gains and with generic ones.

        Gains that are multiples of the identity do not tell one frame from another.
        """
        for s in (sample.s, sample.generic):
            yield sample.loop.controller.torque(s), self.torque(s, sample.loop.controller)

    @abstractmethod
    def torque(self, s: Tracking, law: Any) -> Array:
        """The formula, body frame; of the law only its options may be read."""


class TrajectoryCheck(Certificate):
    """A statement about solutions, checked on the runs of a law."""

    kind: ClassVar[Kind] = "trajectory"

    def applies(self, runs: Runs) -> bool:
        """Whether it says anything about these runs."""
        return True

    @abstractmethod
    def check(self, runs: Runs) -> Row:
        """What the runs say."""


class Hypothesis(Certificate):
    """What the theorems assume of group, gains, inertia and reference."""

    kind: ClassVar[Kind] = "hypothesis"

    @abstractmethod
    def check(self, setting: Setting) -> list[Row]:
        """What is true of the setting; no row where it says nothing."""


def registered_name(law: Controller) -> str | None:
    """The name by which a law claims to be what its source writes.

    None where its class overrides the torque of a named law without taking a name of its own: then
    it claims nothing.
    """
    for owner in type(law).__mro__:
        if "name" in vars(owner):
            return law.name
        if "torque" in vars(owner):
            return None
    return None


def _reason(error: Exception) -> str:
    """Why a law cannot be evaluated on exact numbers, with its line."""
    if isinstance(error, UnprovableError):
        return str(error)
    place = place_of(error) or place_of(error, _is_law)
    known = isinstance(error, NotRationalError)
    what = str(error) if known else f"cannot be evaluated on exact numbers: {described(error)}"
    return f"{what}, at {place}" if place else what


def _is_law(module: str) -> bool:
    """Whether a module of eqt holds formulas, and not what evaluates them."""
    return module.startswith("eqt_cli.") and not module.startswith(
        ("eqt_cli.analysis.", "eqt_cli.core.", "eqt_cli.closed_loop.")
    )


def _at_most(probability: float) -> str:
    """A bound with two digits, rounded up."""
    if not probability:
        return "= 0"
    power = floor(log10(probability)) - 1
    return f"≤ {ceil(probability / 10.0**power) * 10.0**power:.1e}"


def _joined(*remarks: str) -> str:
    return "; ".join(filter(None, remarks))


def _excess(pair: tuple[float, float]) -> float:
    difference, bound = pair
    if difference == 0:
        return 0.0
    return difference / bound if bound else float("inf")
