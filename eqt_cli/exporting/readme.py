"""The README of a folder with exported laws, and their size: bytes of flash, and of stack."""

import re
import shutil
import struct
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from eqt_cli.analysis.certificate_table import tally
from eqt_cli.analysis.verification import identities_of
from eqt_cli.config.signal_path import loop_in_words
from eqt_cli.core.errors import EqtError
from eqt_cli.core.files import replace_file
from eqt_cli.engines.native.compiler import run
from eqt_cli.exporting.files import filled, markdown
from eqt_cli.exporting.laws import ExportedLaw

FLAGS = (
    "-std=c99 -O2 -ffp-contract=off -fno-math-errno -ffreestanding -Wframe-larger-than=1"
).split()

TARGET = "thumb-freestanding-eabihf"
CORE = ("-mcpu=cortex_m4+vfp4d16sp",)
"""Options of the compiler in the package ziglang for a Cortex-M4 with hardware floats."""

GCC = "arm-none-eabi-gcc"
GCC_CORE = "-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard".split()

MISSING = (
    "not measured: no compiler for Cortex-M4 was found (arm-none-eabi-gcc, or pip install ziglang)"
)


@dataclass(frozen=True)
class Footprint:
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


def measured(name: str, files: Mapping[str, str]) -> Footprint | None:
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
        return Footprint(_flash(made.read_bytes()), _stack(answer.stderr), called)


def _stack(warnings: str) -> int:
    """Return the sum of the frames of all functions, from the warnings of a compiler.

    It bounds the stack, since any function may call another.
    """
    frames = re.findall(r"frame size(?: of)? \(?(\d+)\)? ", warnings)
    return sum(map(int, frames))


def _flash(content: bytes) -> int:
    """Return the bytes of the sections of a 32-bit object file that are kept in flash."""
    [start] = struct.unpack_from("<I", content, 32)
    size, count = struct.unpack_from("<HH", content, 46)
    loaded = 0
    for index in range(count):
        _, kind, flags, _, _, length = struct.unpack_from("<6I", content, start + index * size)
        if kind == 1 and flags & 2:  # has contents, and is part of the image
            loaded += length
    return int(loaded)


NAME = "README.md"


def readme(laws: Sequence[ExportedLaw], costs: Mapping[str, Footprint | None]) -> str:
    """Return the text of the README of the laws of an experiment."""
    experiment = laws[0].experiment
    rows = identities_of(experiment)
    return filled(
        NAME,
        experiment=experiment,
        laws=laws,
        first=laws[0].name,
        real=laws[0].by.name,
        loop=loop_in_words(experiment.resolved),
        # Labels that are no names in C.
        spelled=[f'"{markdown(x.label)}" is `{x.name}`' for x in laws if x.label != x.name],
        costs=costs,
        known=next((cost for cost in costs.values() if cost), None),
        missing=MISSING,
        claim=_claim,
        tally=lambda law: tally([row for row in rows if row.controller == law.label]),
    )


def _claim(law: ExportedLaw) -> str:
    """Say what the law claims of its L."""
    controller = law.loop.controller
    claim = controller.claims(law.loop.group, law.loop.gains)
    return {
        True: f"L = {controller.energy} falls along every motion of the ideal loop, in "
        f"continuous time ({controller.theorem})",
        False: f"L = {controller.energy} is not claimed to fall",
        None: "nothing is claimed",
    }[claim]
