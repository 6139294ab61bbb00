"""What an executor is: it has numbered items done somewhere; it must not know what they are."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from eqt_cli.core.component import Component
from eqt_cli.core.option_types import Count
from eqt_cli.core.reporting import reporter

if TYPE_CHECKING:
    from eqt_cli.engines import Engine

Progress = Callable[[float], None]

MOST_TRIES = 3
"""An item whose worker has been lost so often is given up."""


@dataclass(frozen=True)
class TaskContext:
    """How an item is done, which does not change what comes out.

    Attributes
    ----------
    progress
        Told how much more is done; if not given, the reporter of who made this.
    threads
        The most threads to use.
    """

    progress: Progress = field(default_factory=lambda: reporter().advance)
    threads: int = 1


class Task(Protocol):
    """The work; it must survive pickling."""

    def __call__(self, item: int, context: TaskContext) -> int:
        """Do one item, leave its result where it belongs, and say how many runs failed."""

    def runs_of(self, item: int) -> int:
        """The amount of progress that one item is worth."""


@dataclass(frozen=True)
class Outcome:
    """The end of one item; `failed` is None if every worker that tried it was lost."""

    item: int
    failed: int | None


@dataclass(frozen=True)
class Executor(Component):
    """Has items done, in any order.

    Attributes
    ----------
    workers
        The most items at a time.
    """

    workers: Count = 1

    def for_engine(self, engine: Engine) -> Executor:
        """The same, with the options decided that it leaves to the engine."""
        return self

    def at_once(self, items: int, each: float) -> int:
        """How many of so many items it does at a time, where one takes `each` s."""
        return min(self.workers, items)

    def threads_for(self, items: int) -> int:
        """The most threads that one of so many items may use."""
        return 1

    def wall_time(self, items: int, each: float) -> float:
        """How long so many items take, s, where one takes `each` s."""
        return math.ceil(items / max(self.at_once(items, each), 1)) * each

    @abstractmethod
    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        """Yield the items as they end; what is done meanwhile is told to `reporter().advance`.

        An exception of the task, or closing the iterator, ends everything that is under way.
        """
