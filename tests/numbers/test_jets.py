"""Derivatives of expressions and series in time, on floats, arrays and symbols."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eqt_cli.base.arrays import FUNCTIONS, apply, cross, dot, norm, sqrt, stack, where
from eqt_cli.extend import parse
from eqt_cli.numbers.jets import Jet, series, slope, value_and_derivative
from eqt_cli.numbers.program import traced

# Smooth on all of R, so that composites have no poles; all are analytic, as a complex step needs.
SMOOTH = ["sin", "cos", "atan", "tanh", "exp"]
STEP = 1e-20

COMPLEX = {name: getattr(np, name) for name in ("sin", "cos", "tanh", "exp")} | {"atan": np.arctan}


@st.composite
def expressions(draw, depth=3):
    """Text of a smooth expression in t, and the same as a function of a complex number."""
    if depth == 0 or draw(st.booleans()):
        if draw(st.booleans()):
            return "t", lambda t: t
        number = draw(st.integers(1, 9)) / 4
        return f"{number}", lambda t: number + 0 * t
    kind = draw(st.sampled_from(["+", "-", "*", "/", "**", "call", "negation"]))
    left, f = draw(expressions(depth=depth - 1))
    if kind == "call":
        name = draw(st.sampled_from(SMOOTH))
        # tanh keeps exp(exp(exp(t))) finite.
        return f"{name}(tanh({left}))", lambda t: COMPLEX[name](np.tanh(f(t)))
    if kind == "negation":
        return f"(-({left}))", lambda t: -f(t)
    if kind == "**":
        power = draw(st.integers(1, 3))
        return f"({left})**{power}", lambda t: f(t) ** power
    right, g = draw(expressions(depth=depth - 1))
    if kind == "/":
        return f"({left})/(2 + ({right})**2)", lambda t: f(t) / (2 + g(t) ** 2)
    combine = {"+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": lambda a, b: a * b}[kind]
    return f"({left}){kind}({right})", lambda t: combine(f(t), g(t))


@given(pair=expressions(), t=st.floats(-1.5, 1.5))
def test_derivative_is_that_of_a_complex_step(pair, t):
    text, function = pair
    value, derivative = value_and_derivative(parse(text), {"t": t})
    stepped = complex(function(np.complex128(complex(t, STEP))))
    # Both are exact but for the rounding of a dozen operations.
    assert value == pytest.approx(stepped.real, rel=1e-12, abs=1e-12)
    assert derivative == pytest.approx(stepped.imag / STEP, rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_slope_of_every_function(name):
    x = 1.5 if name == "acosh" else 0.5
    f, h = getattr(np, name), 1e-4
    difference = (8 * (f(x + h) - f(x - h)) - (f(x + 2 * h) - f(x - 2 * h))) / (12 * h)
    # Five points: h⁴|f⁽⁵⁾|/30 ~ 1e-15, rounding ε/h ~ 2e-12.
    assert slope(name, x) == pytest.approx(difference, rel=1e-10)


@pytest.mark.parametrize(
    ("text", "at", "expected"),
    [
        *(("t**t", 2.0, 4 * (math.log(2) + 1)), ("2**t", 3.0, 8 * math.log(2))),
        *(("t**0", 5.0, 0.0), ("t**1", 0.0, 1.0), ("t**2", 0.0, 0.0), ("1/t", 2.0, -0.25)),
        *(("abs(t)", -3.0, -1.0), ("abs(t)", 0.0, 1.0), ("sqrt(t)", 4.0, 0.25), ("3", 1.0, 0.0)),
        *(("-t", 1.0, -1.0), ("t - t - t", 1.0, -1.0)),
    ],
)
def test_derivative_where_a_rule_could_go_wrong(text, at, expected):
    _, derivative = value_and_derivative(parse(text), {"t": at})
    assert derivative == pytest.approx(expected, rel=1e-15, abs=0)


@pytest.mark.parametrize(
    ("text", "at", "expected"),
    [
        *(("min(t, t**2)", 0.5, (0.25, 1.0, 2.0)), ("max(t, t**2)", 0.5, (0.5, 1.0, 0.0))),
        *(("sign(t)*t**2", -2.0, (-4.0, 4.0, -2.0)), ("step(t, 1)*t**2", 2.0, (4.0, 4.0, 2.0))),
        ("smoothstep(t, 1, 3)", 2.0, (0.5, 0.75, 0.0)),
        ("smoothstep(t, 1, 3)", 1.5, (0.15625, 0.5625, 0.75)),
        ("smoothstep(t, 1, 3)", 4.0, (1.0, 0.0, 0.0)),
        # (ẏx − yẋ)/(x² + y²) = ((1 − t)2t + t² − 2)/((1 − t)² + (t² − 2)²), and its derivative.
        ("atan2(t**2 - 2, 1 - t)", 0.0, (math.atan2(-2, 1), -0.4, 0.24)),
        ("atan2(t**2 - 2, 1 - t)", 1.0, (-math.pi / 2, -1.0, -4.0)),
        ("atan2(t**2 - 2, 1 - t)", 2.0, (math.atan2(2, -1), -0.4, 1.04)),
        ("where(t < 1, t, t**3)", 2.0, (8.0, 12.0, 12.0)),
        ("2", 2.0, (2.0, 0.0, 0.0)),
        ("2**t", 0.0, (1.0, math.log(2), math.log(2) ** 2)),
        ("t**t", 1.0, (1.0, 1.0, 2.0)),
    ],
)
def test_second_derivatives(text, at, expected):
    for t in (at, np.array([at, at])):
        found = series(parse(text), {"t": t}, 2)
        for k, derivative in enumerate(expected):
            np.testing.assert_allclose(found.derivative(k), derivative, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "expected"), [("log(t)", math.inf), ("1/t", -math.inf), ("sqrt(t)", math.inf)]
)
def test_poles_are_infinite_as_in_arithmetic(text, expected):
    assert value_and_derivative(parse(text), {"t": 0.0})[1] == expected


def test_what_does_not_vary_costs_nothing_and_hides_no_infinity():
    value, derivative = value_and_derivative(parse("0*log(t) + 1"), {"t": 0.0})
    assert math.isnan(value) and math.isnan(derivative)  # 0·inf is not taken for 0
    assert value_and_derivative(parse("sqrt(2)*pi"), {"t": 1.0})[1] == 0.0


def test_other_variables_are_constants():
    expression = parse("a*t + a**2", ("t", "a"))
    assert value_and_derivative(expression, {"t": 2.0, "a": 3.0})[1] == 3.0


def test_arrays_are_differentiated_entry_by_entry():
    t = np.linspace(0.1, 2.0, 7)
    value, derivative = value_and_derivative(parse("sin(t)*t"), {"t": t})
    np.testing.assert_allclose(value, np.sin(t) * t, rtol=1e-15)
    np.testing.assert_allclose(derivative, np.cos(t) * t + np.sin(t), rtol=1e-14)


def test_long_sums_do_not_exhaust_the_stack():
    text = " + ".join(["t"] * 2000)
    assert value_and_derivative(parse(text), {"t": 1.0}) == (2000.0, 2000.0)


# Truncated Taylor series in time ------------------------------------------------------------------


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
    # Of the truncation.
    np.testing.assert_allclose(found.derivative(2), curve, rtol=1e-6, atol=1e-6)
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
    longer = Jet.time(np.array([-1.0, 2.0]), 3)
    for chosen in (
        where(apply("less", t, 0.0), t, longer),
        where(apply("less", t, 0.0), longer, t),
    ):
        assert chosen.order == 2
        np.testing.assert_array_equal(chosen.derivative(1), [1.0, 1.0])


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


@pytest.mark.parametrize("exponent", ["1e7", "101", "-1e7"])
def test_a_large_power_has_the_derivatives_of_its_formula(exponent):
    """n, n (n − 1), …; its products one by one would take minutes."""
    n, found = float(exponent), series(parse(f"t**{exponent}"), {"t": 1.0}, 3)
    expected = [1.0, n, n * (n - 1), n * (n - 1) * (n - 2)]
    found = [found.derivative(k) for k in range(4)]
    np.testing.assert_allclose(found, expected, rtol=1e-14)
