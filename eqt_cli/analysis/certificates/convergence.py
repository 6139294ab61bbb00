"""Whether the errors of the runs have gone by the horizon, for the two parts of the state."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.certificates.runs import Runs, largest
from eqt_cli.core.arrays import Array

GROWTH = 0.01
"""L that grows by this part over the second half of the horizon speaks against convergence."""


class Convergence(TrajectoryCheck):
    """An error that tends to 0: within the settling threshold at the horizon, or still under way.

    A finite horizon cannot refute a limit; only a growing L does.
    """

    def judge(self, runs: Runs, final: Array) -> Row:
        """Count the runs that are not there yet, and say how fast L decays."""
        label = runs.label
        if not len(final):
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=label)
        late = int(np.count_nonzero(~(final <= runs.threshold)))
        rate, span = runs.decay_rate(), float(runs.times[-1] - runs.times[0])
        decay = f"L decays at {rate:.2g} 1/s (median)" if np.isfinite(rate) else ""
        counted = f"{late} of {len(final)} runs not there at {runs.times[-1]:g} s" if late else ""
        remark = "; ".join(part for part in (counted, decay, runs.remark) if part)
        if not late:
            verdict = Verdict.HOLDS
        elif not runs.claims_decrease:
            verdict = Verdict.UNCLAIMED
        else:
            verdict = Verdict.FAILS if rate * span / 2 < -GROWTH else Verdict.UNDECIDED
        return self.row(verdict, largest(final), runs.threshold, remark, label)


class PoseConvergence(Convergence):
    """‖I − Q_E‖_F at the horizon."""

    name: ClassVar[str] = "Q → Q_d"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.32

    def check(self, runs: Runs) -> Row:
        """The final pose errors."""
        return self.judge(runs, runs.final_pose_error)


class MomentumConvergence(Convergence):
    """‖V − V_d‖ at the horizon, which vanishes with P − P_d = 𝕀(V − V_d)."""

    name: ClassVar[str] = "P → P_d"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.33

    def check(self, runs: Runs) -> Row:
        """The final velocity errors."""
        return self.judge(runs, runs.final_velocity_error)
