"""Evaluates programs with many digits, to which rounded results are compared."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import Any

import mpmath

from eqt_cli.base.arrays import FUNCTIONS, Array
from eqt_cli.numbers.program import COMPARISONS, Constant, Input, Program

DIGITS = 60
"""Digits of every operation, so that some 40 are left where a state is near a singularity."""


def evaluated(program: Program, inputs: Mapping[str, Array]) -> dict[str, list[mpmath.mpf]]:
    """Return the outputs of a program for doubles, entry by entry; NaN where undefined.

    Values that no `select` chooses may be undefined: no comparison with NaN holds.
    """
    values: list[Any] = []
    with mpmath.workdps(DIGITS):
        for value in program.values:
            if isinstance(value, Input):
                values.append(mpmath.mpf(float(inputs[value.group][value.number])))
            elif isinstance(value, Constant):
                values.append(mpmath.mpf(value.number))
            else:
                values.append(_real(value.name, [values[operand] for operand in value.operands]))
        return {output.name: [values[k] for k in output.entries] for output in program.outputs}


def _real(name: str, operands: list[Any]) -> Any:
    """Return the value of an operation; NaN where it is not real."""
    try:
        value = _OPERATIONS[name](*operands)
    except ZeroDivisionError:
        value = mpmath.sign(operands[0]) * mpmath.inf  # NaN for 0/0
    return mpmath.nan if isinstance(value, mpmath.mpc) else value


_OPERATIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(mpmath, name, abs) for name in FUNCTIONS},
    **dict.fromkeys(COMPARISONS, operator.lt),
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "negative": operator.neg,
    "pow": operator.pow,
    "select": lambda holds, a, b: a if holds else b,
}
