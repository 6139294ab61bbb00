"""Computes one item after the other in this process."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import ClassVar

from threadpoolctl import threadpool_limits

from eqt_cli.execution.executors.base import ExecutorHere, Outcome, Task, TaskContext


@dataclass(frozen=True)
class Serial(ExecutorHere):
    """In this process, one item at a time. Some engines use several threads for an item."""

    name: ClassVar[str] = "serial"

    def at_once(self, items: int, each: float) -> int:
        """Return 1."""
        return 1

    def threads_for(self, items: int) -> int:
        """Return all workers."""
        return self.workers

    def take(self, task: Task, items: Iterable[int], threads: int) -> Iterator[Outcome]:
        context = TaskContext(threads=threads)
        for item in items:
            with threadpool_limits(1):  # results must not depend on how a library splits a product
                failed = task(item, context)
            yield Outcome(item, failed)
