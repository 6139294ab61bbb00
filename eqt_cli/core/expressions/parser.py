"""Parses the text of an expression to a syntax tree, with an error message for invalid text."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import NoReturn

from eqt_cli.core.arrays import FUNCTIONS
from eqt_cli.core.errors import ExpressionError, suggestion
from eqt_cli.core.expressions.piecewise import PIECEWISE
from eqt_cli.core.expressions.tree import Binary, Call, Negation, Node, Number, Variable

MAX_LENGTH = 10_000
"""Longest expression, characters."""

MAX_NESTING = 100
"""Deepest nesting of parentheses, signs and ``**``, far within Python's recursion limit."""

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

# The binding strength of each operator, and the smallest strength within its right operand.
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
            # No error yet, because an error earlier in the text should be reported first.
            tokens.append(_Token("other", text[position], position + 1))
            position += 1
            continue
        if match.lastgroup and match.lastgroup != "space":
            tokens.append(_Token(match.lastgroup, match.group(), position + 1))
        position = match.end()
    tokens.append(_Token("end", "", len(text) + 1))
    return tokens


class Parser:
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
        """Parse the arguments of a function, and check their number."""
        known = PIECEWISE.get(function.text)
        takes, count = (known.takes, known.count) if known else ("one argument", 1)
        rule = f"function '{function.text}' at column {function.column} takes {takes}"
        if self._token.text == ")":
            raise ExpressionError(f"{rule}, got none", function.column)
        is_inverted = False
        if function.text == "where":
            arguments, is_inverted = self._comparison(rule)
        else:
            arguments = [self._expression(0)]
        while self._token.text == ",":
            if len(arguments) == count:
                column = self._token.column
                raise ExpressionError(f"{rule}, got another after ',' at column {column}", column)
            self._advance()
            arguments.append(self._expression(0))
        if self._token.text == ")" and len(arguments) < (count or 2):
            got = "no more" if function.text == "where" else str(len(arguments))
            raise ExpressionError(f"{rule}, got {got}", function.column)
        if is_inverted:
            arguments[2:] = arguments[:1:-1]
        return tuple(arguments)

    def _comparison(self, rule: str) -> tuple[list[Node], bool]:
        """Parse a comparison as a < b; also return whether that is its inverse."""
        column = self._token.column
        left = self._expression(0)
        sign = self._token.text
        if sign not in _COMPARISONS:
            raise ExpressionError(f"{rule}, got no comparison at column {column}", column)
        self._advance()
        pair = [left, self._expression(0)]
        if sign in (">", "<="):
            pair.reverse()
        return pair, sign in ("<=", ">=")

    def _name_hint(self, name: str) -> str:
        hint = _NAME_HINTS.get(name, "") or suggestion(name.lower(), self._known)
        return hint or f"; known names: {', '.join(self._known)}"

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
        """Say why `token` cannot stand here, after a complete operand or as a foreign character."""
        column = token.column
        if token.kind == "other":
            hint = _CHARACTER_HINTS.get(token.text, "")
            raise ExpressionError(
                f"unexpected character {token.text!r} at column {column}{hint}", column
            )
        if token.text == ")":
            raise ExpressionError(f"the ')' at column {column} has no matching '('", column)
        if token.text == ",":
            several = ", ".join(name for name, known in PIECEWISE.items() if known.count != 1)
            raise ExpressionError(
                f"unexpected ',' at column {column}; write decimals with a point; only "
                f"{several} take several arguments",
                column,
            )
        if token.text in _COMPARISONS:
            raise ExpressionError(
                f"unexpected '{token.text}' at column {column}; a comparison may only be the first "
                "argument of 'where', as in 'where(t < 1, 0, 2)'",
                column,
            )
        if token.text in ("and", "or", "if"):
            hint = _NAME_HINTS[token.text]
            raise ExpressionError(f"unexpected '{token.text}' at column {column}{hint}", column)
        before, after = _short(self._tokens[self._next - 1].text), _short(token.text)
        # 2t probably means a product; 1_000, 0x10 and 1e do not.
        multiply = token.kind != "name" or token.text in self._known
        hint = f"; write '{before}*{after}' to multiply" if multiply else ""
        raise ExpressionError(
            f"missing operator between '{before}' and '{after}' at column {column}{hint}", column
        )


def _short(word: str) -> str:
    return word if len(word) <= 30 else word[:27] + "..."
