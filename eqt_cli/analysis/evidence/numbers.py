"""Base class of the numbers of certificates, rounded or exact, which carry a value and a rate."""

from __future__ import annotations

from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array


class Number:
    """A number that carries its time derivative through any law.

    A kind of numbers has the arithmetic of laws, and

    - ``of(x)``: converts a float or a number of this kind to this kind;
    - ``nearest``: the nearest float or its neighbour;
    - ``derivative()``: the rate of change as a number without a rate;
    - ``moving(rate)``: the same value with another rate;
    - ``granted(error)``: the number with a larger error bound; exact numbers stay exact.

    It is not an abstract base class, because these slow down `isinstance`, which arithmetic calls.
    """

    __slots__ = ()

    def __sub__(self: Any, other: Any) -> Any:
        return self + -other

    def __rsub__(self: Any, other: Any) -> Any:
        return -self + other


def is_number(x: Any) -> bool:
    """Whether an entry of an array is such a number; else it is a float."""
    return isinstance(x, Number)


def rate_of(numbers: Array) -> Array:
    """Return the rates of change as numbers without rates."""
    return _each(lambda x: x.derivative() if is_number(x) else 0.0, numbers)


def with_rate(numbers: Array, rates: Any) -> Array:
    """Return the numbers with these rates instead of their own; not all may be plain floats."""
    numbers, rates = np.broadcast_arrays(
        np.asarray(numbers, dtype=object), np.asarray(rates, dtype=object)
    )
    kind = next(type(x) for array in (numbers, rates) for x in array.flat if is_number(x))
    return _each(lambda x, rate: kind.of(x).moving(kind.of(rate)), numbers, rates)


def floats(numbers: Array) -> Array:
    """Return the values as floats."""
    return _each(lambda x: x.nearest if is_number(x) else x, numbers).astype(float)


def granted(numbers: Array, error: float) -> Array:
    """Return the numbers with error bounds raised by `error`, if they have error bounds."""
    return _each(lambda x: x.granted(error) if is_number(x) else x, numbers)


def _each(function: Any, *arrays: Array) -> Array:
    found = np.frompyfunc(function, len(arrays), 1)(*arrays)
    return np.asarray(found, dtype=object)
