"""Numbers that a configuration fixes, beyond double precision and rounded once.

The last bits of BLAS, LAPACK and the C library's functions depend on the processor. What is
computed here does not, so a configuration fixes the same numbers on every machine.
"""

import operator
from collections.abc import Callable
from fractions import Fraction
from functools import cache, lru_cache, reduce
from typing import Any

import numpy as np

from eqt_cli.base.arrays import FUNCTIONS, Array, Arrays, inverse_spd
from eqt_cli.numbers.program import COMPARISONS, Constant, Input, Program, traced

# Matrices in exact fractions ----------------------------------------------------------------------


def fractions(matrix: Array) -> Array:
    """Return the numbers of an array as exact fractions."""
    return np.array([*map(Fraction, matrix.ravel().tolist())], object).reshape(matrix.shape)


def inverse(matrix: Array) -> Array:
    """Return the inverse of a symmetric positive definite matrix, ``(m, m)``, rounded once."""
    return inverse_spd(fractions(matrix)).astype(float)


def product(*matrices: Array) -> Array:
    """Return the product of matrices, rounded once."""
    return reduce(operator.matmul, map(fractions, matrices)).astype(float)


def pseudo_inverse(matrix: Array, rank: int) -> Array:
    """Return the pseudo-inverse of a matrix, ``(m, k)``, rounded once.

    Rows of zeros do not count. If neither the other rows nor the columns are independent, which
    `rank` tells, it is LAPACK's.
    """
    return _pseudo_inverse(matrix.tobytes(), matrix.shape, rank).copy()


def is_exact(matrix: Array) -> bool:
    """Whether `pseudo_inverse` needs no LAPACK: its rows but zeros, or columns, are independent."""
    rows = matrix[matrix.any(axis=1)]
    return int(np.linalg.matrix_rank(rows)) == min(rows.shape)


@lru_cache(maxsize=64)  # runs whose other numbers are drawn have the same
def _pseudo_inverse(entries: bytes, shape: tuple[int, ...], rank: int) -> Array:
    matrix = np.frombuffer(entries).reshape(shape)
    rows = np.flatnonzero(matrix.any(axis=1))
    B, result = fractions(matrix[rows]), np.zeros(shape[::-1])
    if rank == len(rows):
        result[:, rows] = B.T @ inverse_spd(B @ B.T)
    elif rank == shape[1]:
        result[:, rows] = inverse_spd(B.T @ B) @ B.T
    else:
        result[:, rows] = np.linalg.pinv(matrix[rows], rcond=1e-12)
    return result


# Functions with many digits -----------------------------------------------------------------------


DIGITS = 60
"""Digits of every operation, so that some 40 are left where a state is near a singularity."""


def rounded(function: Callable[..., Array], *arrays: Array) -> Array:
    """Return what a function of arrays returns, computed with `DIGITS` and rounded once.

    It must be one that can be traced, as laws are.
    """

    def of_symbols(inputs: dict[str, Array]) -> Arrays:
        # With a batch axis of one: without any, a symbol is no array.
        pairs = zip(inputs.values(), arrays, strict=True)
        return {"result": function(*(pair.reshape(1, *array.shape) for pair, array in pairs))[0]}

    numbers = {str(k): array.ravel() for k, array in enumerate(arrays)}
    program = traced(of_symbols, {name: len(entries) for name, entries in numbers.items()})
    values = evaluated(program, numbers)["result"]
    return np.array([*map(float, values)]).reshape(program.outputs[0].shape)


def evaluated(program: Program, inputs: Arrays) -> dict[str, list[Any]]:
    """Return the outputs of a program for doubles as `mpf`, entry by entry; NaN where undefined.

    Values that no `select` chooses may be undefined: no comparison with NaN holds.
    """
    import mpmath  # slow to import, and most configurations need none

    values: list[Any] = []
    with mpmath.workdps(DIGITS):
        for value in program.values:
            if isinstance(value, Input):
                values.append(mpmath.mpf(float(inputs[value.group][value.number])))
            elif isinstance(value, Constant):
                values.append(mpmath.mpf(value.number))
            else:
                operands = [values[operand] for operand in value.operands]
                try:
                    number = _operations()[value.name](*operands)
                except ZeroDivisionError:
                    number = mpmath.sign(operands[0]) * mpmath.inf  # NaN for 0/0
                # NaN where it is not real
                values.append(mpmath.nan if isinstance(number, mpmath.mpc) else number)
        return {output.name: [values[k] for k in output.entries] for output in program.outputs}


@cache
def _operations() -> dict[str, Callable[..., Any]]:
    import mpmath

    return {
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
