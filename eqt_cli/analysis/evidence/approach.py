"""Whether errors of runs tend to 0, as far as the samples of a finite horizon tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.evidence.runs import STATES_PER_RTOL
from eqt_cli.core.arrays import Array

LEFT = 0.05
"""Of the largest error of a run, what may be left at its end."""

DECAYING = 0.9
"""An error has arrived only if its mean over a quarter of the horizon is at most so much of that
over the quarter before: an offset, which is left, would show."""

STALLED = 0.98
"""An error of which so much is left does not decay: to halve would take more than 8 horizons."""

STEADY = 0.2
"""Of its mean, how much an error that stays may vary over the last half of the horizon; slow
oscillations, whose means do not fall for a while, vary more."""

SMALLEST_SCALE = 1e-6
"""Of the size of the motion; where nothing moves at all, errors are rounding."""


@dataclass(frozen=True)
class Approach:
    """How the error of every run ends.

    Attributes
    ----------
    left : (runs,)
        The error at the horizon, as a part of the largest of the run.
    level : (runs,)
        The mean error over the last quarter of the horizon.
    arrived : (runs,)
        It is at the solver's own error, or at most `LEFT` is left and it still decays.
    stays : (runs,)
        It is above the solver's own error, steady, and does not decay: an offset.
    """

    left: Array
    level: Array
    arrived: Array
    stays: Array

    @property
    def offsets(self) -> str:
        """The errors that stay, in words; empty if there are none."""
        if not self.stays.any():
            return ""
        typical = np.median(self.level[self.stays])
        return f"an error of {typical:.2g} stays in {self.stays.sum()} of {len(self.stays)} runs"


def approach(times: Array, errors: Array, rtol: float, size: float) -> Approach:
    """The ends of errors ``(runs, samples)`` of a motion of this size, such as the largest ‖V_d‖.

    The solver's own error is relative to that size, or to the largest error of the run.
    """
    duration = times[-1] - times[0]
    late = times >= times[-1] - duration / 4
    before = ~late & (times >= times[-1] - duration / 2)
    if not before.any():
        before = ~late
    level, largest = errors[:, late].mean(axis=1), errors.max(axis=1)
    solved = level <= STATES_PER_RTOL * rtol * np.maximum(largest, max(size, SMALLEST_SCALE))
    rest = level / np.maximum(errors[:, before].mean(axis=1), np.finfo(float).tiny)
    left = errors[:, -1] / np.where(largest > 0, largest, 1.0)
    arrived = solved | ((rest <= DECAYING) & (left <= LEFT))
    steady = np.ptp(errors[:, late | before], axis=1) <= STEADY * level
    return Approach(left, level, arrived, ~solved & (rest >= STALLED) & steady)
