"""What hypotheses are about: group, gains, inertia, reference and laws over the horizon."""

from __future__ import annotations

from dataclasses import dataclass

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array


@dataclass(frozen=True)
class Setting:
    """An experiment's assumptions.

    Attributes
    ----------
    loops
        The closed loops by label; all but the controller is common to them.
    times : (samples,)
        The horizon.
    desired_pose, desired_velocity : (samples, …)
        Q_d and V_d along it.
    """

    loops: dict[str, ClosedLoop]
    times: Array
    desired_pose: Array
    desired_velocity: Array

    @property
    def loop(self) -> ClosedLoop:
        """Any of the loops, for what they have in common."""
        return next(iter(self.loops.values()))
