"""A law that estimates the parameters of forces that act in known directions."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, absolute, apply_matrix, dot, less, transpose, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Positive, Real, Scale, Unit
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import Controller, published
from eqt_cli.components.matrix_groups import check_turns_in_space
from eqt_cli.components.mechanics import Gains, Tracking, hessian_at_identity

Regressor = Literal["constant", "damping", "quadratic", "weight"]


@dataclass(frozen=True)
class GeometricAdaptive(Controller):
    """Adaptive tracking after Goodarzi, Lee and Lee (2015), on every group.

    τ = τ_ξ + 𝕀 ad_e ξ − L*dΥ(Q_L) − K_d e − W θ̂ for a force W θ that the model does not know, with

        θ̂' = γ Proj(Wᵀ(e + c₂ e_R)),

    e_R the projection of Q_L = Q_d⁻¹Q onto the algebra. While |θ̂| ≤ B and y = Wᵀ(e + c₂ e_R) leads
    inward, Proj y = y, else y − θ̂⟨θ̂, y⟩/|θ̂|². On SO(3) it is the attitude law of the paper
    (arXiv 1411.2986, of which only the opening was read), inside a `cascade` with `ki` and `c1` its
    position law for constant forces. With `estimates: [constant]` and no bound it is
    `goodarzi2013` with k_I = γ.

    L = ½⟨𝕀e, e⟩ + Υ(Q_L) + c₂⟨𝕀e, e_R⟩ + |θ̂|²/(2γ) without such a force, else with θ̂ − θ. It falls
    near the reference if c₂ is small enough; nothing is claimed for any c₂.

    Attributes
    ----------
    gamma
        γ. Default: a tenth of the least stiffness H of Υ, 0.2 on SO(3) with K = I.
    c2
        c₂, 1/s.
    estimates
        What θ has, and W beside one another: `constant`, a force in the body, W = I; `damping`,
        W = diag V; `quadratic`, W = diag |V|V; `weight`, W θ = θ × Rᵀ(0, 0, −1), the torque of a
        weight θ/r at a centre of mass r, on SO3 and SE3.
    bound
        B, for all of θ together. Default: none.
    """

    name: ClassVar[str] = "geometric_adaptive"
    title: ClassVar[str] = "geometric adaptive"
    energy: ClassVar[str] = "½⟨𝕀e, e⟩ + Υ(Q_L) + c₂⟨𝕀e, e_R⟩ + |θ̂|²/(2γ)"
    matched: ClassVar[bool | None] = False
    theorem: ClassVar[str] = ""
    bibtex: ClassVar[str] = published("goodarzi2015adaptive")

    gamma: Annotated[Positive, Scale("γ", "N m/rad", is_symbol=True)] = 0.2
    c2: Annotated[Real, Unit("1/s")] = 0.5
    estimates: list[Regressor] = field(default_factory=lambda: ["constant"])
    bound: Annotated[Positive | None, Scale("bound", "N m")] = None

    def defaults(self, G: MatrixLieGroup, gains: Gains) -> Mapping[str, float]:
        """γ = 0.1 min H: a fixed one would be too strong for a light body."""
        return {"gamma": 0.1 * float(np.linalg.eigvalsh(hessian_at_identity(G, gains.K)).min())}

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note estimates that are none or twice there, and a weight on another group."""
        if not self.estimates or len({*self.estimates}) < len(self.estimates):
            problems.at("estimates").add(f"expected names, each once, got {self.estimates}")
        if "weight" in self.estimates:
            check_turns_in_space("an estimated weight", G, problems.at("estimates"))

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of the parts of θ̂."""
        return {name: 3 if name == "weight" else G.dimension for name in self.estimates}

    def regressed(self, s: Tracking, parts: Arrays) -> Array:
        """Return W θ of the parts of θ."""
        force: Any = 0.0 * s.V
        for name, theta in parts.items():
            if name == "weight":
                torque = apply_matrix(_turned(s), theta)
                rest = 0.0 * s.V[..., 3:]
                force = force + np.concatenate([torque, rest], axis=-1)
            else:
                force = force + _factor(name, s.V) * theta
        return force

    def _transposed(self, s: Tracking) -> Arrays:
        """Wᵀ(e + c₂ e_R), by the parts of θ."""
        y = self.velocity_error(s)
        return {
            name: apply_matrix(transpose(_turned(s)), y[..., :3])
            if name == "weight"
            else _factor(name, s.V) * y
            for name in self.estimates
        }

    def memory_rate(self, s: Tracking) -> Arrays:
        """γ Proj(Wᵀ(e + c₂ e_R))."""
        y, theta = self._transposed(s), s.memory
        if self.bound is None:
            return {name: self.gamma * y[name] for name in y}
        outward: Any = sum(dot(theta[name], y[name]) for name in y)
        size: Any = sum(dot(theta[name], theta[name]) for name in y)
        share = where(
            less(self.bound**2 + 0.0 * outward[..., None], size[..., None]),
            outward[..., None] / (size[..., None] + 1e-300),
            0.0 * outward[..., None],
        )
        share = where(less(0.0, share), share, 0.0 * share)
        return {name: self.gamma * (y[name] - share * theta[name]) for name in y}

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = s.relative
        feedback = r.gradient + self.regressed(s, self._estimate(s))
        return r.feedforward(0.0, 0.0, 1.0) - r.body_damping - feedback

    def _estimate(self, s: Tracking) -> Arrays:
        return {name: s.memory[name] for name in self.estimates}

    def velocity_error(self, s: Tracking) -> Array:
        """e + c₂ e_R."""
        r = s.relative
        return r.V_tilde + self.c2 * r.G.vee(r.Q)

    def lyapunov(self, s: Tracking) -> Array:
        """Return L without a force that the model does not know."""
        r, theta = s.relative, self._estimate(s)
        stored: Any = sum(dot(x / (2.0 * self.gamma), x) for x in theta.values())
        return r.lyapunov + dot(self.c2 * r.P_tilde, r.G.vee(r.Q)) + stored

    def memory_gradient(self, s: Tracking) -> Arrays:
        """∂L/∂θ̂ = θ̂/γ."""
        return {name: x / self.gamma for name, x in self._estimate(s).items()}

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d e, e⟩, the rate of the mixed term, and what the projection takes."""
        r, theta, rates = s.relative, self._estimate(s), self.memory_rate(s)
        if s.inertia.leaves:
            return None
        G, e = r.G, r.V_tilde
        adaptive = self.regressed(s, theta)
        # d(𝕀e)/dt = Ṗ − d(𝕀ξ)/dt, here without the adaptive force.
        force = G.ad_star(r.V, r.P) + self.torque(s) + adaptive - G.ad_star(r.Vd, r.Pd) - r.tau_d
        moved = dot(self.c2 * force, G.vee(r.Q))
        moved = moved + dot(self.c2 * r.P_tilde, G.vee(r.Q @ G.hat(e)))
        stored: Any = sum(dot(x / self.gamma, rates[name]) for name, x in theta.items())
        return dot(r.body_damping, e) - moved + dot(adaptive, self.velocity_error(s)) - stored


def _factor(name: str, V: Any) -> Any:
    if name == "constant":
        return 1.0 + 0.0 * V
    return V if name == "damping" else absolute(V) * V


def _turned(s: Tracking) -> Array:
    """(Rᵀ(0, 0, 1))^, which makes θ × Rᵀ(0, 0, −1) of θ."""
    G: Any = s.G
    turned: Array = G.rotation_group.hat(G.rotation(s.Q)[..., 2, :])
    return turned
