"""The geometric tracking law GT = (½, ½, ½), a point of the (g, c, n) family."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from eqt_cli.controllers.family import Family


@dataclass(frozen=True)
class GT(Family):
    """Geometric tracking after Bullo and Lewis, damped in the body frame; eq. (24) on SO(3)."""

    name: ClassVar[str] = "gt"
    title: ClassVar[str] = "GT"

    gyroscopic: float = field(default=0.5, init=False)
    transport: float = field(default=0.5, init=False)
    connection: float = field(default=0.5, init=False)
    damping: Literal["spatial", "body"] = field(default="body", init=False)
