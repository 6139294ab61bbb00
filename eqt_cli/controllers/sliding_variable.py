"""Base class of laws that drive the variable s = V − V_r to zero, with their own V_r."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.base import Controller
from eqt_cli.core.arrays import Array, dot
from eqt_cli.core.option_types import Positive
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class SlidingVariable(Controller):
    """τ = 𝕀V̇_r + 𝕀̇V_r − ad*_{V_r} 𝕀V + Ṡ*S⁻* 𝕀s − reaching(s), s = V − V_r.

    V_r = ξ − Λ L*dΥ(Q_L) with Q_L = Q_d⁻¹Q, ξ = Ad_{Q_L⁻¹}V_d and Λ = slope · I, from g* to g. Then
    d½⟨𝕀s, s⟩/dt = −⟨reaching(s), s⟩, and where s is 0 the potential Υ(Q_L) falls at the rate
    ⟨L*dΥ, Λ L*dΥ⟩. For small errors all modes are real: no choice of gains gives the stiffness and
    damping of the other laws.

    Attributes
    ----------
    slope
        Λ, the commanded velocity per unit of force of Υ: rad/s per N m.
    """

    energy: ClassVar[str] = "½⟨𝕀s, s⟩"
    matched: ClassVar[bool | None] = False
    claims_decrease: ClassVar[bool | None] = True

    slope: Positive = 0.5

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = self._sliding(s)
        feedforward = r.Pd_dot - s.G.ad_star(r.Vd, r.P) + r.inertia_force
        return feedforward - self.reaching(r)

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀s, s⟩."""
        return self._sliding(s).kinetic_error

    def velocity_error(self, s: Tracking) -> Array:
        """The variable s."""
        return self._sliding(s).V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨reaching(s), s⟩."""
        r = self._sliding(s)
        return dot(self.reaching(r), r.V_tilde)

    @abstractmethod
    def reaching(self, r: Tracking) -> Array:
        """Return the force against s, which is `r.V_tilde`."""

    def _sliding(self, s: Tracking) -> Tracking:
        """Return the motion with V_r as the velocity of its reference."""
        r = s.relative
        Vr = r.Vd - self.slope * r.gradient
        return r.following(Vr, r.Vd_dot - self.slope * r.gradient_rate)
