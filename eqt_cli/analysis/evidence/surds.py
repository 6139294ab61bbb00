"""Integers with square roots adjoined: sums of integers times products of roots r with r² = E.

Each root is an independent symbol that only its equation reduces, so a sum is 0 only if all its
integers are. This is stricter than a value of 0 for real roots: such a sum is 0 for either sign of
every root.
"""

from __future__ import annotations

from functools import reduce
from typing import TypeAlias


class Root:
    """r with r² = E."""

    __slots__ = ("square",)

    def __init__(self, square: int) -> None:
        self.square = square


class Surd:
    """A sum of integers times products of roots; without any root it is an `int` instead."""

    __slots__ = ("terms",)

    def __init__(self, terms: dict[frozenset[Root], int]) -> None:
        self.terms = terms

    @classmethod
    def of(cls, root: Root) -> Surd:
        """Return a single root."""
        return cls({frozenset([root]): 1})

    def __add__(self, other: Whole) -> Whole:
        found = dict(self.terms)
        for roots, integer in _terms(other).items():
            found[roots] = found.get(roots, 0) + integer
        return _simplified(found)

    def __mul__(self, other: Whole) -> Whole:
        found: dict[frozenset[Root], int] = {}
        for one, a in self.terms.items():
            for two, b in _terms(other).items():
                squares = reduce(lambda product, root: product * root.square, one & two, a * b)
                found[one ^ two] = found.get(one ^ two, 0) + squares
        return _simplified(found)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> Surd:
        return Surd({roots: -integer for roots, integer in self.terms.items()})

    def conjugate(self, root: Root) -> Surd:
        """Return the sum with −r in place of r."""
        return Surd({roots: -n if root in roots else n for roots, n in self.terms.items()})


Whole: TypeAlias = int | Surd
"""An integer, or one with roots."""


def to_integer(number: Whole) -> tuple[Whole, int, int]:
    """Return a factor, its integer product with the number, and how many roots were removed."""
    factor: Whole = 1
    taken = 0
    while isinstance(number, Surd):
        roots = next(roots for roots in number.terms if roots)
        conjugate = number.conjugate(next(iter(roots)))
        number, factor, taken = number * conjugate, factor * conjugate, taken + 1
    return factor, number, taken


def _terms(number: Whole) -> dict[frozenset[Root], int]:
    return number.terms if isinstance(number, Surd) else {frozenset(): number}


def _simplified(terms: dict[frozenset[Root], int]) -> Whole:
    found = {roots: integer for roots, integer in terms.items() if integer}
    if not found.keys() - {frozenset()}:
        return found.get(frozenset(), 0)
    return Surd(found)
