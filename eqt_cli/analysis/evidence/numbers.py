"""Numbers that carry their time derivative through any law, and the rounded ones among them.

The laws of eqt run on object arrays of symbols. With `Bounded` numbers as symbols, one evaluation
gives a value, its exact derivative along a motion (forward mode), and bounds of the rounding errors
of both by a running error analysis (Higham, Accuracy and Stability of Numerical Algorithms, section
3.3), to first order in the errors. `exact` has the numbers without rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from eqt_cli.core.arrays import FUNCTIONS, Array, register_symbols
from eqt_cli.core.jets import slope


class Number:
    """A number that carries its time derivative through any law.

    A kind of numbers has the arithmetic of laws, and

    - ``of(x)``: converts a float or a number of this kind to this kind;
    - ``nearest``: the nearest float or its neighbour;
    - ``derivative()``: the rate of change as a number without a rate;
    - ``moving(rate)``: the same value with another rate;
    - ``granted(error)``: the number with a larger error bound; exact numbers stay exact.

    It is not an abstract base class, because these slow down `isinstance`, which arithmetic calls.
    """

    __slots__ = ()

    def __sub__(self: Any, other: Any) -> Any:
        return self + -other

    def __rsub__(self: Any, other: Any) -> Any:
        return -self + other


def is_number(x: Any) -> bool:
    """Whether an entry of an array is such a number; else it is a float."""
    return isinstance(x, Number)


def rate_of(numbers: Array) -> Array:
    """Return the rates of change as numbers without rates."""
    return entrywise(lambda x: x.derivative() if is_number(x) else 0.0, numbers)


def with_rate(numbers: Array, rates: Any) -> Array:
    """Return the numbers with these rates instead of their own; not all may be plain floats."""
    numbers, rates = (np.asarray(array, dtype=object) for array in (numbers, rates))
    kind = next(type(x) for array in (numbers, rates) for x in array.flat if is_number(x))
    return entrywise(lambda x, rate: kind.of(x).moving(kind.of(rate)), numbers, rates)


def floats(numbers: Array) -> Array:
    """Return the values as floats."""
    return entrywise(lambda x: x.nearest if is_number(x) else x, numbers).astype(float)


def granted(numbers: Array, error: float) -> Array:
    """Return the numbers with error bounds raised by `error`, if they have error bounds."""
    return entrywise(lambda x: x.granted(error) if is_number(x) else x, numbers)


def entrywise(function: Any, *arrays: Any) -> Array:
    """Return the values of a function at the entries of arrays, broadcast against each other."""
    results = np.frompyfunc(function, len(arrays), 1)(*arrays)
    return np.asarray(results, dtype=object)


UNIT = 2.0**-53
"""Unit roundoff of doubles: largest relative error of one operation."""

LIBRARY_ULPS = 4.0
"""Error bound of library functions in unit roundoffs; libraries promise about one."""


class Bounded(Number):
    """A double, its rate of change, and bounds of the rounding errors of both.

    Attributes
    ----------
    value, rate
        Values computed in doubles.
    error, rate_error
        Bounds of their distances from exact arithmetic on exact inputs.
    """

    __slots__ = ("error", "rate", "rate_error", "value")

    def __init__(
        self, value: float, error: float = 0.0, rate: float = 0.0, rate_error: float = 0.0
    ) -> None:
        self.value, self.error, self.rate, self.rate_error = value, error, rate, rate_error

    @classmethod
    def of(cls, x: Any) -> Bounded:
        """Convert a number; a float has no error."""
        return x if isinstance(x, Bounded) else cls(float(x))

    @property
    def nearest(self) -> float:
        """The value in doubles."""
        return self.value

    def derivative(self) -> Bounded:
        """Return the rate with the bound of its error."""
        return Bounded(self.rate, self.rate_error)

    def moving(self, rate: Bounded) -> Bounded:
        """Return the value with another rate and the bounds of both."""
        return Bounded(self.value, self.error, rate.value, rate.error)

    def granted(self, error: float) -> Bounded:
        """Return the number with a larger error bound."""
        return Bounded(self.value, self.error + error, self.rate, self.rate_error)

    def __add__(self, other: Any) -> Bounded:
        if not isinstance(other, Bounded) and other == 0:
            return self
        other = Bounded.of(other)
        value, rate = self.value + other.value, self.rate + other.rate
        return Bounded(
            value,
            self.error + other.error + UNIT * abs(value),
            rate,
            self.rate_error + other.rate_error + UNIT * abs(rate),
        )

    def __mul__(self, other: Any) -> Any:
        if not isinstance(other, Bounded) and other == 0:
            return 0.0
        other = Bounded.of(other)
        a, b = abs(self.value), abs(other.value)
        value = self.value * other.value
        error = a * other.error + b * self.error + self.error * other.error + UNIT * abs(value)
        left, right = self.value * other.rate, other.value * self.rate
        rate_error = (
            a * other.rate_error
            + b * self.rate_error
            + (abs(other.rate) + other.rate_error) * self.error
            + (abs(self.rate) + self.rate_error) * other.error
            + 2 * UNIT * (abs(left) + abs(right))
        )
        return Bounded(value, error, left + right, rate_error)

    def __truediv__(self, other: Any) -> Any:
        return self * (other.reciprocal() if isinstance(other, Bounded) else 1 / Bounded(other))

    def __rtruediv__(self, other: Any) -> Any:
        return self.reciprocal() * other

    def reciprocal(self) -> Bounded:
        """Return 1/x; its derivative is −1/x²."""
        with np.errstate(divide="ignore"):
            inverse = float(1 / np.float64(self.value))
        return self._mapped(inverse, lambda x: -1 / (x * x))

    def __pow__(self, exponent: Any) -> Any:
        if isinstance(exponent, Bounded):
            return (exponent * self.apply("log")).apply("exp")

        def derivative(x: Any) -> Any:
            return exponent * (x ** (exponent - 1) if exponent != 1 else 1.0)

        return self._mapped(self.value**exponent, derivative)

    def __neg__(self) -> Bounded:
        return Bounded(-self.value, self.error, -self.rate, self.rate_error)

    def __abs__(self) -> Bounded:
        return -self if self.value < 0 else self

    __radd__ = __add__
    __rmul__ = __mul__

    def apply(self, name: str) -> Bounded:
        """Apply a function of the expression grammar by name."""
        value = float(getattr(np, name)(self.value))
        return self._mapped(value, lambda x: slope(name, x))

    def _mapped(self, value: float, derivative: Callable[[Any], Any]) -> Bounded:
        """Return f(x) with the rate f′(x)ẋ; an error e of x changes f by |f′(x)| e."""
        with np.errstate(all="ignore"):
            steepness = abs(float(derivative(np.float64(self.value))))
        error = steepness * self.error + LIBRARY_ULPS * UNIT * abs(value)
        if self.rate == 0 and self.rate_error == 0:
            return Bounded(value, error)
        motion = derivative(Bounded(self.value, self.error)) * Bounded(self.rate, self.rate_error)
        if not isinstance(motion, Bounded):  # a slope of exactly 0
            return Bounded(value, error)
        return Bounded(value, error, motion.value, motion.error)


def lifted(values: Array, errors: Any = 0.0, rates: Any = 0.0) -> Array:
    """Convert floats to `Bounded` numbers with given errors and rates."""
    parts = [np.asarray(part, dtype=float) for part in (values, errors, rates)]
    return entrywise(Bounded, *parts)


def value_of(numbers: Array) -> tuple[Array, Array]:
    """Return the values and the bounds of their errors, as floats."""
    errors = entrywise(lambda x: x.error if is_number(x) else 0.0, numbers)
    return floats(numbers), errors.astype(float)


def discrepancy(left: Array, right: Array) -> tuple[float, float]:
    """Return the difference of two results for the same quantity, and its rounding bound.

    Both are taken at the entry with the largest ratio of difference to bound.
    """
    (a, e), (b, f) = value_of(left), value_of(right)
    difference, bound = np.broadcast_arrays(np.abs(a - b), e + f)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(difference == 0, 0.0, difference / bound)
    ratio = np.where(np.isnan(ratio), math.inf, ratio)
    worst = np.unravel_index(ratio.argmax() if ratio.any() else difference.argmax(), ratio.shape)
    return float(difference[worst]), float(bound[worst])


register_symbols(
    Bounded,
    {
        **{name: (lambda x, name=name: x.apply(name)) for name in FUNCTIONS},
        "less": lambda a, b: Bounded.of(a).value < Bounded.of(b).value,
        "where": lambda condition, a, b: a if condition else b,
    },
)
