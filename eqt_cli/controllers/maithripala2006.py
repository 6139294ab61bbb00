"""State feedback after Maithripala, Berg and Dayawansa (2006), damped by the kinetic energy."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from eqt_cli.controllers.base import Controller
from eqt_cli.core.arrays import Array, dot
from eqt_cli.core.option_types import Positive, Unit
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class Maithripala2006(Controller):
    """After Maithripala, Berg and Dayawansa (2006); uses its own damping (gains not matched).

    τ = 𝕀(V̇_d + ∇_V V_d) − Ad*_{Q_d} L*dΥ(Q_E) − k_d 𝕀Ṽ: the damping is proportional to the
    momentum error, ∇ the Levi-Civita connection of 𝕀. IEEE Trans. Automatic Control 51 (2),
    216-225, of which only the abstract was read; the form is that of the design of eqt.

    Damping by k_d 𝕀 is not that by K_d: the stiffness is matched, the damping is not. `gains.kd` is
    not used.

    Attributes
    ----------
    damping_rate
        k_d, 1/s.
    """

    name: ClassVar[str] = "maithripala2006"
    title: ClassVar[str] = "Maithripala 2006"
    theorem: ClassVar[str] = "after Maithripala, Berg, Dayawansa (2006)"
    bibtex: ClassVar[str] = """\
@article{maithripala2006almost,
  author  = {Maithripala, D. H. S. and Berg, Jordan M. and Dayawansa, W. P.},
  title   = {Almost-Global Tracking of Simple Mechanical Systems on a General Class of {Lie}
             Groups},
  journal = {{IEEE} Transactions on Automatic Control},
  volume  = {51},
  number  = {2},
  pages   = {216--225},
  year    = {2006}
}"""
    matched: ClassVar[bool | None] = False
    claims_decrease: ClassVar[bool | None] = True

    damping_rate: Annotated[Positive, Unit("1/s")] = 0.5

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        damping = self.damping_rate * s.P_tilde
        return s.feedforward(0.5, 0.5, 0.5) - damping - s.G.Ad_star(s.Qd, s.gradient)

    def dissipation(self, s: Tracking) -> Array | None:
        """k_d⟨𝕀Ṽ, Ṽ⟩."""
        return dot(self.damping_rate * s.P_tilde, s.V_tilde)
