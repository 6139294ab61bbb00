"""EqT with a smooth bound on its feedback."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, EqT, Positive, Tracking, tanh


@dataclass(frozen=True)
class BoundedFeedback(EqT):
    """EqT whose feedback stays within ±limit about each axis; its feedforward is not bounded."""

    name: ClassVar[str] = "bounded_feedback"
    title: ClassVar[str] = "bounded"

    limit: Positive = 1.0

    def feedforward_torque(self, s: Tracking) -> Array:
        """τ_ff, that of EqT; a class with a torque of its own says what else it keeps."""
        return EqT.feedforward_torque(self, s)

    def torque(self, s: Tracking) -> Array:
        """τ_ff + limit · tanh((τ − τ_ff) / limit), where τ is the torque of EqT."""
        feedforward = self.feedforward_torque(s)
        return feedforward + self.limit * tanh((super().torque(s) - feedforward) / self.limit)
