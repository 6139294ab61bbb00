"""Judges from samples on a finite horizon whether the errors of runs tend to 0."""

from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.evidence.runs import STATES_PER_RTOL
from eqt_cli.core.arrays import Array

# These values were chosen on 2120 errors of 10 shipped experiments, with 20 runs per law, that were
# integrated over four times their horizon. "The bounds of convergence" in the documentation
# describes the effect of other values.

LEFT = 0.05
"""Largest final error of a settled run as a share of its largest error: 5 %, as for settling."""

DECAYING = 0.9
"""An error has settled only if the ratio of its means over the last two quarters of the horizon is
at most this. It then halves within 1.6 horizons, or approaches an offset."""

STALLED = 0.98
"""Ratio of the same means at or above which an error does not decay: halving would take more than 8
horizons. For L, which is quadratic in the error, the square of this ratio counts. Any value from
0.9 to 0.999 gives the same verdicts."""

STEADY = 0.2
"""Largest variation of a steady error over the last half of the horizon, relative to its mean. Slow
oscillations, whose means can stall for a while, vary more. Up to 0.4, no error that was judged
steady decayed later; at 0.1 and below, no real offset was found."""

SMALLEST_SCALE = 1e-6
"""Least scale of the motion; without any motion, errors are rounding."""


@dataclass(frozen=True)
class Approach:
    """The final behaviour of the error of every run.

    Attributes
    ----------
    left : (runs,)
        Final error as a share of the largest error of the run.
    level : (runs,)
        Mean error over the last quarter of the horizon.
    arrived : (runs,)
        Whether the error is within the solver's error, or at most `LEFT` remains and it still
        decays.
    stays : (runs,)
        Whether the error is an offset: above the solver's error and steady, while neither it nor L
        decays.
    """

    left: Array
    level: Array
    arrived: Array
    stays: Array

    @property
    def offsets(self) -> str:
        """Description of the offsets; empty if there are none."""
        if not self.stays.any():
            return ""
        typical = np.median(self.level[self.stays])
        return f"an error of {typical:.2g} stays in {self.stays.sum()} of {len(self.stays)} runs"


def approach(
    times: Array, errors: Array, rtol: float, size: float, lyapunov: Array | None = None
) -> Approach:
    """Judge the errors ``(runs, samples)`` of a motion with a given size, such as max ‖V_d‖.

    The solver's error is relative to the larger of that size and the largest error of the run.
    While L of a run still falls, its error is no offset: one error can stall while another decays.
    """
    duration = times[-1] - times[0]
    late = times >= times[-1] - duration / 4
    before = ~late & (times >= times[-1] - duration / 2)
    if not before.any():
        before = ~late
    level, largest = errors[:, late].mean(axis=1), errors.max(axis=1)
    solved = level <= STATES_PER_RTOL * rtol * np.maximum(largest, max(size, SMALLEST_SCALE))
    rest = _rest(errors, before, late)
    left = errors[:, -1] / np.where(largest > 0, largest, 1.0)
    arrived = solved | ((rest <= DECAYING) & (left <= LEFT))
    steady = np.ptp(errors[:, late | before], axis=1) <= STEADY * level
    stays = ~solved & (rest >= STALLED) & steady
    if lyapunov is not None:
        stays &= ~(_rest(lyapunov, before, late) < STALLED**2)
    return Approach(left, level, arrived, stays)


def _rest(values: Array, before: Array, late: Array) -> Array:
    """Return the ratio of the mean over the later samples to that over the earlier ones."""
    earlier = np.maximum(values[:, before].mean(axis=1), np.finfo(float).tiny)
    rest: Array = values[:, late].mean(axis=1) / earlier
    return rest
