"""Fused multiply-add: products that occur in one sum only become a b + c, rounded once."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from eqt_cli.program.program import Operation, Output, Program, Value


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
            a, b = _operands(program, sum_.product)
            c = signed(sum_.other, sum_.minus_other)
            value = Operation("fma", (signed(a, sum_.minus_product), places[b], c))
        elif isinstance(value, Operation):
            value = Operation(value.name, tuple(places[each] for each in value.operands))
        places[place] = add(value)
    outputs = tuple(
        Output(each.name, each.shape, tuple(places[entry] for entry in each.entries))
        for each in program.outputs
    )
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


def _operands(program: Program, place: int) -> tuple[int, ...]:
    value = program.values[place]
    assert isinstance(value, Operation)
    return value.operands
