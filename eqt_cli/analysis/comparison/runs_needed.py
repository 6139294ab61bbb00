"""Computes how many runs would decide a question."""

import math

from eqt_cli.analysis.comparison.bootstrap import FEWEST

POWER = 0.8
"""Probability that so many runs decide, if the effect is as large as measured."""

MOST_RUNS = 1e9
"""Largest number of runs to report; an effect that needs more counts as none."""

SHARE = 0.95
"""Share of all initial states for which a claim about every run must hold."""


def runs_to_decide(effect: float, confidence: float) -> int | None:
    """Return the runs after which the interval of a mean excludes 0 with probability `POWER`.

    Parameters
    ----------
    effect
        Measured mean of the paired differences divided by their standard deviation.
    confidence
        Confidence of the interval.

    Returns
    -------
    int or None
        ((z_{1−α/2} + z_power)/d)² + z²_{1−α/2}/2, the normal approximation with the usual
        correction for an estimated spread (Guenther 1981); None if it exceeds `MOST_RUNS`.
    """
    from scipy.special import ndtri  # slow to import

    z = float(ndtri((1 + confidence) / 2))
    distance = z + float(ndtri(POWER))
    if not abs(effect) > distance / math.sqrt(MOST_RUNS):
        return None
    return max(FEWEST, math.ceil((distance / effect) ** 2 + z**2 / 2))


def runs_without_exception(confidence: float) -> int:
    """Return the runs without exception that show `SHARE` of all without one, with confidence."""
    return math.ceil(math.log(1 - confidence) / math.log(SHARE))
