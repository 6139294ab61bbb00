"""Checks solutions against the theorems: energy, decrease of L, convergence, tracking."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict, joined
from eqt_cli.analysis.evidence.approach import LEFT, SMALLEST_SCALE, Approach, approach
from eqt_cli.analysis.evidence.runs import ENERGY_PER_RTOL, STATES_PER_RTOL, Runs, largest
from eqt_cli.analysis.evidence.tracking import Fifths
from eqt_cli.core.arrays import Array
from eqt_cli.results.metrics import ENERGY_SCALE

GROWTH = 0.01
"""Relative growth of L over the second half of the horizon that contradicts convergence."""


TRACKED = 0.5
"""Largest ratio of the error over the last fifth to that over the first fifth. In the shipped
configurations it is at most 0.16, except for a slow sliding mode (0.71) and for forces unknown to
the laws (0.58)."""

GROWN = 1.0
"""The same with unknown forces, noise or limits, which can keep any error from decaying."""


class LyapunovCheck(TrajectoryCheck):
    """A statement about a law's own L, with the reference of the law's source."""

    statement: ClassVar[str] = "Theorems 3.2, 6.2"

    def check(self, runs: Runs) -> Row:
        """Judge the runs, and add the function L and its theorem."""
        row = self.judge(runs)
        remark = joined(row.remark, runs.own_function)
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
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=runs.label)
        bound = STATES_PER_RTOL * runs.rtol
        return self.compared(largest(runs.group_drift), bound, runs.remark, runs.label)


class ErrorSystemAlone(TrajectoryCheck):
    """E from eq. (18) with the inertia 𝕀̄_t against X X_d⁻¹, at every sample of a few runs."""

    name: ClassVar[str] = "error system by itself"
    statement: ClassVar[str] = "Lemma 6.1, eq. (18)"
    section: ClassVar[float] = 6.1

    def check(self, runs: Runs) -> Row:
        """Judge the larger of the differences in pose and momentum."""
        if runs.error_system is None:
            return self.row(Verdict.UNDECIDED, remark="no good run", controller=runs.label)
        bound = STATES_PER_RTOL * runs.rtol
        return self.compared(runs.error_system, bound, controller=runs.label)


class EnergyBalance(LyapunovCheck):
    """L(t) + ∫(dissipation − ⟨δ, y⟩) = L(0) at every sample, relative to max(L(0), 1 J).

    δ is the force unknown to the law: effects of actuators, forces and a different inertia.
    """

    name: ClassVar[str] = "energy balance"
    section: ClassVar[float] = 6.3

    def judge(self, runs: Runs) -> Row:
        """The largest residual of the runs."""
        if not runs.count:
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=runs.label)
        if runs.no_dissipation:
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
            remark = runs.remark if L is not None else "the result holds no trajectories"
            return self.row(Verdict.UNDECIDED, remark=remark, controller=label)
        rises = np.diff(L, axis=1).max(axis=1) / np.maximum(L[:, 0], ENERGY_SCALE)
        measured, bound = max(largest(rises), 0.0), ENERGY_PER_RTOL * runs.rtol
        if runs.departures:
            return self.row(Verdict.NOT_COVERED, measured, bound, runs.departures, label)
        if runs.claims_decrease:
            return self.compared(measured, bound, runs.remark, label)
        known = runs.claims_decrease is not None
        remark = "not claimed of this law" if known else "the law says nothing"
        return self.row(Verdict.UNCLAIMED, measured, bound, remark, label)


class Convergence(LyapunovCheck):
    """An error tends to 0: it has decayed at the horizon, still decays, or is an offset.

    A finite horizon cannot refute a limit; only a growing L does.
    """

    def arrived(
        self, runs: Runs, final: Array, near: Array, found: Approach | None, bound: float | None
    ) -> Row:
        """Count the runs that have not settled, and report the decay rate of L and offsets.

        Parameters
        ----------
        final
            The measured value of every run.
        near
            Whether each run is within the bound.
        found
            Final behaviour of the errors of the runs with stored trajectories.
        bound
            Bound of the measured value; None if it has no scale.
        """
        label = runs.label
        if not len(final):
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=label)
        arrived = near.copy()
        if found is not None:
            arrived[: len(found.arrived)] &= found.arrived
        late = int(np.count_nonzero(~arrived))
        rate, span = runs.decay_rate(), float(runs.times[-1] - runs.times[0])
        claimed = runs.claims_decrease and np.isfinite(rate)
        remark = joined(
            f"{late} of {len(final)} runs not settled at {runs.times[-1]:g} s" if late else "",
            found.offsets if found else "the result holds no trajectories",
            f"L decays at {rate:.2g} 1/s (median)" if claimed else "",
            runs.remark,
        )
        if runs.departures:
            verdict, remark = Verdict.NOT_COVERED, joined(runs.departures, remark)
        elif not late and found is not None:
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
        found = None if errors is None else approach(runs.times, errors, runs.rtol, 1.0, L)
        if runs.settled is not None:
            return self.arrived(runs, final, runs.settled, found, None)
        return self.arrived(runs, final, final <= bound, found, bound)


class MomentumConvergence(Convergence):
    """‖V − V_d‖ at the horizon relative to its largest value in the run.

    It vanishes with P − P_d = 𝕀(V − V_d), and the ratio does not depend on units.
    """

    name: ClassVar[str] = "P → P_d"
    section: ClassVar[float] = 6.33

    def judge(self, runs: Runs) -> Row:
        """The velocity errors."""
        final, errors = runs.final_velocity_error, runs.velocity_error
        if errors is None:
            return self.arrived(runs, final, np.isfinite(final), None, None)
        found = approach(runs.times, errors, runs.rtol, runs.desired_speed, runs.lyapunov)
        return self.arrived(runs, found.left, found.arrived, found, LEFT)


@dataclass(frozen=True)
class _Ending:
    """The final behaviour of an error, with its verdict."""

    name: str
    left: float
    verdict: Verdict
    reason: str


class Tracks(TrajectoryCheck):
    """The errors of pose and velocity over the last fifth of the horizon, relative to the first.

    The median over runs counts. This needs no theorem and no claim, so every law is checked.
    """

    name: ClassVar[str] = "tracks"
    statement: ClassVar[str] = "measured on the runs"
    section: ClassVar[float] = 6.34

    def check(self, runs: Runs) -> Row:
        """Judge the worse of the two errors."""
        given = (
            ("pose", runs.pose_error, runs.threshold),
            ("velocity", runs.velocity_error, LEFT * runs.desired_speed),
        )
        found = []
        for name, errors, near in given:
            if errors is None or not len(errors):
                remark = runs.remark if errors is not None else "the result holds no trajectories"
                return self.row(Verdict.UNDECIDED, remark=remark, controller=runs.label)
            fifths = Fifths.of(runs.times, errors)
            if fifths is None:
                remark = f"{len(runs.times)} samples are too few"
                return self.row(Verdict.UNDECIDED, remark=remark, controller=runs.label)
            found.append(self._ending(runs, name, errors, near, fifths))
        worst = max(found, key=lambda each: (_WORSE.index(each.verdict), each.left))
        both = ", ".join(f"{each.name} {each.left:.2g}" for each in found)
        doubts = dict.fromkeys(each.reason for each in found if each.verdict is worst.verdict)
        remark = joined(both, *doubts, runs.remark)
        bound = GROWN if runs.departures else TRACKED
        return self.row(worst.verdict, worst.left, bound, remark, runs.label)

    def _ending(self, runs: Runs, name: str, errors: Array, near: float, fifths: Fifths) -> _Ending:
        """Judge an error; values below `near` count as none."""
        left, closing = fifths.left, float(np.median(fifths.last))
        size = max(float(np.median(errors.max(axis=1))), runs.desired_speed, SMALLEST_SCALE)
        near = max(near, STATES_PER_RTOL * runs.rtol * size)
        if left < TRACKED or closing < near:
            return _Ending(name, left, Verdict.HOLDS, "")
        if fifths.still_falls() or _falls(runs):
            return _Ending(name, left, Verdict.UNDECIDED, "the error still falls")
        if _start_on_reference(runs):
            return _Ending(name, left, Verdict.UNDECIDED, "the runs begin on the reference")
        if runs.departures and (left <= GROWN or not _has_grown(runs)):
            return _Ending(name, left, Verdict.UNDECIDED, runs.departures)
        if runs.claims_decrease and not _has_grown(runs):
            return _Ending(name, left, Verdict.UNDECIDED, "L has not grown")
        return _Ending(name, left, Verdict.FAILS, "the error no longer falls")


_WORSE = (Verdict.HOLDS, Verdict.UNDECIDED, Verdict.FAILS)


def _falls(runs: Runs) -> bool:
    """Whether L still falls: an error may then stall, or grow on a short horizon."""
    fifths = _root_of_L(runs)
    return fifths is not None and fifths.still_falls()


def _has_grown(runs: Runs) -> bool:
    """Whether L is larger at the end than at the start, or unknown.

    Runs that start at rest near an unstable equilibrium need time: their velocity error grows at
    first, while L stays nearly constant.
    """
    fifths = _root_of_L(runs)
    return fifths is None or fifths.left > 1 + ENERGY_PER_RTOL * runs.rtol


def _root_of_L(runs: Runs) -> Fifths | None:
    """Return the means of √L, which scales like the errors; None without L."""
    L = runs.lyapunov
    return None if L is None or not len(L) else Fifths.of(runs.times, np.sqrt(np.abs(L)))


def _start_on_reference(runs: Runs) -> bool:
    """Whether both errors are small at the start."""
    pose, velocity = runs.pose_error, runs.velocity_error
    assert pose is not None and velocity is not None
    small = LEFT * max(runs.desired_speed, SMALLEST_SCALE)
    near = np.median(pose[:, 0]) <= runs.threshold and np.median(velocity[:, 0]) <= small
    return bool(near)
