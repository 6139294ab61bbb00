"""What an actuator is: what becomes of a command; it knows no law, no plant and no engine."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import Given, VehiclePart


@dataclass(frozen=True)
class Actuator(VehiclePart):
    """One of the actuators through which a command goes, in their order.

    It takes the command that it is given, and its own states where it has any, which start at 0.
    """

    limits: ClassVar[bool] = False
    """Whether it can be at a limit."""

    def states(self, G: MatrixLieGroup) -> int:
        """How many states it has."""
        return 0

    @abstractmethod
    def output(self, G: MatrixLieGroup, command: Array, x: Array, given: Given) -> Array:
        """What it makes of a command, ``(..., m)``; x are its states."""

    def rate(self, G: MatrixLieGroup, command: Array, x: Array, given: Given) -> Array:
        """The time derivative of its states."""
        return x

    def at_limit(self, G: MatrixLieGroup, command: Array, given: Given) -> Array | None:
        """Where a command is beyond its limit, ``(...)``; None where it has none."""
        return None
