"""Spring, damper and the torque of the reference; a factor on the damper."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, Controller, Tracking, dot


@dataclass(frozen=True)
class SpringAndStrongDamper(Controller):
    """Proportional and derivative action around the torque of the reference.

    Attributes
    ----------
    damping_ratio
        Factor on the damping K_d.
    """

    name: ClassVar[str] = "damped"
    title: ClassVar[str] = "PD"

    damping_ratio: float = 1.0

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        spring = s.G.Ad_star(s.Qd, s.gradient)
        return s.tau_d - self.damping_ratio * s.body_damping - spring

    def dissipation(self, s: Tracking) -> Array:
        """−dL/dt: the damping, and the power that a feedforward would supply."""
        damping = dot(self.damping_ratio * s.body_damping, s.V_tilde)
        return damping + dot(s.P_tilde, s.G.ad(s.V, s.Vd))
