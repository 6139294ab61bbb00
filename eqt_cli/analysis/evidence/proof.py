"""Proves that two sides are equal as rational functions, by values at random exact states.

Two sides that are not equal differ by n / (c D), where the polynomial n is not 0. Of the states
from N integers a parameter, at most a part of deg n / N are zeros of n (Schwartz 1980, Zippel
1979), and of those where no denominator vanishes at most deg n / (N − deg D), D the product of all
that was divided by. Where functions became parameters, the differences of their arguments count
with n: one that is 0 by chance makes two functions equal that are not. So the probability that k
states miss the difference is at most the k-th power of (d + e) / (N − deg D), d the degree of n and
e the sum of the degrees of what was compared.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import log10

import numpy as np

from eqt_cli.analysis.evidence.exact import Exact, Ledger, difference, noting
from eqt_cli.analysis.evidence.exact_states import RANGE, SMALL, ExactStates
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.core.arrays import Array

Sides = Callable[[Sample], Iterator[tuple[Array, Array]]]

CERTAIN = 1e-50
"""Below this probability of a difference that all states miss, the sides are said to be equal."""

MOST = 20
"""So many states are drawn at most."""


@dataclass(frozen=True)
class Proof:
    """The sides are equal.

    Attributes
    ----------
    degree
        A bound of the degree of every numerator of a difference.
    points
        k, at how many states both sides were equal.
    probability
        A bound of the probability of that if they are not.
    functions
        Which functions became parameters, in words.
    """

    degree: int
    points: int
    probability: float
    functions: str = ""


@dataclass(frozen=True)
class Refutation:
    """The sides differ.

    Attributes
    ----------
    difference
        Left − right at a state.
    place
        In which entry of which equation, at which state.
    """

    difference: Fraction
    place: str


class UnprovableError(Exception):
    """States of this kind cannot decide whether the sides are equal."""


def prove(sides: Sides, states: ExactStates) -> Proof | Refutation | None:
    """Whether the sides are equal for all states; None where there are none.

    Raises
    ------
    UnprovableError
        If such states cannot tell.
    Exception
        Whatever a law raises that cannot be evaluated on exact numbers.
    """
    degree, chance, points = 0, Fraction(0), 0
    for index in range(MOST):
        at = _at(sides, states, index, RANGE)
        if at is None:
            continue
        if not at.differences:
            return None
        if at.refuting is not None:
            if at.functions:
                raise UnprovableError(f"the sides differ where {at.functions}")
            return _readable(sides, states) or at.refutation("at a random state")
        degree, points = max(degree, at.degree), points + 1
        chance = max(chance, at.chance)
        if chance**points < CERTAIN:
            return Proof(degree, points, float(chance**points), at.functions)
    raise UnprovableError(f"{MOST} random states do not suffice, of which {points} have values")


Place = tuple[int, tuple[int, ...]]


@dataclass(frozen=True)
class _At:
    """The sides at one state.

    Attributes
    ----------
    differences
        Left − right of every entry, with the number of its equation.
    ledger
        What was taken for granted.
    """

    differences: list[tuple[Place, Exact]]
    ledger: Ledger

    @property
    def degree(self) -> int:
        return max(each.degree for _, each in self.differences)

    @property
    def chance(self) -> Fraction:
        """A bound of the probability that the sides are equal here, and not everywhere."""
        room = RANGE - self.ledger.degree
        return min(Fraction(1), Fraction(self.degree + self.ledger.compared, max(room, 1)))

    @property
    def refuting(self) -> tuple[Place, Exact] | None:
        return next((each for each in self.differences if each[1].numerator), None)

    @property
    def functions(self) -> str:
        """``sqrt() and tanh() are free parameters``, where some are."""
        names = [f"{name}()" for name in sorted(self.ledger.functions)]
        if not names:
            return ""
        few = "is a free parameter" if len(names) == 1 else "are free parameters"
        return f"{' and '.join(names)} {few}"

    def refutation(self, where: str) -> Refutation:
        assert self.refuting is not None
        (number, entry), each = self.refuting
        place = f" in entry {list(entry)}" if entry else ""
        return Refutation(each.value, f"{place} of equation {number}, {where}")


def _at(sides: Sides, states: ExactStates, index: int, count: int) -> _At | None:
    """The sides at a state; None where a denominator vanishes."""
    try:
        state = states.state(index, count)
        with noting(state.ledger):
            found = [
                ((number, entry), difference(a, b))
                for number, (left, right) in enumerate(sides(state.sample), start=1)
                for entry, (a, b) in _entries(left, right)
            ]
    except ZeroDivisionError:
        return None
    return _At(found, state.ledger)


def _entries(left: Array, right: Array) -> Iterator[tuple[tuple[int, ...], tuple[object, object]]]:
    a, b = np.broadcast_arrays(np.asarray(left, dtype=object), np.asarray(right, dtype=object))
    for entry in np.ndindex(a.shape):
        yield entry[1:], (a[entry], b[entry])


def _readable(sides: Sides, states: ExactStates) -> Refutation | None:
    """The difference at a state of small integers, where one is found."""
    for index in range(MOST):
        at = _at(sides, states, index, SMALL)
        if at is not None and at.refuting is not None:
            return at.refutation("at a random state of small integers")
    return None


def written(number: Fraction, most: int = 60) -> str:
    """A fraction, shortened where it has many digits."""
    if len(text := str(number)) <= most:
        return text
    size = log10(abs(number.numerator)) - log10(number.denominator)
    power = int(size // 1)
    sign = "-" if number < 0 else ""
    digits = sum(map(str.isdigit, text))
    return f"{sign}{10 ** (size - power):.3f}e{power:+03d} (a fraction of {digits} digits)"
