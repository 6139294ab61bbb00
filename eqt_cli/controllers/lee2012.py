"""A law after Lee, Leok and McClamroch (2012), a point of the family in body errors."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.family import Frame, Member


@dataclass(frozen=True)
class Lee2012(Member):
    """After Lee, Leok and McClamroch (2012): attitude part, no robust term, on every group.

    On SO(3), τ = −k_R e_R − k_Ω e_Ω + (RᵀR_dΩ_d) × J(RᵀR_dΩ_d) + JRᵀR_dΩ̇_d with K = (k_R/2) I and
    K_d = k_Ω I: Nonlinear robust tracking control of a quadrotor UAV on SE(3), arXiv 1109.4457, of
    which only the opening was read. Goodarzi, Lee and Lee (2013)
    without their integral is the same law.
    """

    name: ClassVar[str] = "lee2012"
    title: ClassVar[str] = "Lee 2012"
    theorem: ClassVar[str] = "after Lee, Leok, McClamroch (2012), attitude part"
    bibtex: ClassVar[str] = """\
@inproceedings{lee2012nonlinear,
  author    = {Lee, Taeyoung and Leok, Melvin and McClamroch, N. Harris},
  title     = {Nonlinear Robust Tracking Control of a Quadrotor {UAV} on {SE(3)}},
  booktitle = {American Control Conference},
  year      = {2012},
  eprint    = {1109.4457},
  archivePrefix = {arXiv}
}"""
    weights: ClassVar[tuple[float, float, float, float]] = (0.0, 0.0, 1.0, 0.0)
    frames: ClassVar[tuple[Frame, Frame]] = ("body", "body")
