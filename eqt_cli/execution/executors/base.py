"""Base class of executors, which compute numbered items without knowing what they are."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from eqt_cli.core.option_types import Count
from eqt_cli.core.registry import Component
from eqt_cli.core.reporting import reporter

if TYPE_CHECKING:
    from eqt_cli.engines import Engine


MOST_TRIES = 3
"""Number of lost workers after which an item is given up."""


@dataclass(frozen=True)
class TaskContext:
    """Settings for the computation of an item that do not change its result.

    Attributes
    ----------
    progress
        Called with the amount of additional progress. Default: the reporter in force.
    threads
        Largest number of threads to use.
    """

    progress: Callable[[float], None] = field(default_factory=lambda: reporter().advance)
    threads: int = 1


class Task(Protocol):
    """The work on an item; it must be picklable."""

    def __call__(self, item: int, context: TaskContext) -> int:
        """Compute and save one item; return the number of failed runs."""

    def runs_of(self, item: int) -> int:
        """Return the amount of progress of one item."""


@dataclass(frozen=True)
class Outcome:
    """The end of one item; `failed` is None if every worker that tried it was lost."""

    item: int
    failed: int | None


@dataclass(frozen=True)
class Executor(Component):
    """Computes items, in any order.

    Attributes
    ----------
    workers
        Largest number of items at a time.
    """

    workers: Count = 1

    def for_engine(self, engine: Engine) -> Executor:
        """Return the executor with the options set whose defaults depend on the engine."""
        return self

    def at_once(self, items: int, each: float) -> int:
        """Return how many of the items run at a time, if one takes `each` s."""
        return min(self.workers, items)

    def threads_for(self, items: int) -> int:
        """Return the largest number of threads for one of so many items."""
        return 1

    def wall_time(self, items: int, each: float) -> float:
        """Return the wall time of so many items, s, if one takes `each` s."""
        return math.ceil(items / max(self.at_once(items, each), 1)) * each

    @abstractmethod
    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        """Yield the items as they finish; progress goes to `reporter().advance`.

        An exception of the task, or closing the iterator, stops all running items.
        """


class ExecutorHere(Executor):
    """An executor in this process, which takes items one by one."""

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        yield from self.take(task, items, self.threads_for(len(items)))

    @abstractmethod
    def take(self, task: Task, items: Iterable[int], threads: int) -> Iterator[Outcome]:
        """Yield the outcomes of items, each taken when it can begin, with `threads` for each."""
