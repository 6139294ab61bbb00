"""The law nog = (0, 1, 0), a point of the (g, c, n) family."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.family import Member


@dataclass(frozen=True)
class NoG(Member):
    """EqT without its gyroscopic term (the paper's §7)."""

    name: ClassVar[str] = "nog"
    weights: ClassVar[tuple[float, float, float, float]] = (0.0, 1.0, 0.0, 0.0)
