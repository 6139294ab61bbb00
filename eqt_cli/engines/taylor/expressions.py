"""A traced program as heyoka expressions."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from eqt_cli.engines.taylor.library import heyoka_module
from eqt_cli.program import COMPARISONS, Constant, Input, Operation, Program

OPERATORS: dict[str, Callable[..., Any]] = {
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "negative": operator.neg,
    "pow": operator.pow,
}
NAMES = dict.fromkeys(COMPARISONS, "lt")
"""heyoka's names of operations that programs name differently."""


@dataclass(frozen=True)
class Expressions:
    """A program as heyoka expressions.

    Attributes
    ----------
    state
        The variables: the group of inputs of this name.
    values
        The expression of every value of the program.
    outputs
        The expressions of all entries of all outputs.
    parameters
        Number of parameters: all groups of inputs but state and time, in their order.
    """

    state: list[Any]
    values: list[Any]
    outputs: list[Any]
    parameters: int

    @staticmethod
    def of(program: Program) -> Expressions:
        """Return the expressions of a program."""
        heyoka, parameters, sums = heyoka_module(), 0, _sums(program)
        given = {"time": [heyoka.time]}
        for group, length in program.inputs:
            if group == "state":
                given[group] = list(heyoka.make_vars(*(f"y{k:04d}" for k in range(length))))
            elif group not in given:
                given[group] = [heyoka.par[parameters + k] for k in range(length)]
                parameters += length
        values: list[Any] = []
        for value in program.values:
            if isinstance(value, Input):
                values.append(given[value.group][value.number])
            elif isinstance(value, Constant):
                values.append(heyoka.expression(value.number))
            elif value.name == "add":
                values.append(heyoka.sum([values[term] for term in sums[len(values)]]))
            else:
                name = NAMES.get(value.name, value.name)
                function = OPERATORS.get(name) or getattr(heyoka, name)
                values.append(function(*(values[operand] for operand in value.operands)))
        outputs = [values[place] for output in program.outputs for place in output.entries]
        return Expressions(given["state"], values, outputs, parameters)


def _sums(program: Program) -> dict[int, list[int]]:
    """Return all terms of every sum, including those of sums that occur nowhere else.

    Long sums in one operation make compact code of large systems a tenth faster.
    """
    used = Counter(place for output in program.outputs for place in output.entries)
    for value in program.values:
        if isinstance(value, Operation):
            used.update(value.operands)
    found: dict[int, list[int]] = {}
    for place, value in enumerate(program.values):
        if isinstance(value, Operation) and value.name == "add":
            parts = [
                found.get(each, [each]) if used[each] == 1 else [each] for each in value.operands
            ]
            found[place] = [term for part in parts for term in part]
    return found
