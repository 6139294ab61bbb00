"""Python's calls of a user's own C function: for many runs, arrays in, arrays out.

The user's text is compiled as it is; eqt adds only names that were found in it, and numbers.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError, Remedy, TraceError, suggestion
from eqt_cli.engines.native import compiler

SHIM = Path(__file__).parent / "own_code.h"

REALS = {"double": 8, "float": 4}
"""The types of numbers, and their sizes in bytes."""

INPUTS = ("t", "pose", "velocity", "desired_pose", "desired_velocity", "desired_acceleration")
"""The fields of ``X_input``, in their order."""

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\\n])*\"", re.DOTALL)


def is_name(text: str) -> bool:
    """Return whether a text can be a name in C."""
    return _NAME.fullmatch(text) is not None


@dataclass(frozen=True)
class OwnCode:
    """A user's text in C and the names that it has to define.

    Attributes
    ----------
    file
        The name of the text.
    text
        The text, with the files in quotes that it includes.
    prefix
        X of ``X_torque``, ``X_numbers``, ``X_memory`` and ``X_input``.
    numbers
        The fields of ``X_numbers`` that are set, and their lengths.
    memory
        The fields of ``X_memory``.
    real
        ``double`` or ``float``.
    entries, axes
        The number of entries of a pose, and of a velocity.
    """

    file: str
    text: str = field(repr=False)
    prefix: str
    numbers: tuple[tuple[str, int], ...]
    memory: tuple[str, ...]
    real: str
    entries: int
    axes: int

    @property
    def function(self) -> str:
        """The name of the function."""
        return f"{self.prefix}_torque"

    @cached_property
    def _plain(self) -> str:
        """The text without comments and strings."""
        return _COMMENT.sub(" ", self.text)

    def defines(self, function: str) -> bool:
        """Return whether the text has the body of a function."""
        return re.search(rf"\b{function}\s*\([^;{{}}]*\)\s*\{{", self._plain) is not None

    def fields(self, name: str) -> list[str] | None:
        """Return the fields of ``typedef struct {…} name``; None if it is written otherwise."""
        found = re.search(rf"\bstruct\s*\w*\s*\{{([^{{}}]*)\}}\s*{name}\s*;", self._plain)
        if found is None:
            return None
        return re.findall(r"([A-Za-z_]\w*)\s*(?:\[[^\]]*\]\s*)*(?=[,;])", found[1])

    @property
    def starts(self) -> bool:
        """Whether the text has a function that sets the memory at the start of a run."""
        return self.defines(f"{self.prefix}_start")

    @property
    def has_period(self) -> bool:
        """Whether the numbers include the control period, which eqt then sets."""
        given = {name for name, _ in self.numbers}
        return "period" not in given and "period" in (self.fields(f"{self.prefix}_numbers") or ())

    def check(self) -> None:
        """Raise an `InputError` where a name is not in the text."""
        if not self.defines(self.function):
            others = re.findall(r"\b(\w+_torque)\s*\([^;{}]*\)\s*\{", self._plain)
            names = ", ".join(dict.fromkeys(others))
            there = f"it defines {names}" if names else "it defines no function X_torque"
            raise InputError(
                f"{self.file} does not define the function {self.function}; {there}; name the "
                "function with the key `function`"
            )
        known = self.fields(f"{self.prefix}_numbers")
        for name, _ in self.numbers:
            if known is not None and name not in known:
                raise InputError(
                    _no_field(self.file, "numbers", f"{self.prefix}_numbers", name, known)
                )
        known = self.fields(f"{self.prefix}_memory")
        for name in self.memory:
            if known is not None and name not in known:
                raise InputError(
                    _no_field(self.file, "memory", f"{self.prefix}_memory", name, known)
                )

    @property
    def source(self) -> str:
        """The source to compile: the text, and eqt's calls of it."""
        X, numbers = self.prefix, [name for name, _ in self.numbers]
        has_defaults = re.search(rf"\b{X}_defaults\s*=", self._plain)
        definitions = {
            "EQT_NUMBER_TYPE": f"{X}_numbers",
            "EQT_MEMORY_TYPE": f"{X}_memory",
            "EQT_INPUT_TYPE": f"{X}_input",
            "EQT_TORQUE": self.function,
            "EQT_CODE_REAL": self.real,
            "EQT_CODE_AXES": str(self.axes),
            "EQT_DEFAULT_NUMBERS": f"{X}_defaults" if has_defaults else "{0}",
            "EQT_SET_NUMBERS": "".join(f"EQT_IN(numbers.{name}, given); " for name in numbers),
            "EQT_READ_MEMORY": "".join(f"EQT_IN(memory.{name}, kept); " for name in self.memory),
            "EQT_WRITE_MEMORY": "".join(
                f"EQT_OUT(remembered, memory.{name}); " for name in self.memory
            ),
            "EQT_LIST_NUMBERS": "".join(
                f"(long)sizeof(((EQT_NUMBER_TYPE *)0)->{name}), " for name in numbers
            ),
            "EQT_LIST_MEMORY": "".join(
                f"(long)sizeof(((EQT_MEMORY_TYPE *)0)->{name}), " for name in self.memory
            ),
        }
        if self.starts:
            definitions["EQT_CODE_START"] = f"{X}_start"
        if self.has_period:
            definitions["EQT_SET_PERIOD"] = "1"
        defined = "".join(f"#define {name} {text}\n" for name, text in definitions.items())
        return "\n".join([self.text, defined, SHIM.read_text(encoding="utf-8")])


def _no_field(file: str, key: str, struct: str, name: str, known: Sequence[str]) -> str:
    hint = suggestion(name, known) or f"; it has {', '.join(known) or 'none'}"
    return f"{key}: {struct} in {file} has no field {name}{hint}"


@dataclass(frozen=True)
class CodeFunction:
    """A user's compiled function.

    Attributes
    ----------
    code
        Its source.
    lengths
        The length of each part of the memory, by name.
    """

    code: OwnCode
    lengths: dict[str, int] = field(compare=False)
    library: Any = field(repr=False, compare=False)

    @property
    def row(self) -> int:
        """The number of entries of an input."""
        return 1 + 2 * self.code.entries + 3 * self.code.axes

    def started(self, numbers: Array, period: float, inputs: Array) -> Array:
        """Return the memory at the start of runs with these inputs, ``(runs, …)``."""
        memory = np.zeros((len(inputs), sum(self.lengths.values())))
        return self._called(1, numbers, period, memory, inputs)[1]

    def torque(
        self, numbers: Array, period: float, memory: Array, inputs: Array
    ) -> tuple[Array, Array]:
        """Return the torques of runs, and their memory a period later, ``(runs, …)`` each."""
        return self._called(0, numbers, period, memory, inputs)

    def _called(
        self, begins: int, numbers: Array, period: float, memory: Array, inputs: Array
    ) -> tuple[Array, Array]:
        runs = len(inputs)
        given = np.ascontiguousarray(numbers, dtype=float)
        kept = np.array(memory, dtype=float, order="C")
        rows = np.ascontiguousarray(inputs, dtype=float)
        torques = np.empty((runs, self.code.axes))
        assert rows.shape == (runs, self.row)
        addresses = (ctypes.c_void_p(a.ctypes.data) for a in (given, kept, rows, torques))
        self.library.eqt_code(
            ctypes.c_long(runs), ctypes.c_int(begins), ctypes.c_double(period), *addresses
        )
        return torques, kept


@lru_cache(maxsize=64)
def compiled(code: OwnCode) -> CodeFunction:
    """Compile a user's function; the last ones are kept.

    Raises
    ------
    InputError
        If its names, types or sizes are not the expected ones, or it cannot be compiled.
    """
    code.check()
    if compiler.missing():
        raise InputError(
            f"{code.file} is C, and this machine has no C compiler; install gcc or clang, or "
            "'pip install ziglang', a clang in a wheel"
        )
    try:
        library = compiler.library(code.source)
    except TraceError as error:
        said = "; ".join(line.strip() for line in error.lines)
        raise InputError(
            f"{code.file} cannot be compiled: {said or error.args[0]}",
            Remedy("compile it with your own compiler to see all of it"),
        ) from error
    count = 8 + len(code.numbers) + len(code.memory)
    sizes = list((ctypes.c_long * count).in_dll(library, "eqt_code_sizes"))
    return CodeFunction(code, _checked(code, sizes), library)


def _checked(code: OwnCode, sizes: Sequence[int]) -> dict[str, int]:
    """Check all sizes, and return the length of each part of the memory."""
    X, size = code.prefix, REALS[code.real]
    t, *parts = sizes[:6]
    if t != size:
        other = next((name for name, length in REALS.items() if length == t), f"{t} bytes")
        raise InputError(
            f"real: the numbers of {X}_input in {code.file} are {other}, not {code.real}; set "
            f"`real: {other}`"
        )
    lengths = (code.entries, code.axes, code.entries, code.axes, code.axes)
    for name, length, found in zip(INPUTS[1:], lengths, parts, strict=True):
        if found != length * size:
            raise InputError(
                f"{X}_input in {code.file} has {found // size} numbers in {name}; expected {length}"
            )
    if not sizes[6]:
        raise InputError(
            f"{code.function} in {code.file} has other arguments; expected void {code.function}"
            f"(const {X}_numbers *, {X}_memory *, const {X}_input *, {code.real} *)"
        )
    whole, rest = sizes[7], sizes[8:]
    for (name, given), found in zip(code.numbers, rest, strict=False):
        if found != given * size:
            raise InputError(
                f"numbers.{name}: {X}_numbers in {code.file} has {found // size} of it, got {given}"
            )
    kept = dict(
        zip(code.memory, (found // size for found in rest[len(code.numbers) :]), strict=True)
    )
    total = sum(kept.values())
    if whole != total * size and (kept or whole > size):
        named = ", ".join(f"{name} ({length})" for name, length in kept.items()) or "none"
        raise InputError(
            f"memory: {X}_memory in {code.file} has {whole // size} numbers, and the fields that "
            f"are named have {total}: {named}; name all of its fields"
        )
    return kept
