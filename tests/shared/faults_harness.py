"""Starts `eqt` as users do, kills it or its workers with SIGKILL, and looks at what is left."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from eqt_cli.base.store_reader import open_results, read_arrays
from eqt_cli.extend import Executor, Outcome, Serial, Task
from eqt_cli.runs.folder import ResultFolder

START = "from eqt_cli.cli import main; main()"
SAVING = f"from eqt_cli.runs import run_study; run_study.UNSAVED_SECONDS = 0; {START}"
"""As a long session, of which a kill finds the files of all finished parts."""
TIMEOUT = 300.0

CONFIG = """
group: SO3
inertia: [[0.824, 0, 0.12], [0, 1.135, 0], [0.12, 0, 1.759]]
gains: {kp: 1.0, kd: 0.5}
reference: {torque: ["cos(t)", "sin(t)", "cos(t)*sin(t)"]}
controllers: [eqt, gt]
initial: {pose: {kind: haar}, velocity: {kind: normal}}
time: {duration: 1.0, samples: 11}
solver: {rtol: 1.0e-6, cross_check: 1, error_estimate: false}
"""
IN_BLOCKS = CONFIG.replace("rtol: 1.0e-6", "rtol: 1.0e-6, block: 10")
# Parts of 50 runs: 8 of them, of some tenths of a second each.
RUN = IN_BLOCKS + "ensemble: {runs: 200, seed: 1}\n"
# As it flies: every run has its own vehicle and noise.
FLIGHT = """
plant:
  inertia: {relative: {uniform: [-0.1, 0.1]}}
  forces: [{kind: gust, std: 0.1, time_constant: 1}]
actuators: [{kind: limit, limit: {uniform: [0.8, 1.2]}}, {kind: lag, time_constant: 0.1}]
control: {period: 0.1, delay: 1}
sensors:
  pose: [{kind: noise, std: 0.01}]
  velocity:
    - {kind: noise, density: 0.01 rad/sqrt(s)}
    - {kind: bias, value: {normal: [0, 0.1]}, walk: 0.01}
"""
FLYING = RUN + FLIGHT
FLYING_NATIVE = FLYING.replace("rtol: 1.0e-6, block: 10", "engine: native, rtol: 1.0e-6")
SWEEP = (
    IN_BLOCKS
    + "ensemble: {runs: 15, seed: 1}\n"
    + "sweep: [{grid: {gains.kp: [0.5, 1, 2], inertia: [[1, 1, 1], [1, 2, 3]]}},"
    + " {sobol: {points: 2, axes: {gains.kd: {low: 0.1, high: 1, scale: log}}}}]\n"
)


# Points that differ in shape, each a group of the file.
RAGGED = SWEEP.replace("gains.kp: [0.5, 1, 2], inertia", "time.samples: [6, 11, 21], inertia")
SWEEP_NATIVE = SWEEP.replace("rtol: 1.0e-6, block: 10", "engine: native, rtol: 1.0e-6")


@dataclass
class Session:
    """One start of `eqt` on a folder."""

    command: str
    config: Path
    out: Path
    options: list[str]
    process: subprocess.Popen[str] = field(init=False)

    def __post_init__(self) -> None:
        folder = [str(self.config), "--out", str(self.out), "--quiet"]
        words = [str(self.out)] if self.command == "pack" else folder
        self.process = subprocess.Popen(
            [sys.executable, "-c", SAVING, self.command, *words, "--json", *self.options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    def wait_for_start(self) -> None:
        """Until it has the folder; what comes before cannot harm anything."""
        deadline = time.monotonic() + TIMEOUT
        while self.running and not self._has_the_folder():
            assert time.monotonic() < deadline
            time.sleep(0.002)

    def _has_the_folder(self) -> bool:
        """Whether it has opened the lock."""
        try:
            open_files = list(Path(f"/proc/{self.process.pid}/fd").iterdir())
        except OSError:  # it ends, or this is no Linux
            return (self.out / "manifest.json").exists()
        for path in open_files:
            try:
                if path.readlink().is_relative_to(self.out):
                    return True
            except OSError:
                continue
        return False

    def workers(self) -> list[int]:
        """The processes that compute for it."""
        return workers_of(self.process.pid)

    def kill(self) -> bool:
        """SIGKILL to the coordinator; False if it had ended by itself."""
        if not self.running:
            return False
        self.process.kill()
        self.process.communicate(timeout=TIMEOUT)
        return self.process.returncode == -signal.SIGKILL

    def finish(self) -> dict[str, object]:
        """Its JSON document, after it has ended well."""
        out, err = self.process.communicate(timeout=TIMEOUT)
        assert self.process.returncode == 0, err
        document: dict[str, object] = json.loads(out)
        return document


@dataclass(frozen=True)
class Losing(Executor):
    """Loses every worker that tries one of some items."""

    lost: Collection[int] = ()

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        good = [item for item in items if item not in self.lost]
        yield from Serial().outcomes(task, good)
        yield from (Outcome(item, None) for item in items if item in self.lost)


def workers_of(pid: int) -> list[int]:
    """The processes that a process has started to compute for it."""
    workers = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            children = path.read_text().split()
        except OSError:
            continue
        for child in children:
            try:
                words = Path(f"/proc/{child}/cmdline").read_text()
            except OSError:
                continue
            if "spawn_main" in words:
                workers.append(int(child))
    return workers


def kill_one(workers: list[int], rng: random.Random) -> bool:
    """SIGKILL to one of these processes; False if there is none."""
    if not workers:
        return False
    try:
        os.kill(rng.choice(workers), signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def parts(out: Path) -> dict[str, tuple[int, int]]:
    """The parts that a folder holds: name, and what tells whether it was written again."""
    states = {}
    for entry in ResultFolder(out).parts.listed().values():
        try:
            state = entry.path.stat()
        except FileNotFoundError:  # packed meanwhile
            continue
        states[entry.path.name] = (state.st_ino, state.st_mtime_ns)
    return states


def check_left_over(out: Path, before: dict[str, tuple[int, int]]) -> None:
    """Every part that was there before the kill is there and every file is readable."""
    folder = ResultFolder(out)
    if folder.results.exists():
        open_results(folder.results).close()
    else:
        now = parts(out)
        assert before.items() <= now.items()
    for entry in folder.parts.listed().values():
        assert read_arrays(entry.path)


def contents(path: Path) -> dict[str, np.ndarray]:
    """Every dataset of a result and of its shapes, read without eqt."""
    datasets = {}
    paths = [path / "results.h5", *path.glob("shapes/*.h5")] if path.is_dir() else [path]
    for source in paths:
        with h5py.File(source) as file:
            of = "" if source.parent.name != "shapes" else f"{source.name}: "
            datasets.update({of + name: item[()] for name, item in file.items()})
    return datasets


def assert_equal(path: Path, expected: dict[str, np.ndarray]) -> None:
    """Every dataset is equal bit for bit."""
    assert_same(contents(path), expected)


def assert_same(actual: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> None:
    assert actual.keys() == expected.keys()
    for name, values in expected.items():
        assert actual[name].dtype == values.dtype, name
        assert actual[name].shape == values.shape, name
        if values.dtype == object:
            np.testing.assert_array_equal(actual[name], values, err_msg=name)
        else:
            assert actual[name].tobytes() == values.tobytes(), name
