"""Starts `eqt` as users do, kills it or its workers with SIGKILL, and looks at what is left."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from eqt_cli.execution.folder import ResultFolder
from eqt_cli.store.reader import open_results

START = "from eqt_cli.cli import main; main()"
TIMEOUT = 300.0

CONFIG = """
group: SO3
inertia: [[0.824, 0, 0.12], [0, 1.135, 0], [0.12, 0, 1.759]]
gains: {kp: 1.0, kd: 0.5}
reference: {torque: ["cos(t)", "sin(t)", "cos(t)*sin(t)"]}
controllers: [eqt, gt]
initial: {pose: {kind: haar}, velocity: {kind: normal}}
time: {duration: 1.0, samples: 11}
solver: {rtol: 1.0e-6, block: 2, cross_check: 1, error_estimate: false}
"""
# Parts of 50 runs: 8 of them, of some tenths of a second each.
RUN = CONFIG + "ensemble: {runs: 200, seed: 1}\n"
# As it flies: every run has its own vehicle and noise.
FLIGHT = """
plant:
  inertia: {relative: {uniform: [-0.1, 0.1]}}
  forces: [{kind: gust, std: 0.1, time_constant: 1}]
actuators: [{kind: limit, limit: {uniform: [0.8, 1.2]}}, {kind: lag, time_constant: 0.1}]
control: {period: 0.1, delay: 1}
sensors:
  pose: [{kind: noise, std: 0.01}]
  velocity: [{kind: noise, density: 0.01}, {kind: bias, value: {normal: [0, 0.1]}, walk: 0.01}]
"""
FLYING = RUN + FLIGHT
FLYING_COMPILED = FLYING.replace("rtol: 1.0e-6, block: 2", "engine: taylor, rtol: 1.0e-6")
SWEEP = (
    CONFIG
    + "ensemble: {runs: 15, seed: 1}\n"
    + "sweep: [{grid: {gains.kp: [0.5, 1, 2], inertia: [[1, 1, 1], [1, 2, 3]]}},"
    + " {sobol: {points: 2, axes: {gains.kd: {low: 0.1, high: 1, scale: log}}}}]\n"
)


@dataclass
class Session:
    """One start of `eqt` on a folder."""

    command: str
    config: Path
    out: Path
    options: list[str]
    process: subprocess.Popen[str] = field(init=False)

    def __post_init__(self) -> None:
        words = [self.command, str(self.config), "--out", str(self.out), "--json", "--quiet"]
        self.process = subprocess.Popen(
            [sys.executable, "-c", START, *words, *self.options],
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
        while self.running and not (self.out / "manifest.json").exists():
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def workers(self) -> list[int]:
        """The processes that compute for it."""
        found = []
        for path in Path(f"/proc/{self.process.pid}/task").glob("*/children"):
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
                    found.append(int(child))
        return found

    def kill(self) -> bool:
        """SIGKILL to the coordinator; False if it had ended by itself."""
        if not self.running:
            return False
        self.process.kill()
        self.process.communicate(timeout=TIMEOUT)
        return self.process.returncode == -signal.SIGKILL

    def kill_worker(self, rng: random.Random) -> bool:
        """SIGKILL to one of its workers; False if there is none."""
        workers = self.workers()
        if not workers:
            return False
        try:
            os.kill(rng.choice(workers), signal.SIGKILL)
        except ProcessLookupError:
            return False
        return True

    def finish(self) -> dict[str, object]:
        """Its JSON document, after it has ended well."""
        out, err = self.process.communicate(timeout=TIMEOUT)
        assert self.process.returncode == 0, err
        document: dict[str, object] = json.loads(out)
        return document


def parts(out: Path) -> dict[str, tuple[int, int]]:
    """The parts that a folder holds: name, and what tells whether it was written again."""
    found = {}
    for entry in ResultFolder(out).parts.listed().values():
        try:
            state = entry.path.stat()
        except FileNotFoundError:  # packed meanwhile
            continue
        found[entry.path.name] = (state.st_ino, state.st_mtime_ns)
    return found


def check_left_over(out: Path, before: dict[str, tuple[int, int]]) -> None:
    """Every part that was there before the kill is there and every file is readable."""
    folder = ResultFolder(out)
    if folder.results.exists():
        open_results(folder.results).close()
    else:
        now = parts(out)
        assert before.items() <= now.items()
    for entry in folder.parts.listed().values():
        open_results(entry.path).close()


def contents(path: Path) -> dict[str, np.ndarray]:
    """Every dataset of a result file, read without eqt."""
    with h5py.File(path) as file:
        return {name: file[name][()] for name in file}


def assert_equal(path: Path, expected: dict[str, np.ndarray]) -> None:
    """Every dataset is equal bit for bit."""
    found = contents(path)
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        assert found[name].dtype == values.dtype, name
        assert found[name].shape == values.shape, name
        if values.dtype == object:
            np.testing.assert_array_equal(found[name], values, err_msg=name)
        else:
            assert found[name].tobytes() == values.tobytes(), name
