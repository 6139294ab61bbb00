"""A hard limit of the torque."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array, clip, less, norm, where
from eqt_cli.core.errors import Problems
from eqt_cli.core.leaves import with_fields
from eqt_cli.core.option_types import TORQUE, Scale, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.actuators.base import Actuator, PassThrough, against
from eqt_cli.vehicle.component import Numbers, check_limits


@dataclass(frozen=True)
class Limit(Actuator):
    """No more than a limit, along each axis or in all.

    Attributes
    ----------
    limit
        The largest value along each axis in both directions, or a list of m.
    norm
        Limit the Euclidean norm instead; the direction is kept. Along different axes, limits then
        count in proportion. Only with `limit`.
    low, high
        Instead of `limit`: the least and the largest value along each axis, or lists of m.
    """

    name: ClassVar[str] = "limit"
    departs: ClassVar[str] = "torque limited"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("limit", "low", "high")
    positive: ClassVar[tuple[str, ...]] = ("limit",)
    limits: ClassVar[bool] = True

    limit: Annotated[Numbers | None, Scale("limit of the torque", TORQUE)] = None
    norm: bool = False
    low: Annotated[Numbers | None, Unit(TORQUE)] = None
    high: Annotated[Numbers | None, Unit(TORQUE)] = None

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the actuator with limits in both directions, or with the limit of the norm."""
        part = super().of_run(G, random)
        if part.norm or part.limit is None:
            return part
        return with_fields(part, limit=None, low=-part.limit, high=part.limit)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the saturated command."""
        if not self.norm:
            return clip(command, self.low, self.high)
        size = norm(command / self.limit)[..., None]
        return where(less(1.0, size), command / size, command)

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array | None:
        """Return where the command is beyond the limits."""
        if self.norm:
            return np.array(norm(command / self.limit) > 1.0)
        beyond = (command < self.low) | (command > self.high)
        return np.array(beyond.any(axis=-1))

    def torque_range(self, G: MatrixLieGroup) -> tuple[Array, Array] | None:
        """Return the limits along the axes; None for a limit of the norm."""
        if self.norm:
            return None
        ends: Any = (self.low, self.high)
        low, high = (np.broadcast_to(end, G.dimension) for end in ends)
        return low, high

    def most(self, G: MatrixLieGroup, times: Array, torque: Array) -> tuple[Array, Array] | None:
        """Return magnitudes on the axes, or the norm times the largest limit, with their limits."""
        if not self.norm:
            return against(torque, self.low, self.high)
        limit: Any = self.limit
        largest = limit.max()
        return norm(torque / limit)[..., None] * largest, largest

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note limits given in both ways or in none, and limits with nothing between them."""
        given: Any = [name for name in ("low", "high") if getattr(self, name) is not None]
        if self.limit is not None and given:
            problems.add(f"expected limit, or low and high, got limit and {' and '.join(given)}")
        elif self.limit is None and not given:
            problems.add("expected limit, or low and high, got neither; add limit: 1.0")
        elif self.norm and given:
            problems.at("norm").add("needs limit, got low and high; use limit, or remove this key")
        super().check(G, problems)
        if not problems:
            check_limits(self.low, self.high, problems)
