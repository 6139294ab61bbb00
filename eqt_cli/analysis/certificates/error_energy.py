"""The error system is mechanical, with an inertia that varies with the reference."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array, apply_matrix, dot, transpose
from eqt_cli.mechanics.navigation import potential


class ErrorEnergy(Identity):
    """𝕀̄_t V_E = P_E with 𝕀̄_t = Ad*_{Q_d⁻¹} 𝕀_t Ad_{Q_d⁻¹}, and L = ½⟨P_E, V_E⟩ + Υ(Q_E)."""

    name: ClassVar[str] = "error velocity and energy"
    statement: ClassVar[str] = "Lemma 6.1"
    section: ClassVar[float] = 6.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Both equations, with E and V_E as G ⋉ g* gives them."""
        s, G, S = sample.s, sample.G, sample.semidirect
        X_d = s.Qd, s.Pd
        Q_E, P_E = S.error((s.Q, s.P), X_d)
        V_E, _ = S.error_input(X_d, (s.V, s.tau_d), (s.Vd, s.tau_d))
        A = G.Ad_matrix(G.inverse(s.Qd))
        yield apply_matrix(transpose(A) @ s.inertia.matrix @ A, V_E), P_E
        yield s.lyapunov, dot(P_E, V_E) / 2 + potential(G, s.gains.K, Q_E)
