"""Certificates: statements that are checked, the runs they read, and the rows they give."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import ceil, floor, log10
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.registry import Registry, described, place_of
from eqt_cli.base.reporting import NOTHING, Block, TextTable, brief, count_of, reporter, step
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.laws import Controller
from eqt_cli.components.mechanics import Tracking
from eqt_cli.engines.engine import Problem
from eqt_cli.extensions.proofs import sample as exact_states
from eqt_cli.extensions.proofs.exact import NotRationalError, discrepancy
from eqt_cli.extensions.proofs.sample import ExactStates, Sample
from eqt_cli.loop.closed_loop import ClosedLoop

# The runs of one law as certificates read them, and the setting that all laws share ---------------


ENERGY_PER_RTOL = 100.0
"""Allowed error of L per unit of `rtol`. There are hundreds of steps with errors of about rtol, and
damping removes most of them (measured over all groups and laws: 0.2 to 3)."""

STATES_PER_RTOL = 1000.0
"""Allowed error of states per unit of `rtol`, as in the cross-check. Trajectories amplify errors:
190 times for a run of nog in the paper's ensemble that was solved alone."""


@dataclass(frozen=True)
class VehicleRuns:
    """Good runs of one law in a loop that is not ideal.

    Attributes
    ----------
    problem
        The problem that the engine solved.
    states : (runs, samples, n)
        Flat states.
    seed
        Seed of the experiment.
    numbers : (runs,)
        Numbers of the runs.
    windows
        Some of the runs at other times, over which momentum is balanced; None without good runs.
    rtol, atol
        Tolerances of the engine that solved the problem.
    """

    problem: Problem
    states: Array
    seed: int
    numbers: Array
    windows: "VehicleRuns | None" = None
    rtol: float = 0.0
    atol: float = 0.0

    @property
    def loop(self) -> ClosedLoop:
        """The loop with the numbers of every run, for states ``(runs, samples, n)``."""
        return self.problem.batched_loop(extra_axes=1)

    def white_noise(self) -> Iterator[Array]:
        """Yield the white noise of each sensor in each run, ``(runs, instants, n)``, of variance 1.

        This is the noise divided by its configured standard deviation. Axes without noise are left
        out.
        """
        problem, vehicle = self.problem, self.problem.loop.vehicle
        G = problem.loop.group
        for place, sensor, clock, _, axes in vehicle.drawings(G):
            count = int(clock.numbers(problem.control_instants)[-1]) + 1
            period, whitened = clock.every * vehicle.tick, []
            for run in self.numbers.tolist():
                random = generator_at(self.seed, Stream.VEHICLE, run, place)
                sensor_of_run = sensor.drawn(random)
                deviation = sensor_of_run.white_deviation(G, period)
                if deviation is None:
                    break
                errors, deviation = (
                    sensor_of_run.errors(G, count, period, random)[:, axes],
                    deviation[axes],
                )
                whitened.append(errors[:, deviation > 0] / deviation[deviation > 0])
            if len(whitened) == len(self.numbers) and whitened and whitened[0].size:
                yield np.array(whitened)


@dataclass(frozen=True)
class Runs:
    """Metrics and trajectories of the good runs of one controller.

    Attributes
    ----------
    label
        Label of the controller.
    claims_decrease
        Whether L is claimed to decrease; None if the law makes no statement.
    rtol
        Relative tolerance of the runs.
    threshold
        Pose error below which a run counts as settled; with thresholds by part, their norm.
    times : (samples,)
        Sample times, s.
    lyapunov : (runs, samples) or None
        L; None without trajectories.
    energy_residual, group_drift, final_pose_error, final_velocity_error : (runs,)
        Metrics as in a result.
    failed
        Number of failed runs.
    departures
        Parts of the loop that the theorems do not cover, in words.
    vehicle
        The runs of a loop that is not ideal; None for an ideal one.
    energy, theorem
        Name of the function L, and the source of its decrease.
    pose_error, velocity_error : (runs, samples) or None
        Errors over time of the runs with stored trajectories; None without trajectories.
    settled : (runs,) or None
        Whether each run has settled, if there are thresholds by part.
    desired_speed
        Largest ‖V_d‖.
    rate
        Rate at which small errors decay, from the linearised loop, 1/s; None if not known.
    estimate
        Signals by which a filter with a covariance judges itself, ``(runs, samples)`` by name;
        empty without trajectories, None without such a filter.
    barrier
        Of `task: point`, the least L, J, with the axis opposite; 0 where no arrival is claimed.
    leaves_spin
        Whether nothing damps the velocity about that axis.
    """

    label: str
    claims_decrease: bool | None
    rtol: float
    threshold: float
    times: Array
    lyapunov: Array | None
    energy_residual: Array
    group_drift: Array
    final_pose_error: Array
    final_velocity_error: Array
    failed: int = 0
    departures: str = ""
    vehicle: VehicleRuns | None = None
    energy: str = Controller.energy
    theorem: str = Controller.theorem
    pose_error: Array | None = None
    velocity_error: Array | None = None
    settled: Array | None = None
    desired_speed: float = 0.0
    rate: float | None = None
    estimate: dict[str, Array] | None = None
    barrier: float = 0.0
    leaves_spin: bool = False

    @property
    def count(self) -> int:
        """Number of good runs."""
        return len(self.energy_residual)

    @property
    def remark(self) -> str:
        """Number of failed runs in words; empty if there are none."""
        return f"{count_of(self.failed, 'run')} failed" if self.failed else ""

    def decay_rate(self) -> float:
        """Return the median decay rate of log L, fitted over the second half of the horizon.

        It is positive if L falls, and NaN if there is nothing to fit.
        """
        if self.lyapunov is None or not len(self.lyapunov):
            return float("nan")
        later = self.times >= (self.times[0] + self.times[-1]) / 2
        t, L = self.times[later], self.lyapunov[:, later]
        usable = (L > 0).all(axis=1)
        if later.sum() < 2 or not usable.any():
            return float("nan")
        slopes = np.polyfit(t, np.log(L[usable]).T, 1)[0]
        return float(-np.median(slopes))


@dataclass(frozen=True)
class Setting:
    """The assumptions of an experiment.

    Attributes
    ----------
    loops
        Closed loops by label, which differ only in the controller.
    times : (samples,)
        Sample times, s.
    desired_pose, desired_velocity : (samples, …)
        Q_d and V_d at these times.
    rigid
        Whether the inertia is declared to be that of a rigid body.
    exact
        Whether proofs are asked for that take long.
    """

    loops: dict[str, ClosedLoop]
    times: Array
    desired_pose: Array
    desired_velocity: Array
    rigid: bool = True
    exact: bool = False

    @property
    def loop(self) -> ClosedLoop:
        """Any of the loops, for their common parts."""
        return next(iter(self.loops.values()))

    @property
    def inside(self) -> ClosedLoop:
        """The loop of the attitude, of a cascade."""
        return self.loop.inside


def largest(values: Array) -> float:
    """Return the largest number; NaN counts as larger than any other."""
    return float(np.max(values))


# Base classes of certificates: statements that a numerical check can confirm or refute ------------


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
        subject = self.name, self.statement, self.kind, controller
        return Row(*subject, measured, bound, verdict, remark)

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
        label = sample.label if self.per_law else ""
        try:
            discrepancies = [discrepancy(left, right) for left, right in self.sides(sample)]
        except Exception as error:  # a plugin's law may not support these numbers
            reason = f"cannot be evaluated on symbols: {type(error).__name__}: {error}"
            row = self.row(Verdict.UNDECIDED, remark=reason, controller=label)
        else:
            if not discrepancies:
                return []
            row = self.compared(*max(discrepancies, key=_excess), controller=label)
        return [row if sample.exact is None else self._exactly(row, sample.exact)]

    def _exactly(self, row: Row, states: ExactStates) -> Row:
        """Return the row with the outcome of the proof, or with the reason why there is none."""
        try:
            reason = self.not_rational or states.obstacle
            proof = None if reason else exact_states.prove(self.sides, states)
        except Exception as error:
            proof, reason = None, _reason(error)
        if isinstance(proof, exact_states.Refutation):
            remark = f"left − right = {exact_states.written(proof.difference)}{proof.place}"
            difference = str(proof.difference)
            return replace(row, verdict=Verdict.FAILS, remark=remark, difference=difference)
        if proof is None:
            remark = joined(row.remark, f"not proved: {reason}")
            return replace(row, remark=remark, not_proved=reason)
        shown = f"degree {proof.degree}, {proof.points} states, p {_at_most(proof.probability)}"
        return replace(
            row,
            verdict=Verdict.PROVED if row.verdict is Verdict.HOLDS else row.verdict,
            degree=proof.degree,
            points=proof.points,
            probability=proof.probability,
            remark=joined(row.remark, shown, proof.functions),
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
        return loop.controller.name == self.law

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
        return self.row(Verdict.UNDECIDED, remark=reason or runs.remark, controller=runs.label)

    @abstractmethod
    def check(self, runs: Runs) -> Row:
        """Judge the statement by the runs."""


class Hypothesis(Certificate):
    """An assumption of the theorems about group, gains, inertia or reference."""

    kind: ClassVar[Kind] = "hypothesis"

    @abstractmethod
    def check(self, setting: Setting) -> list[Row]:
        """Judge the assumption for the setting; no row if it does not apply."""


def _reason(error: Exception) -> str:
    """Return the reason why a law cannot be evaluated on exact numbers, with its line."""
    if isinstance(error, exact_states.UnprovableError):
        return str(error)
    # In modules of eqt with formulas, rather than code that evaluates them
    others = tuple(f"eqt_cli.{x}." for x in ("extensions.proofs", "base", "numbers", "loop"))
    place = place_of(error) or place_of(
        error, lambda module: module.startswith("eqt_cli.") and not module.startswith(others)
    )
    is_not_rational = isinstance(error, NotRationalError)
    what = (
        str(error)
        if is_not_rational
        else f"cannot be evaluated on exact numbers: {described(error)}"
    )
    return f"{what}, at {place}" if place else what


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


# Certificates: numerical checks of the theory. One file per topic, found by scanning --------------


T = TypeVar("T")

_MODULES = "extensions.proofs.identities", "extensions.proofs.run_checks"
certificates = Registry("certificate", "certificates", Certificate, _MODULES)


CHECKED = "certificates checked"
"""Title of the step in which identities are checked."""


def identity_rows(
    common: Sample, laws: Sequence[Sample], cascades: Sequence[Sample] = ()
) -> list[Row]:
    """Check every identity: on each law or cascade or, if it concerns no law, on `common`."""
    due, rows = list[tuple[Identity, Sample]](), list[Row]()
    whole: Sequence[Sample] = [x for x in laws if x.loop.setpoint == "full"]
    for certificate in _of_kind(Identity):
        samples = whole if certificate.per_law else [common]
        if certificate.of_whole:
            samples = cascades
        due += [(certificate, sample) for sample in samples if certificate.applies(sample.loop)]
    with step(CHECKED, len(due)):
        for certificate, sample in due:
            rows += certificate.check(sample)
            reporter().advance(1)
    return _in_order(rows)


def trajectory_rows(runs: Iterable[Runs]) -> list[Row]:
    """Check every statement about solutions on the runs of every law."""
    checks = _of_kind(TrajectoryCheck)
    rows = [check.check(run) for run in runs for check in checks if check.applies(run)]
    return _in_order(rows)


def hypothesis_rows(setting: Setting) -> list[Row]:
    """Check every hypothesis."""
    rows = [row for hypothesis in _of_kind(Hypothesis) for row in hypothesis.check(setting)]
    return _in_order(rows)


def _of_kind(kind: type[T]) -> list[T]:
    return [certificate() for certificate in certificates.all() if issubclass(certificate, kind)]


def _in_order(rows: list[Row]) -> list[Row]:
    """Sort rows by the paper's sections; laws keep their order."""
    sections = {
        certificate.name: (certificate.section, certificate.name)
        for certificate in certificates.all()
    }
    return sorted(rows, key=lambda row: sections[row.name])


# Lays out certificates as a text table. Does not know how they were found -------------------------


_KINDS = {
    "identity": "Identities, at random states: difference of both sides, bound of its rounding",
    "trajectory": "Trajectories, over the runs: error or change, tolerance",
    "hypothesis": "Hypotheses: what the theorems assume",
    "code": "Laws in code, against the laws that they claim to be: difference of torques, bound",
}
_LEGEND = {
    Verdict.PROVED: "both sides are equal as rational functions of the state; p bounds the "
    "probability that all exact states that were drawn hide a difference; of a rate: in fractions",
    Verdict.UNDECIDED: "the numbers neither confirm nor refute it",
    Verdict.UNCLAIMED: "the paper does not claim this for the law",
    Verdict.NOT_COVERED: "the theorems do not cover this loop",
    Verdict.MORSE_BOTT: "the critical points form manifolds, so the paper's Morse condition is "
    "met only across them",
    Verdict.GROWING: "the largest value over the second half of the horizon exceeds the first's, "
    "so that a bound is in doubt",
    Verdict.VIOLATED: "the theorems do not cover this experiment",
    Verdict.UNKNOWN: "the program cannot decide this",
}
"""Explanations of the verdicts, except for holds and FAILS."""

_LISTED = (Verdict.UNCLAIMED, Verdict.NOT_COVERED)
"""Verdicts that do not concern the experiment; a brief table lists their rows in one note."""


def with_titles(rows: Sequence[Row], titles: Mapping[str, str]) -> list[Row]:
    """Return the rows with the display names of the controllers."""
    return [replace(row, controller=titles.get(row.controller, row.controller)) for row in rows]


def certificate_table(rows: Sequence[Row], *, brief: bool = False) -> TextTable | None:
    """Return a table with a block for each kind of row; None if it would be empty.

    Parameters
    ----------
    brief
        Whether to show only rows that do not hold or could not be proved. Rows that are not claimed
        or not covered are then listed in the notes.
    """
    expected = (Verdict.HOLDS, Verdict.PROVED, *_LISTED)
    shown = [row for row in rows if not brief or row.verdict not in expected or row.not_proved]
    blocks = [
        Block(title, cells)
        for kind, title in _KINDS.items()
        if (cells := [_cells(row) for row in shown if row.kind == kind])
    ]
    notes = []
    for verdict, meaning in _LEGEND.items():
        if having := [row for row in rows if row.verdict is verdict]:
            names = f": {_named(having)}" if brief and verdict in _LISTED else ""
            notes.append(f"{verdict}: {meaning}{names}.")
    if not (blocks or notes):
        return None
    return TextTable(
        "certificates",
        f"The paper's statements, checked on this experiment: {tally(rows)}",
        ["statement", "what", "law", "measured", "bound", "verdict", "remark"],
        blocks,
        notes,
        spare=("statement",),  # a measured value means nothing without its bound
    )


def _named(rows: Sequence[Row]) -> str:
    """List rows by name with their laws: ``decrease of L (lee2010, lee2012)``."""
    laws: dict[str, list[str]] = {}
    for row in rows:
        laws.setdefault(row.name, []).extend([row.controller] if row.controller else [])
    return "; ".join(f"{name} ({', '.join(of)})" if of else name for name, of in laws.items())


def tally(rows: Sequence[Row]) -> str:
    """Count the verdicts of all rows but hypotheses: ``41 hold, 2 undecided, 0 fail``."""
    counts = Counter(row.verdict for row in rows if row.kind != "hypothesis")
    holding, failing = counts.pop(Verdict.HOLDS, 0), counts.pop(Verdict.FAILS, 0)
    others = sorted(f"{count} {verdict}" for verdict, count in counts.items())
    return ", ".join([f"{holding} hold", *others, f"{failing} fail"])


def open_rows(rows: Sequence[Row]) -> list[str]:
    """Return a line for all rows of one cause that neither hold nor fail, the undecided first.

    ``? undecided: Q → Q_d (EqT 16, GT 3); P → P_d (EqT 3) of 20 runs not converged at 20 s``.
    """
    alike = dict[tuple[str, str], list[Row]]()
    for row in sorted(rows, key=lambda row: row.verdict is not Verdict.UNDECIDED):
        if row.verdict in (Verdict.HOLDS, Verdict.PROVED, Verdict.FAILS) and not row.not_proved:
            continue
        cause = "" if row.kind == "hypothesis" else row.not_proved or row.remark.split("; ")[0]
        number, _, runs = cause.partition(" of ")
        cause = f": {cause}" if cause else ""
        if number.isdecimal():  # so many runs of this law
            row, cause = replace(row, controller=f"{row.controller} {number}"), f" of {runs}"
        verdict = "not proved" if row.not_proved else str(row.verdict)
        alike.setdefault((verdict, cause), []).append(row)
    return [f"? {verdict}: {_named(of)}{cause}" for (verdict, cause), of in alike.items()]


def _cells(row: Row) -> list[str]:
    numbers = [_number(row.measured), _number(row.bound)]
    return [row.statement, row.name, row.controller, *numbers, str(row.verdict), row.remark]


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.1e}" if NOTHING < abs(value) < 1e-2 else brief(value, 3)
