"""Starts in this process, and switches to worker processes if much work remains."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from eqt_cli.execution.executors.base import Executor, ExecutorHere, Outcome, Task
from eqt_cli.execution.executors.serial import Serial
from eqt_cli.execution.executors.threads import Threads

if TYPE_CHECKING:
    from eqt_cli.engines import Engine
    from eqt_cli.execution.executors.local import Local

WORTH_STARTING = 3.0
"""Least remaining work for which processes are started, s; a process takes 1 to 2 s to start."""

WORTH_LEAVING_THREADS = 10.0
"""The same with threads of an engine that computes outside Python, s: they already use the cores,
and lose to processes only what they compute in the one Python interpreter that they share."""


@dataclass(frozen=True)
class Auto(Executor):
    """Starts in this process; switches to workers when much work remains.

    Attributes
    ----------
    threads
        Whether to start in threads. Default: if the engine computes outside Python.
    stays
        Whether to stay in this process. Default: if threads are as fast with the engine.
    """

    name: ClassVar[str] = "auto"
    threads: bool | None = None
    stays: bool | None = None

    def for_engine(self, engine: Engine) -> Auto:
        """Return the executor with the measured defaults for this engine."""
        threads = engine.threads if self.threads is None else self.threads
        as_fast = self.workers <= engine.as_fast_in_threads
        return Auto(self.workers, threads, as_fast if self.stays is None else self.stays)

    def at_once(self, items: int, each: float) -> int:
        """Return the number of items at a time, after the switch to processes if there is one."""
        here, later = self._split(items, each)
        return self._in_processes.at_once(later, each) if later else self._here.at_once(here, each)

    def threads_for(self, items: int) -> int:
        """Return the threads per item before a switch to processes."""
        return self._here.threads_for(items)

    def wall_time(self, items: int, each: float) -> float:
        """Return the wall time: first in this process, then in processes, s."""
        here, later = self._split(items, each)
        return self._here.wall_time(here, each) + self._in_processes.wall_time(later, each)

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        waiting = deque(items)
        threads = self.threads_for(len(items))
        yield from self._here.take(task, self._until_switch(waiting), threads)
        if waiting:
            yield from self._in_processes.share(task, list(waiting))

    @property
    def _here(self) -> ExecutorHere:
        return Threads(self.workers) if self.threads else Serial()

    @property
    def _in_processes(self) -> Local:
        from eqt_cli.execution.executors.local import Local  # most experiments need no processes

        return Local(self.workers)

    def _split(self, items: int, each: float) -> tuple[int, int]:
        """Return how many of the items are done here, and how many in processes."""
        first = self._here.at_once(items, each)
        pace = each / max(first, 1)
        return (first, items - first) if self._worth_starting(items - first, pace) else (items, 0)

    def _until_switch(self, waiting: deque[int]) -> Iterator[int]:
        """Yield waiting items, each when the next one can begin, until processes are worthwhile."""
        started, begun = time.monotonic(), 0
        while waiting:
            if self._worth_starting(len(waiting), (time.monotonic() - started) / max(begun, 1)):
                return
            begun += 1
            yield waiting.popleft()

    def _worth_starting(self, left: int, each: float) -> bool:
        enough = WORTH_LEAVING_THREADS if self.threads else WORTH_STARTING
        return left > 1 and self.workers > 1 and not self.stays and left * each > enough
