"""The law asym of §7 on SO(3), literally."""

from __future__ import annotations

from typing import ClassVar, Literal

from eqt_cli.analysis.certificates.so3_laws import Rigid, SO3Law
from eqt_cli.core.arrays import Array


class SO3Asym(SO3Law):
    """τ_d + ω̃ × 𝕀ω_d + ½ω_d × 𝕀ω̃ + ½𝕀(ω × ω_d) − R_dᵀK_dR_d ω̃ − proportional term."""

    name: ClassVar[str] = "asym on SO(3)"
    statement: ClassVar[str] = "§7, τ^asym"
    section: ClassVar[float] = 7.6
    member: ClassVar[tuple[float, float, float, Literal["spatial", "body"]]] = (
        1.0,
        0.5,
        0.5,
        "spatial",
    )

    def torque(self, b: Rigid) -> Array:
        """The sum of its terms."""
        return (
            b.taud
            + b.gyroscopic()
            + b.transport() / 2
            + b.connection() / 2
            - b.spatial_damping
            - b.proportional
        )
