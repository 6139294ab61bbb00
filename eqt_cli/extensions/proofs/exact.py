"""Exact numbers and bounds of rounding errors, by which identities are proved."""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from functools import reduce, total_ordering
from math import isfinite, isqrt, prod
from typing import Any, TypeAlias

import numpy as np

from eqt_cli.base.arrays import FUNCTIONS, Array, register_symbols
from eqt_cli.base.errors import TraceError
from eqt_cli.numbers.jets import slope

# Numbers that carry their time derivative through any law, and the rounded ones among them --------
#
# The laws of eqt run on object arrays of symbols. With `Bounded` numbers as symbols, one evaluation
# gives a value, its exact derivative along a motion (forward mode), and bounds of the rounding
# errors of both by a running error analysis (Higham, Accuracy and Stability of Numerical
# Algorithms, section 3.3), to first order in the errors. `exact` has the numbers without rounding.


class Number:
    """A number that carries its time derivative through any law.

    A kind of numbers has the arithmetic of laws, and

    - ``of(x)``: converts a float or a number of this kind to this kind;
    - ``nearest``: the nearest float or its neighbour;
    - ``derivative()``: the rate of change as a number without a rate;
    - ``moving(rate)``: the same value with another rate.

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


def entrywise(function: Any, *arrays: Any) -> Array:
    """Return the values of a function at the entries of arrays, broadcast against each other."""
    return np.asarray(np.frompyfunc(function, len(arrays), 1)(*arrays), dtype=object)


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
        return self._mapped(float(getattr(np, name)(self.value)), lambda x: slope(name, x))

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
    return entrywise(Bounded, *[np.asarray(part, dtype=float) for part in (values, errors, rates)])


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


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: (lambda x, name=name: x.apply(name)) for name in FUNCTIONS},
    "where": lambda condition, a, b: a if condition else b,
}
"""Functions of arrays that all kinds of numbers share."""

register_symbols(
    Bounded, _FUNCTIONS | {"less": lambda a, b: Bounded.of(a).value < Bounded.of(b).value}
)


# Exact numbers that carry their time derivative, and their degree in the parameters, through laws -
#
# A number is a quotient n / D: n is the value at integer parameters of a polynomial with rational
# coefficients, and D a product of divisors, each of which is the value of such a polynomial. Each
# number carries a bound of the degree of n, which every operation computes from those of its
# operands. Divisors are stored as factors, so that the fractions of one rotation, or of one
# inverse, share a denominator. Only factors known by construction are cancelled.
#
# A function of the state that is not rational becomes a free parameter for each argument, with the
# function's derivative: sides that are equal for all values of the parameter are equal for its
# actual value. A square root is also reduced by its equation r² = x.


class Root:
    """r with r² = E."""

    __slots__ = ("square",)

    def __init__(self, square: Fraction) -> None:
        self.square = square


class Surd:
    """A sum of fractions times products of roots; without any root it is a fraction instead."""

    __slots__ = ("terms",)

    def __init__(self, terms: dict[frozenset[Root], Rational]) -> None:
        self.terms = terms

    def __add__(self, other: WithRoots) -> WithRoots:
        terms = dict(self.terms)
        for roots, number in _terms(other).items():
            terms[roots] = terms.get(roots, 0) + number
        return _simplified(terms)

    def __mul__(self, other: WithRoots) -> WithRoots:
        terms: dict[frozenset[Root], Rational] = {}
        for one, a in self.terms.items():
            for two, b in _terms(other).items():
                squares = prod((root.square for root in one & two), start=a * b)
                terms[one ^ two] = terms.get(one ^ two, 0) + squares
        return _simplified(terms)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> Surd:
        return Surd({roots: -number for roots, number in self.terms.items()})

    def conjugate(self, root: Root) -> Surd:
        """Return the sum with −r in place of r."""
        return Surd({roots: -n if root in roots else n for roots, n in self.terms.items()})


Rational: TypeAlias = int | Fraction
WithRoots: TypeAlias = Rational | Surd


def _terms(number: WithRoots) -> dict[frozenset[Root], Rational]:
    return number.terms if isinstance(number, Surd) else {frozenset(): number}


def _simplified(terms: dict[frozenset[Root], Rational]) -> WithRoots:
    left = {roots: number for roots, number in terms.items() if number}
    return Surd(left) if left.keys() - {frozenset()} else left.get(frozenset(), 0)


class NotRationalError(TraceError):
    """An operation on the state that is not rational, so that no polynomial decides it."""


class Divisor:
    """A polynomial used as divisor: its value at the parameters, and its degree."""

    __slots__ = ("degree", "value")

    def __init__(self, value: Rational, degree: int) -> None:
        self.value, self.degree = value, degree
        _assume_not_zero(degree)


class Ledger:
    """Records the assumptions of a computation from a state.

    Attributes
    ----------
    parameter
        Draws a new parameter.
    degree
        Degree of the product of all polynomials assumed not to be 0, such as divisors.
    compared
        Sum of the degrees of all differences between two arguments of a function.
    functions
        Functions that became parameters.
    """

    def __init__(self, parameter: Callable[[], Exact]) -> None:
        self.parameter = parameter
        self.degree = 0
        self.compared = 0
        self.functions: set[str] = set()
        self._values: dict[str, list[tuple[Exact, Exact]]] = {}

    def value(self, kind: str, argument: Exact, new: Callable[[], Exact]) -> Exact:
        """Return the parameter for a function of this argument: a known or a new one."""
        entries = self._values.setdefault(kind, [])
        for other, value in entries:
            gap = _sum(argument, -other)
            self.compared += gap.degree
            if not gap.numerator:
                return value
        entries.append((argument, new()))
        return entries[-1][1]


_ledgers: list[Ledger] = []


def _assume_not_zero(degree: int) -> None:
    """Record that a polynomial of this degree is assumed not to be 0."""
    if _ledgers:
        _ledgers[-1].degree += degree


@contextmanager
def noting(ledger: Ledger) -> Iterator[None]:
    """Record the assumptions made within the block."""
    _ledgers.append(ledger)
    try:
        yield
    finally:
        _ledgers.pop()


Factors = Counter[Divisor]
"""Divisors with their powers, which no number changes."""

_NONE: Factors = Counter()


@total_ordering
class Exact(Number):
    """n / D, and its rate of change.

    Attributes
    ----------
    numerator
        n, the value of a polynomial.
    degree
        Bound of the degree of n in the parameters; a polynomial of degree 0 is constant.
    factors
        D as divisors with powers.
    rate
        The rate of change, a number without a rate; None for a number that does not change.
    """

    __slots__ = ("_cleared", "_divisor", "degree", "factors", "numerator", "rate")

    def __init__(
        self,
        numerator: WithRoots,
        degree: int = 0,
        factors: Factors = _NONE,
        rate: Exact | None = None,
    ) -> None:
        self.numerator, self.degree = numerator, degree
        self.factors, self.rate = factors, rate
        self._divisor: Divisor | None = None
        self._cleared: tuple[Exact, Exact] | None = None

    @classmethod
    def of(cls, x: Any) -> Exact:
        """Convert a number; a float becomes the exact dyadic fraction."""
        if isinstance(x, Exact):
            return x
        if isinstance(x, float | np.floating) and not isfinite(x):
            raise ValueError(f"{x} cannot be used in exact arithmetic")
        # Whole numbers are integers, which are faster than fractions.
        return cls(int(x) if x == int(x) else Fraction(x))

    @property
    def value(self) -> Fraction:
        """The number without its rate; only for numbers without roots."""
        return Fraction(_rational(self.numerator), _value(self.factors))

    @property
    def is_constant(self) -> bool:
        """Whether it is equal for all parameters and constant."""
        return not self.degree and not self.factors and self.rate is None

    @property
    def nearest(self) -> float:
        """The nearest float."""
        return float(self.value)

    def derivative(self) -> Exact:
        """Return the rate, or 0."""
        return ZERO if self.rate is None else self.rate

    def moving(self, rate: Exact) -> Exact:
        """Return the number with another rate; a rate of 0 is dropped."""
        still = rate._still()
        return self._with(None if still._is_zero() else still)

    def _still(self) -> Exact:
        return self if self.rate is None else self._with(None)

    def _with(self, rate: Exact | None) -> Exact:
        other = Exact(self.numerator, self.degree, self.factors, rate)
        other._divisor, other._cleared = self._divisor, self._cleared
        return other

    def _without_roots(self) -> tuple[Exact, Exact]:
        """Return the product of all conjugates, and the number times that product."""
        if self._cleared is None:
            factor: WithRoots = 1
            product, times = self.numerator, 1
            while isinstance(product, Surd):
                roots = next(roots for roots in product.terms if roots)
                conjugate = product.conjugate(next(iter(roots)))
                product, factor, times = product * conjugate, factor * conjugate, 2 * times
            self._cleared = (
                Exact(factor, (times - 1) * self.degree),
                Exact(product, times * self.degree, self.factors),
            )
        return self._cleared

    def _is_zero(self) -> bool:
        """Whether it is 0 for all parameters, because a polynomial of degree 0 is constant."""
        return not self.numerator and not self.degree and self.rate is None

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
            quotient.rate = _quotient(_added(self.rate, -_product(quotient, other.rate)), other)
        elif self.rate is not None:
            quotient.rate = _quotient(self.rate, other)
        return quotient

    def __rtruediv__(self, other: Any) -> Any:
        return Exact.of(other) / self

    def __neg__(self) -> Exact:
        rate = None if self.rate is None else -self.rate
        return Exact(-self.numerator, self.degree, self.factors, rate)

    def __pow__(self, exponent: Any) -> Any:
        power = Exact.of(exponent)
        if not power.is_constant or (2 * power.value).denominator != 1:
            shown = power.value if isinstance(exponent, Exact) else exponent
            raise NotRationalError(f"the power {shown} of a state is not rational")
        whole, half = divmod(abs(2 * power.value), 2)
        product: Any = self.apply("sqrt") if half else 1
        for _ in range(int(whole)):
            product = self * product
        return 1 / product if power.value < 0 else product

    __radd__ = __add__
    __rmul__ = __mul__

    # Branches are the same for all states only if constants are compared.

    def _constant(self, what: str, *, moves: bool = False) -> Fraction:
        if self.degree or self.factors or not (moves or self.rate is None):
            raise NotRationalError(f"{what} of a state is not rational")
        return self.value

    def _against(self, other: Any) -> tuple[Fraction, Fraction]:
        what, other = "a comparison", Exact.of(other)
        a, b = (x._constant(what, moves=True) for x in (self, other))
        if a == b:  # equal values with rates are equal only for an instant
            a, b = (x._constant(what) for x in (self, other))
        return a, b

    def __lt__(self, other: Any) -> bool:
        a, b = self._against(other)
        return a < b

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
        """Apply a function of the expression grammar by name; its rate is f′(x)ẋ."""
        if name == "abs":
            return abs(self)
        argument = self._still()
        value = _root(argument) if name == "sqrt" else _free_value(name, argument)
        if self.rate is None:
            return value
        return value.moving(Exact.of(slope(name, argument) * self.rate))


ZERO = Exact(0)


def free(value: int) -> Exact:
    """Return a parameter with this value."""
    return Exact(value, 1)


def difference(left: Any, right: Any) -> Exact:
    """Return left − right of two entries, which may be floats."""
    return Exact.of(left) - Exact.of(right)


def inverse(matrix: Array) -> Array:
    """Return A⁻¹ = adj A / det A, ``(..., m, m)``, with the degrees of Cramer's rule.

    Its rate is −A⁻¹ȦA⁻¹.
    """
    stacked = matrix.reshape(-1, *matrix.shape[-2:])
    return np.stack([_inverse(matrix) for matrix in stacked]).reshape(matrix.shape)


def _inverse(matrix: Array) -> Array:
    entries, n = entrywise(Exact.of, matrix), len(matrix)
    factors = reduce(operator.or_, (x.factors for x in entries.flat))
    over_all = [[_over(x, factors) for x in row] for row in entries]
    rows = [[Fraction(_rational(numerator)) for numerator, _ in row] for row in over_all]
    degree = max(degree for row in over_all for _, degree in row)
    adjugate, determinant = _adjugate(rows, degree)
    over = Exact(determinant, n * degree)
    scale = Exact(_value(factors), _degree(factors))
    cofactors = np.empty((n, n), dtype=object)
    for i, j in np.ndindex(n, n):
        cofactor = Exact(adjugate[i][j], (n - 1) * degree)
        cofactors[i, j] = _quotient(_product(cofactor, scale), over)
    if all(x.rate is None for x in entries.flat):
        return cofactors
    return with_rate(cofactors, -(cofactors @ rate_of(entries) @ cofactors))


def _adjugate(rows: list[list[Fraction]], degree: int) -> tuple[list[list[Fraction]], Fraction]:
    """Return adjugate and determinant of a matrix by elimination without quotients (Bareiss).

    The pivots are the leading minors, none of which may vanish.
    """
    n = len(rows)
    work = [[*row, *(Fraction(i == j) for j in range(n))] for i, row in enumerate(rows)]
    before = Fraction(1)
    for k in range(n):
        pivot = work[k][k]
        if not pivot:
            raise ZeroDivisionError("a leading minor vanishes")
        _assume_not_zero((k + 1) * degree)
        for i in range(n):
            if i != k:
                factor = work[i][k]
                pairs = zip(work[i], work[k], strict=True)
                work[i] = [(pivot * a - factor * b) / before for a, b in pairs]
        before = pivot
    return [row[n:] for row in work], before


# Functions ----------------------------------------------------------------------------------------


def _root(x: Exact) -> Exact:
    """Return √x: a rational number if x is the square of a constant, else √(n D) / D."""
    numerator = _rational(x.numerator)
    if not x.degree and not x.factors:
        root = Fraction(*(isqrt(max(part, 0)) for part in numerator.as_integer_ratio()))
        if root**2 == numerator:
            return Exact(root)
    square = Fraction(numerator * _value(x.factors))
    degree = x.degree + _degree(x.factors)

    def new() -> Exact:
        return Exact(Surd({frozenset([Root(square)]): 1}), -(-degree // 2), x.factors)

    return _noted("sqrt").value("sqrt", x, new)


def _free_value(name: str, x: Exact) -> Exact:
    """Return a parameter, or an expression in one that related functions of an argument share."""
    if x._is_zero() and name in _AT_ZERO:
        return Exact(_AT_ZERO[name])
    ledger = _noted(name)
    if name in ("sin", "cos", "tan"):
        half = ledger.value("tan(x/2)", x, ledger.parameter)
        sine, cosine, scale = 2 * half, 1 - half * half, 1 + half * half
        if name == "tan":
            return _quotient(sine, cosine)
        return _quotient(sine if name == "sin" else cosine, scale)
    if name in ("exp", "sinh", "cosh", "tanh"):
        growth = ledger.value("exp(x)", x, ledger.parameter)
        square, twice = growth * growth, 2 * growth
        quotients = {
            "exp": (growth, Exact(1)),
            "sinh": (square - 1, twice),
            "cosh": (square + 1, twice),
            "tanh": (square - 1, square + 1),
        }
        return _quotient(*quotients[name])
    return ledger.value(name, x, ledger.parameter)


_AT_ZERO = {
    **dict.fromkeys("sin tan asin atan sinh tanh asinh atanh floor".split(), 0),
    **dict.fromkeys("cos cosh exp".split(), 1),
}
"""Values at 0, which need no parameter."""


def _noted(name: str) -> Ledger:
    if not _ledgers:
        raise NotRationalError(f"{name}() of a state is not rational")
    _ledgers[-1].functions.add(name)
    return _ledgers[-1]


# Fractions without their rates ------------------------------------------------------------------


def _sum(a: Exact, b: Exact) -> Exact:
    if a.factors is b.factors or a.factors == b.factors:
        return Exact(a.numerator + b.numerator, max(a.degree, b.degree), a.factors)
    factors = a.factors | b.factors
    (left, left_degree), (right, right_degree) = (_over(x, factors) for x in (a, b))
    return Exact(left + right, max(left_degree, right_degree), factors)


def _product(a: Exact, b: Exact) -> Exact:
    factors = a.factors + b.factors if a.factors and b.factors else a.factors or b.factors
    return Exact(a.numerator * b.numerator, a.degree + b.degree, factors)


def _quotient(a: Exact, b: Exact) -> Exact:
    if not b.numerator:
        raise ZeroDivisionError("a denominator vanishes")
    if isinstance(b.numerator, Surd):
        factor, product = b._without_roots()
        return _quotient(_product(a, factor), product)
    over, under = b.factors - a.factors, a.factors - b.factors
    numerator, degree = a.numerator * _value(over), a.degree + _degree(over)
    if not b.degree:
        return Exact(numerator * Fraction(1, b.numerator), degree, under)
    if b._divisor is None:
        b._divisor = Divisor(b.numerator, b.degree)
    return Exact(numerator, degree, under + Counter([b._divisor]))


def _added(a: Exact | None, b: Exact | None) -> Any:
    if a is None or b is None:
        return b if a is None else a
    return _sum(a, b)


def _rational(number: WithRoots) -> Rational:
    if isinstance(number, Surd):
        raise NotRationalError(
            "a root of a root, or in a matrix that is inverted, is not supported"
        )
    return number


def _over(x: Exact, factors: Factors) -> tuple[WithRoots, int]:
    """Return the numerator over a multiple of the denominator, and its degree."""
    missing = factors - x.factors
    return x.numerator * _value(missing), x.degree + _degree(missing)


def _value(factors: Factors) -> Rational:
    return prod(factor.value**power for factor, power in factors.items())


def _degree(factors: Factors) -> int:
    return sum(factor.degree * power for factor, power in factors.items())


def _off_zero(squares: Any) -> bool:
    """Return True: states with a norm of 0 are excluded, like those with a denominator of 0."""
    squares = Exact.of(squares)
    if not squares.numerator:
        raise ZeroDivisionError("a norm vanishes")
    _assume_not_zero(squares.degree)
    return True


def _at_once(x: Any) -> Fraction:
    """Return a constant without its rate: where two values are equal, both smooth forms hold."""
    return Exact.of(x)._constant("a comparison", moves=True)


register_symbols(
    Exact,
    _FUNCTIONS
    | {
        "less": lambda a, b: Exact.of(a) < Exact.of(b),
        "smooth_less": lambda a, b: _at_once(a) < _at_once(b),
        "positive": _off_zero,
        "inverse": inverse,
    },
)
