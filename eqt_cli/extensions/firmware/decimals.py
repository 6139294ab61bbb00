"""Evaluates programs in decimals of many digits, to which rounded results are compared."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from decimal import Context, Decimal, localcontext
from typing import Any

from eqt_cli.base.arrays import Array
from eqt_cli.numbers.program import COMPARISONS, Constant, Input, Program

DIGITS = 60
"""Digits of every operation, so that some 40 are left where a state is near a singularity."""


def evaluated(program: Program, inputs: Mapping[str, Array]) -> dict[str, list[Decimal]]:
    """Return the outputs of a program for doubles, entry by entry; NaN where undefined.

    Values that no `select` chooses may be undefined: no condition is trapped, so that they are NaN
    or infinite, and no comparison with NaN holds.
    """
    values: list[Any] = []
    with localcontext(Context(prec=DIGITS, traps=[], Emin=-(10**6), Emax=10**6)):
        for value in program.values:
            if isinstance(value, Input):
                values.append(Decimal(float(inputs[value.group][value.number])))
            elif isinstance(value, Constant):
                values.append(Decimal(value.number))
            else:
                function = _OPERATIONS[value.name]
                values.append(function(*(values[operand] for operand in value.operands)))
        return {
            output.name: [+values[entry] for entry in output.entries] for output in program.outputs
        }


def _pi() -> Decimal:
    """Return π by Machin's formula."""
    return 4 * (4 * _arctangent(Decimal(1) / 5) - _arctangent(Decimal(1) / 239))


def _summed(first: Decimal, ratio: Callable[[int], Decimal]) -> Decimal:
    """Return a series from its first term, and the ratio of its n-th term to the one before."""
    term = total = first
    n = 0
    while abs(term) > Decimal(10) ** -(DIGITS + 5) * abs(first):
        n += 1
        term *= ratio(n)
        total += term
    return total


def _arctangent(x: Decimal) -> Decimal:
    """Return the arctangent of a number between -1/2 and 1/2."""
    return _summed(x, lambda n: -x * x * (2 * n - 1) / (2 * n + 1))


def _atan(x: Decimal) -> Decimal:
    if x.is_infinite():
        return (_pi() / 2).copy_sign(x)
    for _ in range(3):  # atan x = 2 atan(x / (1 + sqrt(1 + x^2)))
        x = x / (1 + (1 + x * x).sqrt())
    return 8 * _arctangent(x)


def _turned(x: Decimal) -> tuple[Decimal, Decimal]:
    """Return sine and cosine."""
    turn = 2 * _pi()
    x = x - (x / turn).to_integral_value() * turn
    sine = _summed(x, lambda n: -x * x / (2 * n * (2 * n + 1)))
    return sine, _summed(Decimal(1), lambda n: -x * x / (2 * n * (2 * n - 1)))


def _asin(x: Decimal) -> Decimal:
    return _atan(x / (1 - x * x).sqrt())


def _sinh(x: Decimal) -> Decimal:
    if abs(x) < Decimal("0.1"):  # where a difference of exponentials loses digits
        return _summed(x, lambda n: x * x / (2 * n * (2 * n + 1)))
    return (x.exp() - (-x).exp()) / 2


def _cosh(x: Decimal) -> Decimal:
    return (x.exp() + (-x).exp()) / 2


_OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "negative": lambda a: -a,
    "pow": operator.pow,
    "select": lambda holds, a, b: a if holds else b,
    **dict.fromkeys(COMPARISONS, operator.lt),
    "abs": abs,
    "sqrt": lambda x: x.sqrt(),
    "exp": lambda x: x.exp(),
    "log": lambda x: x.ln(),
    "sin": lambda x: _turned(x)[0],
    "cos": lambda x: _turned(x)[1],
    "tan": lambda x: _turned(x)[0] / _turned(x)[1],
    "asin": _asin,
    "acos": lambda x: _pi() / 2 - _asin(x),
    "atan": _atan,
    "sinh": _sinh,
    "cosh": _cosh,
    "tanh": lambda x: _sinh(x) / _cosh(x) if abs(x) < 100 else Decimal(1).copy_sign(x),
    "asinh": lambda x: (abs(x) + (x * x + 1).sqrt()).ln().copy_sign(x),
    "acosh": lambda x: (x + (x * x - 1).sqrt()).ln(),
    "atanh": lambda x: ((1 + x) / (1 - x)).ln() / 2,
}
