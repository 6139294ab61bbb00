"""Products that occur in one sum only, fused with it: a b + c rounded once, in one instruction."""

from __future__ import annotations

from collections import Counter

from eqt_cli.program.program import Operation, Output, Program, Value


def fused(program: Program) -> Program:
    """The program with ``fma`` operations, a b + c; its values differ by rounding.

    Fused are products that one sum or difference needs and nothing else; of two in a sum, the one
    that is computed later.
    """
    used = Counter(place for output in program.outputs for place in output.entries)
    for value in program.values:
        if isinstance(value, Operation):
            used.update(value.operands)

    def product(place: int) -> tuple[int, ...] | None:
        value = program.values[place]
        alone = isinstance(value, Operation) and value.name == "multiply" and used[place] == 1
        return value.operands if alone else None

    taken: dict[int, tuple[int, int, bool, bool]] = {}
    for place, value in enumerate(program.values):
        if not isinstance(value, Operation) or value.name not in ("add", "subtract"):
            continue
        first, second = value.operands
        minus = value.name == "subtract"
        if product(second) and (second > first or not product(first)):
            taken[place] = second, first, minus, False
        elif product(first):
            taken[place] = first, second, False, minus
    absorbed = {chosen for chosen, _, _, _ in taken.values()}

    values: list[Value] = []
    places: dict[int, int] = {}

    def add(value: Value) -> int:
        values.append(value)
        return len(values) - 1

    for place, value in enumerate(program.values):
        if place in absorbed:
            continue
        if place in taken:
            chosen, other, minus_product, minus_other = taken[place]
            factors = product(chosen)
            assert factors is not None
            a, b, c = (places[each] for each in (*factors, other))
            a = add(Operation("negative", (a,))) if minus_product else a
            c = add(Operation("negative", (c,))) if minus_other else c
            value = Operation("fma", (a, b, c))
        elif isinstance(value, Operation):
            value = Operation(value.name, tuple(places[each] for each in value.operands))
        places[place] = add(value)
    outputs = tuple(
        Output(each.name, each.shape, tuple(places[entry] for entry in each.entries))
        for each in program.outputs
    )
    return Program(program.inputs, tuple(values), outputs)
