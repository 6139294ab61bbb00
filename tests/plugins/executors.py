"""An executor that begins with the last item, and one over another engine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from eqt_cli.extend import Executor, Outcome, Pool, Pooled, Task, TaskContext


@dataclass(frozen=True)
class Backwards(Executor):
    """In this process, from the last item to the first."""

    name: ClassVar[str] = "backwards"

    def at_once(self, items: int, each: float) -> int:
        """One."""
        return 1

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        """The items, the last first."""
        for item in reversed(items):
            yield Outcome(item, task(item, TaskContext(threads=self.threads_for(len(items)))))


@dataclass(frozen=True)
class Elsewhere(Pooled):
    """Over an engine of `concurrent.futures`, as that of MPI."""

    name: ClassVar[str] = "elsewhere"

    @contextmanager
    def started(self, folder: Path) -> Iterator[Pool]:
        """Threads."""
        with ThreadPoolExecutor(self.workers) as engine:
            yield Pool(engine, lost={BrokenExecutor: 3}, room=100)
