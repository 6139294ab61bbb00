"""What theorems say of solutions: drift, energy, decrease of L, the error system, convergence."""

from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.evidence.approach import LEFT, Approach, approach
from eqt_cli.analysis.evidence.runs import ENERGY_PER_RTOL, STATES_PER_RTOL, Runs, largest
from eqt_cli.core.arrays import Array
from eqt_cli.results.metrics import ENERGY_SCALE

GROWTH = 0.01
"""L that grows by this part over the second half of the horizon speaks against convergence."""


class LyapunovCheck(TrajectoryCheck):
    """A statement about a law's own L, made where the law's source makes it."""

    statement: ClassVar[str] = "Theorems 3.2, 6.2"

    def check(self, runs: Runs) -> Row:
        """As `judge`, with the function that L is and its theorem."""
        row = self.judge(runs)
        remark = _joined(row.remark, runs.own_function)
        return replace(row, statement=runs.theorem or row.statement, remark=remark)

    @abstractmethod
    def judge(self, runs: Runs) -> Row:
        """What the runs say."""


class GroupDrift(TrajectoryCheck):
    """Q(t) ∈ G: no integrator of eqt projects, so that its drift shows its error."""

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
        """The larger of the differences in pose and momentum."""
        if runs.error_system is None:
            return self.row(Verdict.UNDECIDED, remark="no good run", controller=runs.label)
        bound = STATES_PER_RTOL * runs.rtol
        return self.compared(runs.error_system, bound, controller=runs.label)


class EnergyBalance(LyapunovCheck):
    """L(t) + ∫(dissipation − ⟨δ, y⟩) = L(0) at every sample, relative to max(L(0), 1 J).

    δ is the force that the law does not know of: what actuators change, forces, another inertia.
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
        """The largest rise, which only the integrator's error may cause."""
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
        said = "not claimed of this law" if known else "the law says nothing"
        return self.row(Verdict.UNCLAIMED, measured, bound, said, label)


class Convergence(LyapunovCheck):
    """An error that tends to 0: it has decayed at the horizon, or is still under way, or stays.

    A finite horizon cannot refute a limit; only a growing L does.
    """

    def arrived(
        self, runs: Runs, final: Array, near: Array, found: Approach | None, bound: float | None
    ) -> Row:
        """Count the runs that are not there yet, and say how fast L decays, and what stays.

        Parameters
        ----------
        final
            What is measured of every run.
        near
            Which runs are within the bound.
        found
            How the errors end of the runs whose trajectories are kept.
        bound
            What the measured error must not exceed; None where there is no scale for it.
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
        remark = _joined(
            f"{late} of {len(final)} runs not there at {runs.times[-1]:g} s" if late else "",
            found.offsets if found else "the result holds no trajectories",
            f"L decays at {rate:.2g} 1/s (median)" if claimed else "",
            runs.remark,
        )
        if runs.departures:
            verdict, remark = Verdict.NOT_COVERED, _joined(runs.departures, remark)
        elif not late and found is not None:
            verdict = Verdict.HOLDS
        elif not runs.claims_decrease:
            verdict = Verdict.UNCLAIMED
        else:
            verdict = Verdict.FAILS if rate * span / 2 < -GROWTH else Verdict.UNDECIDED
        return self.row(verdict, largest(final), bound, remark, label)


class PoseConvergence(Convergence):
    """‖I − Q_E‖_F at the horizon: below the settling threshold, and little of what it was."""

    name: ClassVar[str] = "Q → Q_d"
    section: ClassVar[float] = 6.32

    def judge(self, runs: Runs) -> Row:
        """The final pose errors."""
        final, errors, bound = runs.final_pose_error, runs.pose_error, runs.threshold
        L = runs.lyapunov
        found = None if errors is None else approach(runs.times, errors, runs.rtol, 1.0, L)
        return self.arrived(runs, final, final <= bound, found, bound)


class MomentumConvergence(Convergence):
    """‖V − V_d‖ at the horizon, as a part of its largest value in the run.

    It vanishes with P − P_d = 𝕀(V − V_d), and has the scale of the run, whatever its units.
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


def _joined(*remarks: str) -> str:
    return "; ".join(filter(None, remarks))
