"""How time and memory of `eqt run` grow with the number of runs, metrics only."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

CONFIG = Path(__file__).parents[1] / "configs" / "paper.yaml"

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
    show
        Wall time of `eqt show` on the result, the least of three, s.
    """

    engine: str
    runs: int
    wall: float
    cpu: float
    peak_memory: int
    show: float


def growth(engine: str, runs: int) -> Growth:
    """Run the paper's experiment with `runs` runs in all.

    Between this process and `eqt` there is a small one: Linux counts the memory of the process
    that starts another as the other's.
    """
    command = [sys.executable, "-m", "benchmarks.growth", engine, str(runs)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return Growth(**json.loads(done.stdout))


def _run(engine: str, runs: int) -> Growth:
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["run", str(CONFIG), "--engine", engine, "--out", folder]
        arguments += ["--set", f"ensemble.runs={runs // 4}", "--set", "store.trajectories=none"]
        began = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-m", "eqt_cli", *arguments, "--quiet"], stdout=subprocess.DEVNULL
        )
        _, status, usage = os.wait4(process.pid, 0)  # what subprocess does not tell: memory
        wall = time.perf_counter() - began
        if status:
            raise SystemExit(f"eqt {' '.join(arguments)} failed")
        show = min(_show(folder) for _ in range(3))
    kilobytes = 1 if sys.platform == "darwin" else 1024
    cpu = usage.ru_utime + usage.ru_stime
    return Growth(engine, runs, wall, cpu, usage.ru_maxrss * kilobytes, show)


def _show(folder: str) -> float:
    began = time.perf_counter()
    command = [sys.executable, "-m", "eqt_cli", "show", folder]
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - began


if __name__ == "__main__":
    print(json.dumps(asdict(_run(sys.argv[1], int(sys.argv[2])))))
