"""Exact numbers: against fractions, their degrees, their rates, and functions as parameters."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eqt_cli.base import arrays
from eqt_cli.base.arrays import FUNCTIONS, inverse_spd
from eqt_cli.extensions.proofs.exact import (
    Exact,
    Ledger,
    NotRationalError,
    difference,
    free,
    inverse,
    noting,
    rate_of,
    with_rate,
)
from eqt_cli.numbers.jets import slope

integers = st.integers(-50, 50)
others = integers.filter(bool)


def moving(value, rate):
    return free(value).moving(free(rate))


def ledger():
    values = iter(range(3, 10_000, 7))
    return Ledger(lambda: free(next(values)))


def is_zero(left, right):
    return not difference(left, right).numerator


@settings(max_examples=30)
@given(x=integers, y=others, z=integers, c=st.floats(-10, 10, allow_subnormal=False))
def test_arithmetic_is_that_of_fractions(x, y, z, c):
    a, b, d = map(free, (x, y, z))
    p, q, r = map(Fraction, (x, y, z))
    found = (a / b - c) * (d + 2 / b) - 3 * a**2 / 4 + d**-0.0
    assert found.value == (p / q - Fraction(c)) * (r + 2 / q) - 3 * p**2 / 4 + 1


@settings(max_examples=30)
@given(x=integers, y=others, u=integers, v=integers)
def test_rates_of_products_and_quotients(x, y, u, v):
    a, b = moving(x, u), moving(y, v)
    assert (a * b).derivative().value == x * v + y * u
    assert (a / b).derivative().value == Fraction(u * y - x * v, y * y)
    assert (1 / b**2).derivative().value == Fraction(-2 * v, y**3)


def line(function, s):
    """The numerator of a function of three parameters on a line through them."""
    return function(free(5 + 2 * s), free(11 + s), free(7 + 3 * s)).numerator


@pytest.mark.parametrize(
    ("degree", "function"),
    [
        (1, lambda x, y, z: x + 2 * y - 1),
        (3, lambda x, y, z: x * y * z + x),
        (2, lambda x, y, z: x / y + z),
        (4, lambda x, y, z: x / y + y / z + 1 / (y * z)),
        (2, lambda x, y, z: (x / y) / (z / y) + x),
        (2, lambda x, y, z: x / (y / z) + 1),
        (4, lambda x, y, z: (x / (1 + y * y)) ** 2 + 1),
        (6, lambda x, y, z: (x / (1 + y * y)) ** 2 + z * (y / (1 + y * y))),
    ],
)
def test_degree_is_that_of_the_cleared_numerator(degree, function):
    found = function(free(5), free(11), free(7)).degree
    assert found == degree
    values = [line(function, s) for s in range(degree + 2)]
    # A polynomial of degree d in s has the difference 0 of order d + 1, and here not of order d.
    assert np.diff(np.array(values, dtype=object), degree + 1).tolist() == [0]


def test_fractions_with_one_divisor_have_one_denominator():
    scale = 1 + free(7) * free(7)
    a, b = free(3) / scale, free(4) / scale
    assert (a + b).degree == 1
    assert (a * a + b * b).degree == 2
    assert (1 + a).degree == 2


def test_what_is_constant_is_so_for_all_states():
    assert (Exact.of(0.5) + 1).is_constant
    assert not (free(0) * free(1)).is_constant
    assert not Exact(0).moving(free(1)).is_constant
    assert free(3) * 0.0 == 0


def test_floats_are_the_dyadic_numbers_that_they_are():
    assert (free(1) * np.int64(3)).value == 3
    assert (free(1) * 0.1).value == Fraction(3602879701896397, 36028797018963968)


@pytest.mark.parametrize("x", [np.inf, np.nan])
def test_what_is_no_number_is_refused(x):
    with pytest.raises(ValueError, match=f"^{x} cannot be used in exact arithmetic$"):
        free(1) + x


def test_an_inverse_and_its_rate():
    rates = np.array([[1, 2], [0, -1]], dtype=object)
    A = with_rate(np.array([[free(4), free(1)], [free(2), free(3)]]), rates)
    found = inverse_spd(A)
    product = A @ found
    for index in np.ndindex(2, 2):
        assert is_zero(product[index], float(index[0] == index[1]))
        assert is_zero(rate_of(product)[index], 0.0)
    # Cramer's rule: cofactors of degree 1 over a determinant of degree 2.
    assert {entry.degree for entry in found.flat} == {1}
    assert (found[0, 0] + free(1)).degree == 3


def test_what_must_not_vanish_is_counted():
    """Of an inverse, both leading minors, of degrees 1 and 2, and the determinant."""
    known = ledger()
    with noting(known):
        inverse(np.array([[free(4), free(1)], [free(2), free(3)]]))
    assert known.degree == 1 + 2 + 2
    with noting(known):
        assert (1 / (free(2) * free(3))).degree == 0
    assert known.degree == 1 + 2 + 2 + 2


def test_an_inverse_of_fractions():
    scale = 1 + free(3)
    A = np.array([[[free(5) / scale, Exact.of(0.5)], [0.0, free(7) / 3]]], dtype=object)
    found = inverse(A)
    assert found[0, 0, 0].value == Fraction(4, 5)
    assert found[0, 1, 1].value == Fraction(3, 7)
    assert found[0, 0, 1].value == -Fraction(1, 2) * Fraction(4, 5) * Fraction(3, 7)


def test_a_singular_matrix_is_drawn_again():
    with pytest.raises(ZeroDivisionError):
        inverse(np.array([[free(1), free(2)], [free(2), free(4)]]))


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x: abs(x), "the absolute value of a state is not rational"),
        (lambda x: x < 1, "a comparison of a state is not rational"),
        (lambda x: bool(x == 2), "a comparison of a state is not rational"),
        (lambda x: float(x), "the float of a state is not rational"),
        (lambda x: x**0.3, "the power 0.3 of a state is not rational"),
        (lambda x: x**x, "the power 2 of a state is not rational"),
        (lambda x: arrays.tanh(np.array([x]))[0], "tanh() of a state is not rational"),
    ],
)
def test_what_is_not_rational_is_named(function, message):
    with pytest.raises(NotRationalError) as error:
        function(free(2))
    assert str(error.value) == message


def test_constants_are_compared():
    assert Exact.of(2) > 1
    assert arrays.clip(np.array([Exact.of(2)]), 0.0, 1.5)[0] == 1.5
    assert abs(Exact.of(-2)) == 2
    assert Exact.of(2).moving(free(1)) > 1
    with pytest.raises(NotRationalError):  # it leaves the kink at once
        Exact.of(1).moving(free(1)) > 1  # noqa: B015  it raises


# Functions as parameters --------------------------------------------------------------------------


def test_a_function_of_equal_arguments_is_one_parameter():
    x, y = free(3), free(4)
    with noting(ledger()):
        assert is_zero(((x + y) ** 2).apply("tanh"), (x * x + 2 * x * y + y * y).apply("tanh"))
        assert not is_zero(x.apply("tanh"), y.apply("tanh"))
        assert not is_zero(x.apply("tanh"), x.apply("atan"))


def test_what_is_compared_is_counted():
    known = ledger()
    with noting(known):
        (free(3) * free(4)).apply("log")
        free(12).apply("log")
    assert (known.compared, known.functions) == (2, {"log"})


def test_functions_of_one_argument_know_each_other():
    x = free(3)
    with noting(ledger()):
        sine, cosine, tangent = map(x.apply, ("sin", "cos", "tan"))
        assert is_zero(sine**2 + cosine**2, 1)
        assert is_zero(tangent * cosine, sine)
        even, odd, growth = map(x.apply, ("cosh", "sinh", "exp"))
        assert is_zero(even + odd, growth)
        assert is_zero(odd / even, x.apply("tanh"))


@pytest.mark.parametrize(
    ("name", "slope"),
    [
        ("tanh", lambda x: 1 - x.apply("tanh") ** 2),
        ("sin", lambda x: x.apply("cos")),
        ("log", lambda x: 1 / x),
        ("sqrt", lambda x: 1 / (2 * x.apply("sqrt"))),
    ],
)
def test_rates_of_functions(name, slope):
    with noting(ledger()):
        found = moving(7, 5).apply(name).derivative()
        assert is_zero(found, 5 * free(1) / free(1) * slope(free(7)))


def test_roots_are_reduced_by_their_equation():
    x, y = free(3), free(5)
    with noting(ledger()):
        one, two = (1 + x * x).apply("sqrt"), (y / x).apply("sqrt")
        assert is_zero(one * one, 1 + x * x)
        assert is_zero(x * two**2, y)
        assert is_zero((one + two) * (one - two), 1 + x * x - y / x)
        assert is_zero((1 / (one + two)) * (one + two), 1)
        assert not is_zero(one * two, two)
        assert one.degree == 1


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_is_known_at_0_is_no_parameter(name):
    if name in ("log", "acos", "acosh", "abs", "sqrt"):
        pytest.skip("its value at 0 is none, not rational, or its rate is none")
    known = ledger()
    with noting(known):
        found = Exact(0).moving(free(5)).apply(name)
    assert known.functions == set()
    assert found.value == getattr(np, name)(0.0)
    assert found.derivative().value == 5 * slope(name, 0.0)


def test_a_root_of_a_square_of_a_constant_is_rational():
    assert Exact.of(2.25).apply("sqrt") == 1.5


def test_a_norm_is_off_zero():
    with noting(ledger()):
        v = np.array([free(3), free(4)])
        assert is_zero(arrays.norm(v) ** 2, 25)
        with pytest.raises(ZeroDivisionError):
            arrays.norm(np.array([free(0), free(0)]))
