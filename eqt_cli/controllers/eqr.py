"""The linear-quadratic regulator in the error coordinates of a symmetry of rigid motions."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from eqt_cli.controllers.lqr import Lqr
from eqt_cli.core.arrays import Array, apply_matrix
from eqt_cli.core.errors import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import rigid, rigid_motions
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class Eqr(Lqr):
    """LQR in the error coordinates of a symmetry, an equivariant regulator (EqR); SE2 and SE3.

    The symmetry is a group with one element X for each attitude R, position x and velocity v or w;
    the error is log(X_d⁻¹X). Here v is in space and w = Rᵀv in the body. With R_L = R_dᵀR, its
    rotation vector θ, the left Jacobian J of θ, and p = R_dᵀ(x − x_d):

    - `direct_product`, X = (R, x, v) in SO(n) × ℝⁿ × ℝⁿ: ρ = p, α = R_dᵀ(v − v_d)
    - `pose_velocity`, X = ((R, x), w) in SE(n) × ℝⁿ: ρ = J⁻¹p, α = w − w_d + θ × w_d
    - `extended_pose`, X = (R, x, v) in SE_2(n): ρ = J⁻¹p, α = J⁻¹R_dᵀ(v − v_d)

    The law is `lqr` with the same gains, at ε = (θ, ρ) and e = (e_Ω, α − Ω_d × ρ), where
    e_Ω = Ω − R_LᵀΩ_d in every symmetry. These are the error log(X_d⁻¹X) in the coordinates that
    equal those of `lqr` to first order. So all symmetries have one Riccati equation, one cost and
    one loop for small errors, and differ for large errors only. The error log(XX_d⁻¹) of the
    spatial frame is Ad_{X_d} log(X_d⁻¹X) in each group, and gives the same law.

    The method and the names of the symmetries are those in the abstracts of arXiv 2207.04782
    (Hampsey, van Goor, Hamel, Mahony) and 2211.07045 (Hampsey, van Goor, Mahony). The papers
    themselves were not read. The formulas are derived here, with v or w, the logarithm and e_Ω as
    choices of their own.

    Attributes
    ----------
    symmetry
        The group: `direct_product`, `pose_velocity` or `extended_pose`.
    """

    name: ClassVar[str] = "eqr"
    title: ClassVar[str] = "EqR"

    symmetry: Literal["direct_product", "pose_velocity", "extended_pose"] = "extended_pose"

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without one rotation and one translation, and weights that do not fit."""
        if rigid_motions(G):
            super().check(G, problems)
        else:
            problems.add(
                f"eqr needs a group of one rotation and one translation, SE2 or SE3, got {G.name}"
            )

    def errors(self, s: Tracking) -> tuple[Array, Array]:
        """Return (θ, ρ) and (e_Ω, α − Ω_d × ρ)."""
        G, r = rigid(s.G), s.relative
        k, R_L, epsilon = G.rotations, G.rotation(r.Q), G.log(r.Q)
        alpha = apply_matrix(R_L, s.V[..., k:]) - s.Vd[..., k:]
        turning = 0.0 * epsilon[..., :k]
        if self.symmetry == "direct_product":
            epsilon = np.concatenate([epsilon[..., :k], r.Q[..., : G.space, -1]], axis=-1)
        elif self.symmetry == "extended_pose":  # J⁻¹α
            alpha = G.log(G.assemble(R_L, alpha[..., None]))[..., k:]
        else:
            alpha, turning = s.V_tilde[..., k:], epsilon[..., :k]
        carried = G.ad(s.Vd, np.concatenate([turning, epsilon[..., k:]], axis=-1))
        return epsilon, np.concatenate([r.V_tilde[..., :k], alpha - carried[..., k:]], axis=-1)
