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

from eqt_cli.base.arrays import Array, distinct
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

SMOOTH = 0.1
"""Change of a function within a part, relative to its range, that a step does not miss."""

FLAT = 128
"""Parts so many times as long as the shortest ones near them, in which a function hardly changes,
are long enough for a step to grow and to miss what follows."""

NEAR = 8
"""Parts at most so many times as long as the shortest one belong to the same short pulse."""


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
        return tuple(sorted(ends.union(_steep(expression, ends, until))))


def instants_of(expressions: Iterable[Expression], until: float) -> Array:
    """Return the sorted times at which expressions change their piece, and of short pulses."""
    return np.array(sorted({t for expression in expressions for t in instants(expression, until)}))


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
    edges, shorter = distinct([t for t in inner if 0 < t < until]), until
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
    overlap = MARGIN * until  # rounding may move a change across an end of a part
    low, high = _parts(edges, until, 64, overlap)
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
        low, high = np.concatenate([low, middle]), np.concatenate([middle + overlap, high])
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
    terms = [operand for operand in operands if operand is not None]
    if len(terms) < len(operands):
        return None
    if all(slope == 0 for _, slope in terms):
        return combined(node, tuple(value for value, _ in terms)), 0.0
    (p, q), (r, s) = terms[0], terms[-1]
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


def _steep(expression: Expression, ends: set[float], until: float) -> Iterator[float]:
    """Yield the sides and the middle of what is so short that a step may miss it."""
    low, high, change = _smooth_parts(expression, ends, until)
    lengths = high - low
    waiting = (lengths > FINEST * until) & (change > 0)  # shorter ones are at ends of pieces
    for shortest in np.argsort(lengths, kind="stable").tolist():
        if waiting[shortest]:
            length, is_flat, sides = lengths[shortest], False, list[int]()
            for step in (-1, 1):
                here = shortest + step
                while 0 <= here < len(lengths) and lengths[here] <= NEAR * length:
                    waiting[here] = False
                    here += step
                sides.append(here - step)
                while 0 <= here < len(lengths) and lengths[here] >= lengths[here - step]:
                    waiting[here] = False
                    is_flat |= bool(lengths[here] >= FLAT * length)
                    here += step
            if is_flat:
                first, last = float(low[sides[0]]), float(high[sides[1]])
                yield from (t for t in (first, (first + last) / 2, last) if 0 < t < until)


def bounds_of_integral(expression: Expression, until: float) -> tuple[float, float, float] | None:
    """Return bounds of the integral from 0, and the integral of the size; None if unknown."""
    ends = {t for t in instants(expression, until) if 0 < t < until}
    with np.errstate(all="ignore"):
        low, high, _ = _smooth_parts(expression, ends, until, SMOOTH / 5)
        jet = series(expression, {"t": Interval(low, high)}, 1)
        value, rate = (Interval.of(x, low.shape) for x in (jet.value, jet.derivative(1)))
        length, middle = high - low, expression.evaluate({"t": (low + high) / 2})
        # ∫ (f(m) + r (t − m)) with a rate r between bounds, or f between bounds
        spread = np.fmin((value.high - value.low) / 2, (rate.high - rate.low) * length / 8) * length
        total, error, size = ((middle * length).sum(), spread.sum(), np.abs(middle * length).sum())
    is_bounded = len(low) and np.isfinite([total, error, size]).all()
    return (float(total - error), float(total + error), float(size)) if is_bounded else None


def _smooth_parts(
    expression: Expression, ends: set[float], until: float, smooth: float = SMOOTH
) -> tuple[Array, Array, Array]:
    """Return parts of the horizon, in order, in which an expression changes little.

    With them comes by how much it may. There are none if it takes too many.
    """
    low, high = _parts([t for t in ends if 0 < t < until], until, 16)
    parts, least, most = np.empty((3, 0)), np.inf, -np.inf
    while len(low):
        jet = series(expression, {"t": Interval(low, high)}, 1)
        value, rate = (Interval.of(x, low.shape) for x in (jet.value, jet.derivative(1)))
        middle = (low + high) / 2
        there = np.broadcast_to(expression.evaluate({"t": middle}), low.shape)
        there = there[np.isfinite(there)]
        least, most = there.min(initial=least), there.max(initial=most)
        by_rate = (high - low) * np.maximum(-rate.low, rate.high)
        change = np.fmin(value.high - value.low, by_rate)
        rough = (change > smooth * (most - least)) & (high - low > FINEST * until)
        done = [x[~rough] for x in (low, high, change)]
        parts = np.concatenate([parts, done], axis=1)
        low, middle, high = low[rough], middle[rough], high[rough]
        if 2 * len(low) + parts.shape[1] > MOST_PARTS // 4:
            return low[:0], low[:0], low[:0]
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    low, high, change = parts[:, np.argsort(parts[0])]
    return low, high, change


def _parts(
    edges: Iterable[float], until: float, count: int, overlap: float = 0.0
) -> tuple[Array, Array]:
    """Return parts of the horizon, beside each edge and not at it, at least so many."""
    ends = distinct([0.0, *edges, until])
    first, last = np.nextafter(ends[:-1], np.inf), np.nextafter(ends[1:], -np.inf)
    first[0], last[-1] = 0.0, until
    counts = np.maximum(1, np.ceil((last - first) * count / until)).astype(int)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    step = np.repeat((last - first) / counts, counts)
    low = np.repeat(first, counts) + number * step
    is_last = number + 1 == np.repeat(counts, counts)
    high = np.where(is_last, np.repeat(last, counts), low + step + overlap)
    return low, high
