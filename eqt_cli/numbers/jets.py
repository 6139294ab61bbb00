"""Truncated Taylor series in time, for derivatives along a motion; they know no motion.

``Jet([x, v, a / 2])`` is x + vτ + ½aτ² near a time t, where x, v and a are floats, arrays with
leading batch axes, or arrays of symbols. Whatever is written with operators, ``@``, slicing,
``reshape``, ``swapaxes``, ``sum`` and the functions of `eqt_cli.base.arrays` then gives the series
of its result, as do expressions:

>>> from eqt_cli.base.expressions import parse
>>> p = parse("0.5*t**2 + sin(t)").evaluate({"t": Jet.time(0.0, order=4)})
>>> [float(p.derivative(k)) for k in range(5)]
[0.0, 1.0, 1.0, -1.0, 0.0]

Derivatives that a model gives are appended one at a time: evaluate a force at the order that is
known, and `extended` by the acceleration that follows from it, evaluate it again. A tracer merges
the equal operations of such passes. A derivative that is zero by structure costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np

from eqt_cli.base.arrays import apply, less, stack, unwrapped, where
from eqt_cli.base.expressions import Expression, power


def series(expression: Expression, values: Mapping[str, Any], order: int) -> Jet:
    """Return an expression as a series in ``t`` about its value; other variables are constants."""
    with np.errstate(all="ignore"):
        result = expression.evaluate({**values, "t": Jet.time(values["t"], order)})
    return result if isinstance(result, Jet) else Jet([result, *[None] * order])


def value_and_derivative(expression: Expression, values: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return the value of an expression and its derivative with respect to ``t``.

    Parameters
    ----------
    values
        One value for every variable: floats, arrays or symbols.

    Returns
    -------
    value, derivative
        The value of `Expression.evaluate`; the derivative is 0.0 if the expression does not
        depend on ``t``.
    """
    result = series(expression, values, 1)
    return result.value, result.derivative(1)


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
    "abs": lambda x: unwrapped(where(less(x, 0.0), -1.0, 1.0)),
    "floor": lambda x: 0.0,
}
"""The derivative of every function of the grammar; that of abs at 0 is set to 1, of floor to 0."""

MOST_FACTORS = 100
"""Largest whole exponent that is computed by products."""

COMPARISONS = ("less", "smooth_less", "positive")


class Jet:
    """A truncated Taylor series Σ c_k τᵏ of an array, and of floats or symbols as those of ().

    The result of two series has the order of the shorter one. Other operands are constants. A
    comparison compares values; `where` chooses series by it.

    Attributes
    ----------
    coefficients
        c_k, the k-th derivative over k!; None for zero by structure, but never for c_0.
    """

    __slots__ = ("coefficients",)
    __array_ufunc__ = None  # an array leaves its operators to this class

    def __init__(self, coefficients: Sequence[Any]) -> None:
        if type(coefficients[0]) is float:  # Python's floats raise where IEEE gives inf or nan
            coefficients = (np.float64(coefficients[0]), *coefficients[1:])
        shape = _shape(coefficients[0])
        self.coefficients = tuple(
            c if c is None or _shape(c) == shape else np.broadcast_to(c, shape)
            for c in coefficients
        )

    @classmethod
    def time(cls, t: Any, order: int) -> Jet:
        """Return t + τ."""
        t = float(t) if isinstance(t, int) else t
        return cls([t, 1.0, *[None] * order][: order + 1])

    @classmethod
    def of(cls, derivatives: Sequence[Any]) -> Jet:
        """Return the series with a value and its derivatives, None for zero."""
        numbered = enumerate(derivatives)
        return cls([x if k < 2 or x is None else x / math.factorial(k) for k, x in numbered])

    @property
    def value(self) -> Any:
        """c_0."""
        return self.coefficients[0]

    @property
    def order(self) -> int:
        """The highest derivative that is known."""
        return len(self.coefficients) - 1

    def derivative(self, k: int) -> Any:
        """Return the k-th derivative."""
        coefficient = self.coefficients[k]
        if coefficient is None:
            return np.broadcast_to(0.0, self.shape) if self.shape else 0.0
        return _scaled(coefficient, math.factorial(k))

    @property
    def rate(self) -> Jet:
        """The series of the derivative, of one order less."""
        higher = (_scaled(c, k) for k, c in enumerate(self.coefficients[2:], 2))
        return Jet([self.derivative(1), *higher])

    def extended(self, derivative: Any) -> Jet:
        """Return the series with the next derivative appended."""
        return Jet([*self.coefficients, _scaled(derivative, 1 / math.factorial(self.order + 1))])

    def to_order(self, order: int) -> Jet:
        """Return the series without the derivatives above an order."""
        return Jet(self.coefficients[: order + 1])

    # Operators.

    def __add__(self, other: Any) -> Jet:
        return Jet([_sum(a, b) for a, b in self._with(other)])

    def __neg__(self) -> Jet:
        return self._mapped(lambda c: -c)

    def __sub__(self, other: Any) -> Jet:
        return Jet([_difference(a, b) for a, b in self._with(other)])

    def __rsub__(self, other: Any) -> Jet:
        return -self + other

    def __mul__(self, other: Any) -> Jet:
        a, b = zip(*self._with(other), strict=True)
        return Jet([_convolved(a, b, k) for k in range(len(a))])

    def __matmul__(self, other: Any) -> Jet:
        a, b = zip(*self._with(other), strict=True)
        return Jet([_convolved(a, b, k, matrices=True) for k in range(len(a))])

    def __rmatmul__(self, other: Any) -> Jet:
        return self._constant(other) @ self

    def __truediv__(self, other: Any) -> Jet:
        a, b = zip(*self._with(other), strict=True)
        quotient: list[Any] = []
        for k, numerator in enumerate(a):
            rest = _difference(numerator, _convolved((*quotient, None), b, k))
            quotient.append(None if rest is None else rest / b[0])
        return Jet(quotient)

    def __rtruediv__(self, other: Any) -> Jet:
        return self._constant(other) / self

    def __pow__(self, exponent: Any) -> Jet:
        if isinstance(exponent, Jet) and all(c is None for c in exponent.coefficients[1:]):
            exponent = exponent.value
        if not isinstance(exponent, int | float):
            log, value = exponent * apply("log", self), power(self.value, _value(exponent))
            return log._with_rate(value, lambda u: self.to_order(u.order) ** exponent * log.rate)
        if exponent == 0.5:
            return self._root()
        if exponent % 1 == 0 and abs(exponent) <= MOST_FACTORS:  # products are right at 0, too
            product = self._constant(1.0) if exponent == 0 else self
            for _ in range(abs(int(exponent)) - 1):
                product = product * self
            return 1.0 / product if exponent < 0 else product
        value = self.value**exponent
        return self._with_rate(value, lambda u: exponent * u ** (exponent - 1) * self.rate)

    def __rpow__(self, base: Any) -> Jet:
        return self._constant(base) ** self

    __radd__ = __add__
    __rmul__ = __mul__

    # What arrays have.

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the array."""
        return _shape(self.value)

    @property
    def ndim(self) -> int:
        """The number of its axes."""
        return len(self.shape)

    @property
    def dtype(self) -> Any:
        """That of numbers, also for symbols, because functions of a series are its own."""
        return np.dtype(float)

    @property
    def T(self) -> Jet:
        """The series of the transpose."""
        return self._mapped(lambda c: c.T)

    def __getitem__(self, index: Any) -> Jet:
        return self._mapped(lambda c: c[index])

    def sum(self, axis: Any = None) -> Jet:
        """Return the series of the sum over axes."""
        return self._mapped(lambda c: c.sum(axis=axis))

    def reshape(self, *shape: Any) -> Jet:
        """Return the series of the array in another shape."""
        return self._mapped(lambda c: c.reshape(*shape))

    def swapaxes(self, one: int, other: int) -> Jet:
        """Return the series with two axes exchanged."""
        return self._mapped(lambda c: c.swapaxes(one, other))

    def __array_function__(self, *_: Any) -> Any:
        return NotImplemented  # NumPy's own error names the function

    # What the functions of `eqt_cli.base.arrays` do with it.

    @classmethod
    def stacked(cls, entries: Sequence[Any]) -> Jet:
        """Return the series of `stack`."""
        return cls([_of_known(stack, row) for row in _aligned(entries, _order(entries))])

    @classmethod
    def applied(cls, name: str, arguments: Sequence[Any]) -> Jet:
        """Return the series of a function of `eqt_cli.base.arrays.apply`."""
        if name in COMPARISONS:
            return cls._fixed(apply(name, *map(_value, arguments)), _order(arguments))
        if name == "where":
            condition, *choices = arguments

            def chosen(pair: Sequence[Any]) -> Any:
                return unwrapped(apply("where", _value(condition), *pair))

            return cls([_of_known(chosen, pair) for pair in _aligned(choices, _order(arguments))])
        (series,) = arguments
        if name == "sqrt":
            return series._root()
        return series._with_rate(_of(name, series.value), lambda u: slope(name, u) * series.rate)

    def _with_rate(self, value: Any, rate: Callable[[Jet], Jet]) -> Jet:
        """Return the function of this series with a value, and its rate from one order less."""
        if all(c is None for c in self.coefficients[1:]):
            return self._constant(value)
        rates = rate(self.to_order(self.order - 1)).coefficients
        return Jet([value, *(_scaled(c, 1 / (k + 1)) for k, c in enumerate(rates))])

    def _root(self) -> Jet:
        root = _of("sqrt", self.value)
        terms = [root]
        for k, c in enumerate(self.coefficients[1:], 1):
            rest = _difference(c, _convolved((None, *terms[1:]), (*terms, None), k))
            terms.append(None if rest is None else rest / (2 * root))
        return Jet(terms)

    # Coefficients.

    def _mapped(self, function: Any) -> Jet:
        return Jet([None if c is None else function(c) for c in self.coefficients])

    def _with(self, other: Any) -> list[tuple[Any, ...]]:
        return _aligned((self, other), _order((self, other)))

    def _constant(self, value: Any) -> Jet:
        return Jet._fixed(value, self.order)

    @classmethod
    def _fixed(cls, value: Any, order: int) -> Jet:
        return cls([value, *[None] * order])


def _order(operands: Sequence[Any]) -> int:
    return min(x.order for x in operands if isinstance(x, Jet))


def _aligned(operands: Sequence[Any], order: int) -> list[tuple[Any, ...]]:
    """Return the coefficients of all operands, order by order; what is no series is constant."""
    series = [x if isinstance(x, Jet) else Jet._fixed(x, order) for x in operands]
    return list(zip(*(x.coefficients[: order + 1] for x in series), strict=True))


def _shape(x: Any) -> tuple[int, ...]:
    return getattr(x, "shape", ())


def _value(x: Any) -> Any:
    return x.value if isinstance(x, Jet) else x


def _sum(a: Any, b: Any) -> Any:
    return b if a is None else a if b is None else a + b


def _difference(a: Any, b: Any) -> Any:
    return a if b is None else -b if a is None else a - b


def _scaled(c: Any, factor: float) -> Any:
    return None if c is None else c if factor == 1 else factor * c


def _convolved(a: Sequence[Any], b: Sequence[Any], k: int, matrices: bool = False) -> Any:
    """Return Σ a_j b_{k−j}; a may be shorter than b."""
    terms = [(a[j], b[k - j]) for j in range(min(k + 1, len(a)))]
    pairs = [pair for pair in terms if pair[0] is not None and pair[1] is not None]
    return reduce(_sum, [x @ y if matrices else x * y for x, y in pairs], None)


def _of_known(function: Callable[[Sequence[Any]], Any], row: Sequence[Any]) -> Any:
    """Return a function of coefficients, with 0 for None; None if nothing else is given."""
    if all(c is None for c in row):
        return None
    return function([0.0 if c is None else c for c in row])


def slope(function: str, x: Any) -> Any:
    """Return the derivative of a function of the grammar at x: floats, symbols or a series."""
    return _SLOPES[function](x)


def _of(name: str, x: Any) -> Any:
    return unwrapped(apply(name, x))
