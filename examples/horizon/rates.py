"""By how much a body turns faster than it may: see docs/experiments/horizon.md."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.extend import Array, Metric, SampledRuns, absolute, less, maximum, where

LIMIT = 1.0
"""Largest rate about each axis, rad/s."""


@dataclass(frozen=True)
class RateExcess(Metric):
    """Largest |V_i| beyond its limit."""

    name: ClassVar[str] = "rate_excess"
    signals: ClassVar[tuple[str, ...]] = ("velocity",)
    units: ClassVar[str] = "rad/s"
    better: ClassVar[str] = "lower"

    def of(self, over: SampledRuns, velocity: Any) -> Array:
        """max over axes and time of |V_i| − limit, at least 0."""
        return over.largest(self.beyond(velocity))

    def beyond(self, velocity: Any) -> Any:
        """The same at each time."""
        size = absolute(velocity)
        largest = maximum(maximum(size[..., 0], size[..., 1]), size[..., 2])
        return maximum(largest - LIMIT, 0.0 * largest)


@dataclass(frozen=True)
class BeyondShare(RateExcess):
    """Share of the time in which some |V_i| is more than 1 % beyond its limit."""

    name: ClassVar[str] = "beyond_share"
    units: ClassVar[str] = "1"

    def of(self, over: SampledRuns, velocity: Any) -> Array:
        """The mean of [beyond]."""
        beyond = self.beyond(velocity)
        return over.mean(where(less(0.01 * LIMIT, beyond), 1.0, 0.0))


@dataclass(frozen=True)
class ErrorAndExcess(RateExcess):
    """What is tuned: the mean attitude error and the largest excess; 1 rad/s counts as 1 rad."""

    name: ClassVar[str] = "error_and_excess"
    signals: ClassVar[tuple[str, ...]] = ("attitude_angle", "velocity")
    units: ClassVar[str] = "deg"

    def of(self, over: SampledRuns, angle: Any, velocity: Any) -> Array:
        """mean angle + 180/π largest excess."""
        return over.mean(angle) + math.degrees(1) * over.largest(self.beyond(velocity))
