"""Joins programs, and fuses their operations, without changing a bit."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

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
                places.append(self._place(value.moved(places)))
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
            value.moved(moved) if isinstance(value, Operation) else value
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


class _Fused(NamedTuple):
    """A sum or difference with a product in it: ± product ± other."""

    product: int
    other: int
    minus_product: bool
    minus_other: bool


def fused(program: Program) -> Program:
    """Return the program with ``fma`` operations, a b + c; its values differ by rounding.

    Products are fused that only one sum or difference needs; of two in a sum, the later one.
    """
    chosen = _chosen(program)
    left_out = {each.product for each in chosen.values()}
    values: list[Value] = []
    places: dict[int, int] = {}

    def add(value: Value) -> int:
        values.append(value)
        return len(values) - 1

    def signed(place: int, minus: bool) -> int:
        return add(Operation("negative", (places[place],))) if minus else places[place]

    for place, value in enumerate(program.values):
        if place in left_out:
            continue
        if place in chosen:
            sum_ = chosen[place]
            product = program.values[sum_.product]
            assert isinstance(product, Operation)
            a, b = product.operands
            c = signed(sum_.other, sum_.minus_other)
            value = Operation("fma", (signed(a, sum_.minus_product), places[b], c))
        elif isinstance(value, Operation):
            value = value.moved(places)
        places[place] = add(value)
    outputs = tuple(each.moved(places) for each in program.outputs)
    return Program(program.inputs, tuple(values), outputs)


def _chosen(program: Program) -> dict[int, _Fused]:
    """Return the sums and differences to fuse, by their places."""
    used = Counter(place for output in program.outputs for place in output.entries)
    for value in program.values:
        if isinstance(value, Operation):
            used.update(value.operands)
    products = {
        place
        for place, value in enumerate(program.values)
        if isinstance(value, Operation) and value.name == "multiply" and used[place] == 1
    }
    found = {}
    for place, value in enumerate(program.values):
        if isinstance(value, Operation) and value.name in ("add", "subtract"):
            (first, second), minus = value.operands, value.name == "subtract"
            if second in products and (first not in products or second > first):
                found[place] = _Fused(second, first, minus, False)
            elif first in products:
                found[place] = _Fused(first, second, False, minus)
    return found
