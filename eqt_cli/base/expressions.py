"""Formulas of a configuration, such as reference torques and constants.

An expression is made of numbers, ``pi``, the variables that the caller allows (``t`` by default),
``+ - * / **``, parentheses, the one-argument functions of `eqt_cli.base.arrays.FUNCTIONS`, and
those of `PIECEWISE`. A comparison may only be the first argument of ``where(t < 1, a, b)``.
Precedence is Python's: ``-2**2`` is −4, ``2**3**2`` is 512. Python only parses an expression, it
never evaluates one. There is no ``e``, because it also
starts an exponent; write ``exp(1)``.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, reduce
from typing import Any, NamedTuple, NoReturn

import numpy as np

from eqt_cli.base.arrays import (
    FUNCTIONS,
    absolute,
    apply,
    clip,
    less,
    maximum,
    minimum,
    number_like,
    smooth_less,
    unwrapped,
    where,
    where_number,
)
from eqt_cli.base.errors import ExpressionError, InputError, suggestion

# Functions with kinks or steps -----------------------------------------------------------------


@dataclass(frozen=True)
class Piecewise:
    """A function that is defined in pieces.

    Attributes
    ----------
    value
        The function, of floats, arrays or symbols.
    compared
        The pairs of arguments that it compares, None for all of them; None in a pair stands for 0.
    takes
        The arguments in words.
    count
        The number of arguments; None for two or more.
    wholes
        Arguments x, a and p: it takes the floor of (x − a)/p; None for 0.
    """

    value: Callable[..., Any]
    compared: Sequence[tuple[int, int | None]] | None
    takes: str
    count: int | None
    wholes: Sequence[tuple[int, int | None, int]] = ()


def _sign(x: Any) -> Any:
    return where(less(x, 0.0), -1.0, where(less(0.0, x), 1.0, where_number(x, 0.0)))


def _where(a: Any, b: Any, x: Any, y: Any) -> Any:
    return where_number(a, where_number(b, where(less(a, b), x, y)))


def _smoothstep(x: Any, start: Any, end: Any) -> Any:
    s = clip((x - start) / (end - start), 0.0, 1.0)
    return s * s * (3 - 2 * s)


def _pulse(x: Any, period: Any, start: Any, end: Any) -> Any:
    begun, ended = (apply("floor", (x - edge) / period) for edge in (start, end))
    return begun - ended


def _atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y) from the x axis, by arc tangents of numbers from −1 to 1."""
    steep = smooth_less(absolute(x), absolute(y))
    angle = apply("atan", where(steep, x, y) / where(steep, y, x))
    above = where(smooth_less(y, 0.0), -np.pi / 2, np.pi / 2)
    behind = where(less(y, 0.0), -np.pi, np.pi)  # a real jump, so not `smooth_less`
    return where(steep, above - angle, where(smooth_less(x, 0.0), angle + behind, angle))


PIECEWISE = {
    "min": Piecewise(lambda *x: reduce(minimum, x), None, "two or more arguments", None),
    "max": Piecewise(lambda *x: reduce(maximum, x), None, "two or more arguments", None),
    "mod": Piecewise(
        lambda x, period: x - period * apply("floor", x / period),
        [],
        "two arguments, as in 'mod(t, 10)', the time since the last multiple of 10",
        2,
        wholes=[(0, None, 1)],
    ),
    "pulse": Piecewise(
        _pulse,
        [],
        "four arguments, as in 'pulse(t, 10, 2, 3)', which is 1 from 2 to 3 of every 10, else 0",
        4,
        wholes=[(0, 2, 1), (0, 3, 1)],
    ),
    "sign": Piecewise(_sign, [(0, None)], "one argument", 1),
    "step": Piecewise(
        lambda x, start: _where(x, start, 0.0, 1.0),
        [(0, 1)],
        "two arguments, as in 'step(t, 1)', which is 0 before t = 1 and 1 after",
        2,
    ),
    "smoothstep": Piecewise(
        _smoothstep,
        [(0, 1), (0, 2)],
        "three arguments, as in 'smoothstep(t, 1, 3)', which rises from 0 at 1 to 1 at 3",
        3,
    ),
    "atan2": Piecewise(
        _atan2,
        [(0, None)],
        "two arguments, as in 'atan2(y, x)', the angle of the point (x, y) in rad",
        2,
    ),
    "where": Piecewise(
        _where, [(0, 1)], "a comparison and two values, as in 'where(t < 1, 0, 2)'", 4
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
"""Deepest nesting of parentheses, signs and operators, far within Python's recursion limit."""

_TOO_DEEP = f"the expression is nested more than {MAX_NESTING} deep at {{}}"

_SIGN = re.compile(r"\*\*|<=|>=|[-+*/<>,]")
_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    rf"|(?P<call>(?:{'|'.join([*FUNCTIONS, *PIECEWISE])})[ \t\r\n]*\()"
    r"|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    rf"|(?P<sign>{_SIGN.pattern})"
    r"|(?P<parenthesis>[()])"
    r"|(?P<other>[^ \t\r\n])"  # no error yet, because an error earlier in the text comes first
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
    "%": "; write 'mod(a, b)' for the remainder, or 'pulse(t, period, from, to)'",
    "\N{GREEK SMALL LETTER PI}": "; write 'pi'",
    "\N{SUPERSCRIPT TWO}": "; write '**2'",
    "\N{SUPERSCRIPT THREE}": "; write '**3'",
    **dict.fromkeys("\N{MINUS SIGN}\N{EN DASH}", "; write '-'"),
    **dict.fromkeys("\N{MIDDLE DOT}\N{DOT OPERATOR}\N{MULTIPLICATION SIGN}", "; write '*'"),
    "\N{DIVISION SIGN}": "; write '/'",
}
"""What to write instead of names and characters outside the grammar."""


class _Token(NamedTuple):
    kind: str  # a group of _TOKEN, start or end
    text: str
    column: int


class _Parser:
    """Checks which tokens follow which, and has Python parse the text if all are in order.

    Python then sees numbers and names that exist, signs and parentheses. Of what its grammar makes
    of them, comparisons outside of ``where`` and commas outside of functions are refused.
    """

    def __init__(self, text: str, variables: Collection[str]) -> None:
        if len(text) > MAX_LENGTH:
            message = f"the expression goes on at {{}}; expected at most {MAX_LENGTH} characters"
            _stop(message, MAX_LENGTH + 1)
        self._text, self._variables = text, variables
        self._names = [*variables, "pi", *FUNCTIONS, *PIECEWISE]
        self._leaves: dict[int, Node] = {}
        # Keys, such as gains.kp and inertia[0], are names where they are variables.
        keys = "|".join(map(re.escape, (name for name in variables if not name.isidentifier())))
        names = f"(?P<name>(?:{keys})(?![A-Za-z_0-9.[])|" if keys else "(?P<name>"
        self._token = re.compile(_TOKEN.pattern.replace("(?P<name>", names))
        # Python gets an x for each number and name, because it reads neither 007 nor a variable
        # lambda. After a parenthesis, which allows line breaks, its offsets from 0 are our columns.
        self._python = "("

    def parse(self) -> tuple[Node, frozenset[str]]:
        """Return the tree and the variables in it.

        Raises
        ------
        ExpressionError
            If the text is not in the grammar.
        """
        before = _Token("start", "", 0)
        opened: list[int] = []
        for match in self._token.finditer(self._text):
            token = _Token(str(match.lastgroup), match.group(), match.start() + 1)
            self._check_order(before, token)
            before = token
            kind, text, column = token
            if kind == "number":
                self._leaves[column] = Node(float(text), column)
            elif kind == "name":
                self._leaves[column] = Node(text if text in self._variables else math.pi, column)
            elif text.endswith("("):
                opened.append(match.end())
                if len(opened) > MAX_NESTING:
                    _stop(_TOO_DEEP, column)
            elif text == ")":
                if not opened:
                    _stop("the ')' at {} has no matching '('", column)
                opened.pop()
            word = "x" if column in self._leaves else "".join(text.split())  # of "sin ("
            self._python = self._python.ljust(column) + word
        self._check_order(before, _Token("end", "", len(self._text) + 1))
        if opened:
            _stop("the '(' at {} is never closed", opened[-1])
        try:
            tree = ast.parse(self._python + ")", mode="eval").body
        except (RecursionError, MemoryError):  # more than 1000, depending on Python's version
            _stop("the expression at {} has too many operators in a row", 1)
        used = frozenset(str(leaf.what) for leaf in self._leaves.values() if leaf.is_variable)
        return self._node(tree, 1), used

    def _check_order(self, before: _Token, token: _Token) -> None:
        """Refuse a token that may not follow the one before."""
        kind, word, column = token
        follows_operand = before.kind in ("number", "name") or before.text == ")"
        is_operand = kind in ("number", "name", "call") or word == "("
        ends_call = before.kind == "call" and word == ")"
        if kind == "other":
            _stop(f"unexpected character {word!r} at {{}}{_HINTS.get(word, '')}", column)
        if kind == "end" and before.kind == "start":
            _stop("expected an expression at {}, got an empty text", 1)
        if is_operand and follows_operand:
            self._refuse_second(before, token)
        if not (is_operand or follows_operand or ends_call or word in ("+", "-")):
            got = "the expression ends" if kind == "end" else f"got '{word}'"
            _stop(f"expected a number, a name or '(' at {{}}, but {got}", column)
        if kind == "name" and word not in self._variables and word != "pi":
            self._refuse_name(token)
        if kind == "number" and math.isinf(float(word)):
            _stop(f"number '{_short(word)}' at {{}} is too large", column)

    def _refuse_second(self, before: _Token, token: _Token) -> NoReturn:
        """Say that an operator is missing between two operands."""
        word = token.text[:-1].rstrip() if token.kind == "call" else token.text
        left, right = _short(before.text), _short(word)
        if right in ("and", "or", "if"):
            _stop(f"unexpected '{right}' at {{}}{_HINTS[right]}", token.column)
        # 2t probably means a product; 1_000, 0x10 and 1e do not.
        multiply = token.kind != "name" or token.text in self._names
        hint = f"; write '{left}*{right}' to multiply" if multiply else ""
        _stop(f"missing operator between '{left}' and '{right}' at {{}}{hint}", token.column)

    def _refuse_name(self, token: _Token) -> NoReturn:
        name = token.text
        if name in self._names:
            as_in = f"as in '{name}({next(iter(self._variables), '1')})'"
            message = f"function '{name}' at {{}} needs its argument in parentheses, {as_in}"
        else:
            hint = _HINTS.get(name, "") or suggestion(name.lower(), self._names)
            hint = hint or f"; known names: {', '.join(self._names)}"
            message = f"unknown name '{_short(name)}' at {{}}{hint}"
        _stop(message, token.column)

    def _node(self, tree: ast.expr, depth: int) -> Node:
        """Return a part of Python's tree as our own, `depth` of which contain it."""
        chain: list[ast.BinOp] = []
        while isinstance(tree, ast.BinOp):  # the tree of a long sum is too deep for recursion
            chain.append(tree)
            tree = tree.left
        column = tree.col_offset
        if depth > MAX_NESTING:
            _stop(_TOO_DEEP, column)
        match tree:
            case ast.Name():
                node = self._leaves[column]
            case ast.UnaryOp(op=ast.USub()):
                node = Node("neg", column, (self._node(tree.operand, depth + 1),))
            case ast.UnaryOp(op=ast.UAdd()):
                node = self._node(tree.operand, depth + 1)
            case ast.Call(func=ast.Name(id=name)):
                arguments = self._arguments(tree, name)
                node = Node(name, column, tuple(self._node(a, depth + 1) for a in arguments))
            case ast.Compare(left=first) | ast.Tuple(elts=[first, *_]):
                self._refuse_after(first)
        for operation in reversed(chain):
            sign, column = self._sign_after(operation.left)
            node = Node(sign, column, (node, self._node(operation.right, depth + 1)))
        return node

    def _arguments(self, call: ast.Call, name: str) -> list[ast.expr]:
        """Return the arguments of a function, with a < b as two, if their number is right."""
        piecewise = PIECEWISE.get(name)
        takes, count = (piecewise.takes, piecewise.count) if piecewise else ("one argument", 1)
        rule = f"function '{name}' at column {call.col_offset} takes {takes}, got "
        arguments, got = list(call.args), str(len(call.args) or "none")
        if name == "where" and arguments:
            comparison, got = arguments[0], "no more"
            if not isinstance(comparison, ast.Compare):
                _stop(f"{rule}no comparison at {{}}", comparison.col_offset)
            if len(comparison.ops) > 1:
                self._refuse_after(comparison.comparators[0])
            arguments[:1] = comparison.left, comparison.comparators[0]
            if isinstance(comparison.ops[0], (ast.Gt, ast.LtE)):
                arguments[:2] = arguments[1::-1]
            if isinstance(comparison.ops[0], (ast.GtE, ast.LtE)):
                arguments[2:] = arguments[:1:-1]
        if count and len(arguments) > count:
            _, column = self._sign_after(call.args[count - len(arguments) - 1])
            _stop(f"{rule}another after ',' at {{}}", column)
        if len(arguments) < (count or 2):
            _stop(f"{rule}{got}", call.col_offset)
        return arguments

    def _sign_after(self, tree: ast.expr) -> tuple[str, int]:
        """Return the sign that follows a part of the text, and its column."""
        match = next(_SIGN.finditer(self._python, tree.end_col_offset or 0))
        return match.group(), match.start()

    def _refuse_after(self, tree: ast.expr) -> NoReturn:
        """Say why the comparison or the comma that follows a part cannot stand there."""
        sign, column = self._sign_after(tree)
        rule = "a comparison may only be the first argument of 'where', as in 'where(t < 1, 0, 2)'"
        if sign == ",":
            several = ", ".join(
                name for name, piecewise in PIECEWISE.items() if piecewise.count != 1
            )
            rule = f"write decimals with a point; only {several} take several arguments"
        _stop(f"unexpected '{sign}' at {{}}; {rule}", column)


def _stop(message: str, column: int) -> NoReturn:
    """Raise an error; ``{}`` in the message stands for the column."""
    raise ExpressionError(message.replace("{}", f"column {column}", 1), column)


def _short(word: str) -> str:
    return word if len(word) <= 30 else word[:27] + "..."


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
        number = number_like(next(iter(values.values()), None))

        def visit(node: Node, operands: tuple[Any, ...]) -> Any:
            if node.is_variable:
                value = unwrapped(values[str(node.what)])
                return float(value) if isinstance(value, int) else value
            are_floats = [isinstance(x, float) for x in operands]
            # A power is structure, since a whole one is a product.
            if any(are_floats) and not all(are_floats) and node.what != "**":
                if node.what == "/" and are_floats[1] and _is_power_of_two(operands[1]):
                    return operands[0] * number(1 / operands[1])  # exact; products may be fused
                operands = tuple(number(x) if isinstance(x, float) else x for x in operands)
            return combined(node, operands)

        with np.errstate(all="ignore"):
            result = fold(self.tree, visit)
            return number(result) if isinstance(result, float) else result

    def bound(self, values: Mapping[str, float]) -> Expression:
        """Return the expression with numbers in place of some variables."""
        names = "|".join(values)
        text = re.sub(rf"\b({names})\b", lambda name: f"({values[name[0]]!r})", self.text)
        return parse(text, sorted(self.variables - values.keys()))

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
    tree, used = _Parser(text, variables).parse()
    with np.errstate(all="ignore"):
        fold(tree, _finite_value)
    return Expression(text, used, tree)


_parsed = lru_cache(maxsize=1024)(parse)
"""Kept, because the points of a sweep have mostly the same references."""

MAX_QUOTED = 100
"""Longest quotation of an expression in a message, characters."""


def formula(entry: str | float, variables: tuple[str, ...] = ("t",), times: str = "") -> Expression:
    """Return the expression of an entry in a configuration, text or a number, times a factor.

    Raises
    ------
    InputError
        If the entry is no expression; the message quotes it.
    """
    try:
        alone = _parsed(str(entry), variables)  # errors count its columns
        return _parsed(f"({entry})*{times}", variables) if times else alone
    except ExpressionError as error:
        raise InputError(f"'{shortened(str(entry))}': {error}") from error


def shortened(text: str) -> str:
    """Return the text of an expression as messages quote it."""
    return text if len(text) <= MAX_QUOTED else text[:MAX_QUOTED] + "…"


def constant(text: str) -> float:
    """Compute an expression without variables, such as ``-pi/2``.

    Raises
    ------
    ExpressionError
        As by `parse`.
    """
    return float(_parsed(text, ()).evaluate({}))


# Values of nodes -------------------------------------------------------------------------------


def power(base: Any, exponent: Any) -> Any:
    """Raise to a power, also a number to a symbol, whose type may have no ``__rpow__``."""
    symbols = isinstance(exponent, np.ndarray) and exponent.dtype == object
    if isinstance(base, float) and (symbols or not hasattr(exponent, "__rpow__")):
        return unwrapped(apply("exp", exponent * float(np.log(base))))
    return base**exponent


_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": power,
}


def combined(node: Node, operands: tuple[Any, ...]) -> Any:
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
    piecewise = PIECEWISE.get(what)
    operands = tuple(np.float64(x) if isinstance(x, float) else x for x in operands)
    result = piecewise.value(*operands) if piecewise else apply(what, operands[0])
    return float(result) if isinstance(result, float) else unwrapped(result)


def _is_power_of_two(x: float) -> bool:
    """Return whether 1/x is exact."""
    return abs(math.frexp(x)[0]) == 0.5 and abs(x) > 1e-300


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
    if what in ("mod", "pulse") and node.operands and (period := operands[1]) is not None:
        if not period > 0:
            message = f"'{what}' at column {column} needs a period above 0, got {period:g}"
            raise ExpressionError(message, column)
        start, end = operands[2:] if what == "pulse" else (None, None)
        if start is not None and end is not None and not 0 < end - start <= period:
            raise ExpressionError(
                f"'pulse' at column {column} must end after it begins, within a period of "
                f"{period:g}, got {start:g} and {end:g}",
                column,
            )
    if node.is_variable or None in operands:
        return None
    value = float(combined(node, operands))
    if operands and not math.isfinite(value):
        message = f"'{what}' at column {column} has no finite value (got {value})"
        raise ExpressionError(message, column)
    return value
