"""Wall time, CPU time and peak memory of a command with all the processes that it starts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]

AS_INSTALLED = {"PYTHONDONTWRITEBYTECODE": ""}
"""In the environment of commands: from the second on, their modules are compiled."""

INTERVAL = 0.02
"""s, from one look at the memory to the next."""


@dataclass(frozen=True)
class Spent:
    """What a command took.

    Attributes
    ----------
    wall, cpu
        From start to end, s.
    peak_memory
        Bytes of all its processes at one time; what several share counts for each of them.
    """

    wall: float
    cpu: float
    peak_memory: int


def spent(
    arguments: Sequence[str],
    tree: Path = ROOT,
    environment: dict[str, str] | None = None,
    python: str = sys.executable,
) -> Spent:
    """Run `python` with these arguments in the folder `tree`, whose modules it imports.

    Between this process and the command there is a small one: Linux counts the memory of the
    process that starts another as the other's.

    Raises
    ------
    RuntimeError
        If it fails, with what it says.
    """
    own = AS_INSTALLED | {"PYTHONPATH": str(tree)} | (environment or {})
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "benchmarks.process",
            str(tree),
            json.dumps(own),
            python,
            *arguments,
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"python {' '.join(arguments)} failed:\n{done.stderr}")
    return Spent(**json.loads(done.stdout))


def _watched(tree: str, own: Mapping[str, str], arguments: Sequence[str]) -> Spent:
    began, most = time.perf_counter(), 0
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, cwd=tree, env=os.environ | own)
    while True:
        found, status, usage = os.wait4(process.pid, os.WNOHANG)  # subprocess tells no memory
        if found:
            break
        most = max(most, _memory(process.pid))
        time.sleep(INTERVAL)
    wall = time.perf_counter() - began
    if status:
        raise SystemExit(1)
    largest = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return Spent(wall, usage.ru_utime + usage.ru_stime, max(most, largest))


def _memory(pid: int) -> int:
    """Bytes that a process and its descendants have in memory; 0 where there is no /proc."""
    folder = Path("/proc") / str(pid)
    try:
        pages = int((folder / "statm").read_text().split()[1])
        tasks = [path.read_text().split() for path in folder.glob("task/*/children")]
    except OSError:  # it has ended meanwhile
        return 0
    children = sum(_memory(int(child)) for task in tasks for child in task)
    return pages * os.sysconf("SC_PAGE_SIZE") + children


if __name__ == "__main__":
    tree, own, *arguments = sys.argv[1:]
    print(json.dumps(asdict(_watched(tree, json.loads(own), arguments))))
