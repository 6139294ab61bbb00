"""Proportional action on the quaternion of the body error, for rotations of space."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.controllers.body_errors import CancellingLaw
from eqt_cli.core.arrays import Array, dot, stack
from eqt_cli.core.errors import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.navigation import hessian_at_identity
from eqt_cli.mechanics.tracking import Gains, Tracking


@dataclass(frozen=True)
class Quaternion(CancellingLaw):
    """Quaternion feedback after Wie, Weiss and Arapostathis (1989), on SO(3).

    force = 2 H q with q = sin(θ/2) u the vector part of the unit quaternion of Q_d⁻¹Q whose scalar
    part is q₀ ≥ 0, and H the Hessian of Υ at I: the paper's D is K_d, its K is 2H. The paper has a
    reference at rest and cancels ω × Jω; the feedforward here does so for a moving one. J.
    Guidance, Control, and Dynamics 12, 375-380, which was not read.

    With H = h I, L = ½⟨𝕀e, e⟩ + 4h(1 − q₀) falls. With another H the force has no potential, and
    nothing is claimed. The choice q₀ ≥ 0 takes the shorter rotation, without unwinding; the
    torque is largest at an error angle of π, where it changes its sign.
    """

    name: ClassVar[str] = "quaternion"
    energy: ClassVar[str] = "½⟨𝕀e, e⟩ + 4h(1 − q₀)"
    theorem: ClassVar[str] = "after Wie, Weiss, Arapostathis (1989)"
    bibtex: ClassVar[str] = """\
@article{wie1989quaternion,
  author  = {Wie, Bong and Weiss, H. and Arapostathis, Aristotle},
  title   = {Quaternion Feedback Regulator for Spacecraft Eigenaxis Rotations},
  journal = {Journal of Guidance, Control, and Dynamics},
  volume  = {12},
  number  = {3},
  pages   = {375--380},
  year    = {1989}
}"""

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than the rotations of space."""
        if not (G.compact and G.dimension == G.size == 3):
            problems.add(f"{self.name} is a law for SO3 only; this experiment has group {G.name}")

    def claims(self, G: MatrixLieGroup, gains: Gains) -> bool | None:
        """Return the claim, which needs the same stiffness about every axis."""
        H = hessian_at_identity(G, gains.K)
        homogeneous = np.abs(H - H[0, 0] * np.eye(len(H))).max() <= 1e-12 * np.abs(H).max()
        return self.claims_decrease if homogeneous else None

    def force(self, r: Tracking) -> Array:
        """2 H q."""
        _, twice_q = r.G.half_turn(r.Q)
        return r.linear_gradient(twice_q)

    def potential(self, r: Tracking) -> Array:
        """4h(1 − q₀) with h the mean stiffness."""
        scalar, _ = r.G.half_turn(r.Q)
        return (4 * (1 - stack([scalar])) * self._mean(r))[..., 0]

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d e, e⟩, plus the power of stiffness that differs between axes."""
        r = s.relative
        _, twice_q = r.G.half_turn(r.Q)
        uneven = r.linear_gradient(twice_q) - self._mean(r) * twice_q
        return dot(r.body_damping + uneven, r.V_tilde)

    def _mean(self, r: Tracking) -> Array:
        """h, ``(..., 1)``."""
        H = r.stiffness
        return (H[..., 0, :1] + H[..., 1, 1:2] + H[..., 2, 2:]) / 3
