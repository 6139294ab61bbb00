"""Laws of all three sorts: from the base class, from a law of eqt, from the family."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from eqt_cli.components.laws import EqT
from eqt_cli.extend import (
    Array,
    Controller,
    Family,
    Positive,
    Real,
    Tracking,
    apply_matrix,
    clip,
    dot,
    tanh,
)


@dataclass(frozen=True)
class Damped(Controller):
    """Proportional and derivative action around the torque of the reference.

    Attributes
    ----------
    damping_ratio
        Factor on the damping K_d.
    """

    name: ClassVar[str] = "damped"
    title: ClassVar[str] = "PD"

    damping_ratio: float = 1.0

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        spring = s.G.Ad_star(s.Qd, s.gradient)
        return s.tau_d - self.damping_ratio * apply_matrix(s.gains.K_d, s.V_tilde) - spring

    def dissipation(self, s: Tracking) -> Array:
        """−dL/dt: the damping, and the power that a feedforward would supply."""
        damping = dot(self.damping_ratio * s.body_damping, s.V_tilde)
        return damping + dot(s.P_tilde, s.G.ad(s.V, s.Vd))


@dataclass(frozen=True)
class Limited(EqT):
    """EqT whose torque components stay within ±limit."""

    name: ClassVar[str] = "limited"
    title: ClassVar[str] = "limited"

    limit: Positive = 2.0
    smooth: bool = True

    @property
    def structure(self) -> Hashable:
        """Not the family's: the torque is another."""
        return type(self), self.smooth

    def torque(self, s: Tracking) -> Array:
        """limit · tanh(τ / limit), or τ cut off."""
        tau = super().torque(s)
        if self.smooth:
            return self.limit * tanh(tau / self.limit)
        return clip(tau, -self.limit, self.limit)

    def dissipation(self, s: Tracking) -> None:
        """Not known where the torque is limited."""
        return None


@dataclass(frozen=True)
class Halfway(Family):
    """The member (1, w, 1 − w) of the family.

    Attributes
    ----------
    weight
        w, between transport and connection.
    """

    name: ClassVar[str] = "halfway"
    title: ClassVar[str] = "halfway"

    weight: Real = 0.5
    gyroscopic: float = field(default=1.0, init=False)
    transport: float = field(default=0.0, init=False)
    connection: float = field(default=0.0, init=False)
    damping: Literal["spatial", "body"] = field(default="spatial", init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "transport", self.weight)
        object.__setattr__(self, "connection", 1.0 - self.weight)
        super().__post_init__()
