"""A straight-line program: inputs, then operations one after another, and what it returns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias


class Input(NamedTuple):
    """Entry `number` of a group of inputs."""

    group: str
    number: int


class Constant(NamedTuple):
    """A number that is the same whatever the inputs are."""

    number: float


class Operation(NamedTuple):
    """An operation on values that stand before it, by their places in the program.

    Its name is ``add``, ``subtract``, ``multiply``, ``divide``, ``negative`` or ``pow``, that of an
    elementary function such as ``sin``, one of `COMPARISONS`, or ``select``: its second operand
    where the comparison that is its first holds, else its third. Where products are fused, it may
    be ``fma``, a b + c.
    """

    name: str
    operands: tuple[int, ...]


Value: TypeAlias = Input | Constant | Operation

COMPARISONS = ("less", "smooth_less")
"""Both are a < b; the second chooses between two forms of one smooth function."""


class Output(NamedTuple):
    """An array that a program returns: its entries, row by row, by their places."""

    name: str
    shape: tuple[int, ...]
    entries: tuple[int, ...]


@dataclass(frozen=True)
class Program:
    """What a function does with its numbers; equal programs do the same.

    Attributes
    ----------
    inputs
        The name and the length of each group of inputs.
    values
        In the order in which they are computed. No two are equal, and all of them are needed. Those
        that are needed for one value stand together, so that few have to be kept at a time.
    outputs
        What it returns.
    """

    inputs: tuple[tuple[str, int], ...]
    values: tuple[Value, ...]
    outputs: tuple[Output, ...]

    @cached_property
    def operations(self) -> int:
        """How many operations it has."""
        return sum(isinstance(value, Operation) for value in self.values)

    def operands_of(self, name: str) -> list[tuple[int, ...]]:
        """The operands of every operation of this name, in the order of the program."""
        return [
            value.operands
            for value in self.values
            if isinstance(value, Operation) and value.name == name
        ]

    def following_from(self, name: str) -> set[int]:
        """The places of all values that an operation of this name has a part in."""
        found: set[int] = set()
        for place, value in enumerate(self.values):
            if isinstance(value, Operation) and (
                value.name == name or not found.isdisjoint(value.operands)
            ):
                found.add(place)
        return found
