"""The feedforward of Theorem 6.2 compensates the change of the error system's inertia."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.analysis.certificates.theorem_6_2 import feedforward
from eqt_cli.core.arrays import Array, dot


class TrackingFeedforward(Identity):
    """½⟨P_E, d(𝕀̄_t⁻¹)/dt P_E⟩ = −⟨S̄̇*S̄⁻* P_E, V_E⟩ at fixed P_E, with S̄ = S Ad_{Q_d⁻¹}."""

    name: ClassVar[str] = "feedforward of the error inertia"
    statement: ClassVar[str] = "Theorem 6.2, eq. (22a)"
    section: ClassVar[float] = 6.2

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The rate of the error's kinetic energy at fixed momentum against the power."""
        s, G, P_E = sample.s, sample.G, sample.inputs[0][1]
        V_E = G.Ad(s.Qd, s.inertia.velocity(G.Ad_star(s.Qd, P_E)))
        yield rate_of(dot(P_E, V_E)) / 2, -dot(feedforward(s, P_E), V_E)
