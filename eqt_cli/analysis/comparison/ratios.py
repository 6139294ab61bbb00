"""Relative differences of means, with intervals for the ratio of two estimates."""

import math

import numpy as np

from eqt_cli.analysis.comparison.bootstrap import FEWEST
from eqt_cli.analysis.comparison.shares import Interval
from eqt_cli.core.arrays import Array


def relative_difference(differences: Array, second: Array, confidence: float) -> Interval:
    """Return the mean difference over the absolute mean of the second, with Fieller's interval.

    The interval contains the ratios θ for which Student's paired t-test does not reject that the
    differences have the mean θ |mean of the second| (Fieller 1954). It is unbounded if the mean of
    the second may be 0.

    Parameters
    ----------
    differences, second : (runs,)
        First minus second, and second, of the same runs; NaN where a run has no value.
    confidence
        Confidence of the interval.

    Returns
    -------
    Interval
        NaN for fewer than `FEWEST` runs; ends of ±∞ if unbounded.
    """
    known = np.isfinite(differences) & np.isfinite(second)
    d, y = differences[known], second[known] * np.sign(second[known].mean())
    n = len(d)
    if n < FEWEST or not y.any():
        return Interval(math.nan, math.nan, math.nan)
    from scipy.special import stdtrit  # slow to import

    t = stdtrit(n - 1, (1 + confidence) / 2)
    share = d.mean() / y.mean()
    # (d̄ − θ ȳ)² ≤ t² var(d − θ y)/n: a θ² − 2 b θ + c ≤ 0.
    covariance = t**2 / n * np.cov(d, y)
    a = y.mean() ** 2 - covariance[1, 1]
    b = d.mean() * y.mean() - covariance[0, 1]
    c = d.mean() ** 2 - covariance[0, 0]
    if a <= 0:
        return Interval(float(share), -math.inf, math.inf)
    half = math.sqrt(max(b**2 - a * c, 0.0))
    return Interval(float(share), float((b - half) / a), float((b + half) / a))
