"""The law asym = (1, ½, ½), a point of the (g, c, n) family."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.family import Member


@dataclass(frozen=True)
class Asym(Member):
    """EqT with the symmetric choice of S (the paper's §7 and eq. (10))."""

    name: ClassVar[str] = "asym"
    weights: ClassVar[tuple[float, float, float, float]] = (1.0, 0.5, 0.5, 0.0)
