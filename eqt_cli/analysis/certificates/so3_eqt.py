"""The law EqT of §7 on SO(3), literally."""

from __future__ import annotations

from typing import ClassVar, Literal

from eqt_cli.analysis.certificates.so3_laws import Rigid, SO3Law
from eqt_cli.core.arrays import Array


class SO3EqT(SO3Law):
    """τ_d + ω̃ × 𝕀ω_d + ω_d × 𝕀ω̃ − R_dᵀK_dR_d ω̃ − R_dᵀ(K_pR_E − R_EᵀK_pᵀ)^∨."""

    name: ClassVar[str] = "EqT on SO(3)"
    statement: ClassVar[str] = "eq. (23)"
    section: ClassVar[float] = 7.1
    member: ClassVar[tuple[float, float, float, Literal["spatial", "body"]]] = (
        1.0,
        1.0,
        0.0,
        "spatial",
    )

    def torque(self, b: Rigid) -> Array:
        """The sum of its terms."""
        return b.taud + b.gyroscopic() + b.transport() - b.spatial_damping - b.proportional
