"""Which laws are points of the (g, c, n) family, and which."""

from __future__ import annotations

from typing import Literal, TypeGuard

from eqt_cli.controllers import Controller
from eqt_cli.controllers.family import Family


def is_of_family(law: Controller) -> TypeGuard[Family]:
    """Whether a law's torque is the family's; a subclass with a torque of its own is not."""
    return isinstance(law, Family) and type(law).torque is Family.torque


def is_member(
    law: Controller, g: float, c: float, n: float, damping: Literal["spatial", "body"]
) -> bool:
    """Whether a law is this point of the family."""
    if not is_of_family(law):
        return False
    point = (law.gyroscopic, law.transport, law.connection, law.damping)
    return point == (g, c, n, damping)
