"""An estimator of a user's own: it believes every fix, and knows no bias."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, Estimate, Estimator, Fix, Real, Schedule


@dataclass(frozen=True)
class Trusting(Estimator):
    """Goes on by the velocity as it is measured, and moves towards every fix."""

    name: ClassVar[str] = "trusting"

    weight: Real = 0.5
    bias_weight: Real = 0.2

    def predicted(
        self, schedule: Schedule, now: Estimate, velocity: Array, duration: Array
    ) -> Estimate:
        return now._replace(pose=now.pose @ schedule.G.exp(duration * (velocity - now.bias)))

    def corrected(self, schedule: Schedule, now: Estimate, fix: Fix) -> tuple[Estimate, None]:
        G = schedule.G
        off = G.log(G.inverse(now.pose) @ fix.pose) * fix.arrived
        bias = now.bias - self.bias_weight * off
        return now._replace(pose=now.pose @ G.exp(self.weight * off), bias=bias), None
