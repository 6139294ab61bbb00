"""Begins in this process, and takes more of them where what is left is worth starting them."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.execution.executors.base import Executor, Outcome, Progress, Task
from eqt_cli.execution.executors.local import Local
from eqt_cli.execution.executors.serial import Serial

WORTH_STARTING = 5.0
"""s of work that is left; a process takes a second or two to start."""


@dataclass(frozen=True)
class Auto(Executor):
    """One item after the other in this process; as soon as much is left, as `local`."""

    name: ClassVar[str] = "auto"

    def at_once(self, items: int, each: float) -> int:
        """One, or after the first item as many as `local`."""
        return min(self.workers, items - 1) if self._worth_starting(items - 1, each) else 1

    def wall_time(self, items: int, each: float) -> float:
        """The first item is done before other processes are started."""
        if not self._worth_starting(items - 1, each):
            return items * each
        return each + Local(self.workers).wall_time(items - 1, each)

    def _worth_starting(self, left: int, each: float) -> bool:
        return left > 1 and self.workers > 1 and left * each > WORTH_STARTING

    def outcomes(self, task: Task, items: Sequence[int], progress: Progress) -> Iterator[Outcome]:
        started = time.monotonic()
        for done, item in enumerate(items):
            left = len(items) - done
            if self._worth_starting(left, (time.monotonic() - started) / max(done, 1)):
                yield from Local(self.workers).outcomes(task, items[done:], progress)
                return
            yield from Serial().outcomes(task, [item], progress)
