"""The syntax tree of an expression, and a function that visits its nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias


@dataclass(frozen=True)
class Number:
    """A number, or ``pi``."""

    value: float
    column: int


@dataclass(frozen=True)
class Variable:
    """A variable, whose value is given when the expression is evaluated."""

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

    ``where(a < b, x, y)`` has the arguments a, b, x, y; other comparisons are converted to it.
    """

    function: str
    arguments: tuple[Node, ...]
    column: int


Node: TypeAlias = Number | Variable | Negation | Binary | Call


def fold(node: Node, visit: Callable[[Node, tuple[Any, ...]], Any]) -> Any:
    """Visit the tree from the leaves up, each node with the results of its operands."""
    chain: list[Binary] = []
    while isinstance(node, Binary):  # the tree of a long sum is too deep for recursion
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
