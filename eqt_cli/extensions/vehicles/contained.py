"""xacro and MuJoCo in a process of their own, with limits of time and memory.

A small file may ask both for any amount of either, and MuJoCo may crash. The process has no
environment but the arguments of the file. It answers in JSON, which runs nothing.
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import EqtError, printable
from eqt_cli.engines.compiler import WINDOWS, Limits, run_contained
from eqt_cli.extensions.vehicles.elements import MOST_BYTES, shown
from eqt_cli.extensions.vehicles.request import Request

SECONDS = 5
"""Time of the processor, s; the largest of 60 published vehicles takes MuJoCo 0.2 s."""

PATIENCE = 30
"""Multiple of it by the clock, on a busy machine."""

MEMORY = 250 * 2**20
"""Address space beside that of the packages, bytes."""

_IMPORTS = 4 * 2**30
"""Bound of the address space with the packages, which count with their code, bytes."""

_START = "import sys; sys.path.insert(3, sys.argv[1]); from eqt_cli.extensions.vehicles import "
_START += "child; child.main()"

_ROOT = Path(__file__).parents[3]
TITLES = {"xacro": "xacro", "mjcf": "MuJoCo"}

LACKS_MEMORY = 75
"""Exit code of a process that needs more memory."""


def answer(kind: str, request: Request) -> Any:
    """Return what `xacro` or `mjcf` makes of a file: a text of URDF, or the record of a vehicle.

    Raises
    ------
    EqtError
        With what is wrong with the file; or that its process needed too much, or crashed.
    """
    where, title = shown(request.path), TITLES[kind]
    entries = {**asdict(request), "path": str(request.path.absolute())}
    entries["models"] = [str(folder.absolute()) for folder in request.models]
    text = json.dumps({key: value for key, value in entries.items() if key in _ASKED}).encode()
    limits = Limits(PATIENCE * SECONDS, _IMPORTS, 2 * MOST_BYTES)
    words = ["env", "OPENBLAS_NUM_THREADS=1", "MALLOC_ARENA_MAX=1"] if not WINDOWS else []
    words += [sys.executable, "-I", "-c", _START, str(_ROOT), kind]
    try:
        done = run_contained(words, text, limits)
    except subprocess.TimeoutExpired:
        raise EqtError(
            f"{where}: {title} gave no answer within {limits.seconds:.0f} s, perhaps because the "
            "machine is busy; try again"
        ) from None
    if done.returncode == 0 and done.stdout:
        said = json.loads(done.stdout)
        request.take_over(said["left_out"], said["offered"])
        if "error" in said:
            raise EqtError(said["error"])
        return said["answer"]
    raise EqtError(f"{where}: {title} {_ending(done)}; give the vehicle alone, without its scene")


_ASKED = ("path", "bandwidth", "kind", "models", "without", "arg")


def _ending(done: subprocess.CompletedProcess[bytes]) -> str:
    """Say how a process ended without an answer."""
    if -done.returncode == getattr(signal, "SIGXCPU", None):
        return f"needs more than {SECONDS} s of the processor for it"
    if done.returncode == LACKS_MEMORY:
        return f"needs more than {MEMORY // 2**20} MB of memory for it"
    if -done.returncode == getattr(signal, "SIGKILL", None):
        return "was killed while it read it, perhaps for lack of memory"
    with suppress(ValueError):
        return f"crashed on it ({signal.Signals(-done.returncode).name})"
    said = printable(done.stderr.decode("utf-8", "replace").strip()[-200:])
    return f"gave no answer ({said or f'exit code {done.returncode}'})"


def memory_lacks(said: str) -> bool:
    """Whether an error of a library says that there is no memory."""
    words = "allocat|out of memory|unknown exception"  # the last of what C++ throws without memory
    return re.search(words, said, re.IGNORECASE) is not None
