"""Finds the times at which piecewise functions in a syntax tree change their piece."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eqt_cli.core.expressions.evaluation import combine
from eqt_cli.core.expressions.piecewise import PIECEWISE
from eqt_cli.core.expressions.tree import Binary, Call, Negation, Node, Variable, fold

_Linear = tuple[float, float]
"""p + q t, as (p, q)."""


def instants_in(tree: Node) -> tuple[float, ...]:
    """Return the values of ``t`` at which a piecewise function changes its piece, in order."""
    instants: set[float] = set()

    def visit(node: Node, operands: tuple[_Linear | None, ...]) -> _Linear | None:
        if isinstance(node, Call) and node.function in PIECEWISE:
            instants.update(_roots(node.function, operands))
            return None
        return _linear(node, operands)

    with np.errstate(all="ignore"):
        fold(tree, visit)
    return tuple(sorted(instants))


def _linear(node: Node, operands: tuple[_Linear | None, ...]) -> _Linear | None:
    """Return a node as p + q t, or None where that is not possible."""
    if isinstance(node, Variable):
        return (0.0, 1.0) if node.name == "t" else None
    known = [operand for operand in operands if operand is not None]
    if len(known) < len(operands):
        return None
    if isinstance(node, Binary) and node.operator in "+-":
        (p, q), (r, s) = known
        sign = 1 if node.operator == "+" else -1
        return p + sign * r, q + sign * s
    if isinstance(node, Binary) and node.operator in ("*", "/"):
        (p, q), (r, s) = known
        if s == 0 and node.operator == "/":
            return p / r, q / r
        if node.operator == "*" and q * s == 0:
            return p * r, p * s + q * r
        return None
    if isinstance(node, Negation):
        [(p, q)] = known
        return -p, -q
    if all(slope == 0 for _, slope in known):
        return combine(node, tuple(value for value, _ in known)), 0.0
    return None


def _roots(function: str, operands: tuple[_Linear | None, ...]) -> Iterator[float]:
    """Yield the times at which two compared arguments of a function are equal."""
    for one, other in PIECEWISE[function].compared(len(operands)):
        left, right = operands[one], (0.0, 0.0) if other is None else operands[other]
        if left and right and left[1] != right[1]:
            yield (right[0] - left[0]) / (left[1] - right[1])
