"""Exact derivatives of expressions by dual numbers (forward mode).

A dual number is a value with its derivative, each a float, an array or a symbol. A derivative that
is zero by structure is None, so that it costs nothing and ``0 · inf`` cannot occur.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from eqt_cli.core.arrays import FUNCTIONS, apply, less, register_symbols, where
from eqt_cli.core.expressions import Expression
from eqt_cli.core.expressions.evaluation import power

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
"""The derivative of every function of the grammar; that of abs at 0 is set to 1."""


def value_and_derivative(
    expression: Expression, values: Mapping[str, Any], name: str = "t"
) -> tuple[Any, Any]:
    """Return the value of an expression and its derivative with respect to one variable.

    Parameters
    ----------
    values
        One value for every variable: floats, arrays or symbols.
    name
        The variable to differentiate by.

    Returns
    -------
    value, derivative
        The value of `Expression.evaluate`; the derivative is 0.0 if the expression does not
        depend on the variable.
    """
    t = values[name]
    # Python's floats raise where IEEE gives inf or nan.
    variable = Dual(np.float64(t) if isinstance(t, float | int) else t, 1.0)
    with np.errstate(all="ignore"):
        result = _dual(expression.evaluate({**values, name: variable}))
    parts = result.value, 0.0 if result.rate is None else result.rate
    value, derivative = (float(part) if isinstance(part, float) else part for part in parts)
    return value, derivative


def value_and_derivatives(expression: Expression, t: Any) -> tuple[Any, Any, Any]:
    """Return the value of an expression in ``t``, and its first and second derivative."""
    t = np.float64(t) if isinstance(t, float | int) else t
    with np.errstate(all="ignore"):
        value, rate = map(_dual, value_and_derivative(expression, {"t": Dual(t, 1.0)}))
    return value.value, rate.value, 0.0 if rate.rate is None else rate.rate


class Dual:
    """A value and its derivative: numbers, arrays, symbols, or dual numbers for second derivatives.

    A derivative of None is zero by structure.
    """

    __slots__ = ("rate", "value")
    __array_ufunc__ = None  # an array of floats leaves its operators to this class

    def __init__(self, value: Any, rate: Any) -> None:
        self.value, self.rate = value, rate

    def __add__(self, other: Any) -> Dual:
        other = _dual(other)
        return Dual(self.value + other.value, _sum(self.rate, other.rate))

    def __sub__(self, other: Any) -> Dual:
        other = _dual(other)
        return Dual(self.value - other.value, _sum(self.rate, (-other).rate))

    def __mul__(self, other: Any) -> Dual:
        other = _dual(other)
        rate = _sum(_product(self.rate, other.value), _product(other.rate, self.value))
        return Dual(self.value * other.value, rate)

    def __truediv__(self, other: Any) -> Dual:
        other = _dual(other)
        value = self.value / other.value
        by_numerator = _product(self.rate, 1 / other.value)
        return Dual(value, _sum(by_numerator, _product(other.rate, -value / other.value)))

    def __pow__(self, exponent: Any) -> Dual:
        exponent = _dual(exponent)
        u, v = self.value, exponent.value
        value = power(u, v)
        by_base = by_exponent = None
        if self.rate is not None:
            # x**0 must be 1 also for a symbol or 0, so that the derivative of x**1 is exact.
            is_one = isinstance(v, float) and v == 1
            by_base = v * (1.0 if is_one else power(u, v - 1)) * self.rate
        if exponent.rate is not None:
            by_exponent = value * _of("log", u) * exponent.rate
        return Dual(value, _sum(by_base, by_exponent))

    def __neg__(self) -> Dual:
        return Dual(-self.value, None if self.rate is None else -self.rate)

    def __rsub__(self, other: Any) -> Dual:
        return _dual(other) - self

    def __rtruediv__(self, other: Any) -> Dual:
        return _dual(other) / self

    def __rpow__(self, base: Any) -> Dual:
        return _dual(base) ** self

    __radd__ = __add__
    __rmul__ = __mul__


def _dual(x: Any) -> Dual:
    x = _unwrapped(x)  # functions return a dual number in an array of no dimensions
    return x if isinstance(x, Dual) else Dual(np.float64(x) if isinstance(x, float) else x, None)


def _sum(a: Any, b: Any) -> Any:
    if a is None or b is None:
        return b if a is None else a
    return a + b


def _product(rate: Any, factor: Any) -> Any:
    return None if rate is None else rate * factor


def _function(name: str, x: Dual) -> Dual:
    rate = None if x.rate is None else slope(name, x.value) * x.rate
    return Dual(_of(name, x.value), rate)


def _chosen(condition: Any, a: Any, b: Any) -> Dual:
    condition, a, b = _dual(condition), _dual(a), _dual(b)
    value = _unwrapped(where(condition.value, a.value, b.value))
    if a.rate is None and b.rate is None:
        return Dual(value, None)
    rates = (0.0 if rate is None else rate for rate in (a.rate, b.rate))
    return Dual(value, _unwrapped(where(condition.value, *rates)))


register_symbols(
    Dual,
    {
        **{name: partial(_function, name) for name in FUNCTIONS},
        # A condition has no derivative; as a Dual it can stand in an array by itself.
        "less": lambda a, b: Dual(less(_dual(a).value, _dual(b).value), None),
        "where": _chosen,
    },
)


def slope(function: str, x: Any) -> Any:
    """Return the derivative of a function of the grammar at x: a float, an array or a symbol."""
    return _SLOPES[function](x)


def _of(name: str, x: Any) -> Any:
    return _unwrapped(apply(name, x))


def _unwrapped(result: Any) -> Any:
    return result[()] if isinstance(result, np.ndarray) and result.shape == () else result
