"""A tracking law after Bullo and Murray (1999), a point of the family in body errors."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.family import Frame, Member


@dataclass(frozen=True)
class BulloMurray(Member):
    """After Bullo and Murray (1999), with the transport map of the body error, on every group.

    τ = 𝕀(ξ̇ + ∇_V ξ) − K_d e − L*dΥ(Q_L), where ξ = Ad_{Q_L⁻¹}V_d is the desired velocity carried
    to the body and ∇ the Levi-Civita connection of 𝕀. Automatica 35, 17-34, of which only the
    abstract was read.
    """

    name: ClassVar[str] = "bullo_murray"
    title: ClassVar[str] = "Bullo–Murray"
    theorem: ClassVar[str] = "after Bullo, Murray (1999)"
    bibtex: ClassVar[str] = """\
@article{bullo1999tracking,
  author  = {Bullo, Francesco and Murray, Richard M.},
  title   = {Tracking for Fully Actuated Mechanical Systems: A Geometric Framework},
  journal = {Automatica},
  volume  = {35},
  number  = {1},
  pages   = {17--34},
  year    = {1999}
}"""
    weights: ClassVar[tuple[float, float, float, float]] = (0.5, 0.5, 0.5, 0.0)
    frames: ClassVar[tuple[Frame, Frame]] = ("body", "body")
