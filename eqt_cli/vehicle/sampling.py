"""The clock of a controller: when the law is evaluated, and when its command arrives."""

from dataclasses import dataclass


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
