"""Functions in C that CasADi generates, as laws: names, sizes and sparsity are in the text."""

import re
from collections.abc import Mapping, Sequence
from math import prod
from pathlib import Path
from string import Template

from eqt_cli.base.errors import InputError, suggestion

CALL = Path(__file__).with_name("casadi_call.c")
"""The call of it."""


def casadi_call(
    text: str,
    file: str,
    name: str,
    inputs: Sequence[tuple[str, tuple[int, ...]]],
    numbers: Mapping[str, int],
    axes: int,
) -> str:
    """Return what calls a generated function as a law, for its preprocessed text.

    Parameters
    ----------
    inputs
        Names and shapes of the adapter's inputs.
    numbers
        Lengths of the numbers of the configuration.

    Raises
    ------
    InputError
        If there is no such function, or its arguments have other names or sizes.
    """

    def cases(of: str) -> list[str]:
        body = re.search(rf"\b{name}_{of}\s*\([^)]*\)\s*\{{(.*?)\n\}}", text, re.DOTALL)
        if body is None:
            raise InputError(f"{file} has no {name}_{of}, which CasADi exports with `{name}`")
        return re.findall(r"case \d+:\s*return \"?(\w+)", body[1])

    def size(sparsity: str) -> tuple[int, int]:
        numbers_of = re.search(rf"\b{sparsity}\s*\[\d+\]\s*=\s*\{{(\d+),\s*(\d+)", text)
        assert numbers_of is not None
        return int(numbers_of[1]), int(numbers_of[2])

    shapes, reads, offset = dict(inputs), list[str](), 0
    shapes |= {n: (length,) for n, length in numbers.items()}
    arguments = zip(cases("name_in"), cases("sparsity_in"), strict=True)
    for k, (argument, sparsity) in enumerate(arguments):
        rows, columns = size(sparsity)
        if argument not in shapes:
            hint = suggestion(argument, shapes) or "; name it in adapter.inputs or in numbers"
            raise InputError(f"{name} in {file} has an input {argument}{hint}")
        shape, total = shapes[argument], prod(shapes[argument])
        if rows * columns != total:
            raise InputError(
                f"{name} in {file} has {rows}×{columns} numbers in {argument}; expected {total}"
            )
        row, column = (columns, 1) if shape == (rows, columns) else (1, rows)
        source = "n" if argument in numbers else "in"
        reads.append(f"arg[{k}] = given + {offset};")
        reads.append(
            f"eqt_nonzeros({sparsity}, {row}, {column}, given + {offset}, "
            f"(double *)(void *)&{source}->{argument}, 0);"
        )
        offset += total
    torque = cases("sparsity_out")[0]
    back = size(torque)
    if back not in ((axes, 1), (1, axes)):
        raise InputError(f"{name} in {file} returns {back[0]}×{back[1]} numbers; expected {axes}")
    fields = numbers or {"unused": 1}
    called = '\n#line 1 "eqt"\n' + CALL.read_text(encoding="utf-8")
    return Template(called).substitute(
        name=name,
        axes=axes,
        torque=torque,
        most=max(1, offset),
        reads="\n    ".join(reads),
        numbers=" ".join(f"double {n}[{length}];" for n, length in fields.items()),
        inputs=" ".join(
            f"double {n}[{re.sub(', ', '][', str(shape).strip('(),') or '1')}];"
            for n, shape in inputs
        ),
    )
