"""A hard limit of the rate of the torque."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array, clip
from eqt_cli.core.option_types import TORQUE_RATE, Scale
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.actuators.base import Actuator, PassThrough
from eqt_cli.vehicle.component import Numbers


@dataclass(frozen=True)
class RateLimit(Actuator):
    """From one control instant to the next, no greater change than rate · period, from 0.

    Attributes
    ----------
    rate
        The largest rate along each axis, per second, or a list of m.
    """

    name: ClassVar[str] = "rate_limit"
    departs: ClassVar[str] = "rate of torque limited"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("rate",)
    positive: ClassVar[tuple[str, ...]] = ("rate",)
    limits: ClassVar[bool] = True
    sampled: ClassVar[bool] = True
    limited: ClassVar[str] = "a rate of "

    rate: Annotated[Numbers, Scale("limit of the torque's rate", TORQUE_RATE)]

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states: the torque along each axis."""
        return G.dimension

    def step(self, G: MatrixLieGroup, command: Array, x: Array, period: float) -> Array:
        """Return the torque nearest to the command that it can reach in one period."""
        most = self.rate * period
        return x + clip(command - x, -most, most)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the state."""
        return x

    def most(self, G: MatrixLieGroup, times: Array, torque: Array) -> tuple[Array, Array] | None:
        """Return the magnitude of the rate in the step before each time, and its limit, by axis."""
        return np.abs(np.diff(torque, axis=0) / np.diff(times)[:, None]), self.rate
