"""The input of a law at an instant: the interface between a law and the vehicle that it flies.

Besides it, a law needs only its own numbers and its memory, in a simulation as in firmware.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import InertiaLaw
from eqt_cli.mechanics.tracking import Gains, Tracking


class LawInput(NamedTuple):
    """The input of a law, body frame.

    Attributes
    ----------
    t
        Time, s.
    pose, desired_pose : (..., d, d)
        Measured Q, and Q_d.
    velocity, desired_velocity, desired_acceleration : (..., m)
        Measured V, and V_d and V̇_d.
    """

    t: Any
    pose: Array
    velocity: Array
    desired_pose: Array
    desired_velocity: Array
    desired_acceleration: Array

    @classmethod
    def of(cls, s: Tracking) -> LawInput:
        """Return the input of a law at a tracking state."""
        return cls(s.t, s.Q, s.V, s.Qd, s.Vd, s.Vd_dot)

    def tracking(
        self, G: MatrixLieGroup, inertia: InertiaLaw, gains: Gains, memory: Mapping[str, Array]
    ) -> Tracking:
        """Return the tracking state that the law reads, with momenta by its own inertia."""
        now = inertia.at(self.t)
        P = now.momentum(self.velocity)
        told = Tracking(
            G=G,
            inertia=now,
            gains=gains,
            t=self.t,
            Q=self.pose,
            P=P,
            Qd=self.desired_pose,
            Pd=P,  # until `following` gives it, and τ_d
            tau_d=P,
            memory=memory,
        )
        vars(told).update(V=self.velocity)
        return told.following(self.desired_velocity, self.desired_acceleration)
