"""L falls from sample to sample."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.certificates.runs import ENERGY_PER_RTOL, Runs, largest
from eqt_cli.results.metrics import ENERGY_SCALE


class LyapunovDecrease(TrajectoryCheck):
    """The largest rise of L between samples, relative to max(L(0), 1 J)."""

    name: ClassVar[str] = "decrease of L"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.31

    def check(self, runs: Runs) -> Row:
        """The largest rise, which only the integrator's error may cause."""
        label, L = runs.label, runs.lyapunov
        if L is None or not len(L):
            remark = runs.remark if L is not None else "the result holds no trajectories"
            return self.row(Verdict.UNDECIDED, remark=remark, controller=label)
        rises = np.diff(L, axis=1).max(axis=1) / np.maximum(L[:, 0], ENERGY_SCALE)
        measured, bound = max(largest(rises), 0.0), ENERGY_PER_RTOL * runs.rtol
        if not runs.claims_decrease:
            said = (
                "not claimed of this law"
                if runs.claims_decrease is False
                else "the law says nothing"
            )
            return self.row(Verdict.UNCLAIMED, measured, bound, said, label)
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        return self.row(verdict, measured, bound, runs.remark, label)
