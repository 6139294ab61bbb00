"""A reference driven by a torque, given as expressions in time."""

from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.references.base import InExpressions, Reference


@dataclass(frozen=True)
class TorqueReference(InExpressions, Reference):
    """A torque τ_d(t), one expression per coordinate (the paper's §7).

    Attributes
    ----------
    torque
        m expressions in t, body frame: forces dual to the velocity coordinates.
    """

    name: ClassVar[str] = "torque"
    expressed: ClassVar[str] = "torque"

    torque: list[str | float]

    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """τ_d(t)."""
        return self.at(t)
