"""Exact numbers that carry their time derivative, and their degree in the parameters, through laws.

A number is a fraction n / (c D) of integers: n is the value of a polynomial at integer parameters,
c a constant, and D a product of divisors, each of which is such a polynomial, too. Beside n stands
a bound of the polynomial's degree, which each operation computes from those of its operands.
Divisors are kept as factors, so that the fractions of one rotation, or of one inverse, have one
denominator; nothing is cancelled that is not a factor by construction. It knows no law.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from math import gcd, isfinite, isqrt, prod
from typing import Any

import numpy as np

from eqt_cli.analysis.evidence.numbers import Number, with_rate
from eqt_cli.core.arrays import FUNCTIONS, Array, register_symbols
from eqt_cli.core.errors import TraceError


class NotRationalError(TraceError):
    """An operation on the state that is none of + − × ÷, so that no polynomial decides it."""


class Divisor:
    """A polynomial that something was divided by: its value at the parameters, and its degree."""

    __slots__ = ("degree", "value")

    def __init__(self, value: int, degree: int) -> None:
        self.value, self.degree = value, degree
        if _divisors:
            _divisors[-1].append(self)


_divisors: list[list[Divisor]] = []


@contextmanager
def noting(divisors: list[Divisor]) -> Iterator[None]:
    """Note every divisor that is made within."""
    _divisors.append(divisors)
    try:
        yield
    finally:
        _divisors.pop()


Factors = Mapping[Divisor, int]
"""Divisors with their powers."""

_NONE: Factors = {}


class Exact(Number):
    """n / (c D), and its rate of change.

    Attributes
    ----------
    numerator
        n, the value of a polynomial.
    degree
        A bound of the polynomial's degree in the parameters; one of degree 0 is a constant.
    constant
        c > 0.
    factors
        D.
    rate
        Itself without a rate; None where the number does not move.
    """

    __slots__ = ("_divisor", "constant", "degree", "factors", "numerator", "rate")

    def __init__(
        self,
        numerator: int,
        degree: int = 0,
        constant: int = 1,
        factors: Factors = _NONE,
        rate: Exact | None = None,
    ) -> None:
        self.numerator, self.degree, self.constant = numerator, degree, constant
        self.factors, self.rate = factors, rate
        self._divisor: Divisor | None = None

    @classmethod
    def of(cls, x: Any) -> Exact:
        """A float is the dyadic number that it is."""
        if isinstance(x, Exact):
            return x
        if isinstance(x, float | np.floating) and not isfinite(x):
            raise ValueError(f"{x} is no number to compute with exactly")
        numerator, denominator = x.as_integer_ratio()
        return cls(int(numerator), 0, int(denominator))

    @property
    def value(self) -> Fraction:
        """The number without its rate."""
        return Fraction(self.numerator, self.constant * _value(self.factors))

    @property
    def is_constant(self) -> bool:
        """Whether it is the same for all parameters, and does not move."""
        return not self.degree and not self.factors and self.rate is None

    # The contract of all numbers.

    @property
    def nearest(self) -> float:
        """Rounded once."""
        return float(self.value)

    def derivative(self) -> Exact:
        """0 where the number does not move."""
        return ZERO if self.rate is None else self.rate

    def moving(self, rate: Exact) -> Exact:
        """A rate of 0 is none."""
        still = rate._still()
        return self._with(None if still._is_zero() else still)

    def granted(self, error: float) -> Exact:
        """There is none to grant."""
        return self

    def _still(self) -> Exact:
        return self if self.rate is None else self._with(None)

    def _with(self, rate: Exact | None) -> Exact:
        found = Exact(self.numerator, self.degree, self.constant, self.factors, rate)
        found._divisor = self._divisor
        return found

    def _is_zero(self) -> bool:
        """Whether it is 0 for all parameters: a polynomial of degree 0 is the same everywhere."""
        return not self.numerator and not self.degree and self.rate is None

    # Arithmetic.

    def __add__(self, other: Any) -> Exact:
        if not isinstance(other, Exact):
            if other == 0:
                return self
            other = Exact.of(other)
        if other._is_zero():
            return self
        if self._is_zero():
            return other
        total = _sum(self, other)
        if self.rate is not None or other.rate is not None:
            total.rate = _added(self.rate, other.rate)
        return total

    def __mul__(self, other: Any) -> Any:
        if not isinstance(other, Exact):
            if other == 0:
                return 0
            if other == 1:
                return self
            other = Exact.of(other)
        if self._is_zero() or other._is_zero():
            return 0
        product = _product(self, other)
        if self.rate is not None or other.rate is not None:
            product.rate = _added(
                None if other.rate is None else _product(self, other.rate),
                None if self.rate is None else _product(other, self.rate),
            )
        return product

    def __truediv__(self, other: Any) -> Any:
        other = Exact.of(other)
        quotient = _quotient(self, other)
        if other.rate is not None:
            # (a/b)˙ = (ȧ − (a/b) ḃ) / b.
            change = -_product(quotient, other.rate)
            quotient.rate = _quotient(_added(self.rate, change), other)
        elif self.rate is not None:
            quotient.rate = _quotient(self.rate, other)
        return quotient

    def __rtruediv__(self, other: Any) -> Any:
        return Exact.of(other) / self

    def __neg__(self) -> Exact:
        rate = None if self.rate is None else -self.rate
        return Exact(-self.numerator, self.degree, self.constant, self.factors, rate)

    def __sub__(self, other: Any) -> Exact:
        return self + -other

    def __rsub__(self, other: Any) -> Exact:
        return -self + other

    def __pow__(self, exponent: Any) -> Any:
        power = Exact.of(exponent)
        if not power.is_constant or power.constant != 1:
            raise NotRationalError(f"the power {_written(exponent)} of a state is not rational")
        found: Any = 1
        for _ in range(abs(power.numerator)):
            found = self * found
        return 1 / found if power.numerator < 0 else found

    __radd__ = __add__
    __rmul__ = __mul__

    # What branches: the same for all states only where constants are compared.

    def _constant(self, what: str, *, moves: bool = False) -> Fraction:
        if self.degree or self.factors or not (moves or self.rate is None):
            raise NotRationalError(f"{what} of a state is not rational")
        return self.value

    def _against(self, other: Any) -> tuple[Fraction, Fraction]:
        what, other = "a comparison", Exact.of(other)
        found = [x._constant(what, moves=True) for x in (self, other)]
        if found[0] == found[1]:  # what moves is equal for an instant only
            found = [x._constant(what) for x in (self, other)]
        return found[0], found[1]

    def __lt__(self, other: Any) -> bool:
        a, b = self._against(other)
        return a < b

    def __le__(self, other: Any) -> bool:
        a, b = self._against(other)
        return a <= b

    def __gt__(self, other: Any) -> bool:
        return not self <= other

    def __ge__(self, other: Any) -> bool:
        return not self < other

    def __eq__(self, other: object) -> bool:
        if not hasattr(other, "as_integer_ratio") and not isinstance(other, Exact):
            return NotImplemented
        a, b = self._against(other)
        return a == b

    __hash__ = object.__hash__

    def __abs__(self) -> Exact:
        return Exact.of(abs(self._constant("the absolute value")))

    def __bool__(self) -> bool:
        return bool(self._constant("a comparison"))

    def __float__(self) -> float:
        return float(self._constant("the float"))

    def apply(self, name: str) -> Exact:
        """A function of the expression grammar, by name, where its value is rational."""
        if name == "abs":
            return abs(self)
        if name == "sqrt" and not self.degree and not self.factors:
            return self._root()
        raise NotRationalError(f"{name}() of a state is not rational")

    def _root(self) -> Exact:
        """The root of a constant that is a square; its rate is ẋ / 2√x."""
        reduced = Fraction(self.numerator, self.constant)
        roots = [isqrt(max(part, 0)) for part in reduced.as_integer_ratio()]
        if Fraction(*roots) ** 2 != reduced:
            raise NotRationalError(f"sqrt({_written(reduced)}) is not rational")
        root = Exact(roots[0], 0, roots[1])
        return root if self.rate is None else root._with(_quotient(self.rate, _product(TWO, root)))


ZERO, TWO = Exact(0), Exact(2)


def free(value: int) -> Exact:
    """A parameter with this value."""
    return Exact(value, 1)


def difference(left: Any, right: Any) -> Exact:
    """Left − right of two entries, which may be floats."""
    found: Exact = Exact.of(left) - Exact.of(right)
    return found


def inverse(matrix: Array) -> Array:
    """A⁻¹ = adj A / det A, ``(..., m, m)``, with the degrees of Cramer's rule; −A⁻¹ȦA⁻¹ its rate."""
    stacked = matrix.reshape(-1, *matrix.shape[-2:])
    return np.stack([_inverse(each) for each in stacked]).reshape(matrix.shape)


def _inverse(matrix: Array) -> Array:
    entries = [[Exact.of(x) for x in row] for row in matrix]
    flat = [x for row in entries for x in row]
    factors, constant = flat[0].factors, flat[0].constant
    for x in flat[1:]:
        factors, constant = _common(factors, x.factors), _multiple(constant, x.constant)
    rows = [[_over(x, factors, constant) for x in row] for row in entries]
    degree = max(x.degree + _degree(_beyond(factors, x.factors)) for x in flat)
    adjugate, determinant = _adjugate(rows, degree)
    n = len(rows)
    over = Exact(determinant, n * degree)
    scale = Exact(constant * _value(factors), _degree(factors))
    cofactors = np.empty((n, n), dtype=object)
    for i, j in np.ndindex(n, n):
        cofactor = Exact(adjugate[i][j], (n - 1) * degree)
        cofactors[i, j] = _quotient(_product(cofactor, scale), over)
    rates = np.array([[x.derivative() for x in row] for row in entries], dtype=object)
    if all(x.rate is None for x in flat):
        return cofactors
    return with_rate(cofactors, -(cofactors @ rates @ cofactors))


def _adjugate(rows: list[list[int]], degree: int) -> tuple[list[list[int]], int]:
    """Of a matrix of integers, by elimination without fractions (Bareiss).

    Its pivots are the leading minors, of which none may vanish.
    """
    n = len(rows)
    work = [[*row, *(int(i == j) for j in range(n))] for i, row in enumerate(rows)]
    before = 1
    for k in range(n):
        pivot = work[k][k]
        if not pivot:
            raise ZeroDivisionError("a leading minor vanishes")
        Divisor(pivot, (k + 1) * degree)  # is noted
        for i in range(n):
            if i != k:
                factor = work[i][k]
                work[i] = [
                    (pivot * a - factor * b) // before
                    for a, b in zip(work[i], work[k], strict=True)
                ]
        before = pivot
    return [row[n:] for row in work], before


# Fractions without their rates ------------------------------------------------------------------


def _sum(a: Exact, b: Exact) -> Exact:
    if a.factors is b.factors and a.constant == b.constant:
        return Exact(a.numerator + b.numerator, max(a.degree, b.degree), a.constant, a.factors)
    factors = a.factors if a.factors is b.factors else _common(a.factors, b.factors)
    constant = _multiple(a.constant, b.constant)
    degree = max(x.degree + _degree(_beyond(factors, x.factors)) for x in (a, b))
    numerator = sum(_over(x, factors, constant) for x in (a, b))
    return Exact(numerator, degree, constant, factors)


def _product(a: Exact, b: Exact) -> Exact:
    return Exact(
        a.numerator * b.numerator,
        a.degree + b.degree,
        a.constant * b.constant,
        _joined(a.factors, b.factors),
    )


def _quotient(a: Exact, b: Exact) -> Exact:
    if not b.numerator:
        raise ZeroDivisionError("a denominator vanishes")
    sign = -1 if b.numerator < 0 else 1
    if not b.degree and not b.factors:
        return _product(a, Exact(sign * b.constant, 0, abs(b.numerator)))
    over, under = _beyond(b.factors, a.factors), _beyond(a.factors, b.factors)
    numerator = a.numerator * b.constant * _value(over)
    degree = a.degree + _degree(over)
    if not b.degree:
        return _product(
            Exact(numerator, degree, a.constant, under), Exact(sign, 0, abs(b.numerator))
        )
    if b._divisor is None:
        b._divisor = Divisor(b.numerator, b.degree)
    return Exact(numerator, degree, a.constant, _joined(under, {b._divisor: 1}))


def _added(a: Exact | None, b: Exact | None) -> Any:
    if a is None or b is None:
        return b if a is None else a
    return _sum(a, b)


def _over(x: Exact, factors: Factors, constant: int) -> int:
    """The numerator over a multiple of the denominator."""
    found = x.numerator * (constant // x.constant)
    return found if factors is x.factors else found * _value(_beyond(factors, x.factors))


def _value(factors: Factors) -> int:
    return prod(each.value**power for each, power in factors.items())


def _degree(factors: Factors) -> int:
    return sum(each.degree * power for each, power in factors.items())


def _joined(a: Factors, b: Factors) -> Factors:
    if not a or not b:
        return a or b
    return {**a, **{each: a.get(each, 0) + power for each, power in b.items()}}


def _common(a: Factors, b: Factors) -> Factors:
    if not a or not b:
        return a or b
    return {**a, **{each: max(a.get(each, 0), power) for each, power in b.items()}}


def _beyond(a: Factors, b: Factors) -> Factors:
    """What of a is not in b."""
    if not b:
        return a
    return {each: power - b.get(each, 0) for each, power in a.items() if power > b.get(each, 0)}


def _multiple(a: int, b: int) -> int:
    return a if a == b else a * b // gcd(a, b)


def _written(number: Any) -> str:
    return str(number.value) if isinstance(number, Exact) else str(number)


register_symbols(
    Exact,
    {
        **{name: (lambda x, name=name: x.apply(name)) for name in FUNCTIONS},
        "less": lambda a, b: Exact.of(a) < Exact.of(b),
        "where": lambda condition, a, b: a if condition else b,
        "inverse": inverse,
    },
)
