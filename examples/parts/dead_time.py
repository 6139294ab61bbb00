"""Thrusters that answer after a dead time."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.extend import Actuator, Array, Count, MatrixLieGroup, Numbers, clip, outside


@dataclass(frozen=True)
class DeadTime(Actuator):
    """A limit, and behind it a chain of equal lags, which together last as long as the dead time.

    Attributes
    ----------
    time
        The dead time, s; along every axis, or a list.
    limit
        The largest command that is followed; along every axis, or a list.
    order
        How many lags; the more there are, the sharper the answer.
    """

    name: ClassVar[str] = "dead_time"
    departs: ClassVar[str] = "thrusters answer late"
    vectors: ClassVar[tuple[str, ...]] = ("time", "limit")
    positive: ClassVar[tuple[str, ...]] = ("time", "limit")
    limits: ClassVar[bool] = True
    moves: ClassVar[bool] = True

    time: Numbers
    limit: Numbers
    order: Count = 8

    def states(self, G: MatrixLieGroup) -> int:
        """One for each lag along each axis; the last lag's come last."""
        return self.order * G.dimension

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Each lag follows the one before it, the first one the limited command."""
        m = G.dimension
        before = np.zeros_like(x)
        before[..., :m] = clip(command, -self.limit, self.limit)
        before[..., m:] = x[..., :-m]
        rate = (self.order / self.time)[..., None, :]
        by_lag = (before - x).reshape(*x.shape[:-1], self.order, m)
        return (by_lag * rate).reshape(x.shape)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """The last lag."""
        return x[..., -G.dimension :]

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """1 where the command is beyond its limit; a late answer is not."""
        return outside(command, -self.limit, self.limit)
