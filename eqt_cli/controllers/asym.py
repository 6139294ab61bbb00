"""The law asym = (1, ½, ½), a point of the (g, c, n) family."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from eqt_cli.controllers.family import Family


@dataclass(frozen=True)
class Asym(Family):
    """EqT with the symmetric choice of S (the paper's §7 and eq. (10))."""

    name: ClassVar[str] = "asym"
    title: ClassVar[str] = "asym"

    gyroscopic: float = field(default=1.0, init=False)
    transport: float = field(default=0.5, init=False)
    connection: float = field(default=0.5, init=False)
    damping: Literal["spatial", "body"] = field(default="spatial", init=False)
