"""A parsed expression, and how it is made of a text or of an entry of a configuration."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eqt_cli.core.errors import ExpressionError, InputError
from eqt_cli.core.expressions.constants import check_constants
from eqt_cli.core.expressions.evaluation import combine
from eqt_cli.core.expressions.instants import instants_in
from eqt_cli.core.expressions.parser import Parser
from eqt_cli.core.expressions.tree import Node, Variable, fold


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
        return instants_in(self.tree) if "t" in self.variables else ()

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
    tree, used = Parser(text, variables).parse()
    check_constants(tree)
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
