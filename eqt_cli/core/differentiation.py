"""Exact derivatives of expressions, carried along while they are evaluated.

Each node of the tree gives its value and its derivative (forward mode), on floats, arrays and
symbols alike. A derivative that is zero by structure is None, so that it costs nothing and
``0 · inf`` cannot arise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from eqt_cli.core.arrays import FUNCTIONS, apply, less, maximum, minimum, register_symbols, where
from eqt_cli.core.expressions import (
    PIECEWISE,
    Binary,
    Call,
    Expression,
    Node,
    Variable,
    clipped_fraction,
    combine,
    fold,
)

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


def value_and_derivatives(expression: Expression, t: Any) -> tuple[Any, Any, Any]:
    """The value of an expression in ``t``, and its first and second derivative by it."""
    if isinstance(t, float | int):
        t = np.float64(t)  # Python's floats raise where IEEE has inf and nan
    with np.errstate(all="ignore"):
        value, rate = value_and_derivative(expression, {"t": Dual(t, 1.0)})
    value, rate = (x if isinstance(x, Dual) else Dual(x, 0.0) for x in (value, rate))
    return value.value, rate.value, rate.rate


class Dual:
    """A value and its derivative, each a number, an array or a symbol of another kind.

    Differentiating in these numbers gives second derivatives.
    """

    __slots__ = ("rate", "value")
    __array_ufunc__ = None  # an array of floats leaves its operators to this class

    def __init__(self, value: Any, rate: Any) -> None:
        self.value, self.rate = value, rate

    def __add__(self, other: Any) -> Dual:
        other = _dual(other)
        return Dual(self.value + other.value, self.rate + other.rate)

    def __mul__(self, other: Any) -> Dual:
        other = _dual(other)
        rate = self.rate * other.value + self.value * other.rate
        return Dual(self.value * other.value, rate)

    def __truediv__(self, other: Any) -> Dual:
        other = _dual(other)
        value = self.value / other.value
        return Dual(value, (self.rate - value * other.rate) / other.value)

    def __pow__(self, exponent: Any) -> Dual:
        if isinstance(exponent, Dual):
            return _of("exp", exponent * _of("log", self))
        slope = 1.0 if exponent == 1 else exponent * _power(self.value, exponent - 1)
        return Dual(self.value**exponent, slope * self.rate)

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.rate)

    def __sub__(self, other: Any) -> Dual:
        return self + -_dual(other)

    def __rsub__(self, other: Any) -> Dual:
        return -self + other

    def __rtruediv__(self, other: Any) -> Dual:
        return _dual(other) / self

    __radd__ = __add__
    __rmul__ = __mul__


def _dual(x: Any) -> Dual:
    return x if isinstance(x, Dual) else Dual(np.float64(x) if isinstance(x, float) else x, 0.0)


def _chosen(condition: Dual, a: Any, b: Any) -> Dual:
    a, b = _dual(a), _dual(b)
    pairs = ((a.value, b.value), (a.rate, b.rate))
    return Dual(*(_unwrapped(where(condition.value, x, y)) for x, y in pairs))


register_symbols(
    Dual,
    {
        **{
            name: lambda x, name=name: Dual(_of(name, x.value), slope(name, x.value) * x.rate)
            for name in FUNCTIONS
        },
        # A condition has no derivative; as a Dual it can stand in an array by itself.
        "less": lambda a, b: Dual(less(_dual(a).value, _dual(b).value), 0.0),
        "where": _chosen,
    },
)


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
    if isinstance(node, Call) and node.function in PIECEWISE:
        return _PIECEWISE_SLOPES[node.function](*operands)
    [(argument, rate)] = operands
    return slope(node.function, argument) * rate if isinstance(node, Call) else -rate


def _extreme(choose: Callable[[Any, Any], Any], first_is_meant: Callable[[Any, Any], Any]) -> Any:
    """The derivative of the smallest or largest argument is its own."""

    def slope(first: Any, *others: Any) -> Any:
        value, rate = first[0], _rate(first)
        for other in others:
            rate = _unwrapped(where(first_is_meant(value, other[0]), rate, _rate(other)))
            value = _unwrapped(choose(value, other[0]))
        return rate

    return slope


def _smoothstep_slope(x: Any, start: Any, end: Any) -> Any:
    """6 s (1 − s) times the rate of s, which it makes 0 outside."""
    s = _unwrapped(clipped_fraction(x[0], start[0], end[0]))
    unclipped = (x[0] - start[0]) / (end[0] - start[0])
    rate = _rate(x) - _rate(start) - unclipped * (_rate(end) - _rate(start))
    return 6 * s * (1 - s) * rate / (end[0] - start[0])


def _rate(operand: Any) -> Any:
    return 0.0 if operand[1] is None else operand[1]


_PIECEWISE_SLOPES: dict[str, Callable[..., Any]] = {
    "min": _extreme(minimum, less),
    "max": _extreme(maximum, lambda a, b: less(b, a)),
    "sign": lambda x: None,
    "step": lambda x, start: None,
    "smoothstep": _smoothstep_slope,
    "where": lambda a, b, x, y: _unwrapped(where(less(a[0], b[0]), _rate(x), _rate(y))),
}
"""The derivative of every piecewise function, given (value, derivative) of its arguments."""


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
