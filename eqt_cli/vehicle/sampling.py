"""The clock of a controller: when the law is evaluated, and when its command arrives."""

import math
from dataclasses import dataclass

EXACT = 1e9
"""Largest number of periods for which rounding can tell whether it is whole."""

ROUNDING = 1e-9
"""Relative error that decimals of a time and of a period may leave."""


def periods_in(time: float, period: float) -> int:
    """Return how many whole periods a delay is.

    Parameters
    ----------
    time, period
        Delay and period, s.

    Raises
    ------
    ValueError
        If the delay is no whole number of periods; it names the nearest.
    """
    count = time / period
    if not 0 <= count < EXACT:
        raise ValueError(f"expected from 0 to {EXACT:g} periods of {period:g} s, got {time:g} s")
    if abs(count - round(count)) > ROUNDING * max(count, 1.0):
        near = [math.floor(count), math.ceil(count)]
        times = " or ".join(f"{1e3 * each * period:g} ms" for each in near)
        raise ValueError(
            f"expected a whole number of periods of {1e3 * period:g} ms, got {1e3 * time:g} ms; "
            f"write {times}"
        )
    return round(count)


@dataclass(frozen=True)
class Sampling:
    """Zero-order hold: the law is evaluated at t = k·period, and its command held for a period.

    Attributes
    ----------
    period
        Control period, s.
    delay
        Number of periods after which a command arrives; until the first one does, 0 is held.
    """

    period: float
    delay: int = 0

    departs = "sampled control"
