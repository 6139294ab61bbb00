"""A hard limit of the torque."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array, clip, less, norm, where
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.actuators.base import Actuator
from eqt_cli.vehicle.component import Given
from eqt_cli.vehicle.numbers import Numbers


@dataclass(frozen=True)
class Limit(Actuator):
    """No more than a limit, along each axis or in all.

    Attributes
    ----------
    limit
        The largest value along each axis, or a list of m.
    norm
        Limit the Euclidean norm instead; the direction is kept. Along different axes, limits then
        count in proportion.
    """

    name: ClassVar[str] = "limit"
    departs: ClassVar[str] = "torque limited"
    vectors: ClassVar[tuple[str, ...]] = ("limit",)
    positive: ClassVar[tuple[str, ...]] = ("limit",)
    limits: ClassVar[bool] = True

    limit: Numbers
    norm: bool = False

    def output(self, G: MatrixLieGroup, command: Array, x: Array, given: Given) -> Array:
        """The command, cut off."""
        limit = given["limit"]
        if not self.norm:
            return clip(command, -limit, limit)
        size = norm(command / limit)[..., None]
        return where(less(1.0, size), command / size, command)

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array, given: Given) -> Array | None:
        """Where it cuts off."""
        limit = given["limit"]
        if self.norm:
            return np.array(norm(command / limit) > 1.0)
        return np.array((np.abs(command) > limit).any(axis=-1))

    def most(self, G: MatrixLieGroup, torque: Array, given: Given) -> tuple[Array, Array] | None:
        """Sizes along the axes, or the norm in the unit of the largest limit; and the limits."""
        limit = given["limit"]
        if not self.norm:
            return np.abs(torque), limit
        largest = limit.max(axis=-1, keepdims=True)
        return norm(torque / limit)[..., None] * largest, largest
