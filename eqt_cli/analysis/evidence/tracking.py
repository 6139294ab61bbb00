"""How much of an error is left at the end of the horizon, whatever the law claims."""

from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.evidence.approach import STALLED
from eqt_cli.core.arrays import Array

FIFTHS = 5
"""The horizon is looked at in so many parts: the first, the one in the middle and the last."""


@dataclass(frozen=True)
class Fifths:
    """The root of the mean square of a signal over three fifths of the horizon, ``(runs,)`` each.

    Attributes
    ----------
    first, middle, last
        Over the first fifth, the one in the middle and the last.
    """

    first: Array
    middle: Array
    last: Array

    @classmethod
    def of(cls, times: Array, values: Array) -> "Fifths | None":
        """Those of a signal ``(runs, samples)``; None where a fifth has no sample."""
        part = (times - times[0]) / (times[-1] - times[0]) * FIFTHS
        inside = [
            (part >= k - _SLACK) & (part <= k + 1 + _SLACK) for k in (0, FIFTHS // 2, FIFTHS - 1)
        ]
        if not all(here.any() for here in inside):
            return None
        return cls(*(np.sqrt((values[:, here] ** 2).mean(axis=1)) for here in inside))

    @property
    def left(self) -> float:
        """The median over runs of the last by the first."""
        return _median_ratio(self.last, self.first)

    def still_falls(self) -> bool:
        """Whether the last is less than the one in the middle, in the median over runs."""
        return _median_ratio(self.last, self.middle) < STALLED


_SLACK = 1e-9
"""Of a fifth: what a sample at its end may be off by rounding."""


def _median_ratio(one: Array, other: Array) -> float:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(one == 0, 0.0, one / other)
    return float(np.median(ratio))
