"""Proportional action on the logarithm of the body error; the feedforward cancels the rest."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.controllers.body_errors import CancellingLaw
from eqt_cli.core.arrays import Array, dot
from eqt_cli.core.errors import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class Logarithmic(CancellingLaw):
    """Logarithmic PD after Johnson and Beard (2021), on every group.

    force = J_r⁻ᵀ(x) H x with x = log(Q_d⁻¹Q), J_r the right Jacobian and H the Hessian of Υ at I,
    which gives it the stiffness of the other laws for small errors; the energy is ½⟨H x, x⟩. The
    paper, arXiv 2109.07025, was not read; the form is that of the design of eqt.

    The torque does not vanish towards an error angle of π and changes its sign there, where both
    opposite rotations are equally short. The energy is continuous there, so that L keeps falling:
    always for rotations, and with translations if H weighs these equally in every direction.
    """

    name: ClassVar[str] = "logarithmic"
    energy: ClassVar[str] = "½⟨𝕀e, e⟩ + ½⟨H log Q_L, log Q_L⟩"
    theorem: ClassVar[str] = "after Johnson, Beard (2021)"
    bibtex: ClassVar[str] = """\
@misc{johnson2021globally,
  author = {Johnson, Jacob and Beard, Randal},
  title  = {Globally-Attractive Logarithmic Geometric Control of a Quadrotor for Aggressive
            Trajectory Tracking},
  year   = {2021},
  eprint = {2109.07025},
  archivePrefix = {arXiv}
}"""

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a group without the derivative of its logarithm."""
        with problems.catching():
            G.log_force(np.zeros(G.dimension), np.zeros(G.dimension))

    def force(self, r: Tracking) -> Array:
        """J_r⁻ᵀ(x) H x."""
        x = r.G.log(r.Q)
        return r.G.log_force(x, r.linear_gradient(x))

    def potential(self, r: Tracking) -> Array:
        """½⟨H x, x⟩."""
        x = r.G.log(r.Q)
        return dot(r.linear_gradient(x), x) / 2
