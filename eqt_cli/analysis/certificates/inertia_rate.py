"""The feedforward of Theorem 3.2 compensates the change of the inertia."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, apply_matrix, dot, transpose
from eqt_cli.mechanics.inertia import FactoredInertia, Inertia


class InertiaRate(Identity):
    """∂h/∂t = ½⟨P, d(𝕀⁻¹)/dt P⟩ = −⟨Ṡ*S⁻* P, 𝕀⁻¹P⟩, and d𝕀/dt is what the law says it is.

    Where the configuration gives the factor S, also Ṡ*S⁻* P = Ṡ* 𝕀_0 S V with S* 𝕀_0 S V = P.
    """

    name: ClassVar[str] = "feedforward of a varying inertia"
    statement: ClassVar[str] = "Theorem 3.2, eq. (10)"
    section: ClassVar[float] = 3.2

    def applies(self, loop: ClosedLoop) -> bool:
        """To an inertia that varies."""
        return not isinstance(loop.inertia, Inertia)

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The power of the feedforward, and the rate of the tensor."""
        now, (_, P) = sample.s.inertia, sample.inputs[0]
        V = now.velocity(P)
        feedforward = now.feedforward(V) + 0 * V
        yield rate_of(dot(P, V)) / 2, -dot(feedforward, V)
        yield apply_matrix(rate_of(now.matrix), V), now.rate_force(V) + 0 * V
        law = sample.loop.inertia
        if isinstance(law, FactoredInertia):
            S = law.factor_at(sample.s.t)
            image = apply_matrix(law.initial @ S, V)
            yield apply_matrix(transpose(S), image), P
            yield feedforward, apply_matrix(transpose(rate_of(S)), image)
