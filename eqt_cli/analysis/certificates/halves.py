"""What a finite horizon says about boundedness: a supremum, and whether it is still growing."""

from __future__ import annotations

from eqt_cli.analysis.certificates.base import Verdict
from eqt_cli.core.arrays import Array

GROWTH = 1e-3
"""Relative growth that counts; less is the grid's, whose samples miss the true maxima."""


def over_horizon(values: Array) -> tuple[float, Verdict]:
    """The supremum over samples, and `growing` where the second half exceeds the first."""
    middle = (len(values) + 1) // 2
    first, second = float(values[:middle].max()), float(values[middle:].max(initial=0.0))
    verdict = Verdict.GROWING if second > first * (1 + GROWTH) else Verdict.UNKNOWN
    return max(first, second), verdict
