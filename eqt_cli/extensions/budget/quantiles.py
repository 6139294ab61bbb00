"""Quantiles of an error over runs and time, with intervals of 95 %.

ECSS-E-ST-60-10C asks for the interpretation of a quantile, since three differ:

ensemble
    Of so many runs in a hundred, the error stays below it all the time (or at one instant): a
    quantile over runs of one number a run.
temporal
    In one run, the error is below it for such a share of the time: a quantile over the time of each
    run, told of the median run and of the worst one.
mixed
    The error is below it at an instant and in a run chosen at random: a quantile of all samples.
"""

from typing import NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array

LEVEL = 0.95
"""Confidence of the intervals."""

LEAST_BEYOND = 5
"""Runs expected beyond a mixed quantile if each run were constant; the interval then covers in 93
to 96 of 100 experiments (with 4, in 91)."""


class Interval(NamedTuple):
    """A number with its interval.

    Attributes
    ----------
    value
        The estimate.
    low, high
        Ends of the interval; infinite where the runs do not show one.
    needed
        Runs that would show the interval; 0 where it is shown.
    """

    value: float
    low: float
    high: float
    needed: int = 0


def of_runs(values: Array, share: float) -> Interval:
    """Return the quantile of one number a run, ``(runs,)``, by order statistics.

    The number of runs below the quantile is binomial, so that it lies between two order statistics
    in at least 95 % of all experiments, whatever the distribution (Conover, Practical Nonparametric
    Statistics, 3.2).
    """
    from scipy.special import bdtr  # scipy.stats takes three times as long to import

    ordered, n, tail = np.sort(values), len(values), (1 - LEVEL) / 2
    up_to = bdtr(np.arange(n + 1.0), n, share)  # probabilities of so many runs or fewer
    low, high = int(np.searchsorted(up_to, tail)), int(np.searchsorted(up_to, 1 - tail)) + 1
    needed = 0
    if low < 1 or high > n:
        needed = int(np.ceil(np.log(tail) / np.log(max(share, 1 - share))))
    return Interval(
        float(np.quantile(values, share)),
        float(ordered[low - 1]) if low >= 1 else -np.inf,
        float(ordered[high - 1]) if high <= n else np.inf,
        needed,
    )


def mixed(errors: Array, share: float) -> Interval:
    """Return the quantile of all samples of all runs, ``(runs, times)``.

    Samples of a run depend on each other, runs do not. The variance over runs of the share of time
    beyond the quantile gives the number of independent samples that tell as much; a binomial
    interval of so many (Korn and Graubard 1998), read back at the quantiles of the samples
    (Woodruff 1952), is the interval.
    """
    from scipy.special import betaincinv, stdtrit

    n, value, tail = len(errors), float(np.quantile(errors, share)), (1 - LEVEL) / 2
    needed = int(np.ceil(LEAST_BEYOND / min(share, 1 - share)))
    if n < needed:
        return Interval(value, -np.inf, np.inf, needed)
    beyond = (errors > value).mean(axis=1)
    p, variance = beyond.mean(), beyond.var(ddof=1) / n
    if p == 0:  # all samples are equal, or but a few
        return Interval(value, value, float(errors.max()))
    size = min(p * (1 - p) / variance, errors.size) if variance else errors.size
    size *= (stdtrit(errors.size - 1, tail) / stdtrit(n - 1, tail)) ** 2
    least = betaincinv(p * size, (1 - p) * size + 1, tail)
    most = betaincinv(p * size + 1, (1 - p) * size, 1 - tail)
    return Interval(
        value, float(np.quantile(errors, 1 - most)), float(np.quantile(errors, 1 - least))
    )
