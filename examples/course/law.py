"""Exercise 4: a law of your own. Complete `torque`."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, Controller, Tracking, dot


@dataclass(frozen=True)
class Mine(Controller):
    """Feedback, and the feedforward that you add."""

    name: ClassVar[str] = "mine"
    title: ClassVar[str] = "Mine"

    def torque(self, s: Tracking) -> Array:
        """The torque in the body frame, N m."""
        r = s.relative  # errors in the body frame: r.Q = Q_d⁻¹Q, r.V_tilde = e
        return -r.gradient - r.body_damping

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀e, e⟩ + Υ(Q_d⁻¹Q)."""
        return s.relative.lyapunov

    def velocity_error(self, s: Tracking) -> Array:
        """The error e, on which a torque does work."""
        return s.relative.V_tilde

    def dissipation(self, s: Tracking) -> Array:
        """The rate at which L should fall: ⟨K_d e, e⟩."""
        return dot(s.relative.body_damping, s.relative.V_tilde)
