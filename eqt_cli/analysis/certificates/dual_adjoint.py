"""Ad* is the dual of conjugation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array, dot


class DualAdjoint(Identity):
    """⟨Ad*_Q P, U⟩ = ⟨P, Q U^ Q⁻¹⟩, and Q Q⁻¹ = I."""

    name: ClassVar[str] = "Ad* is the dual of conjugation"
    statement: ClassVar[str] = "eq. (1)"
    section: ClassVar[float] = 2.0

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Both contractions, and the inverse that they use."""
        G, (U, P) = sample.G, sample.inputs[0]
        Q = sample.states[0][0]
        conjugate = G.vee(Q @ G.hat(U) @ G.inverse(Q))
        yield dot(G.Ad_star(Q, P), U), dot(P, conjugate)
        yield Q @ G.inverse(Q), G.identity
