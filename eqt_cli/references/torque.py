"""A reference driven by a torque that is given as expressions in time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array, stack
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.references.base import Reference, check_expressions, instants_of


@dataclass(frozen=True)
class TorqueReference(Reference):
    """A torque τ_d(t), one expression per coordinate (the paper's §7).

    Attributes
    ----------
    torque
        m expressions in t, body frame: forces dual to the velocity coordinates.
    """

    name: ClassVar[str] = "torque"

    torque: list[str | float]

    @cached_property
    def expressions(self) -> list[Expression]:
        """The torque, parsed."""
        return [formula(entry) for entry in self.torque]

    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """τ_d(t)."""
        return stack([expression.evaluate({"t": t}) for expression in self.expressions])

    def instants(self, G: MatrixLieGroup) -> Array:
        """Where an expression changes its piece."""
        return instants_of(self.expressions)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Expressions that do not parse, or a number of them that is not m."""
        check_expressions(self.torque, G, problems.at("torque"))
