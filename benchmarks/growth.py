"""How time and memory grow with the number of runs, metrics only; each size in its own process."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any

from benchmarks.cases import CONFIGS

SIZES = {
    "taylor": (100, 1_000, 10_000, 100_000),
    "solve_ivp": (100, 1_000),  # linear already; 1e5 runs would take some ten minutes
}


@dataclass(frozen=True)
class Growth:
    """One size.

    Attributes
    ----------
    runs
        Over all controllers.
    wall, cpu
        Of the simulation with all metrics and, by taylor, error estimates, s; the first includes
        compiling.
    peak_memory
        Of the whole process, bytes.
    """

    engine: str
    runs: int
    wall: float
    cpu: float
    peak_memory: int


def growth(engine: str, runs: int) -> Growth:
    """Simulate in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.growth", engine, str(runs)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return Growth(**json.loads(done.stdout))


def _simulated(engine: str, runs: int) -> dict[str, Any]:
    from eqt_cli.experiment.build import build
    from eqt_cli.experiment.run import simulate
    from eqt_cli.experiment.source import read_config

    overrides = [
        f"solver.engine={engine}",
        f"ensemble.runs={runs // 4}",
        "store.trajectories=none",
        "solver.cross_check=0",
    ]
    experiment = build(read_config(CONFIGS / "paper.yaml", overrides))
    wall, cpu = time.perf_counter(), time.process_time()
    simulate(experiment, workers=os.cpu_count() or 1)
    return {
        "engine": engine,
        "runs": runs,
        "wall": time.perf_counter() - wall,
        "cpu": time.process_time() - cpu,
        "peak_memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
    }


if __name__ == "__main__":
    print(json.dumps(_simulated(sys.argv[1], int(sys.argv[2]))))
