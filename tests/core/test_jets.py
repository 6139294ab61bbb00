"""Truncated Taylor series in time, on floats, arrays and symbols."""

import math

import numpy as np
import pytest

from eqt_cli.core.arrays import apply, cross, dot, norm, sqrt, stack, where
from eqt_cli.core.expressions import parse
from eqt_cli.core.jets import Jet
from eqt_cli.program import traced

ORDER = 4


def derivatives(function, at):
    """Derivatives 0 to 4 by Cauchy's integral on a circle, to rounding."""
    radius, count = 0.2, 64
    turn = np.exp(2j * np.pi * np.arange(count) / count)
    values = function(at + radius * turn)
    return [
        math.factorial(k) * (values * turn**-k).mean().real / radius**k for k in range(ORDER + 1)
    ]


CLOSED = {
    "t**3 - 2*t/(1 + t**2)": lambda t: t**3 - 2 * t / (1 + t**2),
    "sin(2*t)*exp(-t)": lambda t: np.sin(2 * t) * np.exp(-t),
    "sqrt(2 + cos(t)) + t**0": lambda t: np.sqrt(2 + np.cos(t)) + 1,
    "(1 + t)**1.5/(2 + t)**-2": lambda t: (1 + t) ** 1.5 * (2 + t) ** 2,
    "2**t + (1 + t)**t": lambda t: 2**t + (1 + t) ** t,
    "tanh(t) + atan(t/2)": lambda t: np.tanh(t) + np.arctan(t / 2),
    "log(3 + t)**0.5": lambda t: np.sqrt(np.log(3 + t)),
}


@pytest.mark.parametrize("text", CLOSED)
def test_derivatives_of_expressions(text):
    found = parse(text).evaluate({"t": Jet.time(0.4, ORDER)})
    # The circle divides rounding by 0.2⁴/4!, so by 7e-5.
    for k, expected in enumerate(derivatives(CLOSED[text], 0.4)):
        assert found.derivative(k) == pytest.approx(expected, rel=1e-10, abs=1e-10)


def test_zeros_by_structure_cost_nothing_and_stay():
    t = Jet.time(2.0, ORDER)
    assert (3.0 * t + 1.0).coefficients == (7.0, 3.0, None, None, None)
    assert (t * t).coefficients[3:] == (None, None)
    assert apply("sin", Jet([1.0, None, None])).coefficients[1:] == (None, None)
    # 0 · inf does not occur: the constant has no derivative.
    assert (t + Jet([np.inf, *[None] * ORDER])).derivative(1) == 1.0


def test_arrays_of_runs():
    """|a(t) × M b(t)| of polynomials, against differences of their values."""
    rng = np.random.default_rng(1)
    a, b, M = rng.normal(size=(3, 5, 3)), rng.normal(size=(3, 5, 3)), rng.normal(size=(5, 3, 3))

    def function(a, b):
        c = (M @ cross(a, b)[..., None])[..., 0]
        return stack([norm(c), dot(a, c), sqrt(2.0 + dot(b, b))])

    def at(x):
        return function(*(p[0] + p[1] * x + p[2] * x**2 for p in (a, b)))

    found, h = function(Jet(a), Jet(b)), 1e-3
    np.testing.assert_allclose(found.value, at(0.0), rtol=1e-14)
    slope = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)
    np.testing.assert_allclose(found.derivative(1), slope, rtol=1e-7, atol=1e-7)
    curve = (16 * (at(h) + at(-h)) - (at(2 * h) + at(-2 * h)) - 30 * at(0.0)) / (12 * h**2)
    np.testing.assert_allclose(
        found.derivative(2), curve, rtol=1e-6, atol=1e-6
    )  # of the truncation
    np.testing.assert_array_equal(found.rate.value, found.derivative(1))


def test_a_series_is_extended_by_the_derivative_that_it_gives():
    """ẍ = −x from x(0) = 0, ẋ(0) = 1 is the sine."""
    x = Jet.of([0.0, 1.0])
    while x.order < 6:
        x = x.extended((-x).derivative(x.order - 1))
    assert [x.derivative(k) for k in range(7)] == pytest.approx([0, 1, 0, -1, 0, 1, 0])


def test_a_choice_has_the_derivatives_of_the_chosen():
    t = Jet.time(np.array([-1.0, 2.0]), 2)
    found = where(apply("less", t, 0.0), t * t, 3.0)
    np.testing.assert_array_equal(found.derivative(1), [-2.0, 0.0])
    np.testing.assert_array_equal(found.derivative(2), [2.0, 0.0])


def test_traced_it_costs_what_derivatives_by_hand_cost():
    def by_hand(x, v):
        size = norm(x)
        n = x / size[..., None]
        rate = dot(n, v)
        n1 = (v - n * rate[..., None]) / size[..., None]
        bend = dot(n1, v)
        n2 = -(2 * rate[..., None] * n1 + bend[..., None] * n) / size[..., None]
        return np.stack([n, n1, n2])

    def by_series(x, v):
        n = Jet([x, v, None])
        n = n / norm(n)[..., None]
        return np.stack([n.derivative(k) for k in range(3)])

    x, v = np.random.default_rng(2).normal(size=(2, 7, 3))
    np.testing.assert_allclose(by_series(x, v), by_hand(x, v), rtol=1e-13, atol=1e-14)
    costs = [
        traced(
            lambda given, of=of: {"n": of(given["x"][None], given["v"][None])}, {"x": 3, "v": 3}
        ).operations
        for of in (by_series, by_hand)
    ]
    assert costs[0] <= 1.4 * costs[1]


def test_numpy_functions_are_refused_by_name():
    with pytest.raises(TypeError, match=r"numpy\.concatenate"):
        np.concatenate([Jet([np.ones(2)]), np.ones(2)])
