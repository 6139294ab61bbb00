"""The README of a folder with exported laws, and their size: bytes of flash, and of stack."""

from __future__ import annotations

import re
import shutil
import struct
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from eqt_cli.analysis.certificate_table import tally
from eqt_cli.analysis.certificates.base import Row
from eqt_cli.config.signal_path import loop_in_words
from eqt_cli.core.errors import EqtError
from eqt_cli.core.files import replace_file
from eqt_cli.core.registry import description
from eqt_cli.core.version import __version__
from eqt_cli.engines.native.compiler import run
from eqt_cli.exporting.files import TOLD_MEANINGS, above, bounds_in_words, filled, markdown, meaning
from eqt_cli.exporting.laws import Exported, ExportedLaw

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


NAME = "README.md"


def readme(found: Exported, costs: Mapping[str, Footprint | None]) -> str:
    """Return the text of the README."""
    experiment, laws = found.experiment, found.laws
    first, G = laws[0], experiment.group
    known = next((cost for cost in costs.values() if cost), None)
    reference = ""
    if first.reference:
        reference = (
            f" `{first.name}_reference` sets the time and what is desired; the rest is measured."
        )
    if first.filter:
        reference += (
            f" `{first.name}_update` does all of a period: it estimates pose and velocity from "
            f"what is measured by the filter `{first.filter.kind}`, and calls the law."
        )
    return filled(
        NAME,
        version=__version__,
        experiment=markdown(experiment.name),
        group=G.name,
        real=first.by.name,
        digest=experiment.digest,
        loop=loop_in_words(experiment.resolved),
        laws="\n".join(
            f"- **{markdown(experiment.titles[law.label])}** (`{law.name}.h`, `{law.name}.c`): "
            f"{description(type(law.loop.controller))}"
            for law in laws
        ),
        spelled=_spelled(laws),
        first=first.name,
        reference=reference,
        inputs="\n".join(
            f"| `{each.name}` | {each.size} | {each.unit}: {TOLD_MEANINGS[each.name]} |"
            for each in first.program.told
        ),
        axes=", ".join(G.axis_names),
        torque=f"{first.program.torque.size} numbers, in {first.program.torque.unit}",
        bounds="\n".join(_bounds(law) for law in laws),
        costs="\n".join(_cost(law, costs[law.label]) for law in laws),
        compiler=f"Measured with {known.compiler}, -O2."
        if known
        else f"Cost on Cortex-M4: {MISSING}.",
        numbers="\n\n".join(_numbers(law) for law in laws),
        certificates="\n".join(_certificates(law, found.rows) for law in laws),
    )


def _spelled(laws: Sequence[ExportedLaw]) -> str:
    """Return a sentence on labels that are no names in C; empty without such labels."""
    changed = [f'"{markdown(law.label)}" is `{law.name}`' for law in laws if law.label != law.name]
    return f"\nIn C, {', '.join(changed)}.\n" if changed else ""


def _bounds(law: ExportedLaw) -> str:
    count, singular = law.states.count, int(np.count_nonzero(law.singular))
    apart = "none"
    if singular:
        apart = f"{singular} states, up to {above(float(law.singular_bound.max()))}"
    return f"| `{law.name}` | {count} | {bounds_in_words(law)} | {apart} |"


def _cost(law: ExportedLaw, cost: Footprint | None) -> str:
    flash, stack = (f"{cost.flash} bytes", f"{cost.stack} bytes") if cost else ("-", "-")
    return f"| `{law.name}` | {law.program.step.operations} | {flash} | {stack} |"


def _numbers(law: ExportedLaw) -> str:
    lines = [f"### {law.name}", "", "| number | value | |", "|---|---|---|"]
    for entry in law.program.numbers:
        values = ", ".join(f"{value:.9g}" for value in law.numbers[entry.name].flat)
        unit = f"{entry.unit}; " * bool(entry.unit)
        lines.append(f"| `{entry.name}` | {values} | {unit}{meaning(law, entry)} |")
    return "\n".join(lines)


def _certificates(law: ExportedLaw, rows: Sequence[Row]) -> str:
    own = [row for row in rows if row.controller == law.label]
    controller = law.loop.controller
    claim = controller.claims(law.loop.group, law.loop.gains)
    said = {
        True: f"L = {controller.energy} falls along every motion of the ideal loop, in "
        f"continuous time ({controller.theorem})",
        False: f"L = {controller.energy} is not claimed to fall",
        None: "nothing is claimed",
    }[claim]
    return f"- **{markdown(law.experiment.titles[law.label])}**: {said}. Identities: {tally(own)}."
