"""Measures how much of an error is left at the end of the horizon."""

from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.evidence.approach import STALLED
from eqt_cli.core.arrays import Array

FIFTHS = 5
"""Number of parts of the horizon, of which the first, the middle and the last are compared."""


@dataclass(frozen=True)
class Fifths:
    """Root mean squares of a signal over three fifths of the horizon, ``(runs,)`` each.

    Attributes
    ----------
    first, middle, last
        Values over the first, the middle and the last fifth.
    """

    first: Array
    middle: Array
    last: Array

    @classmethod
    def of(cls, times: Array, values: Array) -> "Fifths | None":
        """Compute them from a signal ``(runs, samples)``; None if a fifth has no sample."""
        part = (times - times[0]) / (times[-1] - times[0]) * FIFTHS
        inside = [
            (part >= k - _SLACK) & (part <= k + 1 + _SLACK) for k in (0, FIFTHS // 2, FIFTHS - 1)
        ]
        if not all(here.any() for here in inside):
            return None
        return cls(*(np.sqrt((values[:, here] ** 2).mean(axis=1)) for here in inside))

    @property
    def left(self) -> float:
        """Median over runs of the ratio of the last to the first."""
        return _median_ratio(self.last, self.first)

    def still_falls(self) -> bool:
        """Whether the last is less than the middle, in the median over runs."""
        return _median_ratio(self.last, self.middle) < STALLED


_SLACK = 1e-9
"""Tolerance for samples at the ends of a fifth, as a share of a fifth."""


def _median_ratio(one: Array, other: Array) -> float:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(one == 0, 0.0, one / other)
    return float(np.median(ratio))
