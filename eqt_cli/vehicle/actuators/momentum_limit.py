"""Reaction wheels, whose momentum is limited."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array, clip
from eqt_cli.core.option_types import MOMENTUM, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.actuators.base import Actuator, PassThrough
from eqt_cli.vehicle.component import Numbers


@dataclass(frozen=True)
class MomentumLimit(Actuator):
    """The integral of the torque stays within a limit: what would lead out of it is cut off.

    A command is held for a period, so that the integral is known at its end. The plant does not
    include the momentum of the wheels: their gyroscopic torques are left out.

    Attributes
    ----------
    momentum
        The largest integral along each axis, in the unit of the torque times s, or a list of m.
    """

    name: ClassVar[str] = "momentum_limit"
    departs: ClassVar[str] = "momentum of wheels limited"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("momentum",)
    positive: ClassVar[tuple[str, ...]] = ("momentum",)
    limits: ClassVar[bool] = True
    sampled: ClassVar[bool] = True
    limited: ClassVar[str] = "a momentum of "

    momentum: Annotated[Numbers, Unit(MOMENTUM)]

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states: torque and momentum at the end of the period, each m."""
        return 2 * G.dimension

    def step(self, G: MatrixLieGroup, command: Array, x: Array, period: float) -> Array:
        """Return the states with the torque nearest to the command within the momentum."""
        most, h = self.momentum, x[..., G.dimension :]
        torque = clip(command, (-most - h) / period, (most - h) / period)
        return np.concatenate([torque, h + period * torque], axis=-1)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the torque among the states."""
        return x[..., : G.dimension]

    def most(self, G: MatrixLieGroup, times: Array, torque: Array) -> tuple[Array, Array] | None:
        """Return the magnitude of the integral from the first time on, and its limit, by axis."""
        pieces = np.diff(times)[:, None] * (torque[1:] + torque[:-1]) / 2
        return np.abs(np.cumsum(pieces, axis=0)), self.momentum
