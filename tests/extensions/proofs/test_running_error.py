"""Numbers with rates and error bounds, against exact fractions and against differences."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eqt_cli.base import arrays
from eqt_cli.base.arrays import FUNCTIONS, frobenius, inverse_spd, maximum, norm
from eqt_cli.extend import parse
from eqt_cli.extensions.proofs.exact import Bounded, discrepancy, lifted, rate_of, value_of
from eqt_cli.numbers.jets import slope

# Exact sums and products of such numbers neither overflow nor underflow.
# The bounds are sums of rounded terms, and so true to their own last digits.
NEARLY = Fraction(1 + 1e-12)
numbers = st.floats(-100, 100, allow_subnormal=False).map(lambda x: round(x, 6))


@given(x=numbers, y=numbers, z=numbers)
def test_error_bound_covers_the_rounding_of_a_polynomial(x, y, z):
    a, b, c = (Bounded(v) for v in (x, y, z))
    p, q, r = (Fraction(v) for v in (x, y, z))
    found = (a - b) * (a + b * c) - 3 * c * c + 0.1
    exact = (p - q) * (p + q * r) - 3 * r * r + Fraction(0.1)
    assert abs(Fraction(found.value) - exact) <= Fraction(found.error) * NEARLY


@given(x=numbers, y=st.floats(0.5, 50))
def test_error_bound_covers_the_rounding_of_a_quotient(x, y):
    found = (Bounded(x) - 1) / Bounded(y)
    exact = (Fraction(x) - 1) / Fraction(y)
    assert abs(Fraction(found.value) - exact) <= Fraction(found.error) * NEARLY


@given(x=numbers, y=numbers, e=st.floats(1e-9, 1e-3), f=st.floats(1e-9, 1e-3))
def test_error_bound_covers_the_errors_of_the_inputs(x, y, e, f):
    found = Bounded(x, e) * Bounded(y, f)
    for sign, other in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        exact = (Fraction(x) + sign * Fraction(e)) * (Fraction(y) + other * Fraction(f))
        assert abs(Fraction(found.value) - exact) <= Fraction(found.error) * NEARLY


@given(x=numbers, y=numbers, u=numbers, v=numbers)
def test_rate_of_a_product_and_its_bound(x, y, u, v):
    found = Bounded(x, rate=u) * Bounded(y, rate=v)
    exact = Fraction(x) * Fraction(v) + Fraction(y) * Fraction(u)
    assert abs(Fraction(found.rate) - exact) <= Fraction(found.rate_error) * NEARLY


@pytest.mark.parametrize("name", FUNCTIONS)
def test_rate_of_every_function(name):
    x = 1.5 if name == "acosh" else 0.5
    found = Bounded(x, rate=2.0).apply(name)
    assert found.value == getattr(np, name)(x)
    assert found.rate == pytest.approx(2 * slope(name, x), rel=1e-14)


@pytest.mark.parametrize("exponent", [1, 2, 3, 0.5, -1])
def test_rate_of_powers(exponent):
    found = Bounded(2.0, rate=3.0) ** exponent
    assert found.value == 2.0**exponent
    assert found.rate == pytest.approx(3 * exponent * 2.0 ** (exponent - 1), rel=1e-15)


@given(x=st.floats(0.5, 3), y=st.floats(-2, 2), u=st.floats(-1, 1), v=st.floats(-1, 1))
def test_rate_of_a_power_whose_exponent_moves(x, y, u, v):
    found = Bounded(x, rate=u) ** Bounded(y, rate=v)
    expected = x**y * (v * np.log(x) + y * u / x)
    assert found.value == pytest.approx(x**y, rel=1e-14)
    assert found.rate == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_slope_of_zero_leaves_no_rate():
    assert Bounded(0.0, rate=1.0).apply("cos").rate == 0.0


def test_functions_of_arrays_take_them():
    x = lifted(np.array([[3.0, 0.0], [0.0, 4.0]]))
    assert value_of(frobenius(x))[0] == 5.0
    assert value_of(norm(x))[0].tolist() == [3.0, 4.0]
    assert value_of(maximum(x, 3.5))[0].tolist() == [[3.5, 3.5], [3.5, 4.0]]
    assert value_of(arrays.clip(x, 0.5, 3.5))[0].tolist() == [[3.0, 0.5], [0.5, 3.5]]


def test_expressions_take_them():
    t = lifted(np.array([0.5, 2.0]), rates=1.0)
    found = parse("2*sin(t) + t**3 + 2**t").evaluate({"t": t})
    time = np.array([0.5, 2.0])
    expected = 2 * np.cos(time) + 3 * time**2 + np.log(2) * 2**time
    np.testing.assert_allclose(value_of(rate_of(found))[0], expected, rtol=1e-14)


def test_an_inverse_carries_its_rate():
    """d(A⁻¹)/dt = −A⁻¹ Ȧ A⁻¹."""
    A, rate = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([[0.5, 0.1], [0.1, -0.3]])
    found = inverse_spd(lifted(A, rates=rate))
    inverse = np.linalg.inv(A)
    difference, bound = discrepancy(found, inverse)
    assert difference <= bound + 1e-15  # the reference is LAPACK's, with rounding of its own
    np.testing.assert_allclose(value_of(rate_of(found))[0], -inverse @ rate @ inverse, atol=1e-15)


def test_discrepancy_is_the_largest_in_proportion():
    left = lifted(np.array([1.0, 2.0]), np.array([1e-3, 1e-9]))
    assert discrepancy(left, np.array([1.0005, 2.0 + 1e-8])) == pytest.approx((1e-8, 1e-9))


def test_discrepancy_of_what_is_not_a_number_is_not_within_its_bound():
    difference, bound = discrepancy(lifted(np.array([np.nan])), np.array([0.0]))
    assert not difference <= bound


def test_discrepancy_without_any_bound_is_exact_equality():
    assert discrepancy(np.array([0.0, 2.0]), np.array([0.0, 2.0])) == (0.0, 0.0)
