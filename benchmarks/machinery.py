"""What eqt's own machinery costs: its share of an experiment's time, and what workers gain."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.process import ROOT
from benchmarks.profile import INTEGRATION, StopWatch

CONFIG = ROOT / "configs" / "paper.yaml"

MINUTE = 3800
"""Runs per controller that keep one worker busy for about a minute."""


@dataclass(frozen=True)
class Overhead:
    """CPU times of the paper's experiment by solve_ivp in one process, s.

    Attributes
    ----------
    imports
        What comes before: interpreter and libraries.
    total
        From the configuration to the packed result.
    integration
        Within the engines, the estimate of errors and the cross-check included.
    writing
        Of the same arrays by plain h5py, once, to the disk.
    """

    imports: float
    total: float
    integration: float
    writing: float

    @property
    def share(self) -> float:
        """Everything but integration and raw writing, over these two; imports apart."""
        return self.total / (self.integration + self.writing) - 1


@dataclass(frozen=True)
class Scaling:
    """How fast workers compute one experiment, the start of each apart.

    Attributes
    ----------
    seconds
        From the first part of each worker to the last part of all.
    rate
        Runs per second in that time.
    """

    workers: int
    runs: int
    seconds: float
    rate: float


@dataclass
class Machinery:
    """Overhead, the least of several, and the scaling by workers."""

    overhead: Overhead
    scaling: list[Scaling] = field(default_factory=list)


def machinery(repeats: int = 3, workers: Sequence[int] = (1, 2)) -> Machinery:
    """Measure both in processes of their own; the scaling, which takes minutes, once."""
    overheads = [Overhead(**_child("overhead")) for _ in range(repeats)]
    found = Machinery(min(overheads, key=lambda each: each.share))
    for count in workers:
        found.scaling.append(Scaling(**_child("scaling", str(count))))
    return found


def _child(*arguments: str) -> Any:
    command = [sys.executable, "-m", "benchmarks.machinery", *arguments]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    return json.loads(done.stdout)


def _overhead() -> Overhead:
    from eqt_cli.config.document import read_config
    from eqt_cli.config.study import study
    from eqt_cli.runs.run_study import execute

    imports = time.process_time()
    watch = StopWatch()
    watch.watch_engines()
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        outcome = execute(study(read_config(CONFIG)), Path(folder, "out"))
        total = time.process_time() - began
        writing = _raw_writing(outcome.folder.results, Path(folder, "raw.h5"))
    return Overhead(imports, total, watch.seconds[INTEGRATION], writing)


def _raw_writing(results: Path, copy: Path) -> float:
    import h5py

    with h5py.File(results) as file:
        arrays = {name: dataset[()] for name, dataset in file.items()}
    began = time.process_time()
    with h5py.File(copy, "w") as file:
        for name, array in arrays.items():
            file.create_dataset(name, data=array)
    with copy.open("rb") as stream:
        os.fsync(stream.fileno())
    return time.process_time() - began


def _scaling(workers: int) -> Scaling:
    from eqt_cli.config.document import read_config
    from eqt_cli.config.study import study
    from eqt_cli.runs.executors import Executor, Local, Outcome, Task
    from eqt_cli.runs.run_study import execute

    moments: list[float] = []

    class Watched(Local):
        def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
            for outcome in super().outcomes(task, items):
                moments.append(time.perf_counter())
                yield outcome

    executor: Executor = Watched(workers)
    settings = [f"ensemble.runs={MINUTE}", "store.trajectories=none", "solver.cross_check=0"]
    with tempfile.TemporaryDirectory() as folder:
        found = study(read_config(CONFIG, settings))
        execute(found, Path(folder, "out"), executor=executor)
    seconds = moments[-1] - moments[workers - 1]
    runs = found.plan.total * (len(moments) - workers) // len(moments)
    return Scaling(workers, runs, seconds, runs / seconds)


if __name__ == "__main__":
    task, *rest = sys.argv[1:]
    result = _overhead() if task == "overhead" else _scaling(int(rest[0]))
    print(json.dumps(asdict(result)))
