"""Being told to stop: Ctrl-C, and what clusters and closed terminals send, are one thing.

The signal becomes an exception at a moment when it can be one: not while a library is loaded or a
process started, of which half would remain. It knows nothing of what is under way.
"""

import os
import signal
import sys
import threading
import time
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

PATIENCE = 5.0
"""s that an end may take; who asks again after them wants it at once."""


class Interrupted(KeyboardInterrupt):
    """Somebody asks this process to stop.

    Attributes
    ----------
    exit_code
        As shells have it: 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.exit_code = 128 + number


def exit_code(error: KeyboardInterrupt) -> int:
    """The exit code that goes with it, whoever raised it."""
    return getattr(error, "exit_code", 128 + signal.SIGINT)


@contextmanager
def as_exceptions(at_once: Callable[[], None]) -> Iterator[None]:
    """Raise `Interrupted` on the first signal; on one much later, end without waiting for anything.

    Between them, what is under way is brought to its end, and further signals change nothing. A
    signal that whoever started us ignores, as `nohup` does, stays ignored.

    Parameters
    ----------
    at_once
        Called before the process is ended by a later signal.
    """
    asked: float | None = None

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if _would_leave_half(frame):
            _raise_again(number)
            return
        if asked is None:
            asked = time.monotonic()
            raise Interrupted(number)
        if time.monotonic() > asked + PATIENCE:
            at_once()
            _end_now(number)

    def forget() -> None:
        nonlocal asked
        asked = None

    earlier: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():  # others cannot say what they want
        for number in ASKED_BY:
            if signal.getsignal(number) != signal.SIG_IGN:
                earlier[number] = signal.signal(number, handle)
    try:
        with _none_is_lost(forget):
            yield
    finally:
        for number, handler in earlier.items():
            # What is left to end after an interruption shall not be interrupted itself.
            signal.signal(number, handler if asked is None else signal.SIG_IGN)


@contextmanager
def _none_is_lost(forget: Callable[[], None]) -> Iterator[None]:
    """Python ignores exceptions in finalisers: raise that of a signal again, as if it were new."""
    earlier = sys.unraisablehook

    def notice(ignored: Any) -> None:
        if isinstance(ignored.exc_value, Interrupted):
            forget()
            _raise_again(ignored.exc_value.exit_code - 128)
        else:
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


def _raise_again(number: int) -> None:
    """The signal once more, when what it must not interrupt may be over."""
    timer = threading.Timer(AGAIN_AFTER, _tell_main_thread, [number])
    timer.daemon = True
    timer.start()


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
