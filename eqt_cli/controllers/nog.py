"""The law nog = (0, 1, 0), a point of the (g, c, n) family."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from eqt_cli.controllers.family import Family


@dataclass(frozen=True)
class NoG(Family):
    """EqT without its gyroscopic term (the paper's §7)."""

    name: ClassVar[str] = "nog"
    title: ClassVar[str] = "nog"

    gyroscopic: float = field(default=0.0, init=False)
    transport: float = field(default=1.0, init=False)
    connection: float = field(default=0.0, init=False)
    damping: Literal["spatial", "body"] = field(default="spatial", init=False)
