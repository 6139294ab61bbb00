"""Statements about runs and vehicles, and the hypotheses that theorems rest on."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from importlib.util import find_spec
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from eqt_cli.base.arrays import Array, frobenius, norm
from eqt_cli.components.groups import MatrixLieGroup, ProductGroup
from eqt_cli.components.inertia import Inertia, critical_sets, not_rigid
from eqt_cli.components.laws import Controller
from eqt_cli.components.mechanics import hessian_at_identity
from eqt_cli.components.vehicle_parts import presences
from eqt_cli.engines.engine import Problem, Span
from eqt_cli.extensions.proofs.certificates import (
    ENERGY_PER_RTOL,
    STATES_PER_RTOL,
    Hypothesis,
    Row,
    Runs,
    Setting,
    TrajectoryCheck,
    Verdict,
    joined,
    largest,
)
from eqt_cli.extensions.proofs.certified import LawRates, box_of, rates_of
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.results.metrics import ENERGY_SCALE

# Assumptions of the theorems about group, gains, inertia, reference and laws ----------------------


INSTANTS = 1001
"""Number of instants of the horizon at which a varying inertia is evaluated."""

LEAST_GROWTH = 1e-3
"""Least relative growth that counts; samples can miss maxima by less than this."""


class NavigationFunction(Hypothesis):
    """Υ is proper and Morse with a unique minimum. Measured: least |Hessian eigenvalue| ≠ 0.

    Morse-Bott if critical points form manifolds and the Hessian is 0 only along them.
    """

    name: ClassVar[str] = "Υ is a navigation function"
    statement: ClassVar[str] = "Definition 2.1"
    section: ClassVar[float] = 2.9

    def check(self, setting: Setting) -> list[Row]:
        """The critical sets with their indices."""
        G, K = setting.inside.group, setting.inside.gains.K
        sets = critical_sets(G, K)
        if sets is None:
            return [self.row(Verdict.UNKNOWN, remark=f"critical points on {G.name} not known")]
        indices = []
        for critical in sets:
            whole = f", a manifold of dimension {critical.dimension}" if critical.dimension else ""
            indices.append(f"{critical.name}: index {critical.index}{whole}")
        sizes = [np.sort(np.abs(x.hessian))[x.nullity :].min() for x in sets]
        verdict = Verdict.MORSE_BOTT if any(x.dimension for x in sets) else Verdict.HOLDS
        minima = [x for x in sets if x.index == 0]
        # The identity comes first, and is a single point.
        if minima != sets[:1] or any(x.nullity != x.dimension for x in sets):
            verdict = Verdict.VIOLATED
        return [self.row(verdict, float(min(sizes)), remark="; ".join(indices))]


class WeightCondition(Hypothesis):
    """The Hessian of Υ at I is positive definite; on SO(3), λ_i + λ_j > 0."""

    name: ClassVar[str] = "Hessian of Υ at I is positive"
    statement: ClassVar[str] = "Example 3.4"
    section: ClassVar[float] = 3.4

    def check(self, setting: Setting) -> list[Row]:
        """Its smallest eigenvalue."""
        hessian = hessian_at_identity(setting.inside.group, setting.inside.gains.K)
        return [self.row(*_definite(hessian, setting.inside, 1))]


class RayleighTensor(Hypothesis):
    """⟨K_d V, V⟩ > 0."""

    name: ClassVar[str] = "K_d is positive definite"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.4

    def check(self, setting: Setting) -> list[Row]:
        """The smallest eigenvalue of its symmetric part."""
        K_d = setting.inside.gains.K_d
        return [self.row(*_definite((K_d + K_d.T) / 2, setting.inside, 2))]


def _definite(matrix: Array, loop: ClosedLoop, free: int) -> tuple[Verdict, float, float, str]:
    left = len(loop.task.free(loop.gains)) >= free  # the axis that `task: point` leaves free
    smallest = float(np.linalg.eigvalsh(matrix)[int(left)])
    verdict = Verdict.HOLDS if smallest > 0 else Verdict.VIOLATED
    return verdict, smallest, 0.0, "smallest eigenvalue" + (" across the axis" if left else "")


class InertiaBounds(Hypothesis):
    """𝕀_t is bounded above and below, and 𝕀̇_t above. Measured: the largest ‖𝕀̇_t‖₂."""

    name: ClassVar[str] = "𝕀_t and its rate are bounded"
    statement: ClassVar[str] = "Theorem 3.2"
    section: ClassVar[float] = 3.2

    def check(self, setting: Setting) -> list[Row]:
        """Extreme eigenvalues and the largest rate; proven where the inertia is constant."""
        law = setting.loop.inertia
        if isinstance(law, Inertia):
            low, high = np.linalg.eigvalsh(law.matrix)[[0, -1]]
            return [self.row(Verdict.HOLDS, 0.0, remark=f"constant, {low:.3g} ≤ 𝕀 ≤ {high:.3g}")]
        now = law.at(np.linspace(setting.times[0], setting.times[-1], INSTANTS))
        change = np.zeros_like(now.matrix) if now.change is None else now.change
        # Expressions without t give one matrix for all times.
        shape = (INSTANTS, *now.matrix.shape[-2:])
        matrix, change = np.broadcast_to(now.matrix, shape), np.broadcast_to(change, shape)
        rates = np.linalg.norm(change + change.swapaxes(-1, -2), 2, axis=(-2, -1))
        eigenvalues = np.linalg.eigvalsh(matrix)
        _, verdict = _over_horizon(np.maximum(rates, eigenvalues.max(axis=-1)))
        remark = f"{eigenvalues.min():.3g} ≤ 𝕀 ≤ {eigenvalues.max():.3g} on the horizon"
        return [self.row(verdict, float(rates.max()), remark=remark)]


class RigidBody(Hypothesis):
    """The inertia can be a rigid body's. No theorem needs this; a row appears if not."""

    name: ClassVar[str] = "𝕀 is a rigid body's"
    statement: ClassVar[str] = "triangle inequality"
    section: ClassVar[float] = 3.21

    def check(self, setting: Setting) -> list[Row]:
        """The principal moments that break the inequality."""
        loop = setting.loop
        broken = not_rigid(loop.group, loop.inertia, float(setting.times[-1]))
        return [self.row(Verdict.VIOLATED, remark=broken)] if broken and setting.rigid else []


class PoseBounded(Hypothesis):
    """sup ‖Q_d(t)‖_F; proven on a compact group and for a reference at rest."""

    name: ClassVar[str] = "Q_d is bounded"
    statement: ClassVar[str] = "Theorem 6.2"
    section: ClassVar[float] = 6.41

    def check(self, setting: Setting) -> list[Row]:
        """The supremum, and whether it is bounded."""
        measured, verdict = _over_horizon(frobenius(setting.desired_pose))
        if setting.loop.group.compact:
            return [self.row(Verdict.HOLDS, measured, remark="the group is compact")]
        if setting.loop.reference.keeps_velocity and not setting.desired_velocity[0].any():
            return [self.row(Verdict.HOLDS, measured, remark="the reference is at rest")]
        return [self.row(verdict, measured, remark="supremum over the horizon")]


class VelocityBounded(Hypothesis):
    """sup ‖V_d(t)‖, which the proof of Theorem 6.2 needs but its statement does not assume."""

    name: ClassVar[str] = "V_d is bounded"
    statement: ClassVar[str] = "Theorem 6.2, its proof"
    section: ClassVar[float] = 6.42

    def check(self, setting: Setting) -> list[Row]:
        """The supremum, and whether it is bounded."""
        measured, verdict = _over_horizon(norm(setting.desired_velocity))
        if setting.loop.reference.keeps_velocity:
            return [self.row(Verdict.HOLDS, measured, remark="the reference keeps its velocity")]
        return [self.row(verdict, measured, remark="supremum over the horizon")]


@runtime_checkable
class InClass(Protocol):
    """A group that knows whether it is a compact group ⋉ a vector space; None: not known."""

    compact_times_vector: bool | None


def compact_times_vector(G: MatrixLieGroup) -> bool | None:
    """Return whether Ad_Q is bounded where Q is: the class of Remark 6.3, closed under products."""
    if isinstance(G, ProductGroup):
        answers = [compact_times_vector(factor) for factor in G.factors]
        if False in answers:
            return False
        return None if None in answers else True
    return G.compact_times_vector if isinstance(G, InClass) else G.compact


class AdjointBounded(Hypothesis):
    """Ad_{Q_d} and its inverse are bounded with Q_d on a compact group times a vector space."""

    name: ClassVar[str] = "Ad_{Q_d} is bounded with Q_d"
    statement: ClassVar[str] = "Remark 6.3"
    section: ClassVar[float] = 6.43

    def check(self, setting: Setting) -> list[Row]:
        """The class of the group, and the largest condition number on the horizon."""
        G = setting.loop.group
        measured = float(np.linalg.cond(G.Ad_matrix(setting.desired_pose)).max())
        is_covered = compact_times_vector(G)
        if is_covered is None:
            return [self.row(Verdict.UNKNOWN, measured, remark=f"class of {G.name} not known")]
        verdict = Verdict.HOLDS if is_covered else Verdict.UNKNOWN
        kind = "compact" if G.compact else "compact ⋉ vector space"
        remark = f"{kind}; largest condition number of Ad_{{Q_d}}"
        return [self.row(verdict, measured, remark=remark)]


class LawCovered(Hypothesis):
    """The law claims that L falls: c + n = 1 in the family, feedforward when stabilising."""

    name: ClassVar[str] = "theorem for the law"
    statement: ClassVar[str] = "Theorems 3.2, 6.2, §7"
    section: ClassVar[float] = 6.44

    def check(self, setting: Setting) -> list[Row]:
        """One row per law, with its source where it is published, else the paper's statement."""
        verdicts = {True: Verdict.HOLDS, False: Verdict.VIOLATED, None: Verdict.UNKNOWN}
        rows = []
        for label, loop in setting.loops.items():
            verdict = Verdict.NOT_COVERED if loop.departures else verdicts[loop.claims_decrease]
            row = self.row(verdict, remark=loop.departures, controller=label)
            theorem = loop.controller.theorem
            published = theorem not in ("", Controller.theorem)
            rows.append(replace(row, statement=theorem) if published else row)
        return rows


def _over_horizon(values: Array) -> tuple[float, Verdict]:
    """Return the supremum over samples, and `growing` if the second half exceeds the first."""
    middle = (len(values) + 1) // 2
    first, second = float(values[:middle].max()), float(values[middle:].max(initial=0.0))
    verdict = Verdict.GROWING if second > first * (1 + LEAST_GROWTH) else Verdict.UNKNOWN
    return max(first, second), verdict


class CertifiedRate(Hypothesis):
    """Small errors decay at a proved rate for every V_d(t) in the box of this reference."""

    name: ClassVar[str] = "certified rate of small errors"
    statement: ClassVar[str] = "Theorem 6.2, to first order"
    section: ClassVar[float] = 6.3
    kind = TrajectoryCheck.kind

    def check(self, setting: Setting) -> list[Row]:
        """Compare the proved rate of each law with the decay along the slowest constant V_d."""
        box, is_asked = box_of(setting.desired_velocity), setting.exact and find_spec("clarabel")
        return [self._row(rates_of(*law, [box])) for law in setting.loops.items() if is_asked]

    def _row(self, law: LawRates) -> Row:
        if law.refused:
            return self.row(Verdict.NOT_COVERED, remark=law.refused, controller=law.label)
        [one] = law.rates
        verdict = Verdict.PROVED if one.rate else Verdict.UNDECIDED
        remark = f"1/s, in the box of the sampled V_d; overshoot {one.overshoot:.2f}"
        return self.row(verdict, float(one.rate or 0), one.slowest_rate, remark, law.label)


# Checks solutions against the theorems: energy, decrease of L, convergence, tracking --------------
#
# Whether errors tend to 0 is judged from samples on a finite horizon.


# These values were chosen on 2120 errors of 10 shipped experiments, with 20 runs per law, that were
# integrated over four times their horizon. "The bounds of convergence" in the documentation
# describes the effect of other values.

LEFT = 0.05
"""Largest final error of a settled run as a share of its largest error: 5 %, as for settling."""

DECAYING = 0.9
"""An error has settled only if the ratio of its means over the last two quarters of the horizon is
at most this. It then halves within 1.6 horizons, or approaches an offset."""

STALLED = 0.98
"""Ratio of the same means at or above which an error does not decay: halving would take more than 8
horizons. For L, which is quadratic in the error, the square of this ratio counts. Any value from
0.9 to 0.999 gives the same verdicts."""

STEADY = 0.2
"""Largest variation of a steady error over the last half of the horizon, relative to its mean. Slow
oscillations, whose means can stall for a while, vary more. Up to 0.4, no error that was judged
steady decayed later; at 0.1 and below, no real offset was found."""

SMALLEST_SCALE = 1e-6
"""Least scale of the motion; without any motion, errors are rounding."""


@dataclass(frozen=True)
class Approach:
    """The final behaviour of the error of every run.

    Attributes
    ----------
    left : (runs,)
        Final error as a share of the largest error of the run.
    level : (runs,)
        Mean error over the last quarter of the horizon.
    arrived : (runs,)
        Whether the error is within the solver's error, or at most `LEFT` remains and it still
        decays.
    stays : (runs,)
        Whether the error is an offset: above the solver's error and steady, while neither it nor L
        decays.
    """

    left: Array
    level: Array
    arrived: Array
    stays: Array

    @property
    def offsets(self) -> str:
        """Description of the offsets; empty if there are none."""
        if not self.stays.any():
            return ""
        typical = np.median(self.level[self.stays])
        return f"an error of {typical:.2g} stays in {self.stays.sum()} of {len(self.stays)} runs"


def approach(
    times: Array, errors: Array, rtol: float, size: float, lyapunov: Array | None = None
) -> Approach:
    """Judge the errors ``(runs, samples)`` of a motion with a given size, such as max ‖V_d‖.

    The solver's error is relative to the larger of that size and the largest error of the run.
    While L of a run still falls, its error is no offset: one error can stall while another decays.
    """
    duration = times[-1] - times[0]
    late = times >= times[-1] - duration / 4
    before = ~late & (times >= times[-1] - duration / 2)
    if not before.any():
        before = ~late
    level, largest = errors[:, late].mean(axis=1), errors.max(axis=1)
    solved = level <= STATES_PER_RTOL * rtol * np.maximum(largest, max(size, SMALLEST_SCALE))
    rest = _rest(errors, before, late)
    left = errors[:, -1] / np.where(largest > 0, largest, 1.0)
    arrived = solved | ((rest <= DECAYING) & (left <= LEFT))
    steady = np.ptp(errors[:, late | before], axis=1) <= STEADY * level
    stays = ~solved & (rest >= STALLED) & steady
    if lyapunov is not None:
        stays &= ~(_rest(lyapunov, before, late) < STALLED**2)
    return Approach(left, level, arrived, stays)


def _rest(values: Array, before: Array, late: Array) -> Array:
    """Return the ratio of the mean over the later samples to that over the earlier ones."""
    earlier = np.maximum(values[:, before].mean(axis=1), np.finfo(float).tiny)
    return values[:, late].mean(axis=1) / earlier


FIFTHS = 5
"""Number of parts of the horizon, of which the first, the middle and the last are compared."""


@dataclass(frozen=True)
class Fifths:
    """Root mean squares of a signal over three fifths of the horizon, ``(runs,)`` each.

    Attributes
    ----------
    first, middle, last
        Values over the first, the middle and the last fifth.
    """

    first: Array
    middle: Array
    last: Array

    @classmethod
    def of(cls, times: Array, values: Array) -> "Fifths | None":
        """Compute them from a signal ``(runs, samples)``; None if a fifth has no sample."""
        part = (times - times[0]) / (times[-1] - times[0]) * FIFTHS
        inside = [
            (part >= k - _SLACK) & (part <= k + 1 + _SLACK) for k in (0, FIFTHS // 2, FIFTHS - 1)
        ]
        if not all(here.any() for here in inside):
            return None
        return cls(*(np.sqrt((values[:, here] ** 2).mean(axis=1)) for here in inside))

    @property
    def left(self) -> float:
        """Median over runs of the ratio of the last to the first."""
        return _median_ratio(self.last, self.first)

    def still_falls(self) -> bool:
        """Whether the last is less than the middle, in the median over runs."""
        return _median_ratio(self.last, self.middle) < STALLED


_SLACK = 1e-9
"""Tolerance for samples at the ends of a fifth, as a share of a fifth."""


def _median_ratio(one: Array, other: Array) -> float:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(one == 0, 0.0, one / other)
    return float(np.median(ratio))


NOT_STORED = "the result holds no trajectories"

GROWTH = 0.01
"""Relative growth of L over the second half of the horizon that contradicts convergence."""


TRACKED = 0.5
"""Largest ratio of the error over the last fifth to that over the first fifth. In the shipped
configurations it is at most 0.16, except for a slow sliding mode (0.71) and for forces unknown to
the laws (0.58)."""

SPAN = 1 - 1 / FIFTHS
"""Time from the first fifth of the horizon to the last, as a share of the horizon."""

GROWN = 1.0
"""The same with unknown forces, noise or limits, which can keep any error from decaying."""


class LyapunovCheck(TrajectoryCheck):
    """A statement about a law's own L, with the reference of the law's source."""

    statement: ClassVar[str] = "Theorems 3.2, 6.2"

    def check(self, runs: Runs) -> Row:
        """Judge the runs, and add the function L and its theorem."""
        row = self.judge(runs)
        energy = "" if runs.energy == Controller.energy else f"L = {runs.energy}"
        remark = joined(row.remark, energy)
        return replace(row, statement=runs.theorem or row.statement, remark=remark)

    @abstractmethod
    def judge(self, runs: Runs) -> Row:
        """Judge the runs."""


class GroupDrift(TrajectoryCheck):
    """Q(t) ∈ G: no integrator of eqt projects, so the drift shows the integrator's error."""

    name: ClassVar[str] = "poses stay in the group"
    statement: ClassVar[str] = "eq. (5)"
    section: ClassVar[float] = 3.0

    def check(self, runs: Runs) -> Row:
        """The largest distance from the group over runs and samples."""
        if not runs.count:
            return self.undecided(runs)
        bound = STATES_PER_RTOL * runs.rtol
        return self.compared(largest(runs.group_drift), bound, runs.remark, runs.label)


class EnergyBalance(LyapunovCheck):
    """L(t) + ∫(dissipation − ⟨δ, y⟩) = L(0) at every sample, relative to max(L(0), 1 J).

    δ is the force unknown to the law: effects of actuators, forces and a different inertia.
    """

    name: ClassVar[str] = "energy balance"
    section: ClassVar[float] = 6.3

    def judge(self, runs: Runs) -> Row:
        """The largest residual of the runs."""
        if not runs.count:
            return self.undecided(runs)
        if np.isnan(runs.energy_residual).all():
            remark = "the law does not say what it dissipates"
            return self.row(Verdict.UNCLAIMED, remark=remark, controller=runs.label)
        bound = ENERGY_PER_RTOL * runs.rtol
        return self.compared(largest(runs.energy_residual), bound, runs.remark, runs.label)


class LyapunovDecrease(LyapunovCheck):
    """The largest rise of L between samples, relative to max(L(0), 1 J)."""

    name: ClassVar[str] = "decrease of L"
    section: ClassVar[float] = 6.31

    def judge(self, runs: Runs) -> Row:
        """Judge the largest rise, which only the integrator's error may cause."""
        label, L = runs.label, runs.lyapunov
        if L is None or not len(L):
            return self.undecided(runs, "" if L is not None else NOT_STORED)
        rises = np.diff(L, axis=1).max(axis=1) / np.maximum(L[:, 0], ENERGY_SCALE)
        measured, bound = max(largest(rises), 0.0), ENERGY_PER_RTOL * runs.rtol
        if runs.departures:
            return self.row(Verdict.NOT_COVERED, measured, bound, runs.departures, label)
        if runs.claims_decrease:
            return self.compared(measured, bound, runs.remark, label)
        is_stated = runs.claims_decrease is not None
        remark = "not claimed of this law" if is_stated else "the law says nothing"
        return self.row(Verdict.UNCLAIMED, measured, bound, remark, label)


class Convergence(LyapunovCheck):
    """An error tends to 0: it has decayed at the horizon, still decays, or is an offset.

    A finite horizon cannot refute a limit; only a growing L does.
    """

    def arrived(
        self, runs: Runs, final: Array, near: Array, left: Approach | None, bound: float | None
    ) -> Row:
        """Count the runs that have not settled, and report the decay rate of L and offsets.

        Parameters
        ----------
        final
            The measured value of every run.
        near
            Whether each run is within the bound.
        left
            Final behaviour of the errors of the runs with stored trajectories.
        bound
            Bound of the measured value; None if it has no scale.
        """
        label = runs.label
        if not len(final):
            return self.undecided(runs)
        arrived = near.copy()
        if left is not None:
            arrived[: len(left.arrived)] &= left.arrived
        late = int(np.count_nonzero(~arrived))
        rate, span = runs.decay_rate(), float(runs.times[-1] - runs.times[0])
        claimed = runs.claims_decrease and np.isfinite(rate)
        remark = joined(
            f"{late} of {len(final)} runs not converged at {runs.times[-1]:g} s" if late else "",
            left.offsets if left else NOT_STORED,
            f"L decays at {rate:.2g} 1/s (median)" if claimed else "",
            runs.remark,
        )
        if runs.departures:
            verdict, remark = Verdict.NOT_COVERED, joined(runs.departures, remark)
        elif not late and left is not None:
            verdict = Verdict.HOLDS
        elif not runs.claims_decrease:
            verdict = Verdict.UNCLAIMED
        else:
            verdict = Verdict.FAILS if rate * span / 2 < -GROWTH else Verdict.UNDECIDED
        return self.row(verdict, largest(final), bound, remark, label)


class PoseConvergence(Convergence):
    """‖I − Q_E‖_F at the horizon: below the settling threshold, and a small share is left."""

    name: ClassVar[str] = "Q → Q_d"
    section: ClassVar[float] = 6.32

    def judge(self, runs: Runs) -> Row:
        """The final pose errors."""
        final, errors, bound = runs.final_pose_error, runs.pose_error, runs.threshold
        L = runs.lyapunov
        left = None if errors is None else approach(runs.times, errors, runs.rtol, 1.0, L)
        if runs.settled is not None:
            return self.arrived(runs, final, runs.settled, left, None)
        return self.arrived(runs, final, final <= bound, left, bound)


class MomentumConvergence(Convergence):
    """‖V − V_d‖ at the horizon relative to its largest value in the run.

    It vanishes with P − P_d = 𝕀(V − V_d), and the ratio does not depend on units.
    """

    name: ClassVar[str] = "P → P_d"
    section: ClassVar[float] = 6.33

    def judge(self, runs: Runs) -> Row:
        """The velocity errors."""
        final, errors = runs.final_velocity_error, runs.velocity_error
        if runs.leaves_spin:
            return self.row(Verdict.UNCLAIMED, remark="the spin is left", controller=runs.label)
        if errors is None:
            return self.arrived(runs, final, np.isfinite(final), None, None)
        left = approach(runs.times, errors, runs.rtol, runs.desired_speed, runs.lyapunov)
        return self.arrived(runs, left.left, left.arrived, left, LEFT)


class PointsFromRegion(LyapunovCheck):
    """From L < 2k, k = tr K, L(t) = ½⟨𝕀Ṽ, Ṽ⟩ + k(1 − cos θ) keeps the axis off −R_d a: it arrives.

    Measured: how many of the runs that start there have not settled at the horizon.
    """

    name: ClassVar[str] = "the axis arrives from {L < 2k}"
    section: ClassVar[float] = 6.34

    def applies(self, runs: Runs) -> bool:
        """For `task: point`, with a law that has this L."""
        return runs.barrier > 0

    def judge(self, runs: Runs) -> Row:
        """Count the starts in the region, and those outside."""
        if runs.lyapunov is None or runs.settled is None or not len(runs.lyapunov):
            return self.undecided(runs, "" if runs.lyapunov is not None else NOT_STORED)
        inside, late = runs.lyapunov[:, 0] < runs.barrier, ~runs.settled[: len(runs.lyapunov)]
        failures = int((inside & late).sum())
        held = Verdict.UNDECIDED if failures else Verdict.HOLDS
        verdict = held if runs.claims_decrease else Verdict.UNCLAIMED
        verdict = Verdict.NOT_COVERED if runs.departures else verdict
        remark = f"not settled: {failures} of {inside.sum()} runs from there"
        remark += f", {(~inside & late).sum()} of {(~inside).sum()} from elsewhere"
        return self.row(verdict, failures, 0.0, joined(remark, runs.departures), runs.label)


class Tracks(TrajectoryCheck):
    """The errors of pose and velocity over the last fifth of the horizon, relative to the first.

    The median over runs counts. This needs no theorem and no claim, so every law is checked.
    """

    name: ClassVar[str] = "tracks"
    statement: ClassVar[str] = "measured on the runs"
    section: ClassVar[float] = 6.34

    def check(self, runs: Runs) -> Row:
        """Judge the worse of the two errors."""
        errors_of = (
            ("pose", runs.pose_error, runs.threshold),
            ("velocity", runs.velocity_error, LEFT * runs.desired_speed),
        )
        endings: dict[str, tuple[float, Verdict, str]] = {}
        for name, errors, near in errors_of:
            if errors is None or not len(errors):
                return self.undecided(runs, "" if errors is not None else NOT_STORED)
            fifths = Fifths.of(runs.times, errors)
            if fifths is None:
                return self.undecided(runs, f"{len(runs.times)} samples are too few")
            endings[name] = fifths.left, *self._ending(runs, errors, near, fifths)
        left, worst, _ = max(
            endings.values(), key=lambda ending: (_WORSE.index(ending[1]), ending[0])
        )
        both = ", ".join(f"{name} {ratio:.2g}" for name, (ratio, *_) in endings.items())
        doubts = dict.fromkeys(why for _, verdict, why in endings.values() if verdict is worst)
        remark = joined(both, *doubts, runs.remark)
        return self.row(worst, left, GROWN if runs.departures else TRACKED, remark, runs.label)

    def _ending(
        self, runs: Runs, errors: Array, near: float, fifths: Fifths
    ) -> tuple[Verdict, str]:
        """Judge an error, with the reason; values below `near` count as none."""
        left, closing = fifths.left, float(np.median(fifths.last))
        size = max(float(np.median(errors.max(axis=1))), runs.desired_speed, SMALLEST_SCALE)
        near = max(near, STATES_PER_RTOL * runs.rtol * size)
        if left < TRACKED or closing < near:
            return Verdict.HOLDS, ""
        root = None  # of L, which scales like the errors
        if runs.lyapunov is not None and len(runs.lyapunov):
            root = Fifths.of(runs.times, np.sqrt(np.abs(runs.lyapunov)))
        # While L still falls, an error may stall, or grow on a short horizon.
        if fifths.still_falls() or (root and root.still_falls()):
            return Verdict.UNDECIDED, "the error still falls"
        span = SPAN * (runs.times[-1] - runs.times[0])
        if runs.rate is not None and runs.rate * span < -np.log(TRACKED):
            words = f"small errors decay at {runs.rate:.2g} 1/s, too slowly for this horizon"
            return Verdict.UNDECIDED, words
        assert runs.pose_error is not None and runs.velocity_error is not None
        pose, velocity = (np.median(x[:, 0]) for x in (runs.pose_error, runs.velocity_error))
        small = LEFT * max(runs.desired_speed, SMALLEST_SCALE)
        if pose <= runs.threshold and velocity <= small:
            return Verdict.UNDECIDED, "the runs begin on the reference"
        # Runs that start at rest near an unstable equilibrium need time: their velocity error grows
        # at first, while L stays nearly constant.
        has_grown = root is None or root.left > 1 + ENERGY_PER_RTOL * runs.rtol
        if runs.departures and (left <= GROWN or not has_grown):
            return Verdict.UNDECIDED, runs.departures
        if runs.claims_decrease and not has_grown:
            return Verdict.UNDECIDED, "L has not grown"
        return Verdict.FAILS, "the error no longer falls"


_WORSE = (Verdict.HOLDS, Verdict.UNDECIDED, Verdict.FAILS)


# Checks of loops that are not ideal: the plant's momentum, the noise, and the estimates -----------


DEVIATIONS = 5.0
"""Allowed deviation of a mean in standard errors; one mean in a million exceeds it."""

RARE = 3e-7
"""Probability that a normal number exceeds this on one side."""

WINDOWS = 10
"""Number of windows of every run over which the momentum is balanced."""

ORDER = 16
"""Degree of the polynomial through the force at the nodes of a window."""

HIGHEST = 5
"""Number of its highest Chebyshev coefficients, whose sum bounds the error of its integral: of a
jump or a kink, wherever it is, that error is at most 0.54 of the sum, of a smooth force far less.
Differences of two rules vanish by chance where a jump is in certain places."""

COARSE = 1e-3
"""Largest error of that integral, over the momentum or impulse, in a window that says anything."""

MARGIN = 0.05
"""Share of a window at each end that is left out, because the vector field may jump there."""

Excess = tuple[float, float, str]
"""A measured number, its bound, and a remark."""


class LargestExcess(TrajectoryCheck):
    """A statement of several numbers, of which the one with the largest ratio to its bound counts.

    Attributes
    ----------
    nothing
        Reason why there may be no number.
    """

    nothing: ClassVar[str] = ""

    def check(self, runs: Runs) -> Row:
        """Judge that number."""
        excesses = list(self.excesses(runs))
        if not excesses:
            return self.undecided(runs, runs.remark or self.nothing)
        measured, bound, remark = max(
            excesses, key=lambda x: x[0] / x[1] if np.isfinite(x[0]) else np.inf
        )
        return self.compared(float(measured), float(bound), remark or runs.remark, runs.label)

    @abstractmethod
    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """Yield numbers with the bounds that they must not exceed."""


class MomentumBalance(LargestExcess):
    """The momentum changes over a window by ∫(ad*_V P + τ + Σ f) dt, with the plant's 𝕀.

    The momentum is P = 𝕀V of the runs; with wheels P = 𝕀V + A h, on which their torque does not
    act. The integral is that of the polynomial through the forces at Chebyshev nodes, where steps
    of the integrator end. Its highest coefficients bound its error. The rest of the bound is
    relative to the largest 𝕀V, A h, and impulse in a window: 16 steps or more, each with an error
    of rtol in the mean over about 30 states, so of up to 6 rtol in one of them.

    A window in which the force changes too fast for the polynomial would call a wrong force good,
    so it is not judged unless even its wide bound is exceeded.
    """

    name: ClassVar[str] = "momentum balance"
    statement: ClassVar[str] = "dP/dt − ad*_V P = τ + forces"
    section: ClassVar[float] = 9.02
    nothing: ClassVar[str] = "forces change too fast between samples: raise time.samples"

    def applies(self, runs: Runs) -> bool:
        """Whether there are parts between the law and the motion."""
        return runs.vehicle is not None

    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """Yield the largest residual of every window and part; none without good runs."""
        windows = runs.vehicle and runs.vehicle.windows
        if windows is None:
            return
        loop, times = windows.loop, windows.problem.times
        s = loop.tracking(times, windows.states)
        G, vehicle, now = s.G, loop.vehicle, loop.now(s)
        body, stored = vehicle.inertia_at(s).momentum(s.V), 0.0 * s.V
        if vehicle.wheels:
            stored = now[f"{vehicle.wheels[0]}.momentum"]
        momentum = body + stored
        force = G.ad_star(s.V, momentum)
        if not vehicle.wheels:
            force = force + now["forces.with_reactions"]
        if vehicle.wheels and vehicle.magnet:
            [name] = [x.name for x in now.blocks.actuated if x.part is vehicle.magnet]
            force = force + now[f"{name}.at"].output(G, 0.0 * s.V, s.V)
        for load in vehicle.forces:
            force = force + load.in_body(G, s.t, s.Q, s.V)
        force = force + vehicle.inertia_at(s).leaving(s.V)
        starts = range(1, len(times) - 1, ORDER + 1)  # without the ends of the horizon
        durations = [np.ptp(times[start : start + ORDER + 1]) for start in starts]
        sizes = np.maximum(np.abs(body), np.abs(stored)).max(axis=(0, 1))
        sizes = np.maximum(sizes, max(durations) * np.abs(force).max(axis=(0, 1)))
        for start, duration in zip(starts, durations, strict=True):
            P = momentum[:, start : start + ORDER + 1]
            polynomial = duration / 2 * (TO_CHEBYSHEV @ force[:, start : start + ORDER + 1])
            residual = np.abs(P[:, -1] - P[:, 0] - INTEGRALS @ polynomial)
            lost = np.abs(polynomial[:, -HIGHEST:]).sum(axis=1)
            for axes in (part.axes for part in G.parts):
                size, unseen = sizes[axes].max(), lost[:, axes].max()
                bound = ENERGY_PER_RTOL * (windows.rtol * size + windows.atol) + unseen
                measured, bound = residual[:, axes].max(), max(bound, np.finfo(float).tiny)
                if unseen <= COARSE * size or not measured <= bound:
                    yield measured, bound, f"at t = {times[start]:.3g} s"


NODES = -np.cos(np.pi * np.arange(ORDER + 1) / ORDER)
"""Times of a window at which the force is known, from −1 to 1."""

TO_CHEBYSHEV = np.linalg.inv(np.polynomial.chebyshev.chebvander(NODES, ORDER))
"""From values at the nodes to the coefficients of the polynomial through them."""

INTEGRALS = np.array([2 / (1 - k**2) if k % 2 == 0 else 0.0 for k in range(ORDER + 1)])
"""Integrals of the Chebyshev polynomials from −1 to 1."""


class StepsEndAtTimes(Problem):
    """A problem whose steps end at its sample times.

    Only there are states known to the tolerance: samples within a step may err by 20 times that.
    """

    @classmethod
    def of(cls, problem: Problem, times: Array) -> "StepsEndAtTimes":
        """Return the problem with these times."""
        entries = {x.name: getattr(problem, x.name) for x in fields(problem)}
        return cls(**(entries | {"times": times}))

    def spans_with(self, times: Array) -> list[Span]:
        """Return the spans, cut at the sample times, too."""
        return super().spans_with(np.append(self.times, times))


def window_times(problem: Problem) -> Array:
    """Return the nodes of `WINDOWS` windows between instants, and the ends of the horizon.

    Instants that runs draw count, too: a payload that is released takes its momentum along.
    """
    vehicle = problem.batched_loop().vehicle
    drawn = [x.of_runs for x in presences([*vehicle.forces, *vehicle.actuators])]
    spans = problem.spans_with(np.concatenate([np.empty(0), *drawn]))
    edges = np.unique(np.concatenate([span.grid for span in spans]))
    chosen = np.unique(np.linspace(0, len(edges) - 2, WINDOWS, dtype=int))
    middle, half = (edges[1:] + edges[:-1])[chosen] / 2, np.diff(edges)[chosen] / 2
    inside = middle[:, None] + (1 - 2 * MARGIN) * np.multiply.outer(half, NODES)
    return np.concatenate([edges[:1], inside.ravel(), edges[-1:]])


class NoiseCovariance(LargestExcess):
    """White noise of sensors has the configured covariance."""

    name: ClassVar[str] = "noise has its covariance"
    statement: ClassVar[str] = "mean of n nᵀ over runs and instants"
    section: ClassVar[float] = 9.3

    def applies(self, runs: Runs) -> bool:
        """Whether the law is sampled and a sensor has white noise."""
        if runs.vehicle is None or runs.vehicle.problem.loop.vehicle.control is None:
            return False
        return any(True for _ in runs.vehicle.white_noise())

    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """Yield the entries of covariance − I for noise divided by its configured deviation."""
        if runs.vehicle is not None and len(runs.vehicle.states):
            for values in runs.vehicle.white_noise():
                yield from _off_identity(values.reshape(-1, values.shape[-1]))


def rare_deviation(mean: float, n: float) -> float:
    """Return how far such a mean of n squares of normals is from 1 one time in a million."""
    from scipy.special import gammaincinv  # slow to import

    return abs(float(2 * gammaincinv(n / 2, RARE if mean < 1 else 1 - RARE) / n) - 1)


def _off_identity(z: Array) -> Iterator[Excess]:
    """Yield the deviations of the covariance of rows from I, with their bounds.

    A variance is distributed as χ²/n, whose quantiles are positive. So noise of 0 always exceeds
    the lower bound, however few rows there are.
    """
    n, axes = z.shape
    covariance = z.T @ z / n
    for variance in np.diag(covariance).tolist():
        yield abs(variance - 1), rare_deviation(variance, n), ""
    for off in covariance[np.triu_indices(axes, 1)].tolist():
        yield abs(off), DEVIATIONS * np.sqrt(2 / n), ""  # products of normals have long tails


class EstimateCheck(LargestExcess):
    """A statement about a filter that has a covariance."""

    nothing: ClassVar[str] = "no trajectories are kept"

    def applies(self, runs: Runs) -> bool:
        """To runs whose law reads the estimate of one."""
        return runs.estimate is not None


class Consistent(EstimateCheck):
    """The mean of NEES over runs and times is its degrees of freedom.

    Errors at two times of a run depend on each other, however much; runs do not. So the mean over
    n runs spreads no more than that of χ² with n times the degrees of freedom.
    """

    name: ClassVar[str] = "estimate errs as its covariance says"
    statement: ClassVar[str] = "NEES within the limits of χ²"
    section: ClassVar[float] = 9.51

    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """The mean over the degrees of freedom, less 1."""
        if not runs.estimate or not runs.estimate["nees"].size:
            return
        nees, degrees = runs.estimate["nees"], runs.estimate["nees_dof"]
        mean = float((nees / degrees).mean())
        bound = rare_deviation(mean, float(degrees[:, 0].sum()))
        yield abs(mean - 1), bound, f"NEES is {mean:.3g} times its mean"


class WhiteInnovations(EstimateCheck):
    """Normalised innovations have the mean square 1 and do not predict the next one."""

    name: ClassVar[str] = "innovations are white"
    statement: ClassVar[str] = "mean square 1, correlation 0"
    section: ClassVar[float] = 9.52

    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """Their mean square less 1, and the correlation of successive ones, over all runs."""
        if not runs.estimate:
            return
        count, square, correlation = (
            runs.estimate[name][:, -1]
            for name in ("innovations", "innovation_square", "innovation_correlation")
        )
        total = float(count.sum())
        if not total:
            return
        squares = np.where(count > 0, count * square, 0.0)
        mean = float(squares.sum() / total)
        words = f"mean square {mean:.3g} of {total:.0f} innovations"
        yield abs(mean - 1), rare_deviation(mean, total), words
        if squares.sum() > 0:
            products = np.where(squares > 0, squares * correlation, 0.0).sum()
            relation = float(products / squares.sum())
            yield abs(relation), DEVIATIONS / np.sqrt(total), f"correlation {relation:.3g}"
