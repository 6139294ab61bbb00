"""Formulas of a configuration, such as reference torques and constants.

An expression is made of numbers, ``pi``, the variables that the caller allows (``t`` by default),
``+ - * / **``, parentheses, the one-argument functions of `eqt_cli.core.arrays.FUNCTIONS`, and
those of `PIECEWISE`. A comparison may only be the first argument of ``where(t < 1, a, b)``.
Precedence is Python's: ``-2**2`` is −4, ``2**3**2`` is 512. There is no ``e``, because it also
starts an exponent; write ``exp(1)``.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array, apply, unwrapped
from eqt_cli.core.errors import ExpressionError, InputError
from eqt_cli.core.grammar import PIECEWISE, Node, Parser, fold

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


@dataclass(frozen=True)
class Expression:
    """A parsed expression; two are equal when their texts are.

    Attributes
    ----------
    text : str
        The text that was parsed.
    variables : frozenset of str
        The variables that occur in it.
    tree : Node
        The syntax tree, in which chains such as ``a + b + c`` lean to the left without limit of
        depth: walk it with a loop along the first operands, as `fold` does.
    """

    text: str
    variables: frozenset[str]
    tree: Node = field(repr=False, compare=False)

    def evaluate(self, values: Mapping[str, Any]) -> Any:
        """Compute the value for the given variables.

        Parameters
        ----------
        values : mapping of str to number, array or symbol
            One value for every name in `variables`; others are ignored.

        Returns
        -------
        float, array or symbol
            Floats give a float, arrays an array of their shape, a symbol a symbol. An expression
            without variables gives a float. Arithmetic follows IEEE 754, without warnings: ``1/t``
            at 0 is inf, ``sqrt(t)`` at −1 is nan.

        Raises
        ------
        KeyError
            If a variable has no value.
        TraceError
            If a symbol's engine lacks a function.
        """

        def visit(node: Node, operands: tuple[Any, ...]) -> Any:
            if node.is_variable:
                value = unwrapped(values[str(node.what)])
                return float(value) if isinstance(value, int) else value
            return _combined(node, operands)

        with np.errstate(all="ignore"):
            return fold(self.tree, visit)

    @lru_cache(maxsize=1024)  # noqa: B019  # equal expressions, of all runs, share their instants
    def instants(self, until: float) -> tuple[float, ...]:
        """Return the values of ``t`` at which steps should end, in order.

        These are the changes of piece of a piecewise function whose compared arguments are linear
        in t, and the sides and the middle of short pulses between 0 and `until`.
        """
        if "t" not in self.variables:
            return ()
        instants: set[float] = set()

        def visit(node: Node, operands: tuple[_Linear | None, ...]) -> _Linear | None:
            if node.operands and node.what in PIECEWISE:
                instants.update(_roots(str(node.what), operands))
                return None
            return _linear(node, operands)

        with np.errstate(all="ignore"):
            fold(self.tree, visit)
            pulses: list[tuple[float, float]] = []
            for t in self._places(until) if len(self.text) <= LONGEST else ():
                if all(abs(t - other) > 10 * width for other, width in pulses):
                    pulses += [(t, width) for width in self._widths(t, until)]
        found = {t + side * width for t, width in pulses for side in (-1, 0, 1)}
        return tuple(sorted(instants | {t for t in found if AWAY[0] * until < t < until}))

    def _places(self, until: float) -> list[float]:
        """Return the zeros and extrema of all parts: there a function of a part may be steep."""
        step, found = until / GRID, list[float]()
        grid = step * np.arange(-1.0, GRID + 2.0)

        def visit(node: Node, operands: tuple[Any, ...]) -> Any:
            value = grid if node.is_variable else _combined(node, operands)
            size = np.abs(value) * np.ones(GRID + 3)
            for w in (size, -size):
                least = (w[1:-1] < w[:-2]) & (w[1:-1] <= w[2:])
                places = grid[1:-1][least]
                if 0 < len(places) <= MOST_PLACES - len(found):
                    part = Expression("", self.variables, node)
                    found.extend(_located(part, places, step, 1.0 if w is size else -1.0))
            return value

        fold(self.tree, visit)
        return [t for t in dict.fromkeys(found) if 0 <= t <= until]

    def _widths(self, t: float, until: float) -> list[float]:
        """Return the half-width of a short pulse about a time; beyond it, nothing changes long."""
        away = until * AWAY
        late, early = (self.evaluate({"t": t + sign * away}) for sign in (1.0, -1.0))
        here = self.evaluate({"t": np.array([t])})
        change = np.maximum(np.abs(late - here), np.abs(early - here))
        steep = np.flatnonzero(~(np.abs(np.diff(change)) <= STEEP * change.max()))
        quiet = np.flatnonzero(np.diff([*steep, len(AWAY)]) > QUIET)
        finite = np.isfinite(change).all()
        return [2 * float(away[steep[k] + 1]) for k in quiet[:1] if finite]

    def __reduce__(self) -> tuple[Callable[..., Expression], tuple[str, tuple[str, ...]]]:
        """Pickle the text, because pickling a deep tree would exhaust the stack."""
        return parse, (self.text, tuple(sorted(self.variables)))


def parse(text: str, variables: Collection[str] = ("t",)) -> Expression:
    """Parse an expression in the given variables.

    Raises
    ------
    ExpressionError
        If the text is not in the grammar, or if a part without variables has no finite value
        (``log(0)``, ``1/0``). The message names the column, counted from 1.
    """
    tree, used = Parser(text, variables).parse()
    with np.errstate(all="ignore"):
        fold(tree, _finite_value)
    return Expression(text, used, tree)


MAX_QUOTED = 100
"""Longest quotation of an expression in a message, characters."""


def formula(entry: str | float) -> Expression:
    """Return the expression in t of an entry in a configuration, text or a number.

    Raises
    ------
    InputError
        If the entry is no expression; the message quotes it.
    """
    try:
        return parse(str(entry))
    except ExpressionError as error:
        text = str(entry)
        quoted = text if len(text) <= MAX_QUOTED else text[:MAX_QUOTED] + "…"
        raise InputError(f"'{quoted}': {error}") from error


def constant(text: str) -> float:
    """Compute an expression without variables, such as ``-pi/2``.

    Raises
    ------
    ExpressionError
        As by `parse`.
    """
    return float(parse(text, ()).evaluate({}))


# Values of nodes -------------------------------------------------------------------------------


def power(base: Any, exponent: Any) -> Any:
    """Raise to a power, also a number to a symbol, whose type may have no ``__rpow__``."""
    symbols = isinstance(exponent, np.ndarray) and exponent.dtype == object
    if isinstance(base, float) and (symbols or not hasattr(exponent, "__rpow__")):
        return apply("exp", exponent * float(np.log(base)))[()]
    return base**exponent


_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": power,
}


def _combined(node: Node, operands: tuple[Any, ...]) -> Any:
    """Return the value of a number or an operation from those of its operands."""
    what = node.what
    if isinstance(what, float):
        return what
    if what == "neg":
        return -operands[0]
    if what in _OPERATORS:
        left, right = operands
        if isinstance(left, float) and isinstance(right, float):
            # Python's floats raise where IEEE gives inf or nan, and (-8)**0.5 becomes complex.
            return float(_OPERATORS[what](np.float64(left), right))
        return _OPERATORS[what](left, right)
    known = PIECEWISE.get(what)
    result = known.value(*operands) if known else apply(what, operands[0])
    return float(result) if isinstance(result, float) else unwrapped(result)


def _finite_value(node: Node, operands: tuple[float | None, ...]) -> float | None:
    """Return the value of a node without variables, which must be finite; None for all others."""
    what, column = node.what, node.column
    if what == "/" and operands[1] == 0:
        raise ExpressionError(f"division by zero at column {column}", column)
    if what == "smoothstep" and node.operands:
        start, end = operands[1:]
        if start is not None and end is not None and not start < end:
            raise ExpressionError(
                f"'smoothstep' at column {column} must rise from a smaller to a larger number, got "
                f"{start:g} and {end:g}",
                column,
            )
    if node.is_variable or None in operands:
        return None
    value = float(_combined(node, operands))
    if operands and not math.isfinite(value):
        message = f"'{what}' at column {column} has no finite value (got {value})"
        raise ExpressionError(message, column)
    return value


def _located(part: Expression, places: Array, step: float, sign: float) -> list[float]:
    """Return where the size of a part is least (`sign` 1) or greatest (−1) about some times."""
    for _ in range(10):  # of 32 intervals over two of the round before: 1e-12 of the first one
        grid = places[:, None] + step * np.linspace(-1.0, 1.0, 33)
        size = sign * np.abs(part.evaluate({"t": grid}))
        places = np.take_along_axis(grid, np.argmin(size, axis=1)[:, None], axis=1)[:, 0]
        step /= 16
    return [float(f"{t:.12g}") for t in places]


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
    if what in ("+", "-"):
        (p, q), (r, s) = known
        sign = 1 if what == "+" else -1
        return p + sign * r, q + sign * s
    if what in ("*", "/"):
        (p, q), (r, s) = known
        if s == 0 and what == "/":
            return p / r, q / r
        if what == "*" and q * s == 0:
            return p * r, p * s + q * r
        return None
    if what == "neg":
        [(p, q)] = known
        return -p, -q
    if all(slope == 0 for _, slope in known):
        return _combined(node, tuple(value for value, _ in known)), 0.0
    return None


def _roots(function: str, operands: tuple[_Linear | None, ...]) -> Iterator[float]:
    """Yield the times at which two compared arguments of a function are equal."""
    for one, other in PIECEWISE[function].compared(len(operands)):
        left, right = operands[one], (0.0, 0.0) if other is None else operands[other]
        if left and right and left[1] != right[1]:
            yield (right[0] - left[0]) / (left[1] - right[1])
