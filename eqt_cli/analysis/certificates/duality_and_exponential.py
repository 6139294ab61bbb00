"""The group, its algebra and their duals (§2): Ad*, ad*, exp and log."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.evidence.sample import Sample
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


class DualBracket(Identity):
    """⟨ad*_V P, U⟩ = ⟨P, V^U^ − U^V^⟩, which fixes the sign of ad*."""

    name: ClassVar[str] = "ad* is the dual of the bracket"
    statement: ClassVar[str] = "eq. (2)"
    section: ClassVar[float] = 2.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Both contractions."""
        G, ((V, P), (U, _)) = sample.G, sample.inputs
        bracket = G.hat(V) @ G.hat(U) - G.hat(U) @ G.hat(V)
        yield dot(G.ad_star(V, P), U), dot(P, G.vee(bracket))
