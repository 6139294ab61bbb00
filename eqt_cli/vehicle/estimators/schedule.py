"""The measurements that an estimator may have of each instant; it knows no estimator."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.sensors.channels import Channel


@dataclass(frozen=True, eq=False)
class Schedule:
    """Times at which parts of pose and velocity are measured, and at which that is known.

    Attributes
    ----------
    channels
        Parts that have sensors.
    period
        Tick of the loop, s.
    """

    G: MatrixLieGroup
    channels: Sequence[Channel]
    period: float

    @cached_property
    def fixes(self) -> list[Channel]:
        """Measured parts of the pose."""
        return [channel for channel in self.channels if channel.signal == "pose"]

    @cached_property
    def depth(self) -> int:
        """Largest delay of a measurement, in ticks."""
        return max((channel.delay for channel in self.channels), default=0)

    @cached_property
    def axes(self) -> list[int]:
        """Measured coordinates of the pose."""
        return [axis for channel in self.fixes for axis in self.axes_of(channel)]

    @property
    def unmeasured(self) -> list[str]:
        """Names of the parts of the pose that no sensor measures."""
        measured = [channel.part.name for channel in self.fixes]
        return [part.name for part in self.G.parts if part.name not in measured]

    def axes_of(self, channel: Channel) -> range:
        """Return the coordinates of a part."""
        return range(self.G.dimension)[channel.part.axes]

    def of_axes(self, signal: str, option: str, default: int) -> Array:
        """Return ``every`` or ``delay`` of each coordinate of a signal, ``(m,)``."""
        values = np.full(self.G.dimension, default)
        for channel in self.channels:
            if channel.signal == signal:
                values[channel.part.axes] = getattr(channel, option)
        return values

    @property
    def intervals(self) -> Array:
        """Time between fixes of each coordinate, s, ``(m,)``."""
        return self.of_axes("pose", "every", 1) * self.period

    def waits(self, channel: Channel) -> int:
        """Return the number of earlier measurements of a part to keep."""
        return self.depth - channel.delay

    def available(self, step: int) -> Iterator[tuple[int, Channel]]:
        """Yield number and channel of the fixes that are known `step` ticks after the oldest."""
        for number, channel in enumerate(self.fixes):
            if step <= self.waits(channel):
                yield number, channel
