"""Being told to stop: Ctrl-C, and what clusters and closed terminals send, are one thing.

The signal becomes an exception at a moment when it can be one: not while a library is loaded or a
process started, of which half would remain. It knows nothing of what is under way.
"""

import os
import signal
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

ASKED_BY = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Ctrl-C; the end of a job's time; a terminal that was closed."""

AGAIN_AFTER = 0.05
"""s until a signal is looked at again that came when it could not be an exception."""

ONE_MOMENT = 0.5
"""s in which one request may come twice: `timeout` sends it to a process, and to its group."""

PATIENCE = 5.0
"""s that an end may take; who asks again after them wants it at once."""


class Interrupted(BaseException):
    """Somebody asks this process to stop.

    It is no `KeyboardInterrupt`, to which libraries have answers of their own: typer ends the
    process without a word.

    Attributes
    ----------
    exit_code
        As shells have it: 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.exit_code = 128 + number


@contextmanager
def as_exceptions(at_once: Callable[[], None]) -> Iterator[None]:
    """Raise `Interrupted` on the first signal; on one much later, end without waiting for anything.

    Between them, what is under way is brought to its end. A second signal that is not of the same
    moment gives all signals the system's own action back, so that the next one ends the process
    also where no Python runs, as in a library that computes without end.

    A signal that whoever started us ignores, as `nohup` does, stays ignored. An exception that
    somebody swallows, as finalisers and callbacks of libraries do, is raised again.

    Parameters
    ----------
    at_once
        Called before the process is ended by a later signal.
    """
    handler = _Handler(at_once)
    earlier: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():  # others cannot say what they want
        for number in ASKED_BY:
            if signal.getsignal(number) != signal.SIG_IGN:
                earlier[number] = signal.signal(number, handler.handle)
    try:
        with _not_printed_where_ignored():
            yield
    finally:
        handler.end()
        for number, before in earlier.items():
            # What is left to end after an interruption shall not be interrupted itself.
            signal.signal(number, before if handler.asked is None else signal.SIG_IGN)


class _Handler:
    """Handles signals, and raises an interruption again that somebody swallowed.

    Attributes
    ----------
    asked
        When somebody asked to stop, in s; None if nobody did, or if the exception was swallowed.
    """

    def __init__(self, at_once: Callable[[], None]) -> None:
        self.asked: float | None = None
        self._at_once = at_once
        self._loss: weakref.finalize[Any, Interrupted] | None = None
        self._again: threading.Timer | None = None

    def handle(self, number: int, frame: FrameType | None) -> None:
        if _would_leave_half(frame):
            self._raise_again(number)
        elif self.asked is None:
            self.asked = time.monotonic()
            raise self._interruption(number)
        elif time.monotonic() > self.asked + PATIENCE:
            self._at_once()
            _end_now(number)
        elif time.monotonic() > self.asked + ONE_MOMENT:
            for each in ASKED_BY:
                if signal.getsignal(each) == self.handle:
                    signal.signal(each, signal.SIG_DFL)

    def _interruption(self, number: int) -> Interrupted:
        """The exception; if it is released before `end`, somebody has swallowed it."""
        error = Interrupted(number)
        self._loss = weakref.finalize(error, self._lost, number)
        return error

    def _lost(self, number: int) -> None:
        self.asked = None
        self._raise_again(number)

    def _raise_again(self, number: int) -> None:
        """The signal once more, when what it must not interrupt may be over."""
        if self._again:
            self._again.cancel()
        self._again = threading.Timer(AGAIN_AFTER, _tell_main_thread, [number])
        self._again.daemon = True
        self._again.start()

    def end(self) -> None:
        """Nothing is raised again from here on."""
        if self._loss:
            self._loss.detach()
        if self._again:
            self._again.cancel()


@contextmanager
def _not_printed_where_ignored() -> Iterator[None]:
    """Python prints exceptions that it ignores, as in finalisers; that of a signal comes again."""
    earlier = sys.unraisablehook

    def notice(ignored: Any) -> None:
        if not isinstance(ignored.exc_value, Interrupted):
            earlier(ignored)

    sys.unraisablehook = notice
    try:
        yield
    finally:
        sys.unraisablehook = earlier


def _end_now(number: int) -> None:
    """End this process and those that it has started, and wait for nothing."""
    started = sys.modules.get("multiprocessing")  # loaded by those who start processes
    for child in started.active_children() if started else ():
        child.kill()
    os._exit(128 + number)


def _tell_main_thread(number: int) -> None:
    """Raise a signal there, so that it ends a wait; it would not if another thread received it."""
    main_thread = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main_thread is not None:
        signal.pthread_kill(main_thread, number)
    else:  # on Windows
        signal.raise_signal(number)


def _would_leave_half(frame: FrameType | None) -> bool:
    """Whether a module is being imported, or a process started."""
    while frame is not None:
        file, function = frame.f_code.co_filename, frame.f_code.co_name
        if file.startswith("<frozen importlib"):
            return True
        if function == "start" and file.endswith(_PROCESSES):
            return True
        frame = frame.f_back
    return False


_PROCESSES = str(Path("multiprocessing", "process.py"))


@contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Block Ctrl-C in the processes that are started, until `of_worker` ignores it.

    Python would answer it with a traceback; other signals end a process that starts without a word.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # as it starts, it unblocks the signal
    earlier = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, earlier)


def of_worker() -> None:
    """Leave to the parent what a signal means, which reaches a whole group, and end with it.

    This process is killed when the one that started it ends, however that ends.
    """
    for number in ASKED_BY:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    if sys.platform == "linux":
        import ctypes

        parent = os.getppid()
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:  # it has ended meanwhile
            os._exit(1)


_PR_SET_PDEATHSIG = 1
