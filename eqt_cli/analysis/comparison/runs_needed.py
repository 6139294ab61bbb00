"""How many runs would decide a question; it knows no controller and no claim."""

import math

from eqt_cli.analysis.comparison.bootstrap import FEWEST

POWER = 0.8
"""The probability with which that many runs decide, if the effect is as large as measured."""

MOST = 1e9
"""Runs that nobody will do: an effect that takes more is as good as none."""

SHARE = 0.95
"""What a statement on every run is about: at least this share of all initial states."""


def runs_to_decide(effect: float, confidence: float) -> int | None:
    """Runs after which the interval of a mean difference leaves out 0, with probability `POWER`.

    Parameters
    ----------
    effect
        Mean over standard deviation of the paired differences, as measured.
    confidence
        Of the interval.

    Returns
    -------
    int or None
        ((z_{1−α/2} + z_power)/d)² + z²_{1−α/2}/2, the normal approximation with the usual
        correction for an estimated spread (Guenther 1981); None where that is beyond `MOST`.
    """
    from scipy.special import ndtri  # slow to import

    z = float(ndtri((1 + confidence) / 2))
    distance = z + float(ndtri(POWER))
    if not abs(effect) > distance / math.sqrt(MOST):
        return None
    return max(FEWEST, math.ceil((distance / effect) ** 2 + z**2 / 2))


def runs_without_exception(confidence: float) -> int:
    """Runs without exception that show, with this confidence, that `SHARE` of all have none."""
    return math.ceil(math.log(1 - confidence) / math.log(SHARE))
