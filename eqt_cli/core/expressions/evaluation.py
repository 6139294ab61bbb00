"""Computes the value of a node of the syntax tree from those of its operands."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from eqt_cli.core.arrays import apply
from eqt_cli.core.expressions.piecewise import PIECEWISE
from eqt_cli.core.expressions.tree import Binary, Call, Negation, Number


def combine(node: Number | Negation | Binary | Call, operands: tuple[Any, ...]) -> Any:
    """Compute the value of a node from those of its operands."""
    if isinstance(node, Binary):
        left, right = operands
        if isinstance(left, float) and isinstance(right, float):
            # Python's floats raise where IEEE gives inf or nan, and (-8)**0.5 becomes complex.
            return float(_OPERATORS[node.operator](np.float64(left), right))
        return _OPERATORS[node.operator](left, right)
    if isinstance(node, Call):
        known = PIECEWISE.get(node.function)
        result = known.value(*operands) if known else apply(node.function, operands[0])
        if isinstance(result, float):
            return float(result)
        zero_dimensional = isinstance(result, np.ndarray) and result.shape == ()
        return result[()] if zero_dimensional else result
    if isinstance(node, Negation):
        return -operands[0]
    return node.value


def power(base: Any, exponent: Any) -> Any:
    """Raise to a power, also a number to a symbol, whose type may have no ``__rpow__``."""
    symbols = isinstance(exponent, np.ndarray) and exponent.dtype == object
    if isinstance(base, float) and (symbols or not hasattr(exponent, "__rpow__")):
        return apply("exp", exponent * float(np.log(base)))[()]
    return base**exponent


_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": power,
}
