"""The complementary filter, with constant gains."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import Scale
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics import navigation
from eqt_cli.notation.poses import vector
from eqt_cli.vehicle.component import Numbers, drawn
from eqt_cli.vehicle.estimators.base import Deviations, Estimate, Estimator, Fix
from eqt_cli.vehicle.estimators.schedule import Schedule


@dataclass(frozen=True)
class Complementary(Estimator):
    """Complementary filter: Q̂̇ = Q̂ (V̂ + k_P σ)^, b̂̇ = −k_I σ, in its gradient form on every group.

    σ is the gradient of ½‖Q̂⁻¹Q_m − I‖²_F, each coordinate over the ‖E_i‖²_F of its generator. On
    SO(3) that is half of the antisymmetric part of Q̂⁻¹Q_m, and the filter is the passive one of
    Mahony, Hamel and Pflimlin, IEEE Trans. Autom. Control 53 (2008) 1203. A fix acts once for the
    time since the one before: Q̂ ← Q̂ exp(T k_P σ), b̂ ← b̂ − T k_I σ.

    Attributes
    ----------
    kp
        k_P, 1/s; one number, or one for each coordinate.
    ki
        k_I, 1/s²; likewise.
    """

    name: ClassVar[str] = "complementary"
    vectors: ClassVar[tuple[str, ...]] = ("kp", "ki", "initial_error")

    kp: Annotated[Numbers, Scale("filter gain k_P", "1/s")] = 1.0
    ki: Annotated[Numbers, Scale("filter gain k_I", "1/s²")] = 0.3

    def check_sensors(self, schedule: Schedule, known: Deviations, problems: Problems) -> None:
        """Note gains with which the estimate cannot settle, for the time between two fixes."""
        G = schedule.G
        kp, ki = (vector(drawn(value, None), G.dimension, G) for value in (self.kp, self.ki))
        for channel in schedule.fixes:
            T = channel.every * schedule.period
            for axis in schedule.axes_of(channel):
                a, b = T * kp[axis], T * T * ki[axis]
                # (ε, Tb̃) from fix to fix: the prediction ε − Tb̃ is corrected by the gains a and b.
                step = np.array([[1 - a, a - 1], [b, 1 - b]])
                largest = float(np.abs(np.linalg.eigvals(step)).max())
                if largest > 1:
                    problems.add(
                        f"the estimate of the {channel.part.name} does not settle with fixes "
                        f"every {T:g} s: an error grows by {largest:.3g} from one to the next; "
                        f"choose kp between 0 and {2 / T:g} and a smaller ki"
                    )
                    break

    def predicted(
        self, schedule: Schedule, now: Estimate, velocity: Array, duration: Array
    ) -> Estimate:
        """Return the estimate with Q̂ exp(hV̂)."""
        step = schedule.G.exp(duration * (velocity - now.bias))
        return now._replace(pose=now.pose @ step)

    def corrected(self, schedule: Schedule, now: Estimate, fix: Fix) -> tuple[Estimate, None]:
        """Return the estimate corrected by σ in the measured coordinates."""
        G: MatrixLieGroup = schedule.G
        own: Any = self  # in a run, options are arrays
        sigma = schedule.intervals * fix.arrived * innovation(G, G.inverse(now.pose) @ fix.pose)
        pose, bias = now.pose @ G.exp(own.kp * sigma), now.bias - own.ki * sigma
        return now._replace(pose=pose, bias=bias), None


def innovation(G: MatrixLieGroup, error: Array) -> Array:
    """Return σ of Q̂⁻¹Q_m, ``(..., m)``; log(Q̂⁻¹Q_m) to first order."""
    squares = (G.basis * G.basis).sum(axis=(-2, -1))
    return navigation.gradient(G, G.identity, error) / squares
