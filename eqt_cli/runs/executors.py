"""Executors, which compute numbered items: in this process, in threads, in processes."""

from __future__ import annotations

import os
import pickle
import sys
import threading
import time
from abc import abstractmethod
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent import futures
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import copy_context
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import chain, islice
from multiprocessing import connection, get_context, parent_process
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.base import process
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.base.option_types import Count
from eqt_cli.base.registry import Component, Registry
from eqt_cli.base.reporting import reporter
from eqt_cli.engines.engine import STOP, Compiled, Engine

# Base class of executors, which compute numbered items without knowing what they are --------------


AS_FAST_IN_THREADS = 2
"""Largest number of threads as fast as that many processes, which take a second to start; measured
on two cores, of compiled code."""

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

    def __call__(self, item: int, context: TaskContext) -> Any:
        """Compute one item, and save it or return it; what is returned must be picklable."""

    def runs_of(self, item: int) -> int:
        """Return the amount of progress of one item."""

    def origin(self) -> Mapping[str, Any]:
        """Return what the last bits of its numbers depend on in this process."""


@dataclass(frozen=True)
class Outcome:
    """The end of one item; `value` is None if every worker that tried it was lost.

    Else it is what the task returned. `origin` says what the last bits depend on in another
    process; empty in this one.
    """

    item: int
    value: Any
    origin: Mapping[str, Any] = field(default_factory=dict, compare=False)


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

    def at_once(self, items: int, seconds: float) -> int:
        """Return how many of the items run at a time, if one takes `seconds`."""
        return min(self.workers, items)

    def threads_for(self, items: int) -> int:
        """Return the largest number of threads for one of so many items."""
        return 1

    def opened(self, folder: Path) -> AbstractContextManager[Executor]:
        """Start what lives for a whole command, with its files in a folder."""
        return nullcontext(self)

    @abstractmethod
    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        """Yield the items as they finish; progress goes to `reporter().advance`.

        An exception of the task, or closing the iterator, stops all running items.
        """


executors = Registry("executor", "executors", Executor, ("runs.executors",))


# Executors over an engine of `concurrent.futures`, such as processes of this machine --------------
#
# What a task raises, it returns; so an exception of a future is the engine's. Of these, only those
# that the engine itself uses for a lost worker mean one.


LOOK_EVERY = 0.2
"""Time between looks at running items, s."""

STOP_WITHIN = 1.5
"""Time in which a stopped process may save the finished runs of its part, s."""

QUIET = 10.0
"""Multiple of the longest time between two ends of items after which silence is remarked on."""

AGAIN = "run the same command again to continue"


@dataclass(frozen=True)
class Pool:
    """An open engine of `concurrent.futures`.

    Attributes
    ----------
    engine
        Takes what `_Work` submits.
    lost
        For each exception of the engine that means a lost worker, the number of these after which
        an item is given up.
    room
        Largest number of items that are submitted at a time.
    check
        Raises if the engine is gone and does not say so.
    reached
        Returns the progress of a running item.
    stop
        Stops running items once it is not 0, `STOP`; None if nothing does but the engine's end.
    notice
        Time in which the engine notices a lost worker, s.
    """

    engine: futures.Executor
    lost: Mapping[Any, int]
    room: int
    check: Callable[[], None] = lambda: None
    reached: Callable[[int], float] = lambda item: 0.0
    stop: Array | None = None
    notice: float = 60.0


@dataclass(frozen=True)
class Pooled(Executor):
    """An executor over an engine of `concurrent.futures`, which runs while it is `opened`."""

    @abstractmethod
    def started(self, folder: Path) -> AbstractContextManager[Pool]:
        """Start the engine, with its files in a folder; at the end, stop it and what it runs."""

    @contextmanager
    def opened(self, folder: Path) -> Iterator[Executor]:
        with self.started(folder) as pool:
            yield _Opened(self.workers, pool)

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        with self.opened(Path()) as opened:
            yield from opened.outcomes(task, items)


@dataclass(frozen=True)
class _Opened(Executor):
    """An executor whose engine runs."""

    pool: Any = None

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        compute = partial(_computed, pickle.dumps(task))
        yield from _Work(self.pool, task, compute).outcomes(items)


_Answer = tuple[Any, Exception | None, Mapping[str, Any]]
"""What a worker returns of an item: the task's value, its error, and the task's origin."""


@dataclass
class _Work:
    """Items at an engine: their progress, and how often each lost its worker."""

    pool: Pool
    task: Task
    compute: Callable[[int], _Answer]
    running: dict[Future[_Answer], int] = field(default_factory=dict)
    again: list[int] = field(default_factory=list)
    advanced: Counter[int] = field(default_factory=Counter)
    tries: Counter[tuple[int, type]] = field(default_factory=Counter)

    def outcomes(self, items: Iterable[int]) -> Iterator[Outcome]:
        try:
            yield from self._outcomes(iter(items))
        finally:
            if self.pool.stop is not None:
                self.pool.stop[:] = 1
                if not futures.wait(self.running, STOP_WITHIN).not_done:
                    self.pool.stop[:] = 0

    def _outcomes(self, waiting: Iterator[int]) -> Iterator[Outcome]:
        last, longest = time.monotonic(), 0.0
        while True:
            for item in islice(chain(self.again, waiting), self.pool.room - len(self.running)):
                self.running[self.pool.engine.submit(self.compute, item)] = item
            self.again = []
            if not self.running:
                return
            self.pool.check()
            done, others = futures.wait(self.running, LOOK_EVERY, futures.FIRST_COMPLETED)
            for future in others:
                item = self.running[future]
                self._advance(item, self.pool.reached(item))
            for future in done:
                if outcome := self._outcome(future, self.running.pop(future)):
                    yield outcome
            silent = time.monotonic() - last
            if done:
                last, longest = last + silent, max(longest, silent)
            elif longest and silent > QUIET * longest + self.pool.notice:
                words = f"no part has ended for {silent:.0f} s, and before one did every"
                hint = f"the workers may be gone: end with Ctrl-C, and {AGAIN}"
                reporter().remark(EqtWarning(f"{words} {longest:.0f} s; {hint}"))
                longest = 0.0

    def _outcome(self, future: Future[_Answer], item: int) -> Outcome | None:
        """Return the outcome of an item; None if it waits again."""
        try:
            value, error, origin = future.result()
        except tuple(self.pool.lost) as loss:
            self._advance(item, 0)
            kind = next(kind for kind in self.pool.lost if isinstance(loss, kind))
            self.tries[item, kind] += 1
            if self.tries[item, kind] == self.pool.lost[kind]:
                return Outcome(item, None)
            self.again.append(item)
            return None
        except Exception as fault:
            words = " ".join(str(fault).split())
            raise EqtError(f"executor: {type(fault).__name__}: {words}; {AGAIN}") from fault
        if error is not None:
            raise error
        self._advance(item, self.task.runs_of(item))
        return Outcome(item, value, origin)

    def _advance(self, item: int, reached: Any) -> None:
        reporter().advance(reached - self.advanced[item])
        self.advanced[item] = reached


@dataclass(frozen=True)
class Threads(Executor):
    """In threads of this process. If there are fewer items than workers, they share the rest."""

    name: ClassVar[str] = "threads"

    def threads_for(self, items: int) -> int:
        """Return the threads for each item: more than one if there are fewer items than workers."""
        return max(1, self.workers // min(self.workers, max(items, 1)))

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        yield from self.take(task, items, self.threads_for(len(items)))

    def take(self, task: Task, items: Iterable[int], threads: int) -> Iterator[Outcome]:
        """Yield the outcomes of items, each taken when it can begin, with `threads` for each."""
        reached, within = defaultdict[int, float](float), copy_context()
        at_once, stop = self.at_once(self.workers, 0.0), np.zeros(1, np.int64)
        within.run(STOP.set, stop)

        def compute(item: int) -> _Answer:
            def advance(amount: float) -> None:
                reached[item] += amount

            try:
                return within.copy().run(task, item, TaskContext(advance, threads)), None, {}
            except Exception as error:
                return 0, error, {}

        # Results must not depend on how a library splits a product.
        with threadpool_limits(1), futures.ThreadPoolExecutor(at_once) as engine:
            pool = Pool(engine, {}, at_once, reached=reached.__getitem__, stop=stop)
            yield from _Work(pool, task, compute).outcomes(items)


@dataclass(frozen=True)
class Serial(Threads):
    """One item at a time, in this process. Some engines use several threads for an item."""

    name: ClassVar[str] = "serial"

    def at_once(self, items: int, seconds: float) -> int:
        """Return 1."""
        return 1

    def threads_for(self, items: int) -> int:
        """Return all workers."""
        return self.workers


_progress: Any = None
"""In a process of `Local`: what it has done of its item, shared with its parent."""


def _computed(payload: bytes, item: int) -> _Answer:
    """Compute an item in a worker."""

    def advance(amount: float) -> None:
        if _progress is not None:
            _progress.value += amount

    try:
        task, origin = _task(payload)
        with threadpool_limits(1):
            return task(item, TaskContext(advance)), None, origin
    except Exception as error:
        return 0, _portable(error), {}


@lru_cache(maxsize=1)
def _task(payload: bytes) -> tuple[Task, Mapping[str, Any]]:
    task: Task = pickle.loads(payload)
    return task, task.origin()


def _portable(error: Exception) -> Exception:
    """Return the error if it is picklable, else an error with the same message."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return EqtError(str(error)) if isinstance(error, EqtError) else RuntimeError(repr(error))
    return error


def _begin(progress: Any, stop: Any) -> None:
    """Begin a process of `Local`, which ends with its parent, even if that was killed."""
    global _progress
    _progress = progress
    STOP.set(np.frombuffer(stop, np.int64))
    process.of_worker()
    if sys.platform != "linux":  # which ends it with its parent
        threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent: Any = parent_process()
    connection.wait([parent.sentinel])
    os._exit(1)


class _Processes(futures.Executor):
    """Pools of one process each, since a pool gives up all items when one process dies.

    Processes are spawned, not forked, because a fork copies locks that threads of the parent hold.
    """

    def __init__(self, workers: int) -> None:
        self.context = get_context("spawn")
        self.progress = [self.context.Value("d", lock=False) for _ in range(workers)]
        self.stop = self.context.Value("q", lock=False)
        self.pools: dict[int, futures.ProcessPoolExecutor] = {}
        self.busy: dict[int, tuple[Future[Any], int]] = {}

    def submit(self, compute: Any, item: Any) -> Future[Any]:  # type: ignore[override]
        for done in [done for done, (future, _) in self.busy.items() if future.done()]:
            future, place = self.busy.pop(done)
            if isinstance(future.exception(), futures.BrokenExecutor):
                del self.pools[place]
        place = min({*range(len(self.progress))} - {place for _, place in self.busy.values()})
        self.progress[place].value = 0.0
        with process.without_ctrl_c():
            try:
                future = self._pool(place).submit(compute, item)
            except futures.BrokenExecutor:  # its process has died without an item
                del self.pools[place]
                future = self._pool(place).submit(compute, item)
        self.busy[item] = future, place
        return future

    def _pool(self, place: int) -> futures.ProcessPoolExecutor:
        if place not in self.pools:
            begin: Any = {"initializer": _begin, "initargs": (self.progress[place], self.stop)}
            self.pools[place] = futures.ProcessPoolExecutor(1, self.context, **begin)
        return self.pools[place]

    def reached(self, item: int) -> float:
        return float(self.progress[self.busy[item][1]].value)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        for pool in self.pools.values():
            for started in [*(pool._processes or {}).values()]:
                started.kill()  # an unfinished part leaves no file
            pool.shutdown(wait, cancel_futures=cancel_futures)


@dataclass(frozen=True)
class Local(Pooled):
    """Processes of this machine, each with one BLAS thread."""

    name: ClassVar[str] = "local"

    @contextmanager
    def started(self, folder: Path) -> Iterator[Pool]:
        with _Processes(self.workers) as engine:
            lost = {futures.BrokenExecutor: MOST_TRIES}
            stop = np.frombuffer(engine.stop, np.int64)
            yield Pool(engine, lost, self.workers, reached=engine.reached, stop=stop, notice=0.0)


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
        compiled = isinstance(engine, Compiled)
        threads = compiled if self.threads is None else self.threads
        as_fast = self.workers <= (AS_FAST_IN_THREADS if compiled else 1)
        return Auto(self.workers, threads, as_fast if self.stays is None else self.stays)

    def at_once(self, items: int, seconds: float) -> int:
        """Return the number of items at a time, after the switch to processes if there is one."""
        here = self._here.at_once(items, seconds)
        later = items - here
        worth = self._worth_starting(later, seconds / max(here, 1))
        return Local(self.workers).at_once(later, seconds) if worth else here

    def threads_for(self, items: int) -> int:
        """Return the threads per item before a switch to processes."""
        return self._here.threads_for(items)

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        waiting = deque(items)
        yield from self._here.take(task, self._until_switch(waiting), self.threads_for(len(items)))
        if waiting:
            yield from Local(self.workers).outcomes(task, list(waiting))

    @property
    def _here(self) -> Threads:
        return Threads(self.workers) if self.threads else Serial()

    def _until_switch(self, waiting: deque[int]) -> Iterator[int]:
        """Yield waiting items, each when the next one can begin, until processes are worthwhile."""
        started, begun = time.monotonic(), 0
        while waiting:
            if self._worth_starting(len(waiting), (time.monotonic() - started) / max(begun, 1)):
                return
            begun += 1
            yield waiting.popleft()

    def _worth_starting(self, left: int, seconds: float) -> bool:
        enough = WORTH_LEAVING_THREADS if self.threads else WORTH_STARTING
        return left > 1 and self.workers > 1 and not self.stays and left * seconds > enough
