"""The integrated poses stay in the group."""

from __future__ import annotations

from typing import ClassVar

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.certificates.runs import STATES_PER_RTOL, Runs, largest


class GroupDrift(TrajectoryCheck):
    """Q(t) ∈ G: no integrator of eqt projects, so that its drift shows its error."""

    name: ClassVar[str] = "poses stay in the group"
    statement: ClassVar[str] = "eq. (5)"
    section: ClassVar[float] = 3.0

    def check(self, runs: Runs) -> Row:
        """The largest distance from the group over runs and samples."""
        if not len(runs.group_drift):
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=runs.label)
        measured, bound = largest(runs.group_drift), STATES_PER_RTOL * runs.rtol
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        return self.row(verdict, measured, bound, runs.remark, runs.label)
