"""A closed loop whose runs start at different times, so that they can be solved side by side."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eqt_cli.closed_loop.system import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.tracking import Tracking

STARTS = "starts"
"""Name of the leaf with the start time of each run, s."""


@dataclass(frozen=True)
class OwnStarts(ClosedLoop):
    """A closed loop in which a run at time t is at t + its own start.

    It is for loops without known instants, since all runs would have to share them.
    """

    starts: Array = field(default_factory=lambda: np.zeros(1))

    @property
    def holds(self) -> bool:
        """Whether numbers are held: never, since each run is at a time of its own."""
        return False

    def tracking(self, t: Any, state: Array) -> Tracking:
        """Return the quantities that a law may read, each run at its own time."""
        return super().tracking(t + self.starts[..., 0], state)
