"""The Rayleigh tensor is positive definite."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Hypothesis, Row, Verdict
from eqt_cli.analysis.certificates.setting import Setting


class RayleighTensor(Hypothesis):
    """⟨K_d V, V⟩ > 0."""

    name: ClassVar[str] = "K_d is positive definite"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.4

    def check(self, setting: Setting) -> list[Row]:
        """The smallest eigenvalue of its symmetric part."""
        K_d = setting.loop.gains.K_d
        smallest = float(np.linalg.eigvalsh((K_d + K_d.T) / 2).min())
        verdict = Verdict.HOLDS if smallest > 0 else Verdict.VIOLATED
        return [self.row(verdict, smallest, 0.0, "smallest eigenvalue")]
