"""The law nog of §7 on SO(3), literally."""

from __future__ import annotations

from typing import ClassVar, Literal

from eqt_cli.analysis.certificates.so3_laws import Rigid, SO3Law
from eqt_cli.core.arrays import Array


class SO3NoG(SO3Law):
    """τ_d + ω_d × 𝕀ω̃ − R_dᵀK_dR_d ω̃ − proportional term."""

    name: ClassVar[str] = "nog on SO(3)"
    statement: ClassVar[str] = "§7, τ^nog"
    section: ClassVar[float] = 7.5
    member: ClassVar[tuple[float, float, float, Literal["spatial", "body"]]] = (
        0.0,
        1.0,
        0.0,
        "spatial",
    )

    def torque(self, b: Rigid) -> Array:
        """The sum of its terms."""
        return b.taud + b.transport() - b.spatial_damping - b.proportional
