"""A reference that moves with a constant body velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.references.base import Reference


@dataclass(frozen=True)
class ConstantReference(Reference):
    """A constant body velocity V_d(t) = V_d(0); the torque that holds it follows.

    With V_d(0) = 0 the desired pose stands still.
    """

    name: ClassVar[str] = "constant"
    keeps_velocity: ClassVar[bool] = True

    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """τ_d = 𝕀̇V_d − ad*_{V_d} P_d, with which V_d stays in Hampsey et al. (2025), eq. (5)."""
        Vd = inertia.velocity(Pd)
        return inertia.rate_force(Vd) - G.ad_star(Vd, Pd)
