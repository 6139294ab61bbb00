"""A straight-line program: inputs, then operations one after another, and outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

Places: TypeAlias = Mapping[int, int] | Sequence[int]
"""The new places of values, by their old ones."""


class Input(NamedTuple):
    """Entry `number` of a group of inputs."""

    group: str
    number: int


class Constant(NamedTuple):
    """A number that does not depend on the inputs."""

    number: float


class Operation(NamedTuple):
    """An operation on earlier values, by their places in the program.

    Its name is ``add``, ``subtract``, ``multiply``, ``divide``, ``negative`` or ``pow``, an
    elementary function such as ``sin``, one of `COMPARISONS`, or ``select``: its second operand if
    its first, a comparison, holds, else its third. If products are fused, it may be ``fma``,
    a b + c.
    """

    name: str
    operands: tuple[int, ...]

    def moved(self, places: Places) -> Operation:
        """Return the operation on values that have moved to these places."""
        return Operation(self.name, tuple(places[operand] for operand in self.operands))


Value: TypeAlias = Input | Constant | Operation

COMPARISONS = ("less", "smooth_less")
"""Both are a < b; the second chooses between two forms of one smooth function."""


class Output(NamedTuple):
    """An output array of a program: its entries, row by row, by their places."""

    name: str
    shape: tuple[int, ...]
    entries: tuple[int, ...]

    def moved(self, places: Places) -> Output:
        """Return the output of values that have moved to these places."""
        return self._replace(entries=tuple(places[entry] for entry in self.entries))


@dataclass(frozen=True)
class Program:
    """The operations of a function on its numbers; equal programs compute the same.

    Attributes
    ----------
    inputs
        The name and the length of each group of inputs.
    values
        Values in the order of computation. No two are equal, and all are needed. Those needed for
        one value stand together, so that few are kept at a time.
    outputs
        The arrays that it returns.
    """

    inputs: tuple[tuple[str, int], ...]
    values: tuple[Value, ...]
    outputs: tuple[Output, ...]

    @cached_property
    def operations(self) -> int:
        """The number of operations."""
        return sum(isinstance(value, Operation) for value in self.values)
