"""Expressions, parsed from text or from an entry of a configuration."""

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
        The text that was parsed.
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

        Only changes where both compared arguments are linear in t are found.
        """
        return instants_in(self.tree) if "t" in self.variables else ()

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
    check_constants(tree)
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
