"""The closed loop as a vector field on flat states, and the signals that follow from a state.

It joins the laws and owns no formula of its own. The same code runs on floats with leading batch
axes and on object arrays of symbols; it knows no engine.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from eqt_cli.closed_loop.layout import StateLayout
from eqt_cli.controllers import Controller
from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import InertiaLaw
from eqt_cli.mechanics.lie_poisson import lie_poisson
from eqt_cli.mechanics.tracking import Gains, Tracking
from eqt_cli.references import Reference

MEMORY = "controller."
"""What the stretches of a law's memory are called, before the names that the law gives them."""


@dataclass(frozen=True)
class ClosedLoop:
    """A mechanical system on G, the reference it tracks and the law that makes it do so.

    A flat state is (Q, P, Q_d, P_d, W, …): the free entries of both poses, both momenta, the
    work W = ∫dissipation dt that the damping has taken out, and the memory of the law. The
    reference is part of every state, so that the errors between the two are consistent.
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

    # What certificates, metrics and figures ask for. A stage between law and plant changes these.

    def command(self, s: Tracking) -> Array:
        """The torque that the law asks for, body frame, ``(..., m)``."""
        return self.controller.torque(s)

    def torque(self, s: Tracking) -> Array:
        """τ, the torque that acts on the system, body frame, ``(..., m)``."""
        return self.command(s)

    def dissipation(self, s: Tracking) -> Array | None:
        """The power −dL/dt that is taken out of L, ``(...)``; None where it is not known."""
        return self.controller.dissipation(s)

    @property
    def claims_decrease(self) -> bool | None:
        """Whether L is claimed to fall along every trajectory; None where nothing is said."""
        return self.controller.claims(self.group, self.gains)

    def lyapunov(self, s: Tracking) -> Array:
        """L, the Lyapunov function of the law, ``(...)``; laws may have different ones."""
        return self.controller.lyapunov(s)

    def work(self, state: Array) -> Array:
        """W, the work that the damping has taken out up to a flat state."""
        work: Array = state[..., self.layout.slices["work"].start]
        return work

    # Flat states.

    @cached_property
    def layout(self) -> StateLayout:
        """The stretches of a flat state."""
        q, m = self.group.pose_length, self.group.dimension
        memory = self.controller.memory(self.group)
        return StateLayout(
            {
                "pose": q,
                "momentum": m,
                "desired_pose": q,
                "desired_momentum": m,
                "work": 1,
                **{MEMORY + name: length for name, length in memory.items()},
            }
        )

    @property
    def state_length(self) -> int:
        """The number of entries of a flat state."""
        return self.layout.length

    @property
    def length_without_memory(self) -> int:
        """The number of entries before the memory of the law, the same for every law."""
        return int(self.layout.slices["work"].stop)

    def initial_state(self, Q: Array, V: Array, Qd: Array, Vd: Array, t: float = 0.0) -> Array:
        """The flat state at time t; poses ``(..., d, d)``, velocities ``(..., m)``, W = 0."""
        inertia = self.inertia.at(t)
        batch = np.broadcast_shapes(Q.shape[:-2], V.shape[:-1], Qd.shape[:-2], Vd.shape[:-1])
        stretches = dict.fromkeys(self.layout.lengths, 0.0) | {
            "pose": self.group.pack(Q),
            "momentum": inertia.momentum(V),
            "desired_pose": self.group.pack(Qd),
            "desired_momentum": inertia.momentum(Vd),
        }
        state = self.layout.join(stretches, np.empty((*batch, self.state_length)))
        if self.controller.memory(self.group):
            memory = self.controller.initial_memory(self.tracking(t, state))
            state = self.layout.join(stretches | _named(memory), state)
        return state

    def tracking(self, t: Any, state: Array) -> Tracking:
        """Everything a law may read, at time t and a flat state ``(..., state_length)``."""
        found = self.layout.split(state)
        Pd = found["desired_momentum"]
        inertia = self.inertia.at(t)
        return Tracking(
            G=self.group,
            inertia=inertia,
            gains=self.gains,
            t=t,
            Q=self.group.unpack(found["pose"]),
            P=found["momentum"],
            Qd=self.group.unpack(found["desired_pose"]),
            Pd=Pd,
            tau_d=self.reference.driving_torque(self.group, inertia, t, Pd),
            memory={
                name.removeprefix(MEMORY): values
                for name, values in found.items()
                if name.startswith(MEMORY)
            },
        )

    # The differential equation.

    def vector_field(self, t: Any, state: Array) -> Array:
        """The time derivative of a flat state, ``(..., state_length)``."""
        s = self.tracking(t, state)
        Q_dot, P_dot = lie_poisson(self.group, s.Q, s.P, s.V, self.torque(s))
        dissipation = self.dissipation(s)
        work_rate = 0.0 if dissipation is None else np.asarray(dissipation)[..., None]
        return self._derivative(s, Q_dot, P_dot, work_rate, state)

    def _derivative(
        self, s: Tracking, Q_dot: Array, P_dot: Array, work_rate: Array | float, state: Array
    ) -> Array:
        """The derivative of a flat state from that of its system, with all that moves beside it."""
        Qd_dot, Pd_dot = lie_poisson(self.group, s.Qd, s.Pd, s.Vd, s.tau_d)
        rates = {
            "pose": self.group.pack(Q_dot),
            "momentum": P_dot,
            "desired_pose": self.group.pack(Qd_dot),
            "desired_momentum": Pd_dot,
            "work": work_rate,
            **_named(self.controller.memory_rate(s)),
        }
        return self.layout.join(rates, state)


def _named(memory: Mapping[str, Any]) -> dict[str, Any]:
    """The memory of the law by the names of its stretches."""
    return {MEMORY + name: values for name, values in memory.items()}


def _replaced(controller: Controller, values: dict[str, Array], prefix: str) -> Controller:
    # Not dataclasses.replace: the fields of a named member are fixed and not for its initialiser.
    copy = object.__new__(type(controller))
    for name, value in controller.attributes.items():
        object.__setattr__(copy, name, values.get(prefix + name, value))
    return copy
