"""The times at which an expression in t changes its piece, and of its short pulses.

Engines end a step there. Where an argument is linear in t, the times follow in closed form. All
others are the zeros of a difference that interval arithmetic encloses, with its derivative: a part
of the horizon is divided until the difference has one sign in it, or is monotone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError
from eqt_cli.base.expressions import PIECEWISE, Expression, Node, combined, fold, shortened
from eqt_cli.numbers.jets import series

MOST_INSTANTS = 50_000
"""Most changes of one kind in a horizon; each of them ends a step of every run."""

MOST_PARTS = 2**18
"""Most parts into which the horizon is divided at a time."""

FINEST = 1e-12
"""Length of a part that is not divided, relative to the horizon; engines cannot tell its ends."""

MARGIN = 8 * float(np.finfo(float).eps)
"""Relative error of both sides of a comparison: some functions, of 1 unit in the last place each,
which another engine rounds otherwise."""

GRID = 2000
"""Number of intervals into which the horizon is divided to look for short pulses."""

LONGEST = 300
"""Largest number of characters of an expression whose parts are examined one by one."""

MOST_PLACES = 1000
"""Largest number of places at which the parts of an expression are examined."""

AWAY = np.geomspace(1e-12, 1e-2, 460)
"""Distances from a place, relative to the horizon: 5 % from one to the next."""

STEEP = 0.003
"""Least change from one distance to the next, relative to the largest, that belongs to a pulse."""

QUIET = 47
"""Number of distances, a factor of 10, without change that follow a pulse."""


@lru_cache(maxsize=1024)  # equal expressions, of all runs, share their instants
def instants(expression: Expression, until: float) -> tuple[float, ...]:
    """Return the values of ``t`` at which steps should end, in order.

    These are the changes of piece between 0 and `until`, and the sides and the middle of short
    pulses. A change that rounding moves is given by two times, one before and one after it. Those
    of a variable that is compared with a number are returned up to any time.

    Raises
    ------
    InputError
        If there are more than `MOST_INSTANTS`.
    """
    if "t" not in expression.variables:
        return ()
    with np.errstate(all="ignore"):
        try:
            ends = set(_Changes(expression, until).ends)
        except InputError as error:
            raise InputError(f"'{shortened(expression.text)}' {error}") from None
        pulses: list[tuple[float, float]] = []
        for t in _places(expression, until) if len(expression.text) <= LONGEST else ():
            if all(abs(t - other) > 10 * width for other, width in pulses):
                pulses += [(t, width) for width in _widths(expression, t, until, ends)]
    edges = {t + side * width for t, width in pulses for side in (-1, 0, 1)}
    return tuple(sorted(ends | {t for t in edges if AWAY[0] * until < t < until}))


def instants_of(expressions: Iterable[Expression], until: float) -> Array:
    """Return the sorted times at which expressions change their piece, and of short pulses."""
    return np.array(sorted({t for each in expressions for t in instants(each, until)}))


# Changes of piece ---------------------------------------------------------------------------------


_LEVELS: dict[str, Callable[[tuple[Node, ...]], Node | None]] = {
    "abs": lambda x: x[0],
    "sqrt": lambda x: x[0],
    "asin": lambda x: _of("-", _of("*", x[0], x[0]), Node(1.0, 0)),
    "acos": lambda x: _of("-", _of("*", x[0], x[0]), Node(1.0, 0)),
    "tan": lambda x: _of("cos", x[0]),
    "/": lambda x: x[1],
    "**": lambda x: None if _is_count(x[1].what) else x[0],
}
"""What is 0 at kinks and poles of functions; there a function of them, such as atan, may jump."""


def _is_count(exponent: float | str) -> bool:
    return isinstance(exponent, float) and exponent >= 0 and exponent % 1 == 0


def _of(what: str, *operands: Node) -> Node:
    return Node(what, 0, operands)


class _Changes:
    """Collects the ends of all pieces of an expression, those of inner functions first."""

    def __init__(self, expression: Expression, until: float) -> None:
        self.until, self.ends = until, list[float]()
        fold(expression.tree, self._visit)

    def _visit(self, node: Node, depends: tuple[bool, ...]) -> bool:
        """Return whether a node depends on t, after collecting where it changes its piece."""
        if not any(depends):
            return node.is_variable and node.what == "t"
        what, x = str(node.what), node.operands
        if what in PIECEWISE:
            pairs, wholes = PIECEWISE[what].compared, PIECEWISE[what].wholes
            for one, other in combinations(range(len(x)), 2) if pairs is None else pairs:
                self._compare(x[one], Node(0.0, 0) if other is None else x[other])
            for number, start, period in wholes:
                shifted = x[number] if start is None else _of("-", x[number], x[start])
                self._count(_of("/", shifted, x[period]))
        elif what == "floor":
            self._count(x[0])
        elif what in _LEVELS and (level := _LEVELS[what](x)) is not None:
            self._compare(level, Node(0.0, 0))
        return True

    def _compare(self, left: Node, right: Node) -> None:
        """Collect the times at which two sides are equal."""
        one, other = (fold(side, _linear) for side in (left, right))
        if one is None or other is None:
            self.ends += _crossings(left, right, self.ends, self.until)
        elif one[1] != other[1]:
            rate = one[1] - other[1]
            t, size = (other[0] - one[0]) / rate, (abs(one[0]) + abs(other[0])) / abs(rate)
            is_exact = (0.0, 1.0) in (one, other) and 0.0 in (one[1], other[1])
            around = _around(t, MARGIN * (abs(t) + size))
            self.ends += [t] if is_exact else [end for end in around if 0 <= end <= self.until]

    def _count(self, argument: Node) -> None:
        """Collect the times at which an argument is a whole number."""
        linear = fold(argument, _linear)
        if linear is None:
            wave = _of("sin", _of("*", Node(math.pi, 0), argument))
            self.ends += _crossings(wave, Node(0.0, 0), self.ends, self.until)
        elif linear[1]:
            p, q = linear
            first, last = sorted((p, p + q * self.until))
            if last - first > MOST_INSTANTS:
                raise _too_many(last - first, self.until)
            for k in range(math.ceil(first), math.floor(last) + 1):
                self.ends += _around((k - p) / q, MARGIN * (abs(k) + abs(p)) / abs(q))


def _around(t: float, margin: float) -> tuple[float, float]:
    return t - margin, t + margin


def _too_many(count: float, until: float) -> InputError:
    return InputError(
        f"changes its piece about {count:.3g} times until t = {until:g} s, and each change ends "
        f"a step; expected at most {MOST_INSTANTS:,} times: take a longer period, or a shorter "
        "time.duration"
    )


def _crossings(left: Node, right: Node, inner: list[float], until: float) -> list[float]:
    """Return times before and after each change of left < right, or of left ≤ right.

    Parameters
    ----------
    inner
        Times between which both sides are smooth.
    """
    difference = Expression("", frozenset("t"), _of("-", left, right))
    sides = [Expression("", frozenset("t"), side) for side in (left, right)]
    edges, shorter = np.unique([t for t in inner if 0 < t < until]), until
    while (parts := _enclosed(difference, edges[edges < shorter], shorter)) is None:
        shorter /= 1000
        if shorter < FINEST**0.75 * until:
            raise InputError(
                "compares what may be equal, so that rounding decides when it changes its piece; "
                "compare numbers that differ"
            )
    if shorter < until:
        raise _too_many(len(parts[0]) * until / shorter, until)
    low, high = parts
    below = [_less(sides, t) for t in (low, high)]
    unresolved = high - low <= FINEST * until  # where it touches 0, and what is not resolved
    points = [*low[unresolved], *high[unresolved]]
    turned = np.flatnonzero((below[0] != below[1]).any(axis=0) & ~unresolved)
    low, high, was = low[turned], high[turned], below[0][:, turned]
    for _ in range(64):
        middle = (low + high) / 2
        same = (_less(sides, middle) == was).all(axis=0)
        low, high = np.where(same, middle, low), np.where(same, high, middle)
        if (high - low <= 2 * np.spacing(high)).all():
            break
    jet = series(difference, {"t": high}, 1)
    rate = np.abs(np.broadcast_to(jet.derivative(1), high.shape))
    size = sum(np.abs(np.broadcast_to(side.evaluate({"t": high}), high.shape)) for side in sides)
    margin = MARGIN * (high + np.minimum(size / rate, until))
    margin = np.where(np.isfinite(margin), margin, MARGIN * high)
    return [*points, *(low - margin), *(high + margin)]


def _less(sides: list[Expression], t: Array) -> Array:
    """Return whether left < right, and whether right < left, ``(2, n)``."""
    left, right = (np.broadcast_to(side.evaluate({"t": t}), t.shape) for side in sides)
    return np.array([left < right, right < left])


def _enclosed(difference: Expression, edges: Array, until: float) -> tuple[Array, Array] | None:
    """Return parts of the horizon in which a difference changes its sign at most once.

    None if there are too many. Those that are not longer than `FINEST` are not resolved.
    """
    sides = [np.nextafter(edges, side) for side in (-np.inf, np.inf)]  # not at a jump itself
    grid = np.unique([*np.clip(sides, 0.0, until).flat, *np.linspace(0.0, until, 65)])
    low, high = grid[:-1], grid[1:]
    lows, highs = list[Array](), list[Array]()
    while len(low):
        jet = series(difference, {"t": Interval(low, high)}, 1)
        value, rate = (Interval.of(x, low.shape) for x in (jet.value, jet.derivative(1)))
        there = (value.low <= 0) & (value.high >= 0)
        once = (rate.low >= 0) | (rate.high <= 0) | (high - low <= FINEST * until)
        lows.append(low[there & once])
        highs.append(high[there & once])
        low, high = low[there & ~once], high[there & ~once]
        if 2 * len(low) > MOST_PARTS or sum(map(len, lows)) > 2 * MOST_INSTANTS + len(edges):
            return None
        middle = (low + high) / 2
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    return np.concatenate(lows), np.concatenate(highs)


_DOMAINS = {"asin": (-1.0, 1.0), "atanh": (-1.0, 1.0), "acosh": (1.0, np.inf)}
_DOMAINS |= dict.fromkeys(("log", "sqrt"), (0.0, np.inf))
"""The arguments of functions that do not have all numbers."""


class Interval:
    """All numbers between two bounds, ``(n,)`` each; NaN where there are none.

    It has the operators and functions of an expression, so that a series has it as coefficients.
    """

    __slots__ = ("high", "low")
    __array_ufunc__ = None  # an array leaves its operators to this class

    def __init__(self, low: Array, high: Array) -> None:
        self.low, self.high = low, high

    @classmethod
    def of(cls, x: Any, shape: tuple[int, ...] = ()) -> Interval:
        """Return an interval, also of a number or an array."""
        if isinstance(x, Interval):
            return x
        bound = np.broadcast_to(x, np.broadcast_shapes(np.shape(x), shape))
        return cls(bound, bound)

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the bounds."""
        return self.low.shape

    def __add__(self, other: Any) -> Interval:
        b = Interval.of(other)
        return _whole_if_unknown(self.low + b.low, self.high + b.high, self, b)

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __sub__(self, other: Any) -> Interval:
        return self + -Interval.of(other)

    def __rsub__(self, other: Any) -> Interval:
        return -self + other

    def __mul__(self, other: Any) -> Interval:
        if other is self:
            return Interval.applied("abs", [self])._by_ends(lambda x: x * x)
        b = Interval.of(other)
        ends = [x * y for x in (self.low, self.high) for y in (b.low, b.high)]
        ends = [np.where(np.isnan(x), 0.0, x) for x in ends]  # 0 times what has no bound
        return _whole_if_unknown(np.minimum.reduce(ends), np.maximum.reduce(ends), self, b)

    def __truediv__(self, other: Any) -> Interval:
        b = Interval.of(other)
        apart = (b.low > 0) | (b.high < 0)
        low, high = np.where(apart, 1 / b.high, -np.inf), np.where(apart, 1 / b.low, np.inf)
        return self * _whole_if_unknown(low, high, b)

    def __rtruediv__(self, other: Any) -> Interval:
        return Interval.of(other) / self

    def __pow__(self, exponent: Any) -> Interval:
        if not isinstance(exponent, int | float):
            log: Any = Interval.of(exponent) * Interval.applied("log", [self])
            return Interval.applied("exp", [log])
        if exponent < 0:
            return 1.0 / self**-exponent
        if exponent % 1:
            return self._within(0.0, np.inf)._by_ends(lambda x: x**exponent)
        size = Interval.applied("abs", [self]) if exponent % 2 == 0 else self
        return size._by_ends(lambda x: x**exponent)

    __radd__ = __add__
    __rmul__ = __mul__

    def _by_ends(self, rising: Callable[[Array], Array]) -> Interval:
        return Interval(rising(self.low), rising(self.high))

    def _within(self, least: float, most: float) -> Interval:
        """Return what lies in a domain."""
        outside = ~((self.high >= least) & (self.low <= most))
        bounds = (np.where(outside, np.nan, np.clip(x, least, most)) for x in (self.low, self.high))
        return Interval(*bounds)

    def _has(self, period: float, offset: float) -> Array:
        """Whether it contains offset + k·period for any whole k."""
        first, last = ((x - offset) / period for x in (self.low, self.high))
        return ~(np.ceil(first) > np.floor(last))  # also where it has no bound

    @classmethod
    def applied(cls, name: str, arguments: Any) -> Interval:
        """Return the interval of a function of `eqt_cli.base.arrays.apply`."""
        if name == "where":
            holds, a, b = map(cls.of, arguments)
            low = np.where(
                holds.low > 0, a.low, np.where(holds.high > 0, np.fmin(a.low, b.low), b.low)
            )
            high = np.where(
                holds.low > 0, a.high, np.where(holds.high > 0, np.fmax(a.high, b.high), b.high)
            )
            return cls(low, high)
        if name in ("less", "smooth_less", "positive"):
            a, b = map(cls.of, [0.0, *arguments][-2:])
            return cls((a.high < b.low) * 1.0, (a.low < b.high) * 1.0)
        (x,) = map(cls.of, arguments)
        if name in ("sin", "cos"):
            top = math.pi / 2 if name == "sin" else 0.0
            ends = [getattr(np, name)(end) for end in (x.low, x.high)]
            return _whole_if_unknown(
                np.where(x._has(2 * math.pi, top + math.pi), -1.0, np.minimum(*ends)),
                np.where(x._has(2 * math.pi, top), 1.0, np.maximum(*ends)),
                x,
            )
        if name in ("abs", "cosh"):
            inside = (x.low < 0) & (x.high > 0)
            ends = [getattr(np, name)(end) for end in (x.low, x.high)]
            lowest = 1.0 if name == "cosh" else 0.0
            return cls(np.where(inside, lowest, np.minimum(*ends)), np.maximum(*ends))
        if name == "tan":
            pole = x._has(math.pi, math.pi / 2)
            low, high = (
                np.where(pole, -np.inf, np.tan(x.low)),
                np.where(pole, np.inf, np.tan(x.high)),
            )
            return _whole_if_unknown(low, high, x)
        if name == "acos":
            return cls.applied("asin", [-x]) + math.pi / 2
        return x._within(*_DOMAINS.get(name, (-np.inf, np.inf)))._by_ends(getattr(np, name))


def _whole_if_unknown(low: Array, high: Array, *operands: Interval) -> Interval:
    """Return an interval, without bound where none is known, of operands that have numbers."""
    empty = np.logical_or.reduce(np.broadcast_arrays(*(np.isnan(x.low) for x in operands)))
    low, high = np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)
    return Interval(np.where(empty, np.nan, low), np.where(empty, np.nan, high))


_Linear = tuple[float, float]
"""p + q t, as (p, q)."""


def _linear(node: Node, operands: tuple[_Linear | None, ...]) -> _Linear | None:
    """Return a node as p + q t, or None where that is not possible."""
    what = node.what
    if node.is_variable:
        return (0.0, 1.0) if what == "t" else None
    known = [operand for operand in operands if operand is not None]
    if len(known) < len(operands):
        return None
    if all(slope == 0 for _, slope in known):
        return combined(node, tuple(value for value, _ in known)), 0.0
    (p, q), (r, s) = known[0], known[-1]
    if what == "neg":
        return -p, -q
    if what == "+":
        return p + r, q + s
    if what == "-":
        return p - r, q - s
    if what == "*" and q * s == 0:
        return p * r, p * s + q * r
    if what == "/" and s == 0:
        return float(np.divide(p, r)), float(np.divide(q, r))
    return None


# Short pulses of smooth functions -----------------------------------------------------------------


def _places(expression: Expression, until: float) -> list[float]:
    """Return the zeros and extrema of all parts: there a function of a part may be steep."""
    step, located = until / GRID, list[float]()
    grid = step * np.arange(-1.0, GRID + 2.0)

    def visit(node: Node, operands: tuple[Any, ...]) -> Any:
        value = grid if node.is_variable else combined(node, operands)
        size = np.abs(value) * np.ones(GRID + 3)
        for w in (size, -size):
            least = (w[1:-1] < w[:-2]) & (w[1:-1] <= w[2:])
            places = grid[1:-1][least]
            if 0 < len(places) <= MOST_PLACES - len(located):
                part = Expression("", expression.variables, node)
                located.extend(_located(part, places, step, 1.0 if w is size else -1.0))
        return value

    fold(expression.tree, visit)
    return [t for t in dict.fromkeys(located) if 0 <= t <= until]


def _located(part: Expression, places: Array, step: float, sign: float) -> list[float]:
    """Return where the size of a part is least (`sign` 1) or greatest (−1) about some times."""
    for _ in range(10):  # of 32 intervals over two of the round before: 1e-12 of the first one
        grid = places[:, None] + step * np.linspace(-1.0, 1.0, 33)
        size = sign * np.abs(part.evaluate({"t": grid}))
        places = np.take_along_axis(grid, np.argmin(size, axis=1)[:, None], axis=1)[:, 0]
        step /= 16
    return [float(f"{t:.12g}") for t in places]


def _widths(expression: Expression, t: float, until: float, ends: set[float]) -> Iterator[float]:
    """Yield the half-width of a short pulse about a time; beyond it, nothing changes long.

    A jump at the end of a piece changes on one side only; a piece between two ends needs no more.
    """
    away = until * AWAY
    late, early = (expression.evaluate({"t": t + sign * away}) for sign in (1.0, -1.0))
    here = expression.evaluate({"t": np.array([t])})
    both = np.abs([late - here, early - here])
    change = both.max(axis=0)
    steep = np.flatnonzero(~(np.abs(np.diff(change)) <= STEEP * change.max()))
    quiet = np.flatnonzero(np.diff([*steep, len(AWAY)]) > QUIET)
    if len(quiet) and np.isfinite(change).all():
        last = steep[quiet[0]] + 1
        width = 2 * float(away[last])
        near = np.array([end - t for end in ends if abs(end - t) <= width])
        apart = near[np.abs(near) > 10 * FINEST * until]
        one_sided = len(near) and both[:, last].min() <= STEEP * change[last]
        if not one_sided and not (apart.min(initial=0.0) < 0 < apart.max(initial=0.0)):
            yield width
