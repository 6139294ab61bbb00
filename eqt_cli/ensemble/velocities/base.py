"""Base class of distributions of the initial velocity."""

from dataclasses import dataclass

from eqt_cli.ensemble.spread import Distribution


@dataclass(frozen=True)
class VelocityDistribution(Distribution):
    """A distribution on g: a frozen dataclass whose fields are its options.

    It draws the coordinates of an algebra element, ``(m,)``: run k starts at V(0) = V_d(0) + draw.
    """
