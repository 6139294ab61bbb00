"""The attitude law of Goodarzi, Lee and Lee (2013) with integral action, on any group."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.controllers.base import Controller
from eqt_cli.core.arrays import Array, absolute, dot, exp, log, tanh
from eqt_cli.core.option_types import POSE, STIFFNESS, Positive, Real, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.navigation import hessian_at_identity
from eqt_cli.mechanics.tracking import Gains, Tracking


@dataclass(frozen=True)
class Goodarzi2013(Controller):
    """Geometric PID after Goodarzi, Lee and Lee (2013), on every group; stiffer, so not matched.

    τ = τ_ξ + 𝕀 ad_e ξ − L*dΥ(Q_L) − K_d e − k_I b tanh(e_I / b), ė_I = e + c₂ e_R, e_I(0) = 0.
    On SO(3): −k_R e_R − k_Ω e_Ω − k_I e_I + (RᵀR_dΩ_d) × J(RᵀR_dΩ_d) + JRᵀR_dΩ̇_d with
    K = (k_R/2) I and K_d = k_Ω I. There e_R = ½(R_dᵀR − RᵀR_d)^∨; on every group it is the
    projection of Q_L onto the algebra. Geometric nonlinear PID control of a quadrotor UAV on SE(3),
    European Control Conference 2013, of which only the abstract was read. The smooth bound b is an
    addition of eqt; without it, the integral is not bounded.

    The integral of e is the small error itself, so that k_I adds to the stiffness H of Υ: it is
    2.2 and not 2.0 N m/rad on SO(3) with K = I and k_I = 0.2. So gains are not matched.

    Without disturbances, L = ½⟨𝕀e, e⟩ + Υ(Q_L) + c₂⟨𝕀e, e_R⟩ + k_I Σ b² log cosh(e_I/b) falls near
    the reference if c₂ is small enough. The paper's bound on c₂ was not available, and none is
    computed, so nothing is claimed for any c₂.

    Attributes
    ----------
    ki
        k_I, N m/rad. Where a configuration leaves it out, a tenth of the least stiffness H of Υ:
        0.2 on SO(3) with K = I.
    c2
        c₂, 1/s.
    bound
        b, the bound of the integral in the torque, rad. Default: none.
    """

    name: ClassVar[str] = "goodarzi2013"
    title: ClassVar[str] = "Goodarzi 2013"
    energy: ClassVar[str] = "½⟨𝕀e, e⟩ + Υ(Q_L) + c₂⟨𝕀e, e_R⟩ + ½k_I|e_I|²"
    matched: ClassVar[bool | None] = False
    theorem: ClassVar[str] = "after Goodarzi, Lee, Lee (2013)"
    bibtex: ClassVar[str] = """\
@inproceedings{goodarzi2013geometric,
  author    = {Goodarzi, Farhad and Lee, Daewon and Lee, Taeyoung},
  title     = {Geometric Nonlinear {PID} Control of a Quadrotor {UAV} on {SE(3)}},
  booktitle = {European Control Conference},
  pages     = {3845--3850},
  year      = {2013}
}"""

    ki: Annotated[Positive, Unit(STIFFNESS)] = 0.2
    c2: Annotated[Real, Unit("1/s")] = 0.5
    bound: Annotated[Positive | None, Unit(POSE)] = None

    def defaults(self, G: MatrixLieGroup, gains: Gains) -> Mapping[str, float]:
        """k_I = 0.1 min H: a fixed one would be too strong for a light body."""
        return {"ki": 0.1 * float(np.linalg.eigvalsh(hessian_at_identity(G, gains.K)).min())}

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the length of the integral e_I."""
        return {"integral": G.dimension}

    def memory_rate(self, s: Tracking) -> Mapping[str, Array]:
        """ė_I = e + c₂ e_R."""
        r = s.relative
        return {"integral": r.V_tilde + self.c2 * self._e_R(r)}

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = s.relative
        shaping = r.gradient + self.ki * self._bounded(s)
        return r.feedforward(0.0, 0.0, 1.0) - r.body_damping - shaping

    def lyapunov(self, s: Tracking) -> Array:
        """Return the paper's function without disturbances."""
        r = s.relative
        return r.lyapunov + dot(self.c2 * r.P_tilde, self._e_R(r)) + self._stored(s)

    def velocity_error(self, s: Tracking) -> Array:
        """e + c₂ e_R."""
        r = s.relative
        return r.V_tilde + self.c2 * self._e_R(r)

    def dissipation(self, s: Tracking) -> Array | None:
        """−dL/dt: ⟨K_d e, e⟩ and the rate of the mixed term c₂⟨𝕀e, e_R⟩."""
        r = s.relative
        G, e, P = r.G, r.V_tilde, r.P_tilde
        # d(𝕀e)/dt = Ṗ − d(𝕀ξ)/dt.
        force = G.ad_star(r.V, r.P) + self.torque(s) - G.ad_star(r.Vd, r.Pd) - r.tau_d
        without_integral = force + self.ki * self._bounded(s)
        moved = dot(self.c2 * without_integral, self._e_R(r))
        return dot(r.body_damping, e) - moved - dot(self.c2 * P, G.vee(r.Q @ G.hat(e)))

    def memory_gradient(self, s: Tracking) -> Mapping[str, Array]:
        """∂L/∂e_I, k_I times the bounded integral."""
        return {"integral": self.ki * self._bounded(s)}

    def _e_R(self, r: Tracking) -> Array:
        return r.G.vee(r.Q)

    def _bounded(self, s: Tracking) -> Array:
        """Return the integral, bounded smoothly by b."""
        integral = s.memory["integral"]
        return integral if self.bound is None else self.bound * tanh(integral / self.bound)

    def _stored(self, s: Tracking) -> Array:
        """Return the energy of the integral, whose gradient is k_I `_bounded`."""
        integral = s.memory["integral"]
        if self.bound is None:
            return dot(self.ki * integral, integral) / 2
        size = absolute(integral / self.bound)
        stored = size + log(1 + exp(-2 * size)) - log(2.0)  # log cosh without overflow
        return (self.ki * self.bound**2 * stored).sum(axis=-1)
