"""The stabilising law of Theorem 3.2, for an inertia that may vary in time."""

from dataclasses import dataclass, field
from typing import ClassVar

from eqt_cli.controllers.base import Controller
from eqt_cli.core.arrays import Array, dot
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class Stabilising(Controller):
    """Energy shaping at a target pose with inertia feedforward, Theorem 3.2 of the paper.

    τ = Ṡ*S⁻* P − K_d V − L*_Q d(Υ(Q Q_target⁻¹)), Hampsey et al. (2025), eq. (11). The desired
    state is the target at rest, so that V_d = 0 and τ_d = 0.

    Attributes
    ----------
    feedforward
        Whether the term Ṡ*S⁻* P, which compensates the change of the inertia, is applied.
    """

    name: ClassVar[str] = "stabilising"
    tasks: ClassVar[tuple[str, ...]] = ("stabilise",)
    matched: ClassVar[bool | None] = True

    feedforward: bool = True
    compensation: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "compensation", 1.0 if self.feedforward else 0.0)

    @property
    def claims_decrease(self) -> bool | None:  # type: ignore[override]  # by its options
        """True with the feedforward; without it, a changing inertia may raise L."""
        return self.feedforward

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        shaping = s.G.Ad_star(s.Qd, s.gradient)
        return self.compensation * s.inertia_force - s.body_damping - shaping

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d V, V⟩, and without feedforward also the power of the changing inertia."""
        uncompensated = (1 - self.compensation) * s.inertia_force
        return dot(s.body_damping + uncompensated, s.V_tilde)
