"""Proves that two sides are equal as rational functions, by their values at random exact states.

Two sides that are not equal differ by n / (c D), where the polynomial n is not 0. Of the states from
N integers a parameter, at most a part of deg n / N are zeros of n (Schwartz 1980, Zippel 1979), and
of those where no denominator vanishes at most deg n / (N − deg D), D the product of all that was
divided by. So the probability that k states miss the difference is at most the k-th power of this.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import log10

import numpy as np

from eqt_cli.analysis.evidence.exact import Exact, difference, noting
from eqt_cli.analysis.evidence.exact_states import RANGE, SMALL, ExactStates, State
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.core.arrays import Array

Sides = Callable[[Sample], Iterator[tuple[Array, Array]]]

CERTAIN = 1e-50
"""Below this probability of a difference that all states miss, the sides are said to be equal."""

SPARE = 20
"""So many states more are drawn where denominators vanish."""


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
    """

    degree: int
    points: int
    probability: float


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
    Exception
        Whatever a law raises that cannot be evaluated on exact numbers.
    """
    degree, beyond, points, index = 0, 0, 0, 0
    while not points or _probability(degree, beyond, points) >= CERTAIN:
        found = _differences(sides, states, index, RANGE)
        index += 1
        if found is None:
            if index - points > SPARE:
                raise UnprovableError("a denominator vanishes at every state that was drawn")
            continue
        differences, divided = found
        if not differences:
            return None
        refuted = next((each for each in differences if each[1].numerator), None)
        if refuted is not None:
            return _readable(sides, states) or _refutation(*refuted, "at a random state")
        points += 1
        degree = max(degree, *(each.degree for _, each in differences))
        beyond = max(beyond, divided)
        if degree + beyond >= RANGE:
            raise UnprovableError(f"its degree, {degree}, is too large for {RANGE} integers")
    return Proof(degree, points, _probability(degree, beyond, points))


def _probability(degree: int, beyond: int, points: int) -> float:
    """(d / (N − deg D))ᵏ."""
    return float(Fraction(degree, RANGE - beyond) ** points)


Place = tuple[int, tuple[int, ...]]


def _differences(
    sides: Sides, states: ExactStates, index: int, count: int
) -> tuple[list[tuple[Place, Exact]], int] | None:
    """Every entry's left − right, and the degree of all that was divided by; None to draw again."""
    try:
        state: State = states.state(index, count)
        with noting(state.divisors):
            found = [
                ((number, entry), difference(a, b))
                for number, (left, right) in enumerate(sides(state.sample), start=1)
                for entry, (a, b) in _entries(left, right)
            ]
    except ZeroDivisionError:
        return None
    return found, sum(each.degree for each in state.divisors)


def _entries(left: Array, right: Array) -> Iterator[tuple[tuple[int, ...], tuple[object, object]]]:
    a, b = np.broadcast_arrays(np.asarray(left, dtype=object), np.asarray(right, dtype=object))
    for entry in np.ndindex(a.shape):
        yield entry[1:], (a[entry], b[entry])


def _readable(sides: Sides, states: ExactStates) -> Refutation | None:
    """The difference at a state of small integers, where one is found."""
    for index in range(SPARE):
        differences, _ = _differences(sides, states, index, SMALL) or ([], 0)
        for place, each in differences:
            if each.numerator:
                return _refutation(place, each, "at a random state of small integers")
    return None


def _refutation(place: Place, each: Exact, where: str) -> Refutation:
    number, entry = place
    at = f" in entry {list(entry)}" if entry else ""
    return Refutation(each.value, f"{at} of equation {number}, {where}")


def written(number: Fraction, most: int = 60) -> str:
    """A fraction, shortened where it has many digits."""
    if len(text := str(number)) <= most:
        return text
    size = log10(abs(number.numerator)) - log10(number.denominator)
    power = int(size // 1)
    sign = "-" if number < 0 else ""
    return f"{sign}{10 ** (size - power):.3f}e{power:+03d} (a fraction of {len(text) - 1} digits)"
