"""The semidirect product G ⋉ g*: states (Q, P), inputs (V, τ), and the error X X_d⁻¹.

The paper's structure, on any group of the registry. Pairs are plain tuples of arrays with leading
batch axes.
"""

from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup

State = tuple[Array, Array]
"""X = (Q, P) ∈ G ⋉ g*: a pose ``(..., d, d)`` and a momentum ``(..., m)``."""
Input = tuple[Array, Array]
"""U = (V, τ) in the algebra of G ⋉ g*: a velocity and a force, both ``(..., m)``."""


@dataclass(frozen=True)
class Semidirect:
    """The group G ⋉ g* over a matrix Lie group G."""

    G: MatrixLieGroup

    @property
    def identity(self) -> State:
        """(I, 0)."""
        return self.G.identity, np.zeros(self.G.dimension)

    def compose(self, X: State, Y: State) -> State:
        """(Q_1 Q_2, Ad*_{Q_2} P_1 + P_2), Hampsey et al. (2025), eq. (15)."""
        (Q1, P1), (Q2, P2) = X, Y
        return Q1 @ Q2, self.G.Ad_star(Q2, P1) + P2

    def inverse(self, X: State) -> State:
        """(Q⁻¹, −Ad*_{Q⁻¹} P)."""
        Q, P = X
        Q_inverse = self.G.inverse(Q)
        return Q_inverse, -self.G.Ad_star(Q_inverse, P)

    def Ad(self, Y: State, U: Input) -> Input:
        """(Ad_Q V, Ad*_{Q⁻¹}(ad*_V P + τ)), Hampsey et al. (2025), eq. (27)."""
        (Q, P), (V, tau) = Y, U
        force = self.G.Ad_star(self.G.inverse(Q), self.G.ad_star(V, P) + tau)
        return self.G.Ad(Q, V), force

    def error(self, X: State, X_d: State) -> State:
        """E = X X_d⁻¹ = (Q Q_d⁻¹, Ad*_{Q_d⁻¹}(P − P_d)), Hampsey et al. (2025), eq. (17)."""
        return self.compose(X, self.inverse(X_d))

    def error_input(self, X_d: State, U: Input, U_d: Input) -> Input:
        """U_E = (V_E, τ_E) = Ad_{X_d}(U − U_d), Hampsey et al. (2025), eq. (19)."""
        return self.Ad(X_d, (U[0] - U_d[0], U[1] - U_d[1]))

    def closed_loop_input(self, X_d: State, tau_d: Array, U_E: Input) -> Array:
        """τ = τ_d + Ad^τ_{X_d⁻¹}(V_E, τ_E), the force that gives the error the input U_E.

        Hampsey et al. (2025), eq. (20).
        """
        _, tau = self.Ad(self.inverse(X_d), U_E)
        return tau_d + tau
