"""What a compiler makes of an exported law: bytes of flash, and of stack."""

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
"""How the compiler in the package ziglang is told of a Cortex-M4, with its floats in hardware."""

GCC, GCC_CORE = (
    "arm-none-eabi-gcc",
    "-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard".split(),
)

MISSING = (
    "not measured: no compiler for Cortex-M4 was found (arm-none-eabi-gcc, or pip install ziglang)"
)


@dataclass(frozen=True)
class Measured:
    """A law on a Cortex-M4.

    Attributes
    ----------
    flash
        Bytes of code and constants.
    stack
        Bytes, of LABEL_torque with all that it calls but what a compiler adds for doubles.
    compiler
        By which.
    """

    flash: int
    stack: int
    compiler: str


def compiler() -> list[str] | None:
    """How a compiler for Cortex-M4 is called on this machine."""
    if path := shutil.which(GCC):
        return [path, *GCC_CORE]
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc", "-target", TARGET, *CORE]
    return None


def measured(name: str, files: Mapping[str, str]) -> Measured | None:
    """An exported law as a Cortex-M4 has it; None where nothing can be told here."""
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
    """The frames of all functions, of which one may call the other, by what a compiler warns of."""
    found = re.findall(r"frame size(?: of)? \(?(\d+)\)? ", warnings)
    return sum(map(int, found))


def _flash(content: bytes) -> int:
    """Bytes of the sections of an object file for 32 bits that are kept in flash."""
    start, size, count = (
        *struct.unpack_from("<I", content, 32),
        *struct.unpack_from("<HH", content, 46),
    )
    loaded = 0
    for index in range(count):
        _, kind, flags, _, _, length = struct.unpack_from("<6I", content, start + index * size)
        if kind == 1 and flags & 2:  # what has contents, and is part of the image
            loaded += length
    return int(loaded)
