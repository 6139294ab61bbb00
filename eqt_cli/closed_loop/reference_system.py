"""The reference by itself: the differential equation of X_d, which no law and no plant acts on.

It is integrated by any engine like a closed loop; the desired motion that is stored is this one.
"""

import dataclasses
from functools import cached_property
from typing import Any, Self

from eqt_cli.closed_loop.layout import StateLayout
from eqt_cli.closed_loop.system import DESIRED, REFERENCE, ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.over_time import GivenOverTime
from eqt_cli.mechanics.tracking import Tracking
from eqt_cli.vehicle import Vehicle


class ReferenceSystem(ClosedLoop):
    """The Lie-Poisson system of X_d = (Q_d, P_d) under τ_d.

    A flat state holds what of X_d is integrated, and nothing else.
    """

    @classmethod
    def of(cls, loop: ClosedLoop) -> Self:
        """The reference of a closed loop."""
        return super().of(dataclasses.replace(loop, vehicle=Vehicle()))

    @property
    def given_over_time(self) -> dict[str, GivenOverTime]:
        """The reference alone: no law acts."""
        return {REFERENCE: self.reference}

    @cached_property
    def layout(self) -> StateLayout:
        """The stretches of Q_d and P_d."""
        lengths = super().layout.lengths
        return StateLayout({name: lengths[name] for name in DESIRED if name in lengths})

    def tracking(self, t: Any, state: Array) -> Tracking:
        """The desired state, in which the true one is."""
        desired, inertia = self._desired(t, state)
        return Tracking(
            G=self.group,
            inertia=inertia,
            gains=self.gains,
            t=t,
            Q=desired.Q,
            P=desired.P,
            Qd=desired.Q,
            Pd=desired.P,
            tau_d=desired.tau,
        )

    def vector_field(self, t: Any, state: Array) -> Array:
        """Q̇_d = Q_d V_d^, Ṗ_d = ad*_{V_d} P_d + τ_d."""
        return self.layout.join(self._desired_rates(self.tracking(t, state)), state)
