"""An executor that begins with the last item."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Executor, Outcome, Task, TaskContext


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
