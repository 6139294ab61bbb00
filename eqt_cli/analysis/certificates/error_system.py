"""The error system, integrated by itself, gives the error of the closed loop."""

from __future__ import annotations

from typing import ClassVar

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.certificates.runs import STATES_PER_RTOL, Runs


class ErrorSystemAlone(TrajectoryCheck):
    """E from eq. (18) with the inertia 𝕀̄_t against X X_d⁻¹, at every sample of a few runs."""

    name: ClassVar[str] = "error system by itself"
    statement: ClassVar[str] = "Lemma 6.1, eq. (18)"
    section: ClassVar[float] = 6.1

    def check(self, runs: Runs) -> Row:
        """The larger of the differences in pose and momentum."""
        if runs.error_system is None:
            return self.row(Verdict.UNDECIDED, remark="no good run", controller=runs.label)
        measured, bound = runs.error_system, STATES_PER_RTOL * runs.rtol
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        return self.row(verdict, measured, bound, controller=runs.label)
