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
from eqt_cli.references.base import Reference


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

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Expressions that do not parse, or a number of them that is not m."""
        problems = problems.at("torque")
        if len(self.torque) != G.dimension:
            expected = f"expected {G.dimension} expressions for {G.name}"
            problems.add(f"{expected}, got {len(self.torque)}")
        for index, entry in enumerate(self.torque):
            with problems.catching(index):
                formula(entry)
