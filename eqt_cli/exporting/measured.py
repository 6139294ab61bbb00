"""The size of a compiled exported law: bytes of flash, and of stack."""

from __future__ import annotations

import re
import shutil
import struct
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from eqt_cli.core.errors import EqtError
from eqt_cli.core.replacement import replace_file
from eqt_cli.engines.native.compiler import run

FLAGS = (
    "-std=c99 -O2 -ffp-contract=off -fno-math-errno -ffreestanding -Wframe-larger-than=1"
).split()

TARGET = "thumb-freestanding-eabihf"
CORE = ("-mcpu=cortex_m4+vfp4d16sp",)
"""Options of the compiler in the package ziglang for a Cortex-M4 with hardware floats."""

GCC, GCC_CORE = (
    "arm-none-eabi-gcc",
    "-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard".split(),
)

MISSING = (
    "not measured: no compiler for Cortex-M4 was found (arm-none-eabi-gcc, or pip install ziglang)"
)


@dataclass(frozen=True)
class Measured:
    """The cost of a law on a Cortex-M4.

    Attributes
    ----------
    flash
        Bytes of code and constants.
    stack
        Bytes of LABEL_torque with all it calls, except what a compiler adds for doubles.
    compiler
        Compiler that was used.
    """

    flash: int
    stack: int
    compiler: str


def compiler() -> list[str] | None:
    """Return the command of a compiler for Cortex-M4 on this machine; None if there is none."""
    if path := shutil.which(GCC):
        return [path, *GCC_CORE]
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc", "-target", TARGET, *CORE]
    return None


def measured(name: str, files: Mapping[str, str]) -> Measured | None:
    """Return the cost of an exported law on a Cortex-M4; None where it cannot be measured."""
    command = compiler()
    if command is None:
        return None
    with tempfile.TemporaryDirectory(prefix="eqt-") as folder:
        for file in (f"{name}.h", f"{name}.c"):
            replace_file(Path(folder, file), files[file].encode())
        made = Path(folder, f"{name}.o")
        try:
            answer = run([*command, *FLAGS, "-c", str(Path(folder, f"{name}.c")), "-o", str(made)])
        except EqtError:
            return None
        if answer.returncode or not made.exists():
            return None
        called = "gcc" if command[0].endswith(GCC) else "clang"
        return Measured(_flash(made.read_bytes()), _stack(answer.stderr), called)


def _stack(warnings: str) -> int:
    """Return the sum of the frames of all functions, from the warnings of a compiler.

    It bounds the stack, since any function may call another.
    """
    found = re.findall(r"frame size(?: of)? \(?(\d+)\)? ", warnings)
    return sum(map(int, found))


def _flash(content: bytes) -> int:
    """Return the bytes of the sections of a 32-bit object file that are kept in flash."""
    start, size, count = (
        *struct.unpack_from("<I", content, 32),
        *struct.unpack_from("<HH", content, 46),
    )
    loaded = 0
    for index in range(count):
        _, kind, flags, _, _, length = struct.unpack_from("<6I", content, start + index * size)
        if kind == 1 and flags & 2:  # has contents, and is part of the image
            loaded += length
    return int(loaded)
