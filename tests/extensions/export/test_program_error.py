"""Bounds of rounding: they hold, and they are no more than a hundred times what is seen."""

import mpmath
import numpy as np
import pytest

from eqt_cli.base.arrays import apply, less, sqrt, where
from eqt_cli.extensions.export.program_error import DOUBLE, FLOAT, bounded
from eqt_cli.numbers.program import Constant, Input, traced
from eqt_cli.numbers.rounded import evaluated

NUMPY = {
    "negative": np.negative,
    "select": lambda holds, a, b: np.where(holds, a, b),
    "less": np.less,
    "smooth_less": np.less,
}


def rounded(program, x, dtype):
    """A program by NumPy in some numbers, for all rows at once."""
    values = []
    with np.errstate(all="ignore"):
        for value in program.values:
            if isinstance(value, Input):
                values.append(x[:, value.number].astype(dtype))
            elif isinstance(value, Constant):
                values.append(dtype(value.number))
            else:
                function = NUMPY.get(value.name) or getattr(np, value.name)
                values.append(function(*(values[operand] for operand in value.operands)))
    [output] = program.outputs
    return np.stack([values[entry] for entry in output.entries], axis=-1)


def program_of(function, length):
    return traced(lambda given: {"y": np.asarray(function(given["x"]))}, {"x": length})


def norms(x):
    """Sums, products, a quotient and a root."""
    a, b, c = x
    size = sqrt(a * a + b * b + 1.0)[()]
    return [a * b / size - c, 0.1 * a - size, (a + b) - (a - c)]


@pytest.mark.parametrize("by", [DOUBLE, FLOAT])
def test_a_bound_holds_and_is_near(by):
    program, x = program_of(norms, 3), np.random.default_rng(1).standard_normal((500, 3))
    x = by.rounded(x)
    found = bounded(program, {"x": x}, by)["y"]
    exact = rounded(program, x, np.longdouble if by is DOUBLE else np.float64)
    error = np.abs(rounded(program, x, by.dtype).astype(exact.dtype) - exact)
    assert (error <= found.errors).all()
    assert (found.errors.max(axis=0) < 20 * error.max(axis=0)).all()
    assert not found.singular.any()


def test_errors_of_one_origin_cancel():
    """An error that is magnified a million times, and undone."""

    def forth_and_back(x):
        a, b = x[0] / 3.0, x[1] * 1e6
        return [(a + b) - (b + 1.0)]

    program = program_of(forth_and_back, 2)
    given = {"x": np.array([[1.0, 1.0]])}
    near = bounded(program, given, errors={"x": np.array([[0.0, 1e-3]])})["y"].errors[0, 0]
    assert near < 1e-6  # and not 2e3, by which b may be wrong


def test_a_bound_against_mpmath():
    program = program_of(lambda x: [sqrt(x[0])[()] * x[1]], 2)
    x = np.random.default_rng(2).uniform(0.1, 2, (50, 2))
    found = bounded(program, {"x": x})["y"]
    with mpmath.workdps(40):
        for row, value, bound in zip(x, rounded(program, x, np.float64), found.errors, strict=True):
            exact = mpmath.sqrt(mpmath.mpf(row[0])) * mpmath.mpf(row[1])
            assert abs(mpmath.mpf(value[0]) - exact) <= bound[0]


def test_a_lost_divisor_is_counted_apart():
    program = program_of(lambda x: [1.0 / (x[0] - x[1])], 2)
    x = np.array([[1.0, 0.5], [1.0 + 1e-9, 1.0]])
    found = bounded(program, {"x": x}, errors={"x": 1e-15 * np.ones((2, 2))})["y"]
    assert found.singular.tolist() == [False, True]


def test_a_choice_that_rounding_can_turn_is_counted_apart():
    program = program_of(lambda x: [where(less(x[0] * 3.0, x[1]), 1.0, -1.0)[()]], 2)
    x = np.array([[0.1, 0.2], [0.1, 3 * 0.1], [0.1, 0.4]])
    found = bounded(program, {"x": x})["y"]
    assert found.singular.tolist() == [False, True, False]
    assert found.errors[1, 0] >= 2.0
    assert found.errors[[0, 2], 0].max() == 0.0


def test_a_choice_between_forms_of_one_function_is_not():
    program = program_of(
        lambda x: [where(less(x[0] * 3.0, x[1]), x[0] - x[1], -x[1] + 0.5 * (2.0 * x[0]))[()]], 2
    )
    found = bounded(program, {"x": np.array([[0.1, 3 * 0.1]])})["y"]
    assert not found.singular.any()
    assert found.errors.max() < 1e-15


def test_constants_of_a_float_are_rounded():
    program = program_of(lambda x: [0.1 * x[0]], 1)
    found = bounded(program, {"x": np.array([[1.0]])}, FLOAT)["y"].errors[0, 0]
    assert found >= abs(float(np.float32(0.1)) - 0.1)


def test_the_exact_number_is_within_the_bound():
    program = program_of(lambda x: [x[0] * x[1] - x[1] * x[2] + 0.1], 3)
    x = np.random.default_rng(3).standard_normal((20, 3))
    found = bounded(program, {"x": x})["y"]
    for row, value, bound in zip(x, rounded(program, x, np.float64), found.errors, strict=True):
        [exact] = evaluated(program, {"x": row})["y"]
        assert abs(float(exact) - value[0]) <= bound[0]


def exactly(function, x):
    return evaluated(program_of(function, len(x)), {"x": np.array(x)})["y"]


@pytest.mark.parametrize(
    ("name", "value"),
    [("sin", np.inf), ("asin", 1.5), ("log", -1.0), ("sqrt", -1.0), ("atan", np.nan)],
)
def test_an_exact_number_is_none_where_a_function_is_undefined(name, value):
    assert mpmath.isnan(exactly(lambda x: apply(name, x), [value])[0])


def test_what_is_not_chosen_of_an_exact_number_may_be_undefined():
    def function(x):
        return [where(less(x[0], 1.0), x[1], x[1] / (x[0] - x[2] - 0.5))[()]]

    assert exactly(function, [0.5, 2.0, 0.0]) == [2]
