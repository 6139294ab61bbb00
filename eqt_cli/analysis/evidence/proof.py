"""Proves that two sides are equal as rational functions, by values at random exact states.

If the sides are not equal, they differ by n / D, where the polynomial n is not 0. If every
parameter is drawn from N integers, n vanishes with a probability of at most deg n / N (Schwartz
1980, Zippel 1979), and among the states where no denominator vanishes with at most
deg n / (N − deg D), where D is the product of all divisors. If functions became parameters, the
differences of their arguments count as well, because an argument difference that is 0 by chance
would identify two different functions. So the probability that k states miss a difference is at
most the k-th power of (d + e) / (N − deg D), where d is the degree of n and e is the sum of the
degrees of the compared arguments.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import log10

import numpy as np

from eqt_cli.analysis.evidence.exact import Exact, Ledger, difference, noting
from eqt_cli.analysis.evidence.sample import RANGE, SMALL, ExactStates, Sample
from eqt_cli.core.arrays import Array

Sides = Callable[[Sample], Iterator[tuple[Array, Array]]]

CERTAIN = 1e-50
"""Probability of a missed difference below which the sides count as equal."""

MOST_STATES = 20
"""Largest number of drawn states."""


@dataclass(frozen=True)
class Proof:
    """The sides are equal.

    Attributes
    ----------
    degree
        Bound of the degree of every numerator of a difference.
    points
        k, the number of states at which the sides were equal.
    probability
        Bound of the probability that different sides agree at all these states.
    functions
        Sentence about functions that became parameters.
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
        Entry, equation and state of the difference, in words.
    """

    difference: Fraction
    place: str


class UnprovableError(Exception):
    """States of this kind cannot decide whether the sides are equal."""


def prove(sides: Sides, states: ExactStates) -> Proof | Refutation | None:
    """Decide whether the sides are equal for all states; None if there are no equations.

    Raises
    ------
    UnprovableError
        If exact states cannot decide this.
    Exception
        Any error of a law that cannot be evaluated on exact numbers.
    """
    degree, chance, points = 0, Fraction(0), 0
    for index in range(MOST_STATES):
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
    raise UnprovableError(
        f"{MOST_STATES} random states do not suffice, of which {points} have values"
    )


Place = tuple[int, tuple[int, ...]]


@dataclass(frozen=True)
class _At:
    """The sides at one state.

    Attributes
    ----------
    differences
        Left − right of every entry, with its place.
    ledger
        Assumptions of the computation.
    """

    differences: list[tuple[Place, Exact]]
    ledger: Ledger

    @property
    def degree(self) -> int:
        return max(each.degree for _, each in self.differences)

    @property
    def chance(self) -> Fraction:
        """Bound of the probability that different sides are equal at this state."""
        room = RANGE - self.ledger.degree
        return min(Fraction(1), Fraction(self.degree + self.ledger.compared, max(room, 1)))

    @property
    def refuting(self) -> tuple[Place, Exact] | None:
        return next((each for each in self.differences if each[1].numerator), None)

    @property
    def functions(self) -> str:
        """Words such as ``sqrt() and tanh() are free parameters``; empty if there are none."""
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
    """Evaluate the sides at a state; None if a denominator vanishes."""
    try:
        sample, ledger = states.state(index, count)
        with noting(ledger):
            values = [
                ((number, entry), difference(a, b))
                for number, (left, right) in enumerate(sides(sample), start=1)
                for entry, (a, b) in _entries(left, right)
            ]
    except ZeroDivisionError:
        return None
    return _At(values, ledger)


def _entries(left: Array, right: Array) -> Iterator[tuple[tuple[int, ...], tuple[object, object]]]:
    a, b = np.broadcast_arrays(np.asarray(left, dtype=object), np.asarray(right, dtype=object))
    for entry in np.ndindex(a.shape):
        yield entry[1:], (a[entry], b[entry])


def _readable(sides: Sides, states: ExactStates) -> Refutation | None:
    """Return a difference at a state of small integers; None if none is found."""
    for index in range(MOST_STATES):
        at = _at(sides, states, index, SMALL)
        if at is not None and at.refuting is not None:
            return at.refutation("at a random state of small integers")
    return None


def written(number: Fraction, most: int = 60) -> str:
    """Format a fraction, shortened if it has many digits."""
    if len(text := str(number)) <= most:
        return text
    size = log10(abs(number.numerator)) - log10(number.denominator)
    power = int(size // 1)
    sign = "-" if number < 0 else ""
    digits = sum(map(str.isdigit, text))
    return f"{sign}{10 ** (size - power):.3f}e{power:+03d} (a fraction of {digits} digits)"
