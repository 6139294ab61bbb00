"""A program as C, and names that are valid there."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from eqt_cli.numbers.program import COMPARISONS, Constant, Input, Operation, Program

KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if "
    "inline int long register restrict return short signed sizeof static struct switch typedef "
    "union unsigned void volatile while asm bool catch class delete explicit export false friend "
    "mutable namespace new operator private protected public template this throw true try typeid "
    "typename using virtual real".split()
)
"""Keywords of C and C++, and the type of the exported numbers."""


def c_name(text: str) -> str:
    """Return a name in C for a text: the text itself if it is one."""
    name = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_") if not _is_name(text) else text
    if not name or name[0].isdigit():
        name = f"n_{name}".rstrip("_")
    return f"{name}_" if name in KEYWORDS else name


def distinct(
    texts: Iterable[str], taken: Collection[str] = (), endings: Collection[str] = ("",)
) -> list[str]:
    """Return names in C for texts, none of which is taken, also with these endings.

    They differ not only in case, so that files can have them on every system.
    """
    names, used = [], {identifier.lower() for identifier in taken}
    for text in texts:
        name, number = c_name(text), 1
        while used & (spellings := {f"{name}{ending}".lower() for ending in endings}):
            number += 1
            name = f"{c_name(text)}_{number}"
        names.append(name)
        used |= spellings
    return names


def _is_name(text: str) -> bool:
    return re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", text, re.ASCII) is not None


LANES_HEADER = Path(__file__).with_name("lanes.h")
"""Header of the number type, one or several numbers side by side; it precedes programs."""

FUNCTIONS_HEADER = Path(__file__).with_name("functions.h")
"""Header of the elementary functions of programs; it follows `LANES_HEADER`."""

_INFIX = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/"}


def c_function(program: Program, name: str, static: bool = False) -> str:
    """Return the definition of a C function for a program, and before it those of its loops.

    It takes a pointer ``in_GROUP`` for each group of inputs, then ``out_NAME`` for each output, in
    their order. Outputs must not overlap inputs. Elementary functions have the names of the
    program, prefixed with ``eqt_``. In a `static` one, long outputs that move their entries are
    written by loops, too, so that its length does not grow with theirs.

    Raises
    ------
    ValueError
        If a name is not an identifier of C.
    """
    for identifier in (name, *dict(program.inputs), *(output.name for output in program.outputs)):
        if not _is_name(identifier):
            raise ValueError(f"{identifier!r} is not an identifier of C")
    bodies = {body: f"{name}_{k}" for k, body in enumerate(_bodies(program), start=1)}
    functions = [("EQT_APART static ", body, called) for body, called in bodies.items()]
    functions.append(("static " if static else "", program, name))
    return "".join(
        kind + _Text(program, bodies, static).function(called)
        for kind, program, called in functions
    )


def _bodies(program: Program) -> dict[Program, None]:
    """Return the programs of all loops, those within others first."""
    bodies: dict[Program, None] = {}
    for value in program.values:
        if isinstance(value, Operation) and value.name == "loop":
            bodies |= {**_bodies(value.of.program), value.of.program: None}
    return bodies


MOST_PERIOD, LEAST_MOVED = 16, 12
"""Longest period of numbers that move, as the entries of a pose, and least numbers of a loop."""


class _Text:
    """The lines of a C function, by the places of a program."""

    def __init__(self, program: Program, bodies: Mapping[Program, str], moves: bool) -> None:
        self._program, self._values, self._bodies = program, program.values, bodies
        operations = [value for value in self._values if isinstance(value, Operation)]
        self._used = Counter(place for operation in operations for place in operation.operands)
        self._used.update(place for output in program.outputs for place in output.entries)
        self._moves = moves or any(value.name == "loop" for value in operations)

    def function(self, name: str) -> str:
        """Return the definition of the function."""
        program, values = self._program, self._values
        groups = [group for group, _ in program.inputs]
        taken = [f"const eqt_real *__restrict in_{group}" for group in groups]
        results = [f"eqt_real *__restrict out_{output.name}" for output in program.outputs]
        used = {value.group for value in values if isinstance(value, Input)}
        targets: dict[int, list[str]] = {}
        last: list[str] = []
        for output in program.outputs:
            target = f"out_{output.name}"
            for first, period, rows in self._stretches(output.entries):
                entries = output.entries[first : first + period * rows]
                if rows > 1:
                    last += self._moved(target, first, entries, period)
                    self._release(entries)
                else:
                    for entry, place in enumerate(entries, start=first):
                        targets.setdefault(place, []).append(f"{target}[{entry}] = v{place};")
        loops = {
            place: self._loop(place, value)
            for place, value in enumerate(values)
            if isinstance(value, Operation) and value.name == "loop"
        }
        lines = [f"(void)in_{group};" for group in groups if group not in used]
        for place in range(len(values)):
            if place in loops:
                lines += loops[place]
            elif self._used[place] > 0:
                lines.append(self._definition(place))
            lines += targets.get(place, [])
        body = "".join(f"    {line}\n" for line in [*lines, *last])
        return f"void {name}({', '.join(taken + results)})\n{{\n{body}}}\n"

    def _definition(self, place: int) -> str:
        value, kind = self._values[place], "eqt_real"
        if isinstance(value, Input) or (isinstance(value, Operation) and value.name == "result"):
            formula = self._form(place)[0].format(*self._form(place)[1])
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

    def _loop(self, place: int, value: Operation) -> list[str]:
        """Return the lines of a loop, whose results are in an array that has its place as name."""
        program, rows = value.of
        carried, width, _ = (length for _, length in program.inputs)
        length, behind = program.outputs[0].shape[0], carried + width * rows
        parts = {"i": value.operands[:carried], "s": value.operands[behind:]}
        lines = [f"eqt_real l{place}[{3 * length}], r{place}[{width + 1}];"]
        for letter, places in parts.items():
            lines.append(f"eqt_real {letter}{place}[{len(places) + 1}];")
            for first, period, count in self._stretches(places):
                entries = places[first : first + period * count]
                lines += self._moved(f"{letter}{place}", first, entries, period)
        table = value.operands[carried:behind]
        listed = [self._form(entry) for entry in table]
        self._release(table, depth=0)
        begin = 0
        while begin < rows:
            # The row after the first has its input from there; others take turns behind the last.
            end = rows if begin else 1
            end = min(end, begin + self._steps(listed, begin * width, width))
            shifts = self._shifts(listed, begin * width, width) if end - begin > 1 else None
            formulas = self._formulas(listed[begin * width : (begin + 1) * width], shifts, begin)
            turn = f"{length} * (1 + ({rows - 1} - k) % 2)"
            before = f"k == 1 ? l{place} : l{place} + {length} * (1 + ({rows} - k) % 2)"
            before, to = (before, f"l{place} + {turn}") if begin else (f"i{place}", f"l{place}")
            lines.append(f"for (int k = {begin}; k < {end}; k++) {{")
            lines += [f"    r{place}[{k}] = {formula};" for k, formula in enumerate(formulas)]
            lines.append(f"    {self._bodies[program]}({before}, r{place}, s{place}, {to});")
            lines.append("}")
            begin = end
        return lines

    def _release(self, places: Iterable[int], depth: int = 1) -> None:
        """Count off values that are read where they are stored, so that they get no name."""
        for place in places:
            value = self._values[place]
            if self._form(place, depth)[1]:
                self._used[place] -= 1
                if isinstance(value, Operation) and value.name == "select":
                    self._release(value.operands, depth=0)

    def _form(self, place: int, depth: int = 0) -> tuple[str, tuple[int, ...]]:
        """Return how a value is read, and the numbers in it that may move from entry to entry."""
        value = self._values[place]
        if isinstance(value, Input):
            return f"in_{value.group}[{{}}]", (value.number,)
        if isinstance(value, Operation) and value.name == "result":
            return f"l{value.operands[0]}[{{}}]", (value.of,)
        only_here = depth and self._used[place] == 1
        if only_here and isinstance(value, Operation) and value.name == "select":
            parts = [self._form(operand) for operand in value.operands]
            text = ", ".join(text for text, _ in parts)
            return f"eqt_select({text})", tuple(k for _, numbers in parts for k in numbers)
        return f"v{place}", ()

    def _steps(self, forms: list[Any], first: int, period: int) -> int:
        """Return how many rows, of `period` forms each, differ by equal shifts of their numbers."""
        shifts, rows = self._shifts(forms, first, period), 1
        while shifts is not None and shifts == self._shifts(forms, first, period):
            first, rows = first + period, rows + 1
        return rows

    def _shifts(self, forms: list[Any], first: int, period: int) -> list[tuple[int, ...]] | None:
        one, other = (forms[first + k * period : first + (k + 1) * period] for k in (0, 1))
        if len(other) < period or any(a[0] != b[0] for a, b in zip(one, other, strict=True)):
            return None
        return [
            tuple(y - x for x, y in zip(a[1], b[1], strict=True))
            for a, b in zip(one, other, strict=True)
        ]

    def _stretches(self, places: Sequence[int]) -> Iterator[tuple[int, int, int]]:
        """Yield first, period and rows of stretches: one row where nothing moves."""
        forms = [self._form(place, depth=1) for place in places]
        first = begun = 0
        while first < len(places):
            period, rows = 1, 1
            if self._moves:
                # The shortest period of those that reach as far.
                counts = [(k * self._steps(forms, first, k), -k) for k in range(1, MOST_PERIOD + 1)]
                reach, period = max(
                    (stretch for stretch in counts if stretch[0] > -stretch[1]), default=(1, -1)
                )
                period, rows = -period, reach // -period
            if period * rows >= LEAST_MOVED and rows > 2:
                if begun < first:
                    yield begun, first - begun, 1
                yield first, period, rows
                first = begun = first + period * rows
            else:
                first += 1
        if begun < first:
            yield begun, first - begun, 1

    def _moved(self, target: str, first: int, places: Sequence[int], period: int) -> list[str]:
        """Return the lines that write a stretch."""
        forms = [self._form(place, depth=1) for place in places]
        if len(places) == period:
            return [f"{target}[{k}] = v{place};" for k, place in enumerate(places, start=first)]
        formulas = self._formulas(forms[:period], self._shifts(forms, 0, period), 0)
        to = [f"{target}[{first + k} + {period} * k]" for k in range(period)]
        lines = [f"    {a} = {formula};" for a, formula in zip(to, formulas, strict=True)]
        return [f"for (int k = 0; k < {len(places) // period}; k++) {{", *lines, "}"]

    def _formulas(self, forms: list[Any], shifts: Any, begin: int) -> list[str]:
        """Return the formulas of a row, with the number k of the row from `begin` on."""
        formulas = []
        for (text, numbers), by in zip(forms, shifts or [()] * len(forms), strict=True):
            places = [
                f"{number - begin * shift} + {shift} * k" if shift else str(number)
                for number, shift in zip(numbers, by or [0] * len(numbers), strict=True)
            ]
            formulas.append(text.format(*places))
        return formulas


def _literal(number: float) -> str:
    """Return a number in C: its shortest digits, which compilers read as the same double."""
    if math.isfinite(number):
        return repr(number)
    return "EQT_NAN" if math.isnan(number) else f"{'-' if number < 0 else ''}EQT_INFINITY"
