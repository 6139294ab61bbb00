"""Measures every shipped law as C on three groups, for the table of the guide to vehicles.

    python docs/reference/measure_laws.py        writes exported_laws.json; needs `ziglang`

It takes some minutes, and what compilers make of a law changes with their version: so the numbers
are kept, and `generate.py` makes the table of them.
"""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from eqt_cli.api.loading import document_from
from eqt_cli.base.errors import Problems
from eqt_cli.components.groups import group_named
from eqt_cli.components.laws import controllers
from eqt_cli.config.preflight import build
from eqt_cli.extensions.export.export import files
from eqt_cli.extensions.export.export_laws import exported
from eqt_cli.extensions.export.program_error import ARITHMETICS

KEPT = Path(__file__).with_name("exported_laws.json")

GROUPS = {
    "SO3": ([1.0, 2.0, 2.5], [1.0, 1.2, 0.8]),
    "SE3": ([1.0, 2.0, 2.5, 3.0, 3.0, 3.0], [1.0, 1.2, 0.8, 0.5]),
    "SE2": ([1.0, 2.0, 2.0], [1.0, 1.2, 0.5]),
}
"""Inertia and navigation weight."""


def configuration(group: str, law: str) -> dict[str, object]:
    """Runs of a law with unequal gains, with errors of any size."""
    inertia, kp = GROUPS[group]
    moving = {"kind": "rates", "rates": ["0.3*cos(t)"] * len(inertia)}
    tracks = "track" in controllers.get(law).tasks
    return {
        "name": "measured",
        "group": group,
        "inertia": inertia,
        "gains": {"kp": kp, "kd": 0.7},
        **(
            {"reference": moving}
            if tracks
            else {"task": "stabilise", "target": {"pose": "identity"}}
        ),
        "controllers": [law],
        "initial": {"pose": {"kind": "exp_normal", "std": 0.6}, "velocity": "normal"},
        "ensemble": {"runs": 20, "seed": 3},
        "time": {"duration": 5.0, "samples": 51},
        "control": {"period": 0.02},
        "solver": {"engine": "solve_ivp", "rtol": 1e-6, "atol": 1e-6, "cross_check": 0},
    }


FLAGS = (
    "-std=c99 -O2 -ffp-contract=off -fno-math-errno -ffreestanding -Wframe-larger-than=1"
).split()

TARGET = "-target thumb-freestanding-eabihf -mcpu=cortex_m4+vfp4d16sp".split()
"""A Cortex-M4 with hardware floats."""


def measured(name: str, files: Mapping[str, str]) -> tuple[int, int]:
    """Return the bytes of flash and of stack of an exported law."""
    with tempfile.TemporaryDirectory(prefix="eqt-") as folder:
        for file in (f"{name}.h", f"{name}.c"):
            Path(folder, file).write_text(files[file], encoding="utf-8")
        compiler = [sys.executable, "-m", "ziglang", "cc", *TARGET, *FLAGS]
        words = [*compiler, "-c", f"{name}.c", "-o", f"{name}.o"]
        done = subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True)
        return _flash(Path(folder, f"{name}.o").read_bytes()), _stack(done.stderr)


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


def main() -> int:
    """Write the numbers."""
    found = []
    for law in controllers.names():
        if not controllers.get(law).tasks:  # code of a user's own is no formula
            continue
        for group in GROUPS:
            problems = Problems(str)
            controllers.get(law)().check(group_named(group), problems)
            if problems:
                continue
            experiment = build(document_from(configuration(group, law), {}))
            record: dict[str, object] = {"law": experiment.titles[law], "group": group}
            for real, by in ARITHMETICS.items():
                [one] = exported(experiment, [], by).laws
                flash, stack = measured(one.name, files(one))
                record["operations"] = one.program.step.operations
                record[real] = {
                    "flash": flash,
                    "stack": stack,
                    "bound": float(one.torque_bound.max()),
                }
            found.append(record)
            print(record)
    KEPT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
