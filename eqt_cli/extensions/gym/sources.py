"""What a function computes, as text: for the file of a policy."""

from __future__ import annotations

import ast
import inspect
import textwrap
from typing import Any

MOST_LETTERS = 2000
"""Longest text."""


def text_of(function: Any) -> str:
    """Return the expression of a function with the numbers that it reads; else its source, or name.

    Of ``lambda x: -w * x.pose_error``, that is ``-w * x.pose_error, w = 0.3``.
    """
    try:
        lines, _ = inspect.findsource(function)
        expression = _expression(function, "".join(lines))
        text = expression or textwrap.dedent(inspect.getsource(function)).strip()
    except (OSError, TypeError, SyntaxError, ValueError):
        text = str(getattr(function, "__qualname__", repr(function)))
    numbers = [f"{name} = {value!r}" for name, value in _read(function).items()]
    return ", ".join([text, *numbers])[:MOST_LETTERS]


def _expression(function: Any, source: str) -> str:
    """Return what a lambda returns, found by the place of its code; "" of another function."""
    if getattr(function, "__name__", "") != "<lambda>":
        return ""
    first = function.__code__.co_firstlineno
    places = [place for place in function.__code__.co_positions() if None not in place]
    inside = {(line, start) for line, _, start, _ in places if (line, start) != (first, 0)}
    parts = [node.body for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Lambda)]
    there = [part for part in parts if all(_holds(part, *place) for place in inside)]
    smallest = min(there, key=lambda part: len(ast.unparse(part)), default=None)
    return "" if smallest is None else ast.unparse(smallest)


def _holds(part: ast.expr, line: Any, column: Any) -> bool:
    end = part.end_lineno or part.lineno, part.end_col_offset or 0
    return (part.lineno, part.col_offset) <= (line, column) <= end


def _read(function: Any) -> dict[str, float]:
    """Return the numbers that a function reads from outside, by name."""
    if not hasattr(function, "__code__"):
        return {}
    read = inspect.getclosurevars(function)
    return {
        name: value
        for name, value in sorted((dict(read.globals) | dict(read.nonlocals)).items())
        if isinstance(value, int | float)
    }
