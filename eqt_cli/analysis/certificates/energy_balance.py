"""What the damping takes out is what L loses, along every run."""

from __future__ import annotations

from typing import ClassVar

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.certificates.runs import ENERGY_PER_RTOL, Runs, largest


class EnergyBalance(TrajectoryCheck):
    """L(t) + ∫dissipation = L(0) at every sample, relative to max(L(0), 1 J)."""

    name: ClassVar[str] = "energy balance"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.3

    def check(self, runs: Runs) -> Row:
        """The largest residual of the runs."""
        found = runs.energy_residual
        if not len(found):
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=runs.label)
        if runs.no_dissipation:
            remark = "the law does not say what it dissipates"
            return self.row(Verdict.UNCLAIMED, remark=remark, controller=runs.label)
        measured, bound = largest(found), ENERGY_PER_RTOL * runs.rtol
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        return self.row(verdict, measured, bound, runs.remark, runs.label)
