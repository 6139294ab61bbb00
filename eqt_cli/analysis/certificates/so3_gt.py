"""The law GT of §7 on SO(3), literally."""

from __future__ import annotations

from typing import ClassVar, Literal

from eqt_cli.analysis.certificates.cross_product import cross
from eqt_cli.analysis.certificates.so3_laws import Rigid, SO3Law
from eqt_cli.core.arrays import Array


class SO3GT(SO3Law):
    """τ_d + ½𝕀(ω × ω_d) + ½ω × 𝕀ω_d + ½ω_d × 𝕀ω − ω_d × 𝕀ω_d − K_d ω̃ − proportional term."""

    name: ClassVar[str] = "GT on SO(3)"
    statement: ClassVar[str] = "eq. (24)"
    section: ClassVar[float] = 7.2
    member: ClassVar[tuple[float, float, float, Literal["spatial", "body"]]] = (
        0.5,
        0.5,
        0.5,
        "body",
    )

    def torque(self, b: Rigid) -> Array:
        """The sum of its terms."""
        return (
            b.taud
            + b.connection() / 2
            + cross(b.w, b.momentum(b.wd)) / 2
            + cross(b.wd, b.momentum(b.w)) / 2
            - cross(b.wd, b.momentum(b.wd))
            - b.body_damping
            - b.proportional
        )
