"""Computes items in several processes of this machine. A lost process loses only its current item.

Processes are spawned, not forked, because a fork copies locks that threads of the parent hold. The
process pool of the standard library is not used, because it gives up all items when one process
dies.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from contextvars import copy_context
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from typing import Any, ClassVar

from threadpoolctl import threadpool_limits

from eqt_cli.core import interruptions
from eqt_cli.core.errors import EqtError
from eqt_cli.core.reporting import reporter
from eqt_cli.execution.executors.base import MOST_TRIES, Executor, Outcome, Task, TaskContext

NONE = -1
"""Marks a worker without an item."""

REPORT_EVERY = 0.2
"""Time between progress reports of a worker, s."""

MOST_PATIENCE = 10.0
"""Time limit for stopping a thread after an interruption, s: a law may loop endlessly."""


@dataclass(frozen=True)
class Local(Executor):
    """Processes of this machine, each with one BLAS thread."""

    name: ClassVar[str] = "local"

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        workers = [_Worker(task) for _ in range(min(self.workers, len(items)))]
        yield from _outcomes_of(workers, items)

    def share(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        """Yield the same as `outcomes`, with a thread here instead of one process to save memory.

        An interruption waits for the thread's next progress report.
        """
        others = min(self.workers, len(items)) - 1
        workers = [_ThreadHere(task), *(_Worker(task) for _ in range(others))]
        yield from _outcomes_of(workers, items)


def _outcomes_of(workers: Sequence[_Worker], items: Sequence[int]) -> Iterator[Outcome]:
    """Hand out items, again if a worker is lost, and stop all workers at the end."""
    waiting = deque(items)
    tries = dict.fromkeys(items, 0)
    try:
        while busy := _busy(workers, waiting):
            ready = connection.wait([worker.pipe for worker in busy])
            for worker in [worker for worker in busy if worker.pipe in ready]:
                item = worker.item
                try:
                    failed = worker.answer()
                except _Lost:
                    tries[item] += 1
                    if tries[item] < MOST_TRIES:
                        waiting.appendleft(item)
                    else:
                        yield Outcome(item, None)
                else:
                    if failed is not None:
                        yield Outcome(item, failed)
    finally:
        for worker in workers:
            worker.end()


class _Lost(Exception):
    """The process died while it computed an item."""


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
        self.process = context.Process(target=_serve, args=(theirs, self.task), daemon=True)
        with interruptions.without_ctrl_c():
            self.process.start()
        theirs.close()

    def answer(self) -> int | None:
        """Return the number of failed runs of the item, or None after a progress report."""
        try:
            kind, value = self.pipe.recv()
        except (EOFError, OSError):
            self._advance(0.0)
            self.end()
            self.process, self.item = None, NONE
            raise _Lost from None
        if kind == "error":
            raise value
        if kind == "progress":
            self._advance(self.reported + value)
            return None
        self._advance(self.task.runs_of(self.item))
        self.item = NONE
        return int(value)

    def _advance(self, reached: float) -> None:
        reporter().advance(reached - self.reported)
        self.reported = reached

    def end(self) -> None:
        if self.process is not None:
            self.process.kill()  # an unfinished part leaves no file
            self.process.join()
            self.pipe.close()


@dataclass
class _ThreadHere(_Worker):
    """A thread of this process with the interface of a worker process."""

    def start(self) -> None:
        self.pipe, theirs = get_context("spawn").Pipe()
        self.process = threading.Thread(
            target=copy_context().run, args=(_do_items, theirs, self.task), daemon=True
        )
        self.process.start()

    def end(self) -> None:
        if self.process is not None:
            self.pipe.close()  # its next progress report fails and ends its item
            self.process.join(MOST_PATIENCE)


def _serve(pipe: Any, task: Task) -> None:
    """Main function of a worker process."""
    interruptions.of_worker()
    # At exit, Python stops the workers that an interruption left with this signal.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()  # if the system does not do it
    _do_items(pipe, task)


def _do_items(pipe: Any, task: Task) -> None:
    """Compute items until the pipe is closed."""
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


def _portable(error: Exception) -> Exception:
    """Return the error if it is picklable, else an error with the same message."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return EqtError(str(error)) if isinstance(error, EqtError) else RuntimeError(repr(error))
    return error


def _end_with_parent() -> None:
    """Exit when the parent process ends, even if it was killed."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
