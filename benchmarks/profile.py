"""Where the CPU time of `eqt run paper` goes: a stop-watch around its stages, in one process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from importlib import import_module
from io import StringIO
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.process import AS_INSTALLED, ROOT

START, INTEGRATION, REST = "start-up and imports", "integration", "all else"

COMPILING = "tracing and loading compiled code"

STAGES = {
    "builtins:__import__": START,
    "importlib:import_module": START,
    "eqt_cli.config.document:read_config": "reading the configuration",
    "eqt_cli.config.study:study": "building the experiment",
    "eqt_cli.engines.native:programs": COMPILING,
    "eqt_cli.engines.native:sampled": COMPILING,
    "eqt_cli.engines.native:running": COMPILING,
    "eqt_cli.engines.library:integration": COMPILING,
    "eqt_cli.engines.library:_evaluate": COMPILING,
    "eqt_cli.runs.compute_part:measured": "signals and metrics",
    "eqt_cli.runs.compute_part:write_arrays": "writing the parts",
}
"""What is watched, beside the engines and what eqt times itself."""

ITS_OWN = {
    "simulation": "the rest of the simulation",
    "writing": "packing the result",
    "cross-check": "cross-check",
}
"""The stages by the names under which eqt reports their wall times."""

INTEGRATE = ("cross-check",)
"""Stages that integrate, which counts as theirs."""


@dataclass
class StopWatch:
    """CPU times of stages; a stage that another one begins is not counted for that one.

    Attributes
    ----------
    seconds
        By stage, in the order in which they begin.
    missing
        What should be watched and is not there.
    """

    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    missing: list[str] = field(default_factory=list)
    _running: list[str] = field(default_factory=lambda: [REST])
    _since: float = 0.0

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the block for a stage."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        inner = name == INTEGRATION and self._running[-1] in INTEGRATE
        self._turn()
        self._running.append(self._running[-1] if inner else name)
        try:
            yield
        finally:
            self._turn()
            self._running.pop()

    def _turn(self) -> None:
        """Count for the stage that runs what has passed since the last turn."""
        now = time.process_time()
        self.seconds[self._running[-1]] += now - self._since
        self._since = now

    def watch(self, owner: Any, name: str, stage: str) -> None:
        """Replace a function by one that is counted."""
        function: Callable[..., Any] = getattr(owner, name)

        def timed(*arguments: Any, **options: Any) -> Any:
            with self.stage(stage):
                return function(*arguments, **options)

        setattr(owner, name, timed)

    def watch_engines(self) -> None:
        """Count what all engines do as integration."""
        from eqt_cli.engines.engine import engines

        for kind in engines.all():
            self.watch(kind, "solve", INTEGRATION)

    def watch_stages(self) -> None:
        """Watch all of eqt, of which nothing is imported yet."""
        for place, stage in STAGES.items():
            module, _, path = place.partition(":")
            *owners, name = path.split(".")
            try:
                owner: Any = import_module(module)
                for each in owners:
                    owner = getattr(owner, each)
                self.watch(owner, name, stage)
            except (ImportError, AttributeError):
                self.missing.append(place)
        self.watch_engines()
        from eqt_cli.runs import run_study

        own = run_study.timed

        @contextmanager
        def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
            with self.stage(ITS_OWN.get(name, name)), own(seconds, name):
                yield

        run_study.timed = timed


@dataclass(frozen=True)
class Profile:
    """One engine with its caches warm.

    Attributes
    ----------
    seconds
        CPU time by stage, s.
    missing
        Functions that are no longer where they were watched.
    """

    engine: str
    seconds: dict[str, float]
    missing: list[str]


def profile(engine: str) -> Profile:
    """The second of two processes."""
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.profile", engine, folder]
        environment = os.environ | AS_INSTALLED | {"XDG_CACHE_HOME": f"{folder}/cache"}
        for _ in range(2):
            done = subprocess.run(
                command, stdout=subprocess.PIPE, text=True, check=True, env=environment
            )
    return Profile(engine, **json.loads(done.stdout))


def _run(engine: str, folder: str) -> dict[str, Any]:
    watch = StopWatch()
    watch.watch_stages()
    watch.seconds[START] = watch._since = time.process_time()
    from eqt_cli.cli import main

    options = ["--engine", engine, "--executor", "serial", "--out", f"{folder}/result", "--force"]
    sys.argv = ["eqt", "run", str(ROOT / "configs" / "paper.yaml"), *options, "--quiet"]
    with redirect_stdout(StringIO()):
        try:
            main()
        except SystemExit as end:
            if end.code:
                raise
    watch._turn()
    return {"seconds": dict(watch.seconds), "missing": watch.missing}


if __name__ == "__main__":
    print(json.dumps(_run(*sys.argv[1:])))
