"""The closed loop as a vector field on flat states, and the signals that follow from a state.

It joins the laws and owns no formula of its own. The same code runs on floats with leading batch
axes and on object arrays of symbols; it knows no engine.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from eqt_cli.controllers import Controller
from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import InertiaLaw
from eqt_cli.mechanics.lie_poisson import lie_poisson
from eqt_cli.mechanics.tracking import Gains, Tracking
from eqt_cli.references import Reference


@dataclass(frozen=True)
class ClosedLoop:
    """A mechanical system on G, the reference it tracks and the law that makes it do so.

    A flat state is (Q, P, Q_d, P_d, W): the free entries of both poses, both momenta, and the
    work W = ∫dissipation dt that the damping has taken out. The reference is part of every state,
    so that the errors between the two are consistent.
    """

    group: MatrixLieGroup
    inertia: InertiaLaw
    gains: Gains
    reference: Reference
    controller: Controller

    # Numbers that may change from run to run without changing the structure.

    @property
    def parameters(self) -> dict[str, Array]:
        """Every runtime parameter, by name; scalars as arrays of shape (1,)."""
        gains = {"kp": self.gains.K, "kd": self.gains.K_d}
        options = {
            f"controller.{name}": value for name, value in self.controller.parameters.items()
        }
        return self.inertia.parameters | gains | options

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """The same structure with other parameters, which may be batched or symbols."""
        controller = _replaced(self.controller, values, "controller.")
        return dataclasses.replace(
            self,
            inertia=self.inertia.with_parameters(values),
            gains=Gains(values["kp"], values["kd"]),
            controller=controller,
        )

    # The layout of a flat state.

    @cached_property
    def _layout(self) -> tuple[slice, slice, slice, slice, int]:
        q, m = self.group.pose_length, self.group.dimension
        ends = np.cumsum([q, m, q, m])
        starts = ends - [q, m, q, m]
        pose, momentum, desired_pose, desired_momentum = map(slice, starts, ends)
        return pose, momentum, desired_pose, desired_momentum, int(ends[-1])

    @property
    def state_length(self) -> int:
        """The number of entries of a flat state."""
        return self._layout[-1] + 1

    def initial_state(self, Q: Array, V: Array, Qd: Array, Vd: Array, t: float = 0.0) -> Array:
        """The flat state at time t; poses ``(..., d, d)``, velocities ``(..., m)``, W = 0."""
        inertia = self.inertia.at(t)
        batch = np.broadcast_shapes(Q.shape[:-2], V.shape[:-1], Qd.shape[:-2], Vd.shape[:-1])
        state = np.zeros((*batch, self.state_length))
        pose, momentum, desired_pose, desired_momentum, _ = self._layout
        state[..., pose] = self.group.pack(Q)
        state[..., momentum] = inertia.momentum(V)
        state[..., desired_pose] = self.group.pack(Qd)
        state[..., desired_momentum] = inertia.momentum(Vd)
        return state

    def tracking(self, t: Any, state: Array) -> Tracking:
        """Everything a law may read, at time t and a flat state ``(..., state_length)``."""
        pose, momentum, desired_pose, desired_momentum, _ = self._layout
        Pd = state[..., desired_momentum]
        inertia = self.inertia.at(t)
        return Tracking(
            G=self.group,
            inertia=inertia,
            gains=self.gains,
            t=t,
            Q=self.group.unpack(state[..., pose]),
            P=state[..., momentum],
            Qd=self.group.unpack(state[..., desired_pose]),
            Pd=Pd,
            tau_d=self.reference.driving_torque(self.group, inertia, t, Pd),
        )

    def work(self, state: Array) -> Array:
        """W, the last entry of a flat state."""
        return state[..., -1]

    # The differential equation.

    def vector_field(self, t: Any, state: Array) -> Array:
        """The time derivative of a flat state, ``(..., state_length)``."""
        s = self.tracking(t, state)
        tau = self.controller.torque(s)
        Q_dot, P_dot = lie_poisson(self.group, s.Q, s.P, s.V, tau)
        Qd_dot, Pd_dot = lie_poisson(self.group, s.Qd, s.Pd, s.Vd, s.tau_d)
        dissipation = self.controller.dissipation(s)
        derivative = np.empty(state.shape, dtype=state.dtype)
        pose, momentum, desired_pose, desired_momentum, work = self._layout
        derivative[..., pose] = self.group.pack(Q_dot)
        derivative[..., momentum] = P_dot
        derivative[..., desired_pose] = self.group.pack(Qd_dot)
        derivative[..., desired_momentum] = Pd_dot
        derivative[..., work] = 0.0 if dissipation is None else dissipation
        return derivative


def _replaced(controller: Controller, values: dict[str, Array], prefix: str) -> Controller:
    # Not dataclasses.replace: the fields of a named member are fixed and not for its initialiser.
    copy = object.__new__(type(controller))
    for name, value in controller.attributes.items():
        object.__setattr__(copy, name, values.get(prefix + name, value))
    return copy
