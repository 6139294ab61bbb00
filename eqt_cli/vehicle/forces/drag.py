"""Drag, linear and quadratic in the velocity, in a medium that may flow."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array, absolute, apply_matrix, stack
from eqt_cli.core.errors import Problems
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.core.leaves import STRUCTURE, with_fields
from eqt_cli.core.option_types import DAMPING, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.references.base import instants_of
from eqt_cli.vehicle.component import Matrix, NumberOrExpression, check_numbers
from eqt_cli.vehicle.forces.base import Force


@dataclass(frozen=True)
class Drag(Force):
    """The drag −(D₁ + D₂ diag|U|) U, with U = V − Ad_{Q⁻¹} (0, c) in a current c, else U = V.

    Attributes
    ----------
    linear
        D₁: a number, a list (the diagonal) or a matrix.
    quadratic
        D₂, likewise.
    current
        c, the velocity of the medium in the spatial frame, m/s: numbers or expressions in t, one
        for each axis of the translation of the group; at rest if left out.
    """

    name: ClassVar[str] = "drag"
    departs: ClassVar[str] = "drag"
    matrices: ClassVar[tuple[str, ...]] = ("linear", "quadratic")

    linear: Annotated[Matrix, Unit(DAMPING)] = 0.0
    quadratic: Matrix = 0.0
    current: Annotated[list[NumberOrExpression] | None, Unit("m/s")] = None

    expressions: tuple[Expression | None, ...] = field(
        default=(), init=False, repr=False, metadata=STRUCTURE
    )

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the drag with the expressions of the current, and 0 for them among its numbers."""
        part = super().of_run(G, random)
        if self.current is None:
            return part
        current: Any = part.current
        numbers = [0.0 if isinstance(entry, str) else entry for entry in current]
        expressions = [formula(entry) if isinstance(entry, str) else None for entry in self.current]
        return with_fields(
            part, current=np.array(numbers, dtype=float), expressions=tuple(expressions)
        )

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which an expression changes its piece, and of short pulses."""
        return instants_of(filter(None, self.expressions), until)

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return −D₁ U − D₂ (|U| U)."""
        if self.current is not None:
            V = V - self._flow(G, t, Q)
        squares = apply_matrix(self.quadratic, absolute(V) * V)
        return -apply_matrix(self.linear, V) - squares

    def _flow(self, G: MatrixLieGroup, t: Any, Q: Array) -> Array:
        """Return the velocity of the medium in the frame of the force, ``(..., m)``."""
        part, numbers = G.translation, np.asarray(self.current)
        assert part is not None
        entries: list[Any] = [0.0] * G.dimension
        for axis in range(numbers.shape[-1]):
            expression = self.expressions[axis]
            value = numbers[..., axis] if expression is None else expression.evaluate({"t": t})
            entries[part.axes.start + axis] = value
        flow = stack(entries)
        return flow if self.frame == "spatial" else G.Ad(G.inverse(Q), flow)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid numbers, and a current on a group without a translation."""
        super().check(G, problems)
        if self.current is None:
            return
        here, part = problems.at("current"), G.translation
        if part is None:
            here.add(
                f"needs a group with one translation in m/s, as SE2 and SE3, got {G.name}; remove "
                "this key"
            )
            return
        axes = part.axes.stop - part.axes.start
        if len(self.current) != axes:
            here.add(
                f"expected {axes} numbers or expressions for {G.name}, got {len(self.current)}"
            )
        for index, entry in enumerate(self.current):
            if isinstance(entry, str):
                with here.catching(index):
                    formula(entry)
            else:
                check_numbers(entry, here.at(index))
