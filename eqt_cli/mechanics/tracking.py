"""The true and the desired state, the errors between them, and the Lyapunov function L.

This is all that a control law may read. Each quantity is computed once, on its first use.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

from eqt_cli.core.arrays import Array, apply_matrix, dot
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics import navigation
from eqt_cli.mechanics.flatness import FlatOutput
from eqt_cli.mechanics.inertia import Inertia


@dataclass(frozen=True)
class Gains:
    """Navigation weight K (`gains.kp`, d×d) and Rayleigh tensor K_d (`gains.kd`, m×m).

    Like the inertia, they may carry leading batch axes, or be symbols.
    """

    K: Array
    K_d: Array


def pose_error(G: MatrixLieGroup, Q: Array, Qd: Array) -> Array:
    """Q_E = Q Q_d⁻¹, the error in the spatial frame, Hampsey et al. (2025), eq. (17)."""
    return Q @ G.inverse(Qd)


@dataclass(frozen=True)
class Tracking:
    """All that a control law reads: group, inertia, gains, time, state, desired state, errors.

    Attributes
    ----------
    t
        Time, s.
    Q, Qd : (..., d, d)
        True and desired pose.
    P, Pd : (..., m)
        True and desired momentum.
    tau_d : (..., m)
        Torque that drives the desired state, body frame.
    memory
        The law's own states by name, ``(..., length)`` each.
    vehicle
        The states of actuators by name, which a law must not read.
    flat
        The flat output of the reference, for laws that read it.
    """

    G: MatrixLieGroup
    inertia: Inertia
    gains: Gains
    t: Any
    Q: Array
    P: Array
    Qd: Array
    Pd: Array
    tau_d: Array
    memory: Mapping[str, Array] = field(default_factory=dict)
    vehicle: Mapping[str, Array] = field(default_factory=dict)
    flat: FlatOutput | None = None

    @cached_property
    def V(self) -> Array:
        """Body velocity V = 𝕀⁻¹P."""
        return self.inertia.velocity(self.P)

    @cached_property
    def Vd(self) -> Array:
        """Desired body velocity V_d = 𝕀⁻¹P_d."""
        return self.inertia.velocity(self.Pd)

    @cached_property
    def Vd_dot(self) -> Array:
        """V̇_d = 𝕀⁻¹(τ_d + ad*_{V_d} P_d − 𝕀̇V_d), the desired acceleration."""
        return self.inertia.velocity(self.Pd_dot - self.inertia.rate_force(self.Vd))

    @cached_property
    def Pd_dot(self) -> Array:
        """Ṗ_d = τ_d + ad*_{V_d} P_d."""
        return self.G.ad_star(self.Vd, self.Pd) + self.tau_d

    @cached_property
    def V_tilde(self) -> Array:
        """Ṽ = V − V_d, body frame."""
        return self.V - self.Vd

    @cached_property
    def P_tilde(self) -> Array:
        """P̃ = P − P_d = 𝕀Ṽ, body frame."""
        return self.P - self.Pd

    @cached_property
    def relative(self) -> Tracking:
        """The same motion with the errors of the body frame, Q_d⁻¹Q and V − ξ.

        The desired velocity carried to the body is ξ = Ad_{Q_L⁻¹} V_d with Q_L = Q_d⁻¹Q; it
        changes at the rate ξ̇ = Ad_{Q_L⁻¹} V̇_d − ad_V ξ, and the torque that drives it is
        τ_ξ = 𝕀ξ̇ + 𝕀̇ξ − ad*_ξ 𝕀ξ. The pose is replaced by Q_L, the desired pose by I, and its
        momentum and torque by (𝕀ξ, τ_ξ). Then all errors of this class are those of the body
        frame, so that one formula serves both frames: Ṽ is V − ξ, Q_E is Q_L, and the gradient
        is L*_{Q_L}dΥ(Q_L).
        """
        G = self.G
        Q_L = G.inverse(self.Qd) @ self.Q
        carry = G.Ad_matrix(G.inverse(Q_L))
        xi = apply_matrix(carry, self.Vd)
        xi_dot = apply_matrix(carry, self.Vd_dot) - G.ad(self.V, xi)
        in_body = replace(self, Q=Q_L, Qd=G.identity)
        vars(in_body).update(V=self.V)  # a measured V need not follow from P
        return in_body.following(xi, xi_dot)

    def following(self, Vd: Array, Vd_dot: Array) -> Tracking:
        """Return the motion with another desired velocity V_d and its rate V̇_d."""
        G, inertia = self.G, self.inertia
        Pd, Pd_dot = inertia.momentum(Vd), inertia.momentum(Vd_dot) + inertia.rate_force(Vd)
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        following = Following(**values | {"Pd": Pd, "tau_d": Pd_dot - G.ad_star(Vd, Pd)})
        vars(following).update(V=self.V, Vd=Vd, Vd_dot=Vd_dot, Pd_dot=Pd_dot)  # fills the cache
        return following

    @cached_property
    def Q_E(self) -> Array:
        """Q_E = Q Q_d⁻¹, Hampsey et al. (2025), eq. (17)."""
        return pose_error(self.G, self.Q, self.Qd)

    @cached_property
    def V_E(self) -> Array:
        """V_E = Ad_{Q_d} Ṽ, the first part of Hampsey et al. (2025), eq. (19)."""
        return self.G.Ad(self.Qd, self.V_tilde)

    @cached_property
    def inertia_force(self) -> Array | float:
        """Ṡ*S⁻* P̃, which compensates the change of the inertia; 0.0 where it is constant.

        Hampsey et al. (2025), eq. (11) in the tracking errors: with 𝕀̄_t = S̄* 𝕀_0 S̄ and
        S̄ = S Ad_{Q_d⁻¹}, the feedforward of Theorem 3.2 is −ad*_{V_d} P̃ + Ṡ*S⁻* P̃ in the body
        frame.
        """
        return self.inertia.feedforward(self.V_tilde)

    def feedforward(self, g: Any, c: Any, n: Any, q: Any = None) -> Array:
        """τ_d − g ad*_Ṽ 𝕀V_d − c ad*_{V_d} 𝕀Ṽ + n 𝕀 ad_V V_d + Ṡ*S⁻* 𝕀Ṽ − q ad*_Ṽ 𝕀Ṽ.

        The terms with g and q have no power. Without q, its term is left out.
        """
        momentum = g * self.Pd
        if q is not None:
            momentum = momentum + q * self.P_tilde
        gyroscopic = self.G.ad_star(self.V_tilde, momentum)
        return self._driving(gyroscopic, c, n) + self.inertia_force

    def _driving(self, gyroscopic: Array, c: Any, n: Any) -> Array:
        """τ_d − gyroscopic − c ad*_{V_d} 𝕀Ṽ + n 𝕀 ad_V V_d."""
        G = self.G
        carried = n * self.inertia.momentum(G.ad(self.V, self.Vd))
        return self.tau_d - gyroscopic - G.ad_star(self.Vd, c * self.P_tilde) + carried

    @cached_property
    def cancelling_feedforward(self) -> Array:
        """Ṗ_d − ad*_V P + Ṡ*S⁻* 𝕀Ṽ, equal to `feedforward` with (1, 1, 0, 1).

        It leaves d(𝕀Ṽ)/dt = Ṡ*S⁻* 𝕀Ṽ.
        """
        return self.Pd_dot - self.G.ad_star(self.V, self.P) + self.inertia_force

    @cached_property
    def gradient(self) -> Array:
        """L*_{Q_E} dΥ(Q_E), spatial frame."""
        return navigation.gradient(self.G, self.gains.K, self.Q_E)

    @cached_property
    def gradient_rate(self) -> Array:
        """The rate at which `gradient` changes."""
        return navigation.gradient_rate(self.G, self.gains.K, self.Q_E, self.V_E)

    @cached_property
    def stiffness(self) -> Array:
        """The Hessian of Υ at I, `gradient` for a small error, ``(..., m, m)``."""
        return navigation.hessian_at_identity(self.G, self.gains.K)

    def linear_gradient(self, x: Array) -> Array:
        """H x: `gradient` to first order in the coordinates x of a small error."""
        return navigation.hessian_times(self.G, self.gains.K, x)

    @property
    def kinetic_error(self) -> Array:
        """½⟨𝕀Ṽ, Ṽ⟩."""
        return dot(self.P_tilde, self.V_tilde) / 2

    @cached_property
    def spatial_damping(self) -> Array:
        """K_d V_E, the Rayleigh force in the spatial frame."""
        return apply_matrix(self.gains.K_d, self.V_E)

    @cached_property
    def body_damping(self) -> Array:
        """K_d Ṽ, the Rayleigh force in the body frame."""
        return apply_matrix(self.gains.K_d, self.V_tilde)

    @property
    def lyapunov(self) -> Array:
        """L = ½⟨P_E, 𝕀̄_t⁻¹P_E⟩ + Υ(Q_E) = ½⟨P̃, Ṽ⟩ + Υ(Q_E), Theorems 3.2 and 6.2."""
        return self.kinetic_error + navigation.potential(self.G, self.gains.K, self.Q_E)


class Following(Tracking):
    """A motion whose desired velocity is given with its rate, so that τ_d follows from them."""

    def _driving(self, gyroscopic: Array, c: Any, n: Any) -> Array:
        """As above with τ_d = 𝕀V̇_d + 𝕀̇V_d − ad*_{V_d} P_d, with fewer products."""
        G, inertia = self.G, self.inertia
        driving = inertia.momentum(self.Vd_dot + n * G.ad(self.V, self.Vd))
        carried = G.ad_star(self.Vd, self.Pd + c * self.P_tilde)
        return driving + inertia.rate_force(self.Vd) - gyroscopic - carried
