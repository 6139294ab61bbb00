"""Several processes of this machine; one that dies costs the item that it had in hand.

Processes are spawned, not forked: a fork copies locks that threads of the parent hold. They are not
a pool of the standard library, which gives up all items when one process dies.
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
from eqt_cli.execution.executors.base import (
    MOST_TRIES,
    Executor,
    Outcome,
    Task,
    TaskContext,
)

NONE = -1
"""No item."""

REPORT_EVERY = 0.2
"""s between a worker's reports of progress."""

MOST_PATIENCE = 10.0
"""s that an interruption waits for a thread's next report: a law may be in an endless loop."""


@dataclass(frozen=True)
class Local(Executor):
    """Processes of this machine, each with one BLAS thread."""

    name: ClassVar[str] = "local"

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        workers = [_Worker(task) for _ in range(min(self.workers, len(items)))]
        yield from _done_by(workers, items)

    def share(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        """As `outcomes`, but a thread of this process takes the place of one, and saves its memory.

        An interruption waits for the thread's next report of progress.
        """
        others = min(self.workers, len(items)) - 1
        workers = [_ThreadHere(task), *(_Worker(task) for _ in range(others))]
        yield from _done_by(workers, items)


def _done_by(workers: Sequence[_Worker], items: Sequence[int]) -> Iterator[Outcome]:
    """Hand out items, also again where a worker is lost, and end the workers whatever happens."""
    waiting = deque(items)
    tries = dict.fromkeys(items, 0)
    try:
        while busy := _occupied(workers, waiting):
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
    """The process is gone, with the item that it had in hand."""


def _occupied(workers: Sequence[_Worker], waiting: deque[int]) -> list[_Worker]:
    """Give an item to everyone without one, and return those who have one."""
    for worker in workers:
        if worker.item == NONE and waiting:
            worker.give(waiting.popleft())
    return [worker for worker in workers if worker.item != NONE]


@dataclass
class _Worker:
    """One process, started when it is first given an item, and what it has in hand."""

    task: Task
    item: int = NONE
    process: Any = None
    pipe: Any = None
    reported: float = 0.0

    def give(self, item: int) -> None:
        self.item, self.reported = item, 0.0
        if self.process is None:
            self.start()
        with suppress(OSError):  # if it has died meanwhile, the end of the pipe says so next
            self.pipe.send(item)

    def start(self) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, self.task), daemon=True)
        with interruptions.without_ctrl_c():
            self.process.start()
        theirs.close()

    def answer(self) -> int | None:
        """What it says: how many runs failed, or None where it only reports progress."""
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
            self.process.kill()  # a part that it has not finished does not exist
            self.process.join()
            self.pipe.close()


@dataclass
class _ThreadHere(_Worker):
    """A thread of this process, which gets its items and answers as a process does."""

    def start(self) -> None:
        self.pipe, theirs = get_context("spawn").Pipe()
        self.process = threading.Thread(
            target=copy_context().run, args=(_do_items, theirs, self.task), daemon=True
        )
        self.process.start()

    def end(self) -> None:
        if self.process is not None:
            self.pipe.close()  # its next report of progress finds nobody, and ends its item
            self.process.join(MOST_PATIENCE)


def _serve(pipe: Any, task: Task) -> None:
    """The life of a process."""
    interruptions.of_worker()
    # Python, at its end, ends by this signal the workers that an interruption has left over.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()  # where the system does not
    _do_items(pipe, task)


def _do_items(pipe: Any, task: Task) -> None:
    """Do items until the pipe ends."""
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
    """The error itself where it survives the journey, or one that says the same."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return EqtError(str(error)) if isinstance(error, EqtError) else RuntimeError(repr(error))
    return error


def _end_with_parent() -> None:
    """A worker must not outlive who gave it work, not even if that was killed."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
