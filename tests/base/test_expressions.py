"""The expression grammar: Python's arithmetic, and an error with a column for all else."""

from __future__ import annotations

import copy
import math
import pickle
import re
import sys
import warnings

import numpy as np
import pytest
from case_tables import from_yaml
from hypothesis import given
from hypothesis import strategies as st
from said import says

from eqt_cli.base.arrays import FUNCTIONS, register_symbols
from eqt_cli.base.errors import ExpressionError, TraceError
from eqt_cli.base.expressions import MAX_LENGTH, MAX_NESTING, constant, parse
from eqt_cli.numbers.jets import series


def _message(text: str, variables: tuple[str, ...] = ("t",)) -> str:
    with pytest.raises(ExpressionError) as caught:
        parse(text, variables)
    assert f"column {caught.value.column}" in str(caught.value)
    return str(caught.value)


# Values ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *(("1", 1.0), (".5", 0.5), ("1.", 1.0), ("1e-9", 1e-9), ("2.5E+3", 2500.0)),
        *(("pi", math.pi), (" -pi / 2\n", -math.pi / 2), ("2 - 3 - 4", -5.0), ("2/4/2", 0.25)),
        *(("2 + 3*4", 14.0), ("(2 + 3)*4", 20.0), ("-2**2", -4.0), ("(-2)**2", 4.0)),
        *(("2**3**2", 512.0), ("2**-1", 0.5), ("2**-1*3", 1.5), ("2*-3", -6.0), ("--+2", 2.0)),
        *(("-2*-3**2", 18.0), ("exp(1)", math.e), ("abs(-3)", 3.0), ("min(3, 1, 2)", 1.0)),
        *(("max(3, 1, 2)", 3.0), ("sign(-2) + sign(0)", -1.0), ("step(1, 2)", 0.0)),
        *(("step(2, 2)", 1.0), ("smoothstep(2, 1, 3)", 0.5), ("smoothstep(9, 1, 3)", 1.0)),
        *(("atan2(1, -1)", 3 * math.pi / 4), ("atan2(-1, 0)", -math.pi / 2)),
        *(("floor(-2.5)", -3.0), ("mod(-1, 10)", 9.0), ("mod(12.5, 5)", 2.5)),
        *(("pulse(2, 10, 2, 3)", 1.0), ("pulse(13, 10, 2, 3)", 0.0), ("pulse(1, 10, 8, 12)", 1.0)),
        *(("atan2(0, -1)", math.pi), ("where(1 < 2, 3, 4)", 3.0), ("where(2 < 2, 3, 4)", 4.0)),
        *(("where(2 <= 2, 3, 4)", 3.0), ("where(2 > 2, 3, 4)", 4.0)),
        *(("where(2 >= 2, 3, 4)", 3.0), ("where(1 < 2, where(1 > 2, 5, 6), 4)", 6.0)),
    ],
)
def test_constant(text: str, value: float) -> None:
    assert constant(text) == value


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_is_in_the_grammar(name: str) -> None:
    x = 1.5 if name == "acosh" else 0.5
    assert parse(f"{name}(t)").evaluate({"t": x}) == getattr(np, name)(x)


def test_variables_are_those_used() -> None:
    expression = parse("x*sin(x) + 1", ("x", "y"))
    assert expression.variables == {"x"}
    assert expression.evaluate({"x": 0.0, "y": 3.0}) == 1.0


def test_a_variable_may_be_a_word_of_python() -> None:
    assert parse("2*lambda - 1", ("lambda",)).evaluate({"lambda": 3.0}) == 5.0


def test_an_array_gives_an_array() -> None:
    t = np.linspace(0.0, 1.0, 6).reshape(2, 3)
    np.testing.assert_array_equal(parse("cos(t)*t**2").evaluate({"t": t}), np.cos(t) * t**2)


@pytest.mark.parametrize("t", [1, 1.0, np.float64(1.0), np.array(1.0)])
def test_a_scalar_of_any_type_gives_a_float(t: object) -> None:
    value = parse("sin(t)/2").evaluate({"t": t})
    assert isinstance(value, float)
    assert value == np.sin(1.0) / 2


@pytest.mark.parametrize(
    ("text", "t", "value"),
    [
        ("1/t", 0.0, math.inf),
        ("1/t", 0, math.inf),
        ("sqrt(t)", -1.0, math.nan),
        ("t**0.5", -1.0, math.nan),  # Python: a complex number
        ("10**t", 400.0, math.inf),  # Python: OverflowError
    ],
)
def test_evaluation_is_ieee_without_warnings(text: str, t: float, value: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = parse(text).evaluate({"t": t})
    np.testing.assert_equal(result, value)


# Symbols --------------------------------------------------------------------------------------


class _Symbol:
    """Records operations as text; like some symbols, it has no `__rpow__`."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text

    def __neg__(self) -> _Symbol:
        return _Symbol(f"-{self}")

    def __mul__(self, other: object) -> _Symbol:
        return _Symbol(f"({self} * {other})")

    def __rmul__(self, other: object) -> _Symbol:
        return _Symbol(f"({other} * {self})")

    def __rtruediv__(self, other: object) -> _Symbol:
        return _Symbol(f"({other} / {self})")

    def __pow__(self, other: object) -> _Symbol:
        return _Symbol(f"({self} ** {other})")


register_symbols(
    _Symbol, {"sin": lambda x: _Symbol(f"sin({x})"), "exp": lambda x: _Symbol(f"exp({x})")}
)


@pytest.mark.parametrize(
    ("text", "traced"),
    [
        ("t", "t"),
        ("-2*sin(t)**2", "(-2.0 * (sin(t) ** 2.0))"),
        ("1/t", "(1.0 / t)"),
        ("(1 + 1)**t", f"exp((t * {math.log(2)}))"),
    ],
)
def test_a_symbol_gives_a_symbol(text: str, traced: str) -> None:
    expression = parse(text)
    t = _Symbol("t")
    value = expression.evaluate({"t": t})
    assert isinstance(value, _Symbol)
    assert repr(value) == traced
    values = expression.evaluate({"t": np.array([t, t], dtype=object)})
    assert [repr(each) for each in values] == [traced, traced]


def test_a_function_that_the_symbols_lack_is_a_trace_error() -> None:
    with pytest.raises(TraceError, match=r"^cos\(\) is not available for _Symbol symbols"):
        parse("cos(t)").evaluate({"t": _Symbol("t")})


# Errors ---------------------------------------------------------------------------------------

_grammar_like = st.text("0123456789.e+-*/()^, tpisncox_")


@pytest.mark.ci("parses hundreds of texts")
@given(st.text() | _grammar_like)
def test_any_text_is_an_expression_or_an_expression_error(text: str) -> None:
    try:
        parse(text)
    except ExpressionError as caught:
        error = caught
    else:
        return
    assert 1 <= error.column <= len(text) + 1
    assert f"column {error.column}" in str(error)


@from_yaml
def test_message(text: str, message: str) -> None:
    assert says(_message(text), message)


@pytest.mark.parametrize(
    ("text", "column"),
    [
        *(("t if t else 1", 3), ("not t", 1), ("lambda: t", 1), ("None", 1), ("2 is t", 3)),
        *(("'t'", 1), ("1j", 2), ("0x1", 2), ("t.real", 2), ("t[0]", 2), ("(t := 1)", 4)),
        *(("sin(*t)", 5), ("sin(**t)", 5), ("sin(t=1)", 6), ("t(t)", 2), ("sin(t,)", 7)),
        *(("ｔ", 1), ("sin(é", 5), ("t #", 3), ("t\\\n", 2), ("t == t", 3), ("t // 2", 4)),
        *(("1 + (t, 1)", 7), ("where((t < 1) < 2, 1, 2)", 10), ("where(1, t < 2, 3)", 7)),
    ],
)
def test_what_only_python_has_is_refused(text: str, column: int) -> None:
    assert f"column {column}" in _message(text)


def test_long_words_are_shortened() -> None:
    assert _message("x" * 500).startswith(f"unknown name '{'x' * 27}...' at column 1; ")
    assert _message(f"2{'0' * 500}") == f"number '2{'0' * 26}...' at column 1 is too large"


# Limits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("before", "after"), [("(", ")"), ("-", ""), ("2**", ""), ("sin(", ")"), ("1-(", ")")]
)
def test_deep_nesting_is_refused(before: str, after: str) -> None:
    most = MAX_NESTING - 1
    assert parse(f"{before * most}t{after * most}").variables == {"t"}
    for depth in (MAX_NESTING + 1, 200):
        assert re.match(
            f"the expression is nested more than {MAX_NESTING} deep at column ",
            _message(f"{before * depth}t{after * depth}"),
        )


@pytest.mark.parametrize("part", ["-", "2**"])
def test_what_python_cannot_parse_is_refused(part: str) -> None:
    message = _message(part * (MAX_LENGTH // len(part) - 1) + "t")
    assert message == "the expression at column 1 has too many operators in a row"


def test_the_longest_sum_is_right_or_refused() -> None:
    """Python parses it from 3.14 on."""
    terms = MAX_LENGTH // 2
    text = "+".join(["t"] * terms)
    if sys.version_info >= (3, 14):
        assert parse(text).evaluate({"t": 1.0}) == terms
    else:
        assert _message(text) == "the expression at column 1 has too many operators in a row"


def test_nesting_side_by_side_does_not_add_up() -> None:
    assert constant("+".join(["((1))"] * MAX_NESTING)) == MAX_NESTING


def test_a_long_text_is_refused() -> None:
    assert _message("1" * (MAX_LENGTH + 1)) == (
        "the expression goes on at column 10001; expected at most 10000 characters"
    )


def test_a_long_sum_is_no_deep_nesting() -> None:
    expression = parse("+".join(["t"] * 1000))
    assert expression.evaluate({"t": 1.0}) == 1000
    assert copy.deepcopy(expression) == expression
    assert pickle.loads(pickle.dumps(expression)).evaluate({"t": 1.0}) == 1000


def test_expressions_with_equal_text_are_equal() -> None:
    assert parse("sin(t)") == parse("sin(t)")
    assert len({parse("sin(t)"), parse("sin(t)"), parse("cos(t)")}) == 2


def test_atan2_is_that_of_numpy_at_every_size():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, 2000)) * 10.0 ** rng.integers(-150, 150, size=(2, 2000))
    expected = np.arctan2(y, x)
    found = parse("atan2(y, x)", ("x", "y")).evaluate({"x": x, "y": y})
    # Of the quotient, of atan and of the sum: half a unit in the last place each.
    assert (np.abs(found - expected) <= 2 * np.spacing(np.abs(expected))).all()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *(("1/(t - t)", math.inf), ("smoothstep(t, t, t)", math.nan), ("-1/(0*t)", -math.inf)),
        *(("1/(t**0 - 1)", math.inf), ("(t**0 - 1)**-1", math.inf)),
    ],
)
def test_arithmetic_is_that_of_ieee(text: str, value: float) -> None:
    expression = parse(text)
    np.testing.assert_equal(expression.evaluate({"t": 2.0}), value)
    np.testing.assert_equal(float(series(expression, {"t": 2.0}, 2).value), value)


def test_the_variables_of_a_plugin_may_be_a_list():
    assert parse("x + 2*t", ["t", "x"]).evaluate({"t": 1.0, "x": 0.5}) == 2.5
