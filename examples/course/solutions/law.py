"""Exercise 4, solved: feedback, and all that a moving reference needs."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, Controller, Tracking, dot


@dataclass(frozen=True)
class Mine(Controller):
    """Feedback and feedforward; d(𝕀e)/dt = −K_d e − L*dΥ(Q_L) remains."""

    name: ClassVar[str] = "mine"
    title: ClassVar[str] = "Mine"

    def torque(self, s: Tracking) -> Array:
        """The torque in the body frame, N m."""
        r = s.relative  # errors in the body frame: r.Q = Q_d⁻¹Q, r.V_tilde = e
        acceleration = r.Pd_dot  # 𝕀ξ̇: what the moving reference needs
        gyroscopic = -s.G.ad_star(s.V, s.P)  # ω × Jω
        return acceleration + gyroscopic - r.gradient - r.body_damping

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀e, e⟩ + Υ(Q_d⁻¹Q)."""
        return s.relative.lyapunov

    def velocity_error(self, s: Tracking) -> Array:
        """The error e, on which a torque does work."""
        return s.relative.V_tilde

    def dissipation(self, s: Tracking) -> Array:
        """The rate at which L should fall: ⟨K_d e, e⟩."""
        return dot(s.relative.body_damping, s.relative.V_tilde)
