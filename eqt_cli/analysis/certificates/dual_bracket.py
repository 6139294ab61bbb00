"""ad* is the dual of the commutator of matrices."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array, dot


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
