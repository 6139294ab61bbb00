"""The reference by itself: the differential equation of X_d, without a law or a plant.

Any engine integrates it like a closed loop; the desired motion that is stored is its solution.
"""

import dataclasses
from functools import cached_property
from typing import Any, Self

from eqt_cli.closed_loop.layout import StateLayout
from eqt_cli.closed_loop.system import DESIRED, ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.over_time import GivenOverTime
from eqt_cli.mechanics.tracking import Tracking
from eqt_cli.vehicle import Vehicle


class ReferenceSystem(ClosedLoop):
    """The Lie-Poisson system of X_d = (Q_d, P_d) under τ_d.

    A flat state holds the integrated parts of X_d, and nothing else.
    """

    @classmethod
    def of(cls, loop: ClosedLoop) -> Self:
        """Return the reference system of a closed loop."""
        return super().of(dataclasses.replace(loop, vehicle=Vehicle()))

    @property
    def given_over_time(self) -> dict[str, GivenOverTime]:
        """The reference alone: no law acts."""
        return {"held_reference": self.reference}

    @cached_property
    def layout(self) -> StateLayout:
        """The layout of Q_d and P_d in a flat state."""
        lengths = super().layout.lengths
        return StateLayout({name: lengths[name] for name in DESIRED if name in lengths})

    def tracking(self, t: Any, state: Array) -> Tracking:
        """Return the tracking state with the true state equal to the desired one."""
        desired, inertia = self._desired(t, state)
        Q, P, tau = desired.Q, desired.P, desired.tau
        return Tracking(self.group, inertia, self.gains, t, Q, P, Q, P, tau)

    def vector_field(self, t: Any, state: Array) -> Array:
        """Return the rates Q̇_d = Q_d V_d^, Ṗ_d = ad*_{V_d} P_d + τ_d."""
        return self.layout.join(self._desired_rates(self.tracking(t, state)), state)
