"""The clocks of a sampled loop: when law, sensors and actuators act, and when a command arrives."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import seconds


class Clock(NamedTuple):
    """The ticks at which a part acts, in which `every` is the step and `offset` the first one.

    Attributes
    ----------
    every
        Number of ticks between two of its instants.
    offset
        Number of the first tick, less than `every`.
    """

    every: int = 1
    offset: int = 0

    @property
    def acts_always(self) -> bool:
        """Whether the part acts at every tick."""
        return self == (1, 0)

    def is_due(self, tick: Any) -> Any:
        """Return whether the part acts at a tick, or at each of an array of ticks."""
        return (tick - self.offset) % self.every == 0

    def numbers(self, ticks: int) -> Array:
        """Return the number of the last measurement at each of so many ticks, from 0.

        The first is of t = 0, whatever the offset.
        """
        return (np.arange(ticks) - self.offset) // self.every + (self.offset > 0)


ALWAYS = Clock()
"""The clock of a part that acts at every tick."""


@dataclass(frozen=True)
class Sampling:
    """The tick of a loop, and the clock of its law, whose command is held from instant to instant.

    Attributes
    ----------
    period
        Control period: the time between two instants of the law, s.
    delay
        Number of ticks after which a command arrives; until the first one does, 0 is held.
    clock
        Clock of the law.
    """

    period: float
    delay: int = 0
    clock: Clock = ALWAYS

    departs = "sampled control"

    @property
    def tick(self) -> float:
        """Time between two ticks, s."""
        return self.period / self.clock.every

    def clock_of(self, period: float | None, offset: float | None) -> Clock:
        """Return the clock of a part with a period and an offset, s; that of the law for None."""
        if period is None:
            every, first = self.clock
        else:
            every, first = round(period / self.tick), 0
        return Clock(every, first if offset is None else round(offset / self.tick))

    def ticks_of(self, delay: int | str) -> int:
        """Return the ticks of a delay: a whole number of control periods, or a time as text."""
        if isinstance(delay, int):
            return delay * self.clock.every
        return round(seconds(delay) / self.tick)
