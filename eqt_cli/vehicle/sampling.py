"""The clock of a controller: when the law is evaluated, and when its command arrives."""

import math
from dataclasses import dataclass

EXACT = 1e9
"""Periods; of more, no rounding tells whether they are whole."""

ROUNDING = 1e-9
"""Relative: what decimals of a time and of a period leave."""


def periods_in(time: float, period: float) -> int:
    """How many whole periods a delay is; raises a `ValueError` that names the nearest.

    Parameters
    ----------
    time, period
        s.
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
        s.
    delay
        After how many periods a command arrives; until the first one does, 0 is held.
    """

    period: float
    delay: int = 0

    departs = "sampled control"
    varies = False

    @property
    def structure(self) -> tuple[float, int]:
        """All of it: when the law is evaluated is the same in all runs of one problem."""
        return self.period, self.delay
