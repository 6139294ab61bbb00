"""Checks that each part of an expression without variables has a finite value."""

from __future__ import annotations

import math

import numpy as np

from eqt_cli.core.errors import ExpressionError
from eqt_cli.core.expressions.evaluation import combine
from eqt_cli.core.expressions.tree import Binary, Call, Node, Variable, fold


def check_constants(tree: Node) -> None:
    """Raise an `ExpressionError` for a constant part without a finite value."""
    with np.errstate(all="ignore"):
        fold(tree, _finite_value)


def _finite_value(node: Node, operands: tuple[float | None, ...]) -> float | None:
    """Return the value of a node without variables, which must be finite; None for all others."""
    if isinstance(node, Binary) and node.operator == "/" and operands[1] == 0:
        raise ExpressionError(f"division by zero at column {node.column}", node.column)
    if isinstance(node, Call) and node.function == "smoothstep":
        start, end = operands[1:]
        if start is not None and end is not None and not start < end:
            raise ExpressionError(
                f"'smoothstep' at column {node.column} must rise from a smaller to a larger "
                f"number, got {start:g} and {end:g}",
                node.column,
            )
    if isinstance(node, Variable) or None in operands:
        return None
    value = float(combine(node, operands))
    if isinstance(node, (Binary, Call)) and not math.isfinite(value):
        name = node.operator if isinstance(node, Binary) else node.function
        raise ExpressionError(
            f"'{name}' at column {node.column} has no finite value (got {value})", node.column
        )
    return value
