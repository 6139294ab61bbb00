"""The whitelisted grammar of reference torques and constants; it knows no config and no engine.

An expression is made of numbers, ``pi``, the variables that the caller allows (``t`` by default),
``+ - * / **``, parentheses, the one-argument functions of `eqt_cli.core.arrays.FUNCTIONS`, and
those of `PIECEWISE`; a comparison stands in ``where(t < 1, a, b)`` and nowhere else.
Precedence is Python's: ``-2**2`` is −4, ``2**3**2`` is 512. There is no ``e``, since it is as often
the start of an exponent; write ``exp(1)``. Text is parsed by hand and never handed to Python.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce
from itertools import combinations
from typing import Any, NoReturn, TypeAlias

import numpy as np

from eqt_cli.core.arrays import FUNCTIONS, apply, clip, less, maximum, minimum, where
from eqt_cli.core.errors import ExpressionError, InputError, suggestion

MAX_LENGTH = 10_000
"""The most characters of an expression."""

MAX_NESTING = 100
"""The deepest nesting of parentheses, signs and ``**``, far inside Python's recursion limit."""


@dataclass(frozen=True)
class Number:
    """A number, or ``pi``."""

    value: float
    column: int


@dataclass(frozen=True)
class Variable:
    """A name whose value is given when the expression is evaluated."""

    name: str
    column: int


@dataclass(frozen=True)
class Negation:
    """``-operand``."""

    operand: Node
    column: int


@dataclass(frozen=True)
class Binary:
    """``left operator right``, with one of ``+ - * / **``; `column` is the operator's."""

    operator: str
    left: Node
    right: Node
    column: int


@dataclass(frozen=True)
class Call:
    """``function(arguments)``.

    ``where(a < b, x, y)`` has the arguments a, b, x, y; other comparisons are turned into this one.
    """

    function: str
    arguments: tuple[Node, ...]
    column: int


Node: TypeAlias = Number | Variable | Negation | Binary | Call


@dataclass(frozen=True)
class Expression:
    """A parsed expression; two are equal when their texts are.

    Attributes
    ----------
    text : str
        What was parsed.
    variables : frozenset of str
        The variables that occur in it.
    tree : Node
        The syntax tree, in which chains such as ``a + b + c`` lean to the left without limit of
        depth: walk it with a loop along `Binary.left`, as `fold` does.
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
            What the operators make of the values: floats give a float, arrays an array of their
            shape, a symbol a symbol. An expression without variables is a float whatever is given.
            Arithmetic is IEEE 754's, without warnings: ``1/t`` at 0 is inf, ``sqrt(t)`` at −1 nan.

        Raises
        ------
        KeyError
            If a variable has no value.
        TraceError
            If a symbol's engine lacks a function.
        """

        def visit(node: Node, operands: tuple[Any, ...]) -> Any:
            if isinstance(node, Variable):
                value = values[node.name]
                if isinstance(value, np.ndarray) and value.ndim == 0:
                    value = value[()]
                return float(value) if isinstance(value, int) else value
            return combine(node, operands)

        with np.errstate(all="ignore"):
            return fold(self.tree, visit)

    @property
    def instants(self) -> tuple[float, ...]:
        """The values of ``t`` at which a piecewise function changes its piece, in order.

        Those that can be read off: where what is compared is linear in t.
        """
        found: set[float] = set()

        def visit(node: Node, operands: tuple[_Linear | None, ...]) -> _Linear | None:
            if isinstance(node, Call) and node.function in PIECEWISE:
                found.update(_roots(node.function, operands))
                return None
            return _linear(node, operands)

        if "t" in self.variables:
            with np.errstate(all="ignore"):
                fold(self.tree, visit)
        return tuple(sorted(found))

    def __reduce__(self) -> tuple[Callable[..., Expression], tuple[str, tuple[str, ...]]]:
        """Travel to workers as text: pickling a deep tree would exhaust the stack."""
        return parse, (self.text, tuple(sorted(self.variables)))


def parse(text: str, variables: Collection[str] = ("t",)) -> Expression:
    """Parse an expression in the given variables.

    Raises
    ------
    ExpressionError
        If the text is not an expression of the grammar, or a part of it without variables has no
        finite value (``log(0)``, ``1/0``). The message names the column, counted from 1.
    """
    tree, used = _Parser(text, variables).parse()
    with np.errstate(all="ignore"):
        fold(tree, _constant_value)
    return Expression(text, used, tree)


MOST_QUOTED = 100
"""Characters of an expression in a message, which names the column."""


def formula(entry: str | float) -> Expression:
    """The expression in t that an entry of a configuration is, text or a number.

    Raises
    ------
    InputError
        If it is none; the message quotes it.
    """
    try:
        return parse(str(entry))
    except ExpressionError as error:
        text = str(entry)
        quoted = text if len(text) <= MOST_QUOTED else text[:MOST_QUOTED] + "…"
        raise InputError(f"'{quoted}': {error}") from error


def constant(text: str) -> float:
    """Compute an expression without variables, such as ``-pi/2``.

    Raises
    ------
    ExpressionError
        As `parse`.
    """
    return float(parse(text, ()).evaluate({}))


# Evaluation -----------------------------------------------------------------------------------


def fold(node: Node, visit: Callable[[Node, tuple[Any, ...]], Any]) -> Any:
    """Visit the tree from the leaves up, each node with the results of its operands."""
    chain: list[Binary] = []
    while isinstance(node, Binary):  # a long sum is a deep tree: recursion would not do
        chain.append(node)
        node = node.left
    if isinstance(node, Negation):
        result = visit(node, (fold(node.operand, visit),))
    elif isinstance(node, Call):
        result = visit(node, tuple(fold(argument, visit) for argument in node.arguments))
    else:
        result = visit(node, ())
    while chain:
        binary = chain.pop()
        result = visit(binary, (result, fold(binary.right, visit)))
    return result


def combine(node: Number | Negation | Binary | Call, operands: tuple[Any, ...]) -> Any:
    """Compute the value of a node from those of its operands."""
    if isinstance(node, Binary):
        left, right = operands
        if isinstance(left, float) and isinstance(right, float):
            # Python's floats raise where IEEE has inf and nan, and turn complex on (-8)**0.5.
            return float(_OPERATORS[node.operator](np.float64(left), right))
        return _OPERATORS[node.operator](left, right)
    if isinstance(node, Call):
        known = PIECEWISE.get(node.function)
        result = known.value(*operands) if known else apply(node.function, operands[0])
        if isinstance(result, float):
            return float(result)
        zero_dimensional = isinstance(result, np.ndarray) and result.shape == ()
        return result[()] if zero_dimensional else result
    if isinstance(node, Negation):
        return -operands[0]
    return node.value


# Functions of several arguments, and others that are put together from pieces.


@dataclass(frozen=True)
class Piecewise:
    """A function that is put together from pieces.

    Attributes
    ----------
    value
        The function itself, of floats, arrays or symbols.
    compared
        Which pairs of arguments it compares, of so many; an argument that is None stands for 0.
    takes
        Its arguments in words.
    count
        How many arguments it takes; None for two or more.
    """

    value: Callable[..., Any]
    compared: Callable[[int], Iterable[tuple[int, int | None]]]
    takes: str
    count: int | None


def _sign(x: Any) -> Any:
    return where(less(x, 0.0), -1.0, where(less(0.0, x), 1.0, 0.0))


def _smoothstep(x: Any, start: Any, end: Any) -> Any:
    s = clip((x - start) / (end - start), 0.0, 1.0)  # how far x has come
    return s * s * (3 - 2 * s)


def _chosen(a: Any, b: Any, x: Any, y: Any) -> Any:
    return where(less(a, b), x, y)


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
    "where": Piecewise(
        _chosen,
        lambda _: [(0, 1)],
        "a comparison and two values, as in 'where(t < 1, 0, 2)'",
        4,
    ),
}
"""The functions that have kinks or steps, at which engines end a step."""

_Linear = tuple[float, float]
"""p + q t, as (p, q)."""


def _linear(node: Node, operands: tuple[_Linear | None, ...]) -> _Linear | None:
    """A node as p + q t, where that can be read off."""
    if isinstance(node, Variable):
        return (0.0, 1.0) if node.name == "t" else None
    if any(operand is None for operand in operands):
        return None
    if isinstance(node, Binary) and node.operator in "+-":
        (p, q), (r, s) = operands  # type: ignore[misc]  # none of them is None
        sign = 1 if node.operator == "+" else -1
        return p + sign * r, q + sign * s
    if isinstance(node, Binary) and node.operator in ("*", "/"):
        (p, q), (r, s) = operands  # type: ignore[misc]  # none of them is None
        if s == 0 and node.operator == "/":
            return p / r, q / r
        if node.operator == "*" and q * s == 0:
            return p * r, p * s + q * r
        return None
    if isinstance(node, Negation):
        [(p, q)] = operands  # type: ignore[misc]  # it is not None
        return -p, -q
    if all(operand[1] == 0 for operand in operands if operand):
        return combine(node, tuple(operand[0] for operand in operands if operand)), 0.0
    return None


def _roots(function: str, operands: tuple[_Linear | None, ...]) -> Iterator[float]:
    """Where arguments that a function compares are equal."""
    for one, other in PIECEWISE[function].compared(len(operands)):
        left, right = operands[one], (0.0, 0.0) if other is None else operands[other]
        if left and right and left[1] != right[1]:
            yield (right[0] - left[0]) / (left[1] - right[1])


def power(base: Any, exponent: Any) -> Any:
    """Raise to a power, also a number to that of a symbol, whose type may have no ``__rpow__``."""
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


def _constant_value(node: Node, operands: tuple[float | None, ...]) -> float | None:
    """Compute a node without variables, which must be finite; None stands for all others."""
    if isinstance(node, Binary) and node.operator == "/" and operands[1] == 0:
        raise ExpressionError(f"division by zero at column {node.column}", node.column)
    if isinstance(node, Call) and node.function == "smoothstep":
        start, end = operands[1:]
        if start is not None and end is not None and not start < end:
            raise ExpressionError(
                f"'smoothstep' at column {node.column} is to rise from {start:g} to {end:g}; "
                "expected the second number to be larger",
                node.column,
            )
    if isinstance(node, Variable) or None in operands:
        return None
    value = float(combine(node, operands))
    if isinstance(node, (Binary, Call)) and not math.isfinite(value):
        name = node.operator if isinstance(node, Binary) else node.function
        raise ExpressionError(
            f"'{name}' at column {node.column} has no finite value (got {value})", node.column
        )
    return value


# Parsing --------------------------------------------------------------------------------------

_TOKEN = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<symbol>\*\*|<=|>=|[-+*/()<>,])"
)

_NAME_HINTS = {
    "e": "; write 'exp(1)' for Euler's number",
    "ln": "; the natural logarithm is 'log'",
    "pow": "; write 'a**b' for a power",
    "math": "; write 'sin' for 'math.sin'",
    "np": "; write 'sin' for 'np.sin'",
    "numpy": "; write 'sin' for 'numpy.sin'",
    "clip": "; write 'min(max(a, low), high)'",
    "if": "; write 'where(t < 1, a, b)'",
    "and": "; write one 'where' within another",
    "or": "; write one 'where' within another",
}
_CHARACTER_HINTS = {
    "^": "; write '**' for a power",
    "\N{GREEK SMALL LETTER PI}": "; write 'pi'",
    "\N{MINUS SIGN}": "; write '-'",
    "\N{EN DASH}": "; write '-'",
    "\N{MIDDLE DOT}": "; write '*'",
    "\N{DOT OPERATOR}": "; write '*'",
    "\N{MULTIPLICATION SIGN}": "; write '*'",
    "\N{DIVISION SIGN}": "; write '/'",
    "\N{SUPERSCRIPT TWO}": "; write '**2'",
    "\N{SUPERSCRIPT THREE}": "; write '**3'",
}

# How strongly an operator binds, and the least strength that its right operand must show.
_INFIX = {"+": (1, 2), "-": (1, 2), "*": (3, 4), "/": (3, 4), "**": (7, 6)}
_COMPARISONS = ("<", ">", "<=", ">=")
_SIGN_STRENGTH = 5  # between * and **, so that -t**2 is -(t**2)


@dataclass(frozen=True)
class _Token:
    kind: str  # number, name, symbol, or other: a character outside the grammar; end
    text: str
    column: int


def _tokens(text: str) -> list[_Token]:
    tokens = []
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            # Not yet an error: what comes before it in the text is to be complained of first.
            tokens.append(_Token("other", text[position], position + 1))
            position += 1
            continue
        if match.lastgroup and match.lastgroup != "space":
            tokens.append(_Token(match.lastgroup, match.group(), position + 1))
        position = match.end()
    tokens.append(_Token("end", "", len(text) + 1))
    return tokens


class _Parser:
    """A precedence-climbing (Pratt) parser of one text."""

    def __init__(self, text: str, variables: Collection[str]) -> None:
        if len(text) > MAX_LENGTH:
            raise ExpressionError(
                f"the expression goes on at column {MAX_LENGTH + 1}; "
                f"expected at most {MAX_LENGTH} characters",
                MAX_LENGTH + 1,
            )
        self._variables = variables
        self._known = [*variables, "pi", *FUNCTIONS, *PIECEWISE]
        self._used: set[str] = set()
        self._tokens = _tokens(text)
        self._next = 0
        self._nesting = 0

    def parse(self) -> tuple[Node, frozenset[str]]:
        if self._token.kind == "end":
            raise ExpressionError("expected an expression at column 1, got an empty text", 1)
        tree = self._expression(0)
        if self._token.kind != "end":
            self._refuse(self._token)
        return tree, frozenset(self._used)

    @property
    def _token(self) -> _Token:
        return self._tokens[self._next]

    def _advance(self) -> _Token:
        token = self._token
        self._next += 1
        return token

    def _expression(self, strength: int) -> Node:
        """Parse operands joined by operators that bind at least as strongly as `strength`."""
        self._nesting += 1
        if self._nesting > MAX_NESTING:
            column = self._token.column
            raise ExpressionError(
                f"the expression is nested more than {MAX_NESTING} deep at column {column}", column
            )
        left = self._operand()
        while self._token.text in _INFIX:
            left_strength, right_strength = _INFIX[self._token.text]
            if left_strength < strength:
                break
            token = self._advance()
            left = Binary(token.text, left, self._expression(right_strength), token.column)
        self._nesting -= 1
        return left

    def _operand(self) -> Node:
        token = self._advance()
        if token.kind == "number":
            return self._number(token)
        if token.kind == "name":
            return self._name(token)
        if token.text == "-":
            return Negation(self._expression(_SIGN_STRENGTH), token.column)
        if token.text == "+":
            return self._expression(_SIGN_STRENGTH)
        if token.text == "(":
            inner = self._expression(0)
            self._close(token)
            return inner
        if token.kind == "other":
            self._refuse(token)
        got = "the expression ends" if token.kind == "end" else f"got '{token.text}'"
        raise ExpressionError(
            f"expected a number, a name or '(' at column {token.column}, but {got}", token.column
        )

    def _number(self, token: _Token) -> Node:
        value = float(token.text)
        if math.isinf(value):
            raise ExpressionError(
                f"number '{_short(token.text)}' at column {token.column} is too large",
                token.column,
            )
        return Number(value, token.column)

    def _name(self, token: _Token) -> Node:
        name, column = token.text, token.column
        if name in self._variables:
            self._used.add(name)
            return Variable(name, column)
        if name == "pi":
            return Number(math.pi, column)
        if name not in FUNCTIONS and name not in PIECEWISE:
            raise ExpressionError(
                f"unknown name '{_short(name)}' at column {column}{self._name_hint(name)}", column
            )
        if self._token.text != "(":
            raise ExpressionError(
                f"function '{name}' at column {column} needs its argument in parentheses, "
                f"as in '{name}({next(iter(self._variables), '1')})'",
                column,
            )
        opening = self._advance()
        arguments = self._arguments(token)
        self._close(opening)
        return Call(name, arguments, column)

    def _arguments(self, function: _Token) -> tuple[Node, ...]:
        """Parse what stands between the parentheses of a function, as many as it takes."""
        known = PIECEWISE.get(function.text)
        takes, count = (known.takes, known.count) if known else ("one argument", 1)
        wrong = f"function '{function.text}' at column {function.column} takes {takes}"
        if self._token.text == ")":
            raise ExpressionError(f"{wrong}, got none", function.column)
        exchanged = False
        if function.text == "where":
            arguments, exchanged = self._comparison(wrong)
        else:
            arguments = [self._expression(0)]
        while self._token.text == ",":
            if len(arguments) == count:
                column = self._token.column
                raise ExpressionError(f"{wrong}, got another after ',' at column {column}", column)
            self._advance()
            arguments.append(self._expression(0))
        if self._token.text == ")" and len(arguments) < (count or 2):
            got = "no more" if function.text == "where" else str(len(arguments))
            raise ExpressionError(f"{wrong}, got {got}", function.column)
        if exchanged:
            arguments[2:] = arguments[:1:-1]
        return tuple(arguments)

    def _comparison(self, wrong: str) -> tuple[list[Node], bool]:
        """Parse a comparison as a < b; also whether what holds then is what holds otherwise."""
        column = self._token.column
        left = self._expression(0)
        sign = self._token.text
        if sign not in _COMPARISONS:
            raise ExpressionError(f"{wrong}, got no comparison at column {column}", column)
        self._advance()
        pair = [left, self._expression(0)]
        if sign in (">", "<="):
            pair.reverse()
        return pair, sign in ("<=", ">=")

    def _name_hint(self, name: str) -> str:
        hint = _NAME_HINTS.get(name, "") or suggestion(name.lower(), self._known)
        return hint or f"; expected one of {', '.join(self._known)}"

    def _close(self, opening: _Token) -> None:
        if self._token.text == ")":
            self._advance()
        elif self._token.kind == "end":
            raise ExpressionError(
                f"the '(' at column {opening.column} is never closed", opening.column
            )
        else:
            self._refuse(self._token)

    def _refuse(self, token: _Token) -> NoReturn:
        """Say why `token` cannot stand here; it follows a complete operand if it is no `other`."""
        column = token.column
        if token.kind == "other":
            hint = _CHARACTER_HINTS.get(token.text, "")
            raise ExpressionError(
                f"unexpected character {token.text!r} at column {column}{hint}", column
            )
        if token.text == ")":
            raise ExpressionError(f"the ')' at column {column} closes no '('", column)
        if token.text == ",":
            several = ", ".join(name for name, known in PIECEWISE.items() if known.count != 1)
            raise ExpressionError(
                f"unexpected ',' at column {column}; numbers take a decimal point, and only "
                f"{several} take several arguments",
                column,
            )
        if token.text in _COMPARISONS:
            raise ExpressionError(
                f"unexpected '{token.text}' at column {column}; one comparison can stand first in "
                "'where', as in 'where(t < 1, 0, 2)'",
                column,
            )
        if token.text in ("and", "or", "if"):
            hint = _NAME_HINTS[token.text]
            raise ExpressionError(f"unexpected '{token.text}' at column {column}{hint}", column)
        before, after = _short(self._tokens[self._next - 1].text), _short(token.text)
        # Of 2t a product is meant, of 1_000, 0x10 or 1e it is not.
        multiply = token.kind != "name" or token.text in self._known
        hint = f"; write '{before}*{after}' to multiply" if multiply else ""
        raise ExpressionError(
            f"missing operator between '{before}' and '{after}' at column {column}{hint}", column
        )


def _short(word: str) -> str:
    return word if len(word) <= 30 else word[:27] + "..."
