"""The grammar of formulas: turns a text into a tree of operations, or says what is wrong with it.

Formulas are parsed here and never evaluated by Python. Python's own parser is not used: it refuses
a sum of 5,000 terms, which is shorter than `MAX_LENGTH`, and its errors name no cause.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from typing import Any, NoReturn

import numpy as np

from eqt_cli.core.arrays import (
    FUNCTIONS,
    absolute,
    apply,
    clip,
    less,
    maximum,
    minimum,
    smooth_less,
    where,
)
from eqt_cli.core.errors import ExpressionError, suggestion

# Functions with kinks or steps -----------------------------------------------------------------


@dataclass(frozen=True)
class Piecewise:
    """A function that is defined in pieces.

    Attributes
    ----------
    value
        The function, of floats, arrays or symbols.
    compared
        Returns the pairs of arguments that it compares, from their number; None stands for 0.
    takes
        The arguments in words.
    count
        The number of arguments; None for two or more.
    """

    value: Callable[..., Any]
    compared: Callable[[int], Iterable[tuple[int, int | None]]]
    takes: str
    count: int | None


def _sign(x: Any) -> Any:
    return where(less(x, 0.0), -1.0, where(less(0.0, x), 1.0, 0.0))


def _smoothstep(x: Any, start: Any, end: Any) -> Any:
    s = clip((x - start) / (end - start), 0.0, 1.0)
    return s * s * (3 - 2 * s)


def _atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y) from the x axis, by arc tangents of numbers from −1 to 1."""
    steep = smooth_less(absolute(x), absolute(y))
    angle = apply("atan", where(steep, x, y) / where(steep, y, x))
    above = where(smooth_less(y, 0.0), -np.pi / 2, np.pi / 2)
    behind = where(less(y, 0.0), -np.pi, np.pi)  # a real jump, so not `smooth_less`
    return where(steep, above - angle, where(smooth_less(x, 0.0), angle + behind, angle))


def _every_pair(count: int) -> Iterable[tuple[int, int | None]]:
    return combinations(range(count), 2)


PIECEWISE = {
    "min": Piecewise(lambda *x: reduce(minimum, x), _every_pair, "two or more arguments", None),
    "max": Piecewise(lambda *x: reduce(maximum, x), _every_pair, "two or more arguments", None),
    "sign": Piecewise(_sign, lambda _: [(0, None)], "one argument", 1),
    "step": Piecewise(
        lambda x, start: where(less(x, start), 0.0, 1.0),
        lambda _: [(0, 1)],
        "two arguments, as in 'step(t, 1)', which is 0 before t = 1 and 1 after",
        2,
    ),
    "smoothstep": Piecewise(
        _smoothstep,
        lambda _: [(0, 1), (0, 2)],
        "three arguments, as in 'smoothstep(t, 1, 3)', which rises from 0 at 1 to 1 at 3",
        3,
    ),
    "atan2": Piecewise(
        _atan2,
        lambda _: [(0, None)],
        "two arguments, as in 'atan2(y, x)', the angle of the point (x, y) in rad",
        2,
    ),
    "where": Piecewise(
        lambda a, b, x, y: where(less(a, b), x, y),
        lambda _: [(0, 1)],
        "a comparison and two values, as in 'where(t < 1, 0, 2)'",
        4,
    ),
}
"""The functions with kinks or steps, at which engines end a step."""

# The tree --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Node:
    """A number, a variable, or an operation on other nodes.

    Attributes
    ----------
    what
        The number; or the name of the variable, of the function, or of the operator: one of
        ``+ - * / **``, and ``neg`` for a sign. ``where(a < b, x, y)`` has the operands a, b, x, y;
        other comparisons are converted to it.
    column
        Its place in the text, from 1.
    operands
        The nodes on which it operates.
    """

    what: float | str
    column: int
    operands: tuple[Node, ...] = ()

    @property
    def is_variable(self) -> bool:
        """Whether this is a variable."""
        return not self.operands and isinstance(self.what, str)


def fold(node: Node, visit: Callable[[Node, tuple[Any, ...]], Any]) -> Any:
    """Visit the tree from the leaves up, each node with the results of its operands."""
    chain: list[Node] = []
    while node.operands:  # the tree of a long sum is too deep for recursion
        chain.append(node)
        node = node.operands[0]
    result = visit(node, ())
    while chain:
        node = chain.pop()
        result = visit(node, (result, *(fold(other, visit) for other in node.operands[1:])))
    return result


# Parsing ---------------------------------------------------------------------------------------

MAX_LENGTH = 10_000
"""Longest expression, characters."""

MAX_NESTING = 100
"""Deepest nesting of parentheses, signs and ``**``, far within Python's recursion limit."""

_TOKEN = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<symbol>\*\*|<=|>=|[-+*/()<>,])"
    r"|(?P<other>.)",  # no error yet, because an error earlier in the text should be reported first
    re.DOTALL,
)

_IN_WHERE = "; write one 'where' within another"
_HINTS = {
    "e": "; write 'exp(1)' for Euler's number",
    "ln": "; the natural logarithm is 'log'",
    "pow": "; write 'a**b' for a power",
    "math": "; write 'sin' for 'math.sin'",
    "np": "; write 'sin' for 'np.sin'",
    "numpy": "; write 'sin' for 'numpy.sin'",
    "clip": "; write 'min(max(a, low), high)'",
    "if": "; write 'where(t < 1, a, b)'",
    "and": _IN_WHERE,
    "or": _IN_WHERE,
    "^": "; write '**' for a power",
    "\N{GREEK SMALL LETTER PI}": "; write 'pi'",
    "\N{SUPERSCRIPT TWO}": "; write '**2'",
    "\N{SUPERSCRIPT THREE}": "; write '**3'",
    **dict.fromkeys("\N{MINUS SIGN}\N{EN DASH}", "; write '-'"),
    **dict.fromkeys("\N{MIDDLE DOT}\N{DOT OPERATOR}\N{MULTIPLICATION SIGN}", "; write '*'"),
    "\N{DIVISION SIGN}": "; write '/'",
}
"""What to write instead of names and characters outside the grammar."""

# The binding strength of each operator, and the smallest strength within its right operand.
_INFIX = {"+": (1, 2), "-": (1, 2), "*": (3, 4), "/": (3, 4), "**": (7, 6)}
_COMPARISONS = ("<", ">", "<=", ">=")
_SIGN_STRENGTH = 5  # between * and **, so that -t**2 is -(t**2)


@dataclass(frozen=True)
class _Token:
    kind: str  # number, name, symbol, or other: a character outside the grammar; end
    text: str
    column: int


class Parser:
    """A precedence-climbing (Pratt) parser of one text."""

    def __init__(self, text: str, variables: Collection[str]) -> None:
        if len(text) > MAX_LENGTH:
            self._stop(
                f"the expression goes on at {{}}; expected at most {MAX_LENGTH} characters",
                MAX_LENGTH + 1,
            )
        self._variables = variables
        self._known = [*variables, "pi", *FUNCTIONS, *PIECEWISE]
        self._used: set[str] = set()
        self._tokens = [
            _Token(str(match.lastgroup), match.group(), match.start() + 1)
            for match in _TOKEN.finditer(text)
            if match.lastgroup != "space"
        ]
        self._tokens.append(_Token("end", "", len(text) + 1))
        self._next = 0
        self._nesting = 0

    def parse(self) -> tuple[Node, frozenset[str]]:
        """Return the tree and the variables in it.

        Raises
        ------
        ExpressionError
            If the text is not in the grammar.
        """
        if self._token.kind == "end":
            self._stop("expected an expression at {}, got an empty text", 1)
        tree = self._expression(0)
        if self._token.kind != "end":
            self._refuse(self._token)
        return tree, frozenset(self._used)

    @staticmethod
    def _stop(message: str, column: int) -> NoReturn:
        """Raise an error; ``{}`` in the message stands for the column."""
        raise ExpressionError(message.replace("{}", f"column {column}", 1), column)

    @property
    def _token(self) -> _Token:
        return self._tokens[self._next]

    def _advance(self) -> _Token:
        self._next += 1
        return self._tokens[self._next - 1]

    def _expression(self, strength: int) -> Node:
        """Parse operands joined by operators that bind at least as strongly as `strength`."""
        self._nesting += 1
        if self._nesting > MAX_NESTING:
            message = f"the expression is nested more than {MAX_NESTING} deep at {{}}"
            self._stop(message, self._token.column)
        left = self._operand()
        while self._token.text in _INFIX:
            left_strength, right_strength = _INFIX[self._token.text]
            if left_strength < strength:
                break
            token = self._advance()
            left = Node(token.text, token.column, (left, self._expression(right_strength)))
        self._nesting -= 1
        return left

    def _operand(self) -> Node:
        token = self._advance()
        if token.kind == "number":
            value = float(token.text)
            if math.isinf(value):
                self._stop(f"number '{_short(token.text)}' at {{}} is too large", token.column)
            return Node(value, token.column)
        if token.kind == "name":
            return self._name(token)
        if token.text == "-":
            return Node("neg", token.column, (self._expression(_SIGN_STRENGTH),))
        if token.text == "+":
            return self._expression(_SIGN_STRENGTH)
        if token.text == "(":
            inner = self._expression(0)
            self._close(token)
            return inner
        if token.kind == "other":
            self._refuse(token)
        got = "the expression ends" if token.kind == "end" else f"got '{token.text}'"
        self._stop(f"expected a number, a name or '(' at {{}}, but {got}", token.column)

    def _name(self, token: _Token) -> Node:
        name, column = token.text, token.column
        if name in self._variables:
            self._used.add(name)
            return Node(name, column)
        if name == "pi":
            return Node(math.pi, column)
        if name not in FUNCTIONS and name not in PIECEWISE:
            hint = _HINTS.get(name, "") or suggestion(name.lower(), self._known)
            hint = hint or f"; known names: {', '.join(self._known)}"
            self._stop(f"unknown name '{_short(name)}' at {{}}{hint}", column)
        if self._token.text != "(":
            as_in = f"as in '{name}({next(iter(self._variables), '1')})'"
            self._stop(
                f"function '{name}' at {{}} needs its argument in parentheses, {as_in}", column
            )
        opening = self._advance()
        arguments = self._arguments(token)
        self._close(opening)
        return Node(name, column, arguments)

    def _arguments(self, function: _Token) -> tuple[Node, ...]:
        """Parse the arguments of a function, and check their number."""
        known = PIECEWISE.get(function.text)
        takes, count = (known.takes, known.count) if known else ("one argument", 1)
        rule = f"function '{function.text}' at column {function.column} takes {takes}, got "
        if self._token.text == ")":
            self._stop(f"{rule}none", function.column)
        is_inverted = False
        if function.text == "where":
            arguments, is_inverted = self._comparison(rule)
        else:
            arguments = [self._expression(0)]
        while self._token.text == ",":
            if len(arguments) == count:
                self._stop(f"{rule}another after ',' at {{}}", self._token.column)
            self._advance()
            arguments.append(self._expression(0))
        if self._token.text == ")" and len(arguments) < (count or 2):
            got = "no more" if function.text == "where" else str(len(arguments))
            self._stop(f"{rule}{got}", function.column)
        if is_inverted:
            arguments[2:] = arguments[:1:-1]
        return tuple(arguments)

    def _comparison(self, rule: str) -> tuple[list[Node], bool]:
        """Parse a comparison as a < b; also return whether that is its inverse."""
        column = self._token.column
        left = self._expression(0)
        sign = self._token.text
        if sign not in _COMPARISONS:
            self._stop(f"{rule}no comparison at {{}}", column)
        self._advance()
        pair = [left, self._expression(0)]
        if sign in (">", "<="):
            pair.reverse()
        return pair, sign in ("<=", ">=")

    def _close(self, opening: _Token) -> None:
        if self._token.kind == "end":
            self._stop("the '(' at {} is never closed", opening.column)
        if self._token.text != ")":
            self._refuse(self._token)
        self._advance()

    def _refuse(self, token: _Token) -> NoReturn:
        """Say why `token` cannot stand here, after a complete operand or as a foreign character."""
        text = token.text
        if token.kind == "other":
            message = f"unexpected character {text!r} at {{}}{_HINTS.get(text, '')}"
        elif text == ")":
            message = "the ')' at {} has no matching '('"
        elif text == ",":
            several = ", ".join(name for name, known in PIECEWISE.items() if known.count != 1)
            message = (
                f"unexpected ',' at {{}}; write decimals with a point; only {several} take several "
                "arguments"
            )
        elif text in _COMPARISONS:
            message = (
                f"unexpected '{text}' at {{}}; a comparison may only be the first argument of "
                "'where', as in 'where(t < 1, 0, 2)'"
            )
        elif text in ("and", "or", "if"):
            message = f"unexpected '{text}' at {{}}{_HINTS[text]}"
        else:
            before, after = _short(self._tokens[self._next - 1].text), _short(text)
            # 2t probably means a product; 1_000, 0x10 and 1e do not.
            multiply = token.kind != "name" or text in self._known
            hint = f"; write '{before}*{after}' to multiply" if multiply else ""
            message = f"missing operator between '{before}' and '{after}' at {{}}{hint}"
        self._stop(message, token.column)


def _short(word: str) -> str:
    return word if len(word) <= 30 else word[:27] + "..."
