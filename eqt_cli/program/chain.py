"""A chain of programs, executed one after the other, as one program.

Nothing is simplified across their borders, so that the outputs of each have the same bits in the
chain as alone. Equal operations are still merged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from eqt_cli.program.program import Constant, Input, Operation, Output, Program, Value

Places: TypeAlias = list[int]
"""The places of the numbers of a group in a chain."""


class Chain:
    """A program under construction.

    Parameters
    ----------
    inputs
        The length of each group of inputs, by its name.
    """

    def __init__(self, inputs: Mapping[str, int]) -> None:
        self._inputs = dict(inputs)
        self._values: list[Value] = []
        self._places: dict[object, int] = {}

    def given(self, group: str, entries: slice = slice(None)) -> Places:
        """Return the places of some of a group of inputs."""
        numbers = range(self._inputs[group])[entries]
        return [self._place(Input(group, number)) for number in numbers]

    def constant(self, number: float) -> Places:
        """Return the place of a constant."""
        return [self._place(Constant(number))]

    def then(self, program: Program, given: Mapping[str, Sequence[int]]) -> dict[str, Places]:
        """Append a program with these places as inputs; return those of its outputs, by name."""
        places: list[int] = []
        for value in program.values:
            if isinstance(value, Input):
                places.append(given[value.group][value.number])
            elif isinstance(value, Operation):
                operands = tuple(places[operand] for operand in value.operands)
                places.append(self._place(Operation(value.name, operands)))
            else:
                places.append(self._place(value))
        return {each.name: [places[entry] for entry in each.entries] for each in program.outputs}

    def program(self, outputs: Mapping[str, tuple[tuple[int, ...], Sequence[int]]]) -> Program:
        """Return the program whose outputs have these shapes and places."""
        needed = {place for _, entries in outputs.values() for place in entries}
        for place in reversed(range(len(self._values))):
            value = self._values[place]
            if place in needed and isinstance(value, Operation):
                needed.update(value.operands)
        moved = {place: new for new, place in enumerate(sorted(needed))}
        values = tuple(
            Operation(value.name, tuple(moved[operand] for operand in value.operands))
            if isinstance(value, Operation)
            else value
            for value in (self._values[place] for place in moved)
        )
        found = tuple(
            Output(name, shape, tuple(moved[entry] for entry in entries))
            for name, (shape, entries) in outputs.items()
        )
        return Program(tuple(self._inputs.items()), values, found)

    def _place(self, value: Value) -> int:
        # As keys, 0.0 and -0.0 would be equal, and nan would differ from nan.
        key = value.number.hex() if isinstance(value, Constant) else value
        if key not in self._places:
            self._places[key] = len(self._values)
            self._values.append(value)
        return self._places[key]
