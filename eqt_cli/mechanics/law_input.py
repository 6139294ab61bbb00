"""The input of a law at an instant: the interface between a law and the vehicle that it flies.

Besides it, a law needs only its own numbers and its memory, in a simulation as in firmware.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.flatness import FlatOutput
from eqt_cli.mechanics.inertia import InertiaLaw
from eqt_cli.mechanics.tracking import Gains, Tracking

AXES = {"t": 0, "pose": 2, "desired_pose": 2, "position": 2}
"""The number of axes of each part of an input that is not a vector."""


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
    position : (..., 5, n)
        p_d and its derivatives to the fourth; only for laws that read the flat output.
    heading : (..., 3)
        ψ and its derivatives to the second; None also where the heading is free.
    """

    t: Any
    pose: Array
    velocity: Array
    desired_pose: Array
    desired_velocity: Array
    desired_acceleration: Array
    position: Any = None  # Array | None, as the next
    heading: Any = None

    @classmethod
    def of(cls, s: Tracking) -> LawInput:
        """Return the input of a law at a tracking state."""
        return cls(s.t, s.Q, s.V, s.Qd, s.Vd, s.Vd_dot, *(s.flat or ()))

    def each(self, function: Callable[[Any], Any]) -> LawInput:
        """Return the input with a function applied to every part that there is."""
        return LawInput._make(None if part is None else function(part) for part in self)

    def zeroed(self, *names: str) -> LawInput:
        """Return the input with some of its parts set to 0."""
        return self._replace(**{name: 0 * getattr(self, name) for name in names})

    def rows(self, names: Iterable[str]) -> Array:
        """Return some parts side by side, ``(states, …)``; matrices are row by row."""
        batch, columns = self.velocity.shape[:-1], []
        for name in names:
            part = np.asarray(getattr(self, name))
            own = part.shape[part.ndim - AXES.get(name, 1) :]
            columns.append(np.broadcast_to(part, (*batch, *own)).reshape(math.prod(batch), -1))
        return np.concatenate(columns, axis=-1)

    def tracking(
        self, G: MatrixLieGroup, inertia: InertiaLaw, gains: Gains, memory: Mapping[str, Array]
    ) -> Tracking:
        """Return the tracking state that the law reads, with momenta by its own inertia."""
        now, Q, Qd = inertia.at(self.t), self.pose, self.desired_pose
        P = now.momentum(self.velocity)
        flat = None if self.position is None else FlatOutput(self.position, self.heading)
        # In place of P_d and τ_d, until `following` gives them, is P.
        tracking = Tracking(G, now, gains, self.t, Q, P, Qd, P, P, memory, flat=flat)
        vars(tracking).update(V=self.velocity)
        return tracking.following(self.desired_velocity, self.desired_acceleration)
