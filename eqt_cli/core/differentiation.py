"""Exact derivatives of expressions, carried along while they are evaluated.

Each node of the tree gives its value and its derivative (forward mode), on floats, arrays and
symbols alike. A derivative that is zero by structure is None, so that it costs nothing and
``0 · inf`` cannot arise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from eqt_cli.core.arrays import apply, less, where
from eqt_cli.core.expressions import Binary, Call, Expression, Node, Variable, combine, fold

_SLOPES: dict[str, Callable[[Any], Any]] = {
    "sin": lambda x: _of("cos", x),
    "cos": lambda x: -_of("sin", x),
    "tan": lambda x: 1 + _of("tan", x) ** 2,
    "asin": lambda x: 1 / _of("sqrt", 1 - x * x),
    "acos": lambda x: -1 / _of("sqrt", 1 - x * x),
    "atan": lambda x: 1 / (1 + x * x),
    "sinh": lambda x: _of("cosh", x),
    "cosh": lambda x: _of("sinh", x),
    "tanh": lambda x: 1 - _of("tanh", x) ** 2,
    "asinh": lambda x: 1 / _of("sqrt", 1 + x * x),
    "acosh": lambda x: 1 / _of("sqrt", x * x - 1),
    "atanh": lambda x: 1 / (1 - x * x),
    "exp": lambda x: _of("exp", x),
    "log": lambda x: 1 / x,
    "sqrt": lambda x: 0.5 / _of("sqrt", x),
    "abs": lambda x: _unwrapped(where(less(x, 0.0), -1.0, 1.0)),
}
"""The derivative of every function of the grammar; that of abs at 0 is taken to be 1."""


def value_and_derivative(
    expression: Expression, values: Mapping[str, Any], name: str = "t"
) -> tuple[Any, Any]:
    """The value of an expression and its derivative with respect to one variable.

    Parameters
    ----------
    values
        One value for every variable: floats, arrays or symbols.
    name
        The variable to differentiate by.

    Returns
    -------
    value, derivative
        As `Expression.evaluate` gives the value; the derivative is 0.0 where it does not depend
        on the variable.
    """

    def visit(node: Node, operands: tuple[Any, ...]) -> tuple[Any, Any]:
        if isinstance(node, Variable):
            return values[node.name], 1.0 if node.name == name else None
        value = combine(node, tuple(operand[0] for operand in operands))
        return value, _slope(node, operands, value)

    with np.errstate(all="ignore"):
        value, derivative = fold(expression.tree, visit)
    if derivative is None:
        return value, 0.0
    return value, float(derivative) if isinstance(derivative, float) else derivative


def slope(function: str, x: Any) -> Any:
    """The derivative of a function of the grammar at x: a float, an array or a symbol."""
    return _SLOPES[function](x)


def _slope(node: Node, operands: tuple[Any, ...], value: Any) -> Any:
    """The derivative of a node, given (value, derivative) of its operands; None for zero."""
    if all(derivative is None for _, derivative in operands):
        return None
    if isinstance(value, float):
        # Python's floats raise where IEEE has inf and nan.
        operands = tuple((np.float64(number), derivative) for number, derivative in operands)
    if isinstance(node, Binary):
        left, right = operands
        return _binary_slope(node.operator, left, right, value)
    [(argument, rate)] = operands
    return slope(node.function, argument) * rate if isinstance(node, Call) else -rate


def _binary_slope(operator: str, left: Any, right: Any, value: Any) -> Any:
    (u, du), (v, dv) = left, right
    if operator == "+":
        return _sum(du, dv)
    if operator == "-":
        return _sum(du, None if dv is None else -dv)
    if operator == "*":
        return _sum(_product(du, v), _product(dv, u))
    if operator == "/":
        return _sum(_product(du, 1 / v), _product(dv, -value / v))
    exponent = v - 1
    by_base = None if du is None else v * _power(u, exponent) * du
    return _sum(by_base, None if dv is None else value * _of("log", u) * dv)


def _power(base: Any, exponent: Any) -> Any:
    # x**0 is 1 also where x is a symbol or 0, so that the derivative of x**1 is exact.
    return 1.0 if isinstance(exponent, float) and exponent == 0 else base**exponent


def _sum(a: Any, b: Any) -> Any:
    if a is None or b is None:
        return b if a is None else a
    return a + b


def _product(slope: Any, factor: Any) -> Any:
    return None if slope is None else slope * factor


def _of(name: str, x: Any) -> Any:
    return _unwrapped(apply(name, x))


def _unwrapped(result: Any) -> Any:
    return result[()] if isinstance(result, np.ndarray) and result.shape == () else result
