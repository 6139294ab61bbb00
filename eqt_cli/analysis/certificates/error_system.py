"""The error system (§5, Lemma 6.1): its dynamics, its energy, and the change of its inertia."""

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.evidence.numbers import rate_of
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.core.arrays import Array, apply_matrix, dot, transpose
from eqt_cli.mechanics.lie_poisson import lie_poisson
from eqt_cli.mechanics.navigation import potential
from eqt_cli.mechanics.tracking import Tracking


class ErrorDynamics(Identity):
    """Ė = f_{U_E}(E) for E = X X_d⁻¹ and U_E = Ad_{X_d}(U − U_d), with free inputs U and U_d."""

    name: ClassVar[str] = "error dynamics"
    statement: ClassVar[str] = "Lemma 5.1, eq. (18), (19)"
    section: ClassVar[float] = 5.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The rate of the error against the vector field of the error input."""
        G, S = sample.G, sample.semidirect
        (X, X_d, _), (U, U_d) = sample.states, sample.inputs
        moving, moving_d = (
            sample.moving(state, lie_poisson(G, *state, *control))
            for state, control in ((X, U), (X_d, U_d))
        )
        rates = map(rate_of, S.error(moving, moving_d))
        U_E = S.error_input(X_d, U, U_d)
        yield from zip(rates, lie_poisson(G, *S.error(X, X_d), *U_E), strict=True)


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


class SDot(Identity):
    """Ṡ = −ad_{V_d} S = −S ad_{Ad_{Q_d} V_d}, Ṡ by differentiation along the reference."""

    name: ClassVar[str] = "rate of Ad_{Q_d⁻¹}"
    statement: ClassVar[str] = "eq. (21)"
    section: ClassVar[float] = 6.15

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The derivative against both forms."""
        s, G = sample.s, sample.G
        S = G.Ad_matrix(G.inverse(s.Qd))
        rate = rate_of(S)
        yield rate, -(G.ad_matrix(s.Vd) @ S)
        yield rate, -(S @ G.ad_matrix(G.Ad(s.Qd, s.Vd)))


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


def feedforward(s: Tracking, P_E: Array) -> Array:
    """S̄̇*S̄⁻* P_E with S̄ = S Ad_{Q_d⁻¹}: −ad*_{Ad_{Q_d}V_d} P_E, Hampsey et al. (2025), eq. (22a).

    Where the inertia varies by itself, also Ad*_{Q_d⁻¹} Ṡ*S⁻* Ad*_{Q_d} P_E.
    """
    G = s.G
    transport = -G.ad_star(G.Ad(s.Qd, s.Vd), P_E)
    if s.inertia.change is None:
        return transport
    velocity = s.inertia.velocity(G.Ad_star(s.Qd, P_E))
    own = s.inertia.feedforward(velocity) + 0 * P_E
    return transport + G.Ad_star(G.inverse(s.Qd), own)
