"""The error system by itself: Lemma 6.1 as a differential equation for E instead of X.

Any engine integrates it like a closed loop; that both give the same E is a certificate.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any

from eqt_cli.closed_loop.system import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.lie_poisson import lie_poisson
from eqt_cli.mechanics.semidirect import Semidirect, State
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class ErrorSystem(ClosedLoop):
    """The Lie-Poisson system of E = X X_d⁻¹, with the inertia 𝕀̄_t, and the reference.

    A flat state is the closed loop's with E = (Q_E, P_E) in place of X.
    """

    def error(self, state: Array) -> State:
        """Return E from a flat state of this system."""
        found = self.layout.split(state)
        return self.group.unpack(found["pose"]), found["momentum"]

    def state_from(self, loop_state: Array, t: float) -> Array:
        """Return the flat state of this system for a flat state of the closed loop."""
        s = super().tracking(t, loop_state)
        Q_E, P_E = Semidirect(self.group).error((s.Q, s.P), (s.Qd, s.Pd))
        error = {"pose": self.group.pack(Q_E), "momentum": P_E}
        return self.layout.join(self.layout.split(loop_state) | error, loop_state)

    def tracking(self, t: Any, state: Array) -> Tracking:
        """Return the quantities that a law may read, at X = E X_d."""
        s = super().tracking(t, state)
        Q, P = Semidirect(self.group).compose(self.error(state), (s.Qd, s.Pd))
        return dataclasses.replace(s, Q=Q, P=P)

    def vector_field(self, t: Any, state: Array) -> Array:
        """Return Q̇_E = Q_E V_E^, Ṗ_E = ad*_{V_E} P_E + τ_E with V_E = 𝕀̄_t⁻¹ P_E.

        Hampsey et al. (2025), eq. (18) and Lemma 6.1; τ_E is the second part of eq. (19).
        """
        G, s = self.group, self.tracking(t, state)
        Q_E, P_E = self.error(state)
        V_E = G.Ad(s.Qd, s.inertia.velocity(G.Ad_star(s.Qd, P_E)))
        acting, moving = self.acting_and_rates(s)
        _, tau_E = Semidirect(G).error_input((s.Qd, s.Pd), (s.V, acting), (s.Vd, s.tau_d))
        Q_E_dot, P_E_dot = lie_poisson(G, Q_E, P_E, V_E, tau_E)
        return self._derivative(s, Q_E_dot, P_E_dot, 0.0, state, moving)
