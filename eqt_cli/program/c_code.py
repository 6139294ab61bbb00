"""A program as a function in C: one line for each value, without memory, branches or loops.

It is written in the common subset of C99 and C++, in the types and functions of two headers. If
the compiler may not contract operations (``-ffp-contract=off``), they round as in IEEE 754.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from eqt_cli.program.program import COMPARISONS, Constant, Input, Program

LANES_HEADER = Path(__file__).with_name("lanes.h")
"""Header of the number type, one or several numbers side by side; it precedes programs."""

FUNCTIONS_HEADER = Path(__file__).with_name("functions.h")
"""Header of the elementary functions of programs; it follows `LANES_HEADER`."""

_INFIX = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/"}


def c_function(program: Program, name: str) -> str:
    """Return the definition of a C function for a program.

    It takes a pointer ``in_GROUP`` for each group of inputs, then ``out_NAME`` for each output, in
    their order. Outputs must not overlap inputs. Elementary functions have the names of the
    program, prefixed with ``eqt_``.

    Raises
    ------
    ValueError
        If a name is no identifier of C.
    """
    groups = [group for group, _ in program.inputs]
    outputs = [output.name for output in program.outputs]
    for each in (name, *groups, *outputs):
        if not re.fullmatch(r"[A-Za-z]\w*", each, re.ASCII):
            raise ValueError(f"{each!r} is no identifier of C")
    taken = [f"const eqt_real *__restrict in_{group}" for group in groups]
    given = [f"eqt_real *__restrict out_{output}" for output in outputs]
    used = {value.group for value in program.values if isinstance(value, Input)}
    targets: dict[int, list[str]] = {}
    for output in program.outputs:
        for entry, place in enumerate(output.entries):
            targets.setdefault(place, []).append(f"out_{output.name}[{entry}] = v{place};")
    lines = [f"(void)in_{group};" for group in groups if group not in used]
    for place in range(len(program.values)):
        lines += [_definition(program, place), *targets.get(place, [])]
    body = "".join(f"    {line}\n" for line in lines)
    return f"void {name}({', '.join(taken + given)})\n{{\n{body}}}\n"


def _definition(program: Program, place: int) -> str:
    value, kind = program.values[place], "eqt_real"
    if isinstance(value, Input):
        formula = f"in_{value.group}[{value.number}]"
    elif isinstance(value, Constant):
        formula = f"eqt_constant({_literal(value.number)})"
    else:
        operands = [f"v{operand}" for operand in value.operands]
        if value.name in _INFIX:
            formula = f" {_INFIX[value.name]} ".join(operands)
        elif value.name == "negative":
            formula = f"-{operands[0]}"
        else:
            kind = "eqt_mask" if value.name in COMPARISONS else kind
            called = "less" if value.name in COMPARISONS else value.name
            formula = f"eqt_{called}({', '.join(operands)})"
    return f"const {kind} v{place} = {formula};"


def _literal(number: float) -> str:
    """Return a number in C: its shortest digits, which compilers read as the same double."""
    if math.isfinite(number):
        return repr(number)
    return "EQT_NAN" if math.isnan(number) else f"{'-' * (number < 0)}EQT_INFINITY"
