"""Base class of laws that shape an energy of the body error and cancel all other forces."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.base import Controller
from eqt_cli.core.arrays import Array, dot
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class CancellingLaw(Controller):
    """τ = 𝕀ξ̇ + 𝕀̇ξ − ad*_V 𝕀V − K_d e − force, and + Ṡ*S⁻* 𝕀e where the inertia varies.

    Here ξ = Ad_{Q_L⁻¹}V_d, e = V − ξ and Q_L = Q_d⁻¹Q. It leaves d(𝕀e)/dt = −K_d e − force, and
    where the force is the gradient of an energy U, L = ½⟨𝕀e, e⟩ + U falls at the rate ⟨K_d e, e⟩.
    """

    matched: ClassVar[bool | None] = True
    claims_decrease: ClassVar[bool | None] = True

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = s.relative
        return r.cancelling_feedforward - r.body_damping - self.force(r)

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀e, e⟩ + U."""
        return s.relative.kinetic_error + self.potential(s.relative)

    def velocity_error(self, s: Tracking) -> Array:
        """The error e."""
        return s.relative.V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d e, e⟩."""
        return dot(s.relative.body_damping, s.relative.V_tilde)

    @abstractmethod
    def force(self, r: Tracking) -> Array:
        """Return the force of the pose error, body frame; `r` has the errors of the body frame."""

    @abstractmethod
    def potential(self, r: Tracking) -> Array:
        """Return the energy U of the pose error."""
