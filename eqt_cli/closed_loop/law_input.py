"""What a law is told at an instant: the interface between a law and the vehicle that it flies.

A law needs nothing else but numbers of its own and its memory, in a simulation as in firmware.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import InertiaLaw
from eqt_cli.mechanics.tracking import Gains, Tracking


class LawInput(NamedTuple):
    """What a law is told, body frame.

    Attributes
    ----------
    t
        Time, s.
    pose, desired_pose : (..., d, d)
        Q as it was measured, and Q_d.
    velocity, desired_velocity, desired_acceleration : (..., m)
        V as it was measured, V_d and V̇_d.
    """

    t: Any
    pose: Array
    velocity: Array
    desired_pose: Array
    desired_velocity: Array
    desired_acceleration: Array

    @classmethod
    def of(cls, s: Tracking) -> LawInput:
        """What of a motion a law is told."""
        return cls(s.t, s.Q, s.V, s.Qd, s.Vd, s.Vd_dot)

    def tracking(
        self, G: MatrixLieGroup, inertia: InertiaLaw, gains: Gains, memory: Mapping[str, Array]
    ) -> Tracking:
        """The motion as a law reads it, with the momenta that its own inertia gives."""
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
