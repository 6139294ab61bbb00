"""The condition on the weight K: the identity is a non-degenerate minimum of Υ."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Hypothesis, Row, Verdict
from eqt_cli.analysis.certificates.setting import Setting
from eqt_cli.mechanics.navigation import hessian_at_identity


class WeightCondition(Hypothesis):
    """The Hessian of Υ at I is positive definite; on SO(3), λ_i + λ_j > 0."""

    name: ClassVar[str] = "Hessian of Υ at I is positive"
    statement: ClassVar[str] = "Example 3.4"
    section: ClassVar[float] = 3.4

    def check(self, setting: Setting) -> list[Row]:
        """Its smallest eigenvalue."""
        hessian = hessian_at_identity(setting.loop.group, setting.loop.gains.K)
        smallest = float(np.linalg.eigvalsh(hessian).min())
        verdict = Verdict.HOLDS if smallest > 0 else Verdict.VIOLATED
        return [self.row(verdict, smallest, 0.0, "smallest eigenvalue")]
