"""Reaction wheels as a limit of the momentum that they take up, along each axis."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array, clip
from eqt_cli.base.option_types import MOMENTUM, Unit
from eqt_cli.components.actuators import Actuator, Needed, PassThrough
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.vehicle_parts import Numbers


@dataclass(frozen=True)
class MomentumLimit(Actuator):
    """The integral of the torque stays within a limit: what would lead out of it is cut off.

    A command is held for a period, so that the integral is known at its end. The plant does not
    include the momentum of the wheels: their gyroscopic torques are left out.

    Attributes
    ----------
    momentum
        Largest integral along each axis, in the unit of torque times s.
    """

    name: ClassVar[str] = "momentum_limit"
    departs: ClassVar[str] = "momentum of wheels limited"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("momentum",)
    positive: ClassVar[tuple[str, ...]] = ("momentum",)
    limits: ClassVar[bool] = True
    sampled: ClassVar[bool] = True

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

    def needed(self, G: MatrixLieGroup, times: Array, torque: Array) -> Needed | None:
        """Return the integral from the first time on, with its limits, by axis."""
        pieces = np.diff(times)[:, None] * (torque[1:] + torque[:-1]) / 2
        return np.cumsum(pieces, axis=0), -self.momentum, self.momentum, "a momentum of "
