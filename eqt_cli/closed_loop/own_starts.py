"""A closed loop whose runs begin at times of their own, so that they can be solved side by side."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eqt_cli.closed_loop.system import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.tracking import Tracking

STARTS = "starts"
"""The leaf that says how much later each run begins, s."""


@dataclass(frozen=True)
class OwnStarts(ClosedLoop):
    """At time t, a run is where the closed loop is at t + its own start.

    It is for loops that change at no known instant, since all runs would have to share it.
    """

    starts: Array = field(default_factory=lambda: np.zeros(1))

    @property
    def holds(self) -> bool:
        """Nothing: each run is at a time of its own."""
        return False

    def tracking(self, t: Any, state: Array) -> Tracking:
        """What a law may read of each run, at its own time."""
        return super().tracking(t + self.starts[..., 0], state)
