"""Computes several items at a time in threads, for engines that compute outside Python."""

import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar

from threadpoolctl import threadpool_limits

from eqt_cli.core.reporting import reporter
from eqt_cli.execution.executors.base import ExecutorHere, Outcome, Task, TaskContext


@dataclass(frozen=True)
class Threads(ExecutorHere):
    """In threads of this process. If there are fewer items than workers, they share the rest."""

    name: ClassVar[str] = "threads"

    def threads_for(self, items: int) -> int:
        """Return the threads for each item: more than one if there are fewer items than workers."""
        return max(1, self.workers // min(self.workers, max(items, 1)))

    def take(self, task: Task, items: Iterable[int], threads: int) -> Iterator[Outcome]:
        lock, waiting, here = threading.Lock(), iter(items), reporter()

        def report(amount: float) -> None:
            with lock:
                here.advance(amount)

        def begin(item: int) -> Future[int]:
            return pool.submit(copy_context().run, task, item, context)  # keeps the reporter

        context = TaskContext(report, threads)
        with threadpool_limits(1), ThreadPoolExecutor(self.workers) as pool:
            begun = {begin(item): item for item in islice(waiting, self.workers)}
            try:
                while begun:
                    for future in wait(begun, return_when=FIRST_COMPLETED).done:
                        for item in islice(waiting, 1):
                            begun[begin(item)] = item
                        yield Outcome(begun.pop(future), future.result())
            finally:
                pool.shutdown(wait=True, cancel_futures=True)
