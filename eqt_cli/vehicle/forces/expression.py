"""A force that is given as expressions in time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array, stack
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.references.base import check_expressions, instants_of
from eqt_cli.vehicle.component import Given
from eqt_cli.vehicle.forces.base import Force


@dataclass(frozen=True)
class ExpressionForce(Force):
    """A force f(t), one expression per coordinate.

    Attributes
    ----------
    force
        m expressions in t.
    """

    name: ClassVar[str] = "expression"
    departs: ClassVar[str] = "force in time"

    force: list[str | float]

    @cached_property
    def expressions(self) -> list[Expression]:
        """The force, parsed."""
        return [formula(entry) for entry in self.force]

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array, given: Given) -> Array:
        """f(t)."""
        return stack([expression.evaluate({"t": t}) for expression in self.expressions])

    def instants(self) -> Array:
        """Where an expression changes its piece."""
        return instants_of(self.expressions)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Expressions that do not parse, or a number of them that is not m."""
        check_expressions(self.force, G, problems.at("force"))
