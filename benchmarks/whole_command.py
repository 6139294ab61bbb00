"""`eqt run` as a user sees it: a process from start to end, with everything it does by default."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.cases import CONFIGS


@dataclass(frozen=True)
class Command:
    """The fastest of several, after one that fills the caches.

    Attributes
    ----------
    wall
        Of the process, s.
    simulation, writing
        Parts of it, as eqt reports them; the rest is starting up, checking and summing up.
    """

    engine: str
    config: str
    wall: float
    simulation: float
    writing: float


def command(engine: str, config: str, repeats: int) -> Command:
    """Run it `repeats` times and once before."""
    found = [_once(engine, config) for _ in range(repeats + 1)]
    return min(found[1:], key=lambda each: each.wall)


def _once(engine: str, config: str) -> Command:
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["run", str(CONFIGS / f"{config}.yaml"), "--engine", engine, "--out", folder]
        began = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "eqt_cli", *arguments, "--json", "--quiet"],
            capture_output=True,
            text=True,
            check=True,
        )
        wall = time.perf_counter() - began
        assert Path(folder, "results.h5").exists()
    seconds = json.loads(done.stdout)["seconds"]
    return Command(engine, config, wall, seconds["simulation"], seconds["writing"])
