"""The equivariant tracking law EqT = (1, 1, 0), a point of the (g, c, n) family."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from eqt_cli.controllers.family import Family


@dataclass(frozen=True)
class EqT(Family):
    """Equivariant tracking, Theorem 6.2 of the paper; eq. (23) on SO(3)."""

    name: ClassVar[str] = "eqt"
    title: ClassVar[str] = "EqT"

    gyroscopic: float = field(default=1.0, init=False)
    transport: float = field(default=1.0, init=False)
    connection: float = field(default=0.0, init=False)
    damping: Literal["spatial", "body"] = field(default="spatial", init=False)
