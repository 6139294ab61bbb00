"""The tracking control of Theorem 6.2 in the error's own variables, written from the paper.

It shares no formula with the controllers, which are written in the body frame.
"""

from __future__ import annotations

from eqt_cli.core.arrays import Array, apply_matrix
from eqt_cli.mechanics.navigation import gradient
from eqt_cli.mechanics.semidirect import Semidirect
from eqt_cli.mechanics.tracking import Tracking


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


def tracking_control(s: Tracking) -> Array:
    """τ = τ_d + Ad^τ_{X_d⁻¹}(V_E, τ_E), Hampsey et al. (2025), eq. (20) and (22)."""
    S, X_d = Semidirect(s.G), (s.Qd, s.Pd)
    Q_E, P_E = S.error((s.Q, s.P), X_d)
    V_E, _ = S.error_input(X_d, (s.V, s.tau_d), (s.Vd, s.tau_d))
    feedback = -apply_matrix(s.gains.K_d, V_E) - gradient(s.G, s.gains.K, Q_E)
    return S.closed_loop_input(X_d, s.tau_d, (V_E, feedforward(s, P_E) + feedback))
