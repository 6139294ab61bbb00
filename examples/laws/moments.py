"""A law that adapts what it believes of the moments of inertia, after Slotine and Li (1987)."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, Controller, Tracking, cross, dot


@dataclass(frozen=True)
class Moments(Controller):
    """τ = Y θ̂ − k s with s = e + slope L*dΥ(Q_L) and θ̂' = −γ Yᵀs, on SO(3).

    Y θ = θ V̇_r − (θ V) × V_r for the moments θ about the principal axes, and V_r = V − s.

    Attributes
    ----------
    gamma
        γ, how fast θ̂ adapts.
    slope
        The velocity that is commanded per unit of force of Υ.
    k
        Damping of s, N m s.
    guess
        θ̂ at the start, kg m².
    """

    name: ClassVar[str] = "moments"
    title: ClassVar[str] = "moments"
    energy: ClassVar[str] = "½⟨𝕀s, s⟩ + |θ̂ − θ|²/(2γ)"
    theorem: ClassVar[str] = "Slotine and Li (1987)"
    claims_decrease: ClassVar[bool] = True

    gamma: float = 1.0
    slope: float = 1.0
    k: float = 1.0
    guess: float = 1.0

    def memory(self, G) -> dict[str, int]:
        """θ̂."""
        return {"moments": G.dimension}

    def initial_memory(self, s: Tracking) -> dict[str, Array]:
        """The guess, about each axis."""
        return {"moments": self.guess + 0.0 * s.V}

    def sliding(self, s: Tracking) -> Array:
        """s."""
        r = s.relative
        return r.V_tilde + self.slope * r.gradient

    def commanded(self, s: Tracking) -> tuple[Array, Array]:
        """V_r and its rate."""
        r = s.relative
        return r.V - self.sliding(s), r.Vd_dot - self.slope * r.gradient_rate

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        V_r, rate = self.commanded(s)
        theta = s.memory["moments"]
        return theta * rate - cross(theta * s.V, V_r) - self.k * self.sliding(s)

    def memory_rate(self, s: Tracking) -> dict[str, Array]:
        """−γ Yᵀs."""
        V_r, rate = self.commanded(s)
        x = self.sliding(s)
        return {"moments": -self.gamma * (x * rate - s.V * cross(V_r, x))}

    def lyapunov(self, s: Tracking) -> Array:
        """L with the moments θ of the model, which `torque` does not read."""
        x = self.sliding(s)
        apart = s.memory["moments"] - s.inertia.momentum(1.0 + 0.0 * s.V)
        return (dot(s.inertia.momentum(x), x) + dot(apart / self.gamma, apart)) / 2

    def dissipation(self, s: Tracking) -> Array:
        """−dL/dt = k|s|²."""
        x = self.sliding(s)
        return dot(self.k * x, x)
