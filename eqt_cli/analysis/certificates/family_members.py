"""Which laws are points of the (g, c, n) family, and which."""

from __future__ import annotations

from typing import Literal

from eqt_cli.controllers import Controller
from eqt_cli.controllers.family import Family


def is_member(
    law: Controller, g: float, c: float, n: float, damping: Literal["spatial", "body"]
) -> bool:
    """Whether a law is this point of the family."""
    if not isinstance(law, Family):
        return False
    point = (law.gyroscopic, law.transport, law.connection, law.damping)
    return point == (g, c, n, damping)
