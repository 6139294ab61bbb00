"""Several items at a time in threads of this process, for engines that compute outside Python."""

import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import ClassVar

from threadpoolctl import threadpool_limits

from eqt_cli.execution.executors.base import Executor, Outcome, Progress, Task, TaskContext


@dataclass(frozen=True)
class Threads(Executor):
    """In threads of this process; where there are fewer items than workers, they share the rest."""

    name: ClassVar[str] = "threads"

    def threads_for(self, items: int) -> int:
        """What is left where there are fewer items than workers."""
        return max(1, self.workers // min(self.workers, max(items, 1)))

    def outcomes(self, task: Task, items: Sequence[int], progress: Progress) -> Iterator[Outcome]:
        if not items:
            return
        lock = threading.Lock()

        def report(amount: float) -> None:
            with lock:
                progress(amount)

        at_once = min(self.workers, len(items))
        context = TaskContext(report, self.threads_for(len(items)))
        with threadpool_limits(1), ThreadPoolExecutor(at_once) as pool:
            futures = {pool.submit(task, item, context): item for item in items}
            try:
                for future in as_completed(futures):
                    yield Outcome(futures.pop(future), future.result())
            finally:
                pool.shutdown(wait=True, cancel_futures=True)
