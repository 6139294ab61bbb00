"""What the numbers of certificates share, whether they are rounded or exact: a value and a rate."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array


class Number:
    """A number that carries its time derivative through any law.

    It is no abstract base class, since these make `isinstance` slow, which arithmetic asks often.
    """

    __slots__ = ()

    @classmethod
    def of(cls, x: Any) -> Self:
        """A number of this kind, or a float, as a number of this kind."""
        raise NotImplementedError

    @property
    def nearest(self) -> float:
        """The nearest float, or one next to it."""
        raise NotImplementedError

    def derivative(self) -> Self:
        """Its rate of change as a number of its own, which does not move."""
        raise NotImplementedError

    def moving(self, rate: Self) -> Self:
        """The same value with another rate."""
        raise NotImplementedError

    def granted(self, error: float) -> Self:
        """The same with an error of this size; exact numbers have none."""
        raise NotImplementedError


def rate_of(numbers: Array) -> Array:
    """The rates of change as numbers of their own."""
    return _each(lambda x: x.derivative() if isinstance(x, Number) else 0.0, numbers)


def with_rate(numbers: Array, rates: Any) -> Array:
    """The numbers with these rates of change, whatever theirs were; some are no plain floats."""
    numbers, rates = np.broadcast_arrays(
        np.asarray(numbers, dtype=object), np.asarray(rates, dtype=object)
    )
    kind = next(type(x) for array in (numbers, rates) for x in array.flat if isinstance(x, Number))
    return _each(lambda x, rate: kind.of(x).moving(kind.of(rate)), numbers, rates)


def floats(numbers: Array) -> Array:
    """The values as floats."""
    return _each(lambda x: x.nearest if isinstance(x, Number) else x, numbers).astype(float)


def granted(numbers: Array, error: float) -> Array:
    """The numbers with errors of this size granted, where they can have any."""
    return _each(lambda x: x.granted(error) if isinstance(x, Number) else x, numbers)


def _each(function: Any, *arrays: Array) -> Array:
    found = np.frompyfunc(function, len(arrays), 1)(*arrays)
    return np.asarray(found, dtype=object)
