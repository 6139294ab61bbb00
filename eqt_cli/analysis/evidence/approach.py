"""Whether errors of runs tend to 0, as far as the samples of a finite horizon tell."""

from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.evidence.runs import STATES_PER_RTOL
from eqt_cli.core.arrays import Array

# Chosen on 2120 errors of 10 shipped experiments, of 20 runs a law, that were integrated for four
# times their horizon; "The bounds of convergence" in the documentation says what others would do.

LEFT = 0.05
"""Of the largest error of a run, what may be left at its end: as a settling time to 5 % has it."""

DECAYING = 0.9
"""An error has arrived only if its mean over a quarter of the horizon is at most so much of that
over the quarter before: it halves within 1.6 horizons, or an offset is left."""

STALLED = 0.98
"""An error of which so much is left does not decay: to halve would take more than 8 horizons. Nor
does L, which is quadratic in it, if the square of it is left. Any value from 0.9 to 0.999 gives the
same verdicts."""

STEADY = 0.2
"""Of its mean, how much an error that stays may vary over the last half of the horizon; slow
oscillations, whose means do not fall for a while, vary more. Up to 0.4 no error that is said to
stay was one that decays later; at 0.1 and below no real offset is found."""

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
        It is above the solver's own error, steady, and neither it nor L decays: an offset.
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


def approach(
    times: Array, errors: Array, rtol: float, size: float, lyapunov: Array | None = None
) -> Approach:
    """The ends of errors ``(runs, samples)`` of a motion of this size, such as the largest ‖V_d‖.

    The solver's own error is relative to that size, or to the largest error of the run. While L, of
    the same runs, still falls, nothing stays: an error may pause for as long as another decays.
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
    """The mean over the later samples, as a part of that over the earlier ones."""
    earlier = np.maximum(values[:, before].mean(axis=1), np.finfo(float).tiny)
    rest: Array = values[:, late].mean(axis=1) / earlier
    return rest
