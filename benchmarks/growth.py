"""How time and memory of `eqt run` grow with the number of runs, metrics only."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass

from benchmarks.cases import CONFIGS

SIZES = {
    "taylor": (100, 1_000, 10_000, 100_000),
    "solve_ivp": (100, 1_000),  # linear by then; 1e5 runs would take some ten minutes
}


@dataclass(frozen=True)
class Growth:
    """One size.

    Attributes
    ----------
    runs
        Over all controllers.
    wall, cpu
        Of the process with its start, all metrics and, by taylor, error estimates, s.
    peak_memory
        Of its largest process, bytes.
    """

    engine: str
    runs: int
    wall: float
    cpu: float
    peak_memory: int


def growth(engine: str, runs: int) -> Growth:
    """Run the paper's experiment with `runs` runs in all."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["run", str(CONFIGS / "paper.yaml"), "--engine", engine, "--out", folder]
        arguments += ["--set", f"ensemble.runs={runs // 4}", "--set", "store.trajectories=none"]
        began = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-m", "eqt_cli", *arguments, "--quiet"], stdout=subprocess.DEVNULL
        )
        _, status, usage = os.wait4(process.pid, 0)  # what subprocess does not tell: memory
        wall = time.perf_counter() - began
    if status:
        raise SystemExit(f"eqt {' '.join(arguments)} failed")
    kilobytes = 1 if sys.platform == "darwin" else 1024
    cpu = usage.ru_utime + usage.ru_stime
    return Growth(engine, runs, wall, cpu, usage.ru_maxrss * kilobytes)
