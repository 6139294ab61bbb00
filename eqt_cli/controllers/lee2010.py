"""The attitude law of Lee, Leok and McClamroch (2010), a point of the family in body errors."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.family import Frame, Member


@dataclass(frozen=True)
class Lee2010(Member):
    """Lee, Leok and McClamroch (2010), the attitude part, on every group.

    On SO(3), τ = −k_R e_R − k_Ω e_Ω + Ω × JΩ − J(Ω̂RᵀR_dΩ_d − RᵀR_dΩ̇_d) with K = (k_R/2) I and
    K_d = k_Ω I: arXiv 1003.2005v4, eq. (8), (9) and (11), where Υ is k_R times the error function
    of eq. (6). On other groups, the form is that of the design of eqt.
    """

    name: ClassVar[str] = "lee2010"
    title: ClassVar[str] = "Lee 2010"
    theorem: ClassVar[str] = "Lee, Leok, McClamroch (2010), attitude part"
    bibtex: ClassVar[str] = """\
@inproceedings{lee2010geometric,
  author    = {Lee, Taeyoung and Leok, Melvin and McClamroch, N. Harris},
  title     = {Geometric Tracking Control of a Quadrotor {UAV} on {SE(3)}},
  booktitle = {49th {IEEE} Conference on Decision and Control},
  pages     = {5420--5425},
  year      = {2010},
  doi       = {10.1109/CDC.2010.5717652}
}"""
    weights: ClassVar[tuple[float, float, float, float]] = (1.0, 1.0, 0.0, 1.0)
    frames: ClassVar[tuple[Frame, Frame]] = ("body", "body")
