"""Which measurements an estimator may have of which instant; it knows no estimator."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.sensors.channels import Channel


@dataclass(frozen=True, eq=False)
class Schedule:
    """When parts of the pose and of the velocity are measured, and when that is known.

    Attributes
    ----------
    channels
        The parts that have sensors.
    period
        Of control, s.
    """

    G: MatrixLieGroup
    channels: Sequence[Channel]
    period: float

    @cached_property
    def fixes(self) -> list[Channel]:
        """The parts of the pose that are measured."""
        return [channel for channel in self.channels if channel.signal == "pose"]

    @cached_property
    def depth(self) -> int:
        """How many control periods the oldest measurement is behind when it arrives."""
        return max((channel.delay for channel in self.channels), default=0)

    @cached_property
    def axes(self) -> list[int]:
        """The coordinates of the pose that are measured."""
        return [axis for channel in self.fixes for axis in self.axes_of(channel)]

    @property
    def unmeasured(self) -> list[str]:
        """The parts of the pose that no sensor measures."""
        measured = [channel.part.name for channel in self.fixes]
        return [part.name for part in self.G.parts if part.name not in measured]

    def axes_of(self, channel: Channel) -> range:
        """The coordinates of a part."""
        return range(self.G.dimension)[channel.part.axes]

    def of_axes(self, signal: str, option: str, default: int) -> Array:
        """``every`` or ``delay`` of each coordinate of a signal, ``(m,)``."""
        found = np.full(self.G.dimension, default)
        for channel in self.channels:
            if channel.signal == signal:
                found[channel.part.axes] = getattr(channel, option)
        return found

    @property
    def intervals(self) -> Array:
        """Between fixes of each coordinate, s, ``(m,)``."""
        return self.of_axes("pose", "every", 1) * self.period

    def waits(self, channel: Channel) -> int:
        """How many earlier measurements of a part have to be kept."""
        return self.depth - channel.delay

    def available(self, step: int) -> Iterator[tuple[int, Channel]]:
        """The parts of the pose of which a measurement `step` periods after the oldest is known."""
        for number, channel in enumerate(self.fixes):
            if step <= self.waits(channel):
                yield number, channel
