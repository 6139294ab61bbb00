"""The bounds of the inertia and of its rate."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Hypothesis, Row, Verdict
from eqt_cli.analysis.certificates.halves import over_horizon
from eqt_cli.analysis.certificates.setting import Setting
from eqt_cli.mechanics.inertia import Inertia

INSTANTS = 1001
"""How many instants of the horizon a varying inertia is looked at."""


class InertiaBounds(Hypothesis):
    """𝕀_t is bounded above and below, and 𝕀̇_t above: measured is the largest ‖𝕀̇_t‖₂."""

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
        _, verdict = over_horizon(np.maximum(rates, eigenvalues.max(axis=-1)))
        remark = f"{eigenvalues.min():.3g} ≤ 𝕀 ≤ {eigenvalues.max():.3g} on the horizon"
        return [self.row(verdict, float(rates.max()), remark=remark)]
