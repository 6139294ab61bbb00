"""Executors, which compute numbered items: in this process, in threads, in processes."""

from __future__ import annotations

import math
import os
import pickle
import signal
import sys
import threading
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from contextvars import copy_context
from dataclasses import dataclass, field
from itertools import islice
from multiprocessing import connection, get_context, parent_process
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from threadpoolctl import threadpool_limits

from eqt_cli.base import process
from eqt_cli.base.errors import EqtError
from eqt_cli.base.option_types import Count
from eqt_cli.base.registry import Component, Registry
from eqt_cli.base.reporting import reporter

if TYPE_CHECKING:
    from eqt_cli.engines.engine import Engine

# Base class of executors, which compute numbered items without knowing what they are --------------


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


executors = Registry("executor", "executors", Executor, ("runs.executors",))


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


# Computes items in several processes of this machine. A lost process loses only its current item --
#
# Processes are spawned, not forked, because a fork copies locks that threads of the parent hold.
# The process pool of the standard library is not used, because it gives up all items when one
# process dies.


NONE = -1
"""Marks a worker without an item."""

REPORT_EVERY = 0.2
"""Time between progress reports of a worker, s."""


@dataclass(frozen=True)
class Local(Executor):
    """Processes of this machine, each with one BLAS thread."""

    name: ClassVar[str] = "local"

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        workers = [_Worker(task) for _ in range(min(self.workers, len(items)))]
        waiting, tries = deque(items), dict.fromkeys(items, 0)
        try:
            while busy := _busy(workers, waiting):
                ready = connection.wait([worker.pipe for worker in busy])
                for worker in [worker for worker in busy if worker.pipe in ready]:
                    item = worker.item
                    kind, failed = worker.answer()
                    if kind == "done":
                        yield Outcome(item, int(failed))
                    elif kind == "lost":
                        tries[item] += 1
                        if tries[item] < MOST_TRIES:
                            waiting.appendleft(item)
                        else:
                            yield Outcome(item, None)
        finally:
            for worker in workers:
                worker.end()


def _busy(workers: Sequence[_Worker], waiting: deque[int]) -> list[_Worker]:
    """Give an item to each free worker, and return the busy workers."""
    for worker in workers:
        if worker.item == NONE and waiting:
            worker.give(waiting.popleft())
    return [worker for worker in workers if worker.item != NONE]


@dataclass
class _Worker:
    """A process, started with its first item, and its current item."""

    task: Task
    item: int = NONE
    process: Any = None
    pipe: Any = None
    reported: float = 0.0

    def give(self, item: int) -> None:
        self.item, self.reported = item, 0.0
        if self.process is None:
            self.start()
        with suppress(OSError):  # `answer` finds out if the process has died
            self.pipe.send(item)

    def start(self) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        started = context.Process(target=_serve, args=(theirs, self.task), daemon=True)
        with process.without_ctrl_c():
            started.start()
        self.process = started
        theirs.close()

    def answer(self) -> tuple[str, Any]:
        """Return ``done`` with the number of failed runs, or ``progress``; ``lost`` if it died."""
        try:
            kind, value = self.pipe.recv()
        except (EOFError, OSError):
            self._advance(0.0)
            self.end()
            self.process, self.item = None, NONE
            return "lost", None
        if kind == "error":
            raise value
        if kind == "progress":
            self._advance(self.reported + value)
        else:
            self._advance(self.task.runs_of(self.item))
            self.item = NONE
        return kind, value

    def _advance(self, reached: float) -> None:
        reporter().advance(reached - self.reported)
        self.reported = reached

    def end(self) -> None:
        if self.process is not None:
            self.process.kill()  # an unfinished part leaves no file
            self.process.join()
            self.pipe.close()


def _serve(pipe: Any, task: Task) -> None:
    """Compute items in a worker process, until the pipe is closed, as by the end of the parent."""
    process.of_worker()
    # At exit, Python stops the workers that an interruption left with this signal.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform != "linux":  # which ends it with its parent
        threading.Thread(target=_end_with_parent, daemon=True).start()
    due = pending = 0.0

    def report(amount: float) -> None:
        nonlocal due, pending
        pending += amount
        if time.monotonic() >= due:
            pipe.send(("progress", pending))
            due, pending = time.monotonic() + REPORT_EVERY, 0.0

    with threadpool_limits(1), pipe, suppress(EOFError, OSError):
        while True:
            item = pipe.recv()
            try:
                answer: Any = ("done", task(item, TaskContext(report)))
            except Exception as error:
                answer = ("error", _portable(error))
            pending = 0.0
            pipe.send(answer)


def _end_with_parent() -> None:
    """Exit when the parent process ends, even if it was killed."""
    parent: Any = parent_process()
    connection.wait([parent.sentinel])
    os._exit(1)


def _portable(error: Exception) -> Exception:
    """Return the error if it is picklable, else an error with the same message."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return EqtError(str(error)) if isinstance(error, EqtError) else RuntimeError(repr(error))
    return error


# Starts in this process, and switches to worker processes if much work remains --------------------


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
        return Local(self.workers).at_once(later, each) if later else self._here.at_once(here, each)

    def threads_for(self, items: int) -> int:
        """Return the threads per item before a switch to processes."""
        return self._here.threads_for(items)

    def wall_time(self, items: int, each: float) -> float:
        """Return the wall time: first in this process, then in processes, s."""
        here, later = self._split(items, each)
        return self._here.wall_time(here, each) + Local(self.workers).wall_time(later, each)

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        waiting = deque(items)
        yield from self._here.take(task, self._until_switch(waiting), self.threads_for(len(items)))
        if waiting:
            yield from Local(self.workers).outcomes(task, list(waiting))

    @property
    def _here(self) -> ExecutorHere:
        return Threads(self.workers) if self.threads else Serial()

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
