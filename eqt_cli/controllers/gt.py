"""The geometric tracking law GT = (½, ½, ½), a point of the (g, c, n) family."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.family import Frame, Member


@dataclass(frozen=True)
class GT(Member):
    """Geometric tracking after Bullo and Lewis, damped in the body frame; eq. (24) on SO(3)."""

    name: ClassVar[str] = "gt"
    title: ClassVar[str] = "GT"
    bibtex: ClassVar[str] = """\
@book{bullo2005geometric,
  author    = {Bullo, Francesco and Lewis, Andrew D.},
  title     = {Geometric Control of Mechanical Systems},
  publisher = {Springer},
  year      = {2005}
}"""
    weights: ClassVar[tuple[float, float, float, float]] = (0.5, 0.5, 0.5, 0.0)
    frames: ClassVar[tuple[Frame, Frame]] = ("spatial", "body")
