"""A controller of one's own: EqT with a smooth limit on every component of the torque."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, EqT, Positive, Tracking, tanh


@dataclass(frozen=True)
class Saturated(EqT):
    """EqT whose torque components stay within ±limit."""

    name: ClassVar[str] = "saturated"
    title: ClassVar[str] = "saturated"

    limit: Positive = 2.0

    def torque(self, s: Tracking) -> Array:
        """limit · tanh(τ / limit); with eqt's own functions, so that engine native compiles it."""
        return self.limit * tanh(super().torque(s) / self.limit)

    def dissipation(self, s: Tracking) -> None:
        """Not known where the torque is limited, so no energy balance is claimed."""
        return None
