"""Base classes of certificates: statements that a numerical check can confirm or refute."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from math import ceil, floor, log10
from typing import Any, ClassVar, Literal

from eqt_cli.analysis.evidence.exact import NotRationalError
from eqt_cli.analysis.evidence.numbers import discrepancy
from eqt_cli.analysis.evidence.proof import Refutation, UnprovableError, prove, written
from eqt_cli.analysis.evidence.runs import Runs, Setting
from eqt_cli.analysis.evidence.sample import ExactStates, Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller
from eqt_cli.core.arrays import Array
from eqt_cli.core.registry import described, place_of
from eqt_cli.mechanics.tracking import Tracking

Kind = Literal["identity", "trajectory", "hypothesis", "code"]


class Verdict(StrEnum):
    """The outcome of a certificate."""

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
        Name, statement and kind of the certificate.
    controller
        Label of the law; empty if the certificate concerns no law.
    measured, bound
        Measured value, and the bound that it must not exceed (for definiteness: fall below); None
        if the check has no such number.
    verdict, remark
        Verdict, and additional information.
    degree, points, probability
        Data of a proof: bound of the degree, number of exact states at which the sides were equal,
        and bound of the probability of this for different sides; None without a proof.
    not_proved
        Reason why a requested proof failed.
    difference
        Left − right at an exact state, as a fraction, if the sides differ.
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
        The statement in a few words.
    statement
        Place in the paper: ``Theorem 4.1``.
    section
        Section of the paper, for the order of rows.
    kind
        Identities and trajectories can fail; hypotheses are only reported.
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
        """Return a row of this certificate."""
        return Row(
            self.name, self.statement, self.kind, controller, measured, bound, verdict, remark
        )

    def compared(
        self, measured: float, bound: float, remark: str = "", controller: str = ""
    ) -> Row:
        """Return a row that holds if the measured value is within its bound, else fails."""
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        return self.row(verdict, measured, bound, remark, controller)


class Identity(Certificate):
    """An equation that holds at every state, up to the rounding of its two sides.

    Attributes
    ----------
    per_law
        Whether it concerns a control law; else only the group and the inertia.
    of_whole
        Whether it concerns a cascade as a whole; else its attitude law.
    not_rational
        Reason why its sides are not rational functions of the state, if this is known.
    """

    kind: ClassVar[Kind] = "identity"
    per_law: ClassVar[bool] = False
    of_whole: ClassVar[bool] = False
    not_rational: ClassVar[str] = ""

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether the identity applies to this closed loop."""
        return True

    @abstractmethod
    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Yield both sides of its equations at random states; none if it claims nothing."""

    def check(self, sample: Sample) -> list[Row]:
        """Compare the sides within their rounding bounds and, with exact states, by a proof."""
        rows = self._within_rounding(sample)
        return rows if sample.exact is None else [self._exactly(row, sample.exact) for row in rows]

    def _within_rounding(self, sample: Sample) -> list[Row]:
        """Compare the largest difference of two sides with the bound of their rounding errors."""
        label = sample.label if self.per_law else ""
        try:
            discrepancies = [discrepancy(left, right) for left, right in self.sides(sample)]
        except Exception as error:  # a plugin's law may not support these numbers
            reason = f"cannot be evaluated on symbols: {type(error).__name__}: {error}"
            return [self.row(Verdict.UNDECIDED, remark=reason, controller=label)]
        if not discrepancies:
            return []
        return [self.compared(*max(discrepancies, key=_excess), controller=label)]

    def _exactly(self, row: Row, states: ExactStates) -> Row:
        """Return the row with the outcome of the proof, or with the reason why there is none."""
        try:
            reason = self.not_rational or states.obstacle
            proof = None if reason else prove(self.sides, states)
        except Exception as error:
            proof, reason = None, _reason(error)
        if isinstance(proof, Refutation):
            remark = f"left − right = {written(proof.difference)}{proof.place}"
            return replace(
                row, verdict=Verdict.FAILS, remark=remark, difference=str(proof.difference)
            )
        if proof is None:
            remark = joined(row.remark, f"not proved: {reason}")
            return replace(row, remark=remark, not_proved=reason)
        shown = f"degree {proof.degree}, {proof.points} states, p {_at_most(proof.probability)}"
        if proof.functions:
            shown = f"{shown}; {proof.functions}"
        return replace(
            row,
            verdict=Verdict.PROVED if row.verdict is Verdict.HOLDS else row.verdict,
            degree=proof.degree,
            points=proof.points,
            probability=proof.probability,
            remark=joined(row.remark, shown),
        )


class LiteralForm(Identity):
    """Compares a registered law with its source's formula, in the form of the source.

    It applies to every law with this registered name, whatever its numbers are. So a law with
    changed numbers fails.

    Attributes
    ----------
    law
        Registered name of the law.
    """

    per_law: ClassVar[bool] = True
    law: ClassVar[str]

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether the loop has this law; override it if the formula does not cover every loop."""
        return registered_name(loop.controller) == self.law

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Compare torque and formula for the experiment's gains and for generic ones.

        Gains that are multiples of the identity could hide a wrong frame.
        """
        for s in (sample.s, sample.generic):
            yield sample.loop.controller.torque(s), self.torque(s, sample.loop.controller)

    @abstractmethod
    def torque(self, s: Tracking, law: Any) -> Array:
        """Return the formula's torque in the body frame; it may read only the law's options."""


class TrajectoryCheck(Certificate):
    """A statement about solutions that is checked on the runs of a law."""

    kind: ClassVar[Kind] = "trajectory"

    def applies(self, runs: Runs) -> bool:
        """Whether the statement applies to these runs."""
        return True

    def undecided(self, runs: Runs, reason: str = "") -> Row:
        """Return a row without a verdict; the reason is that runs failed unless it is given."""
        remark = reason or runs.remark
        return self.row(Verdict.UNDECIDED, remark=remark, controller=runs.label)

    @abstractmethod
    def check(self, runs: Runs) -> Row:
        """Judge the statement by the runs."""


class Hypothesis(Certificate):
    """An assumption of the theorems about group, gains, inertia or reference."""

    kind: ClassVar[Kind] = "hypothesis"

    @abstractmethod
    def check(self, setting: Setting) -> list[Row]:
        """Judge the assumption for the setting; no row if it does not apply."""


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
    """Return the reason why a law cannot be evaluated on exact numbers, with its line."""
    if isinstance(error, UnprovableError):
        return str(error)
    place = place_of(error) or place_of(error, _is_law)
    known = isinstance(error, NotRationalError)
    what = str(error) if known else f"cannot be evaluated on exact numbers: {described(error)}"
    return f"{what}, at {place}" if place else what


def _is_law(module: str) -> bool:
    """Whether a module of eqt contains formulas, rather than code that evaluates them."""
    return module.startswith("eqt_cli.") and not module.startswith(
        ("eqt_cli.analysis.", "eqt_cli.core.", "eqt_cli.closed_loop.")
    )


def _at_most(probability: float) -> str:
    """Format a bound with two digits, rounded up."""
    if not probability:
        return "= 0"
    power = floor(log10(probability)) - 1
    return f"≤ {ceil(probability / 10.0**power) * 10.0**power:.1e}"


def joined(*remarks: str) -> str:
    """Join the remarks that are not empty."""
    return "; ".join(filter(None, remarks))


def _excess(pair: tuple[float, float]) -> float:
    difference, bound = pair
    if difference == 0:
        return 0.0
    return difference / bound if bound else float("inf")
