"""The equivariant tracking law EqT = (1, 1, 0), a point of the (g, c, n) family."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.family import Member


@dataclass(frozen=True)
class EqT(Member):
    """Equivariant tracking, Theorem 6.2 of the paper; eq. (23) on SO(3)."""

    name: ClassVar[str] = "eqt"
    title: ClassVar[str] = "EqT"
    weights: ClassVar[tuple[float, float, float, float]] = (1.0, 1.0, 0.0, 0.0)
