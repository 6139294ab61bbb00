"""Programs with many digits, entry by entry against single calls."""

import mpmath
import numpy as np
import pytest

from eqt_cli.base import arrays
from eqt_cli.base.arrays import FUNCTIONS, less, where
from eqt_cli.extensions.firmware.program_error import evaluated
from eqt_cli.numbers.program import traced

ARGUMENTS = {
    "acosh": [1.0, 1.25, 40.0],
    "asinh": [-1e9, 1e-9, 37.0],
    "asin": [-1.0, 1e-9, 0.7],
    "acos": [-1.0, 1e-9, 0.7],
    "atanh": [-0.9, 1e-9, 0.7],
    "log": [1e-9, 1.25, 1e9],
    "atan": [-2.5, 0.0, 1e-9, 37.0],
    "sinh": [-2.5, -0.05, 0.0, 1e-30, 0.07, 37.0],
    "sin": [-2.5, 1e-70, 1e4],
    "sqrt": [0.0, 1e-9, 2.0],
    "tanh": [-1e9, 1e-9, 37.0],
}


def program(function, length=3):
    return traced(lambda given: {"y": function(given["x"])}, {"x": length})


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_has_forty_digits(name):
    x = np.array(ARGUMENTS.get(name, [-2.5, 1e-9, 37.0]))
    found = evaluated(program(lambda x: arrays.apply(name, x), len(x)), {"x": x})["y"]
    with mpmath.workdps(60):
        function = abs if name == "abs" else getattr(mpmath, name)
        for each, value in zip(x, found, strict=True):
            exact = function(mpmath.mpf(float(each)))
            assert abs(mpmath.mpf(str(value)) - exact) <= mpmath.mpf(10) ** -40 * abs(exact)


def test_operations_and_choices_are_exact():
    def function(x):
        a, b, c = x
        chosen = where(less(a, b), a * b - c / a, b)[()]
        return np.array([chosen, a**0.3, -a, a + c, 2.5 - b], dtype=object)

    found = evaluated(program(function), {"x": np.array([0.1, 0.7, -3.0])})["y"]
    with mpmath.workdps(60):
        a, b, c = map(mpmath.mpf, (0.1, 0.7, -3.0))
        exact = [a * b - c / a, a ** mpmath.mpf(0.3), -a, a + c, 2.5 - b]
        for value, expected in zip(found, exact, strict=True):
            assert abs(mpmath.mpf(str(value)) - expected) <= mpmath.mpf(10) ** -40


def test_numbers_beyond_the_range_of_doubles_are_kept():
    x = np.array([1e300, 1e-300, 2.0])
    found = evaluated(program(lambda x: x * x * x), {"x": x})["y"]
    assert [round(float(mpmath.log10(value))) for value in found] == [900, -900, 1]


def test_an_arctangent_of_infinity_is_half_of_pi():
    found = evaluated(
        program(lambda x: arrays.apply("atan", x[:2] / x[2])[()], 3),
        {"x": np.array([1.0, -1.0, 0.0])},
    )
    np.testing.assert_allclose([float(x) for x in found["y"]], [np.pi / 2, -np.pi / 2])


UNDEFINED = {
    "sin": [np.inf, np.nan],
    "cos": [-np.inf, np.nan],
    "asin": [1.5, np.nan],
    "log": [-1.0, np.nan],
    "sqrt": [-1.0, np.nan],
    "atan": [np.nan, np.nan],
}


@pytest.mark.parametrize("name", UNDEFINED)
def test_a_function_is_not_a_number_where_it_is_undefined(name):
    x = np.array(UNDEFINED[name])
    found = evaluated(program(lambda x: arrays.apply(name, x), len(x)), {"x": x})["y"]
    assert [mpmath.isnan(value) for value in found] == [True, True]


def test_a_root_of_a_negative_number_is_undefined_and_one_of_zero_is_zero():
    x = np.array([-2.0, 0.0, 4.0])
    found = evaluated(program(lambda x: x**1.5), {"x": x})["y"]
    assert mpmath.isnan(found[0])
    assert found[1:] == [0, 8]


@pytest.mark.parametrize(
    ("a", "b", "holds"),
    [(1.0, 2.0, 1), (2.0, 1.0, 0), (1.0, 1.0, 0), (np.nan, 1.0, 0), (1.0, np.nan, 0)],
)
def test_no_comparison_with_an_equal_number_or_with_none_holds(a, b, holds):
    def function(x):
        return np.array([where(less(x[0], x[1]), 1.0, x[2])[()]], dtype=object)

    assert evaluated(program(function), {"x": np.array([a, b, 0.0])})["y"] == [holds]


def test_what_is_not_chosen_may_be_undefined():
    def function(x):
        return np.array(
            [where(less(x[0], 1.0), x[1], x[1] / (x[0] - x[2] - 0.5))[()]], dtype=object
        )

    assert evaluated(program(function), {"x": np.array([0.5, 2.0, 0.0])})["y"] == [2]
