"""The stabilising law of Theorem 3.2 from its terms, each by differentiation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.bounded import lifted, rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers.stabilising import Stabilising
from eqt_cli.core.arrays import Array, apply_matrix, stack
from eqt_cli.mechanics.navigation import potential


class StabilisingControl(Identity):
    """τ = Ṡ*S⁻* P − K_d V − L*_Q d(Υ ∘ R_{Q_target⁻¹}), the gradient term by term from Υ."""

    name: ClassVar[str] = "stabilising control"
    statement: ClassVar[str] = "Theorem 3.2, eq. (11)"
    section: ClassVar[float] = 3.2
    per_law: ClassVar[bool] = True

    def applies(self, loop: ClosedLoop) -> bool:
        """To the stabilising law."""
        return isinstance(loop.controller, Stabilising)

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The law against the sum of its terms."""
        G, law = sample.G, sample.loop.controller
        s = sample.s
        shaping = stack([self._slope(sample, E) for E in np.eye(G.dimension)])
        damping = apply_matrix(s.gains.K_d, s.V)
        compensated = isinstance(law, Stabilising) and law.feedforward
        feedforward = s.inertia.feedforward(s.V) if compensated else 0.0
        yield sample.loop.command(s), feedforward - damping - shaping

    def _slope(self, sample: Sample, E: Array) -> Array:
        """d/dε Υ(Q exp(εE) Q_target⁻¹)."""
        s, G = sample.s, sample.G
        Q, _ = sample.moving((s.Q, s.P), (s.Q @ G.hat(lifted(E)), 0 * s.P))
        return rate_of(potential(G, s.gains.K, Q @ G.inverse(s.Qd)))
