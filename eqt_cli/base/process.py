"""What a process owes the system: signals, the standard streams, the current folder."""

from __future__ import annotations

import io
import os
import re
import signal
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager, nullcontext, suppress
from pathlib import Path
from types import FrameType
from typing import Any

# Turns requests to stop into exceptions: Ctrl-C, and the signals of clusters and terminals --------


STOP_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Signals of Ctrl-C, of the end of a job's time, and of a closed terminal."""

AGAIN_AFTER = 0.05
"""Delay before a swallowed signal is raised again, s."""

ONE_MOMENT = 0.5
"""Time in which two signals are one request, s: `timeout` signals a process and its group."""


class Interrupted(BaseException):
    """A request to stop this process.

    It is no `KeyboardInterrupt`, because libraries handle that themselves: typer ends the process
    without a message.

    Attributes
    ----------
    exit_code
        The exit code as in shells: 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.exit_code = 128 + number


@contextmanager
def as_exceptions(at_once: Callable[[], None]) -> Iterator[Requests]:
    """Raise `Interrupted` on the first signal; on a later one, end the process immediately.

    A signal that the parent process ignores, as under `nohup`, stays ignored. An exception that is
    swallowed, as by finalisers and callbacks of libraries, is raised again.

    Parameters
    ----------
    at_once
        Called before the process is ended immediately.
    """
    requests, print_ignored = Requests(at_once), sys.unraisablehook

    def print_others(ignored: Any) -> None:
        # Python would print one that a finaliser ignores; it is raised again.
        if not isinstance(ignored.exc_value, Interrupted):
            print_ignored(ignored)

    earlier: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():  # only it may set handlers
        for number in STOP_SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:
                earlier[number] = signal.signal(number, requests.handle)
    sys.unraisablehook = print_others
    try:
        yield requests
    finally:
        sys.unraisablehook = print_ignored
        requests.end()
        for number, before in earlier.items():
            # After an interruption, the rest of the work must not be interrupted again.
            signal.signal(number, before if requests.requested_at is None else signal.SIG_IGN)


class Requests:
    """Handles signals, and raises a swallowed interruption again.

    Attributes
    ----------
    requested_at
        Time of the request to stop, s; None without one, or if its exception was swallowed.
    number
        The signal of the last request; None without one.
    """

    def __init__(self, at_once: Callable[[], None]) -> None:
        self.requested_at: float | None = None
        self.number: int | None = None
        self._at_once = at_once
        self._loss: weakref.finalize[Any, Interrupted] | None = None
        self._again: threading.Timer | None = None

    def handle(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if self.requested_at is None:
            self.requested_at, self.number = now, number
            raise self._interruption(number)
        if now > self.requested_at + ONE_MOMENT:
            self._at_once()
            _end_now(number)

    def _interruption(self, number: int) -> Interrupted:
        """Return the exception; if it is released before `end`, it was swallowed."""
        error = Interrupted(number)  # a variable of `handle` would live on in its traceback
        self._loss = weakref.finalize(error, self._raise_again, number)
        return error

    def _raise_again(self, number: int) -> None:
        self.requested_at = None
        self._again = threading.Timer(AGAIN_AFTER, _signal_main_thread, [number])
        self._again.daemon = True
        self._again.start()

    def end(self) -> None:
        """Raise nothing again from now on."""
        if self._loss:
            self._loss.detach()
        if self._again:
            self._again.cancel()


def _end_now(number: int) -> None:
    """End this process and its child processes immediately."""
    library = sys.modules.get("multiprocessing")  # only loaded if processes were started
    if library:
        for child in library.active_children():
            child.kill()
    os._exit(128 + number)


def _signal_main_thread(number: int) -> None:
    """Send a signal to the main thread; another thread's signal would not end its waits."""
    main_thread = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main_thread is not None:
        signal.pthread_kill(main_thread, number)
    else:  # on Windows
        signal.raise_signal(number)


@contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Block Ctrl-C in the processes that the block starts, until `of_worker` ignores it.

    A starting Python would show a traceback on Ctrl-C; other signals end it without a message.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    from multiprocessing import resource_tracker

    earlier = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGHUP])
    resource_tracker.ensure_running()  # outlives a closed terminal; it unblocks Ctrl-C as it starts
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, earlier)


def of_worker() -> None:
    """Ignore signals, which reach the whole process group, because the parent handles them.

    On Linux, this process is killed when its parent ends, however that ends, also if it has ended
    before this call: what the parent was is told by the parent itself.
    """
    for number in STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    if sys.platform == "linux":
        import ctypes
        from multiprocessing import parent_process

        parent = parent_process()
        assert parent is not None  # of a process that `multiprocessing` has started
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent.pid:  # the parent has ended meanwhile
            os._exit(1)


_PR_SET_PDEATHSIG = 1


# Keeps files in the current folder from being loaded by this process and its child processes ------
#
# The folder may belong to somebody else. Python would search it for the modules of a new process,
# and Matplotlib for its settings, one of which some versions evaluate.


_SAFE_PATH = "PYTHONSAFEPATH"

_is_excluded = False


@contextmanager
def without_current_folder() -> Iterator[None]:
    """Load no module and no setting from the current folder in the block; for commands."""
    global _is_excluded
    earlier, _is_excluded = _is_excluded, True
    is_new = _SAFE_PATH not in os.environ
    os.environ.setdefault(_SAFE_PATH, "1")
    try:
        yield
    finally:
        _is_excluded = earlier
        if is_new:
            os.environ.pop(_SAFE_PATH, None)


@contextmanager
def at_import() -> Iterator[None]:
    """Wrap the import of a library that searches the current folder."""
    must_leave = _is_excluded and has_current_folder()
    with chdir(Path(__file__).parent) if must_leave else nullcontext():
        yield


def has_current_folder() -> bool:
    """Whether the current folder exists; another process may have removed it."""
    try:
        os.getcwd()  # noqa: PTH109  # no path object is needed
    except FileNotFoundError:  # the folder was removed
        return False
    return True


# Safe stdout and stderr: for closed or full streams, and encodings with few characters ------------
#
# Text that stderr cannot take is dropped, since no message is worth the work that it reports on.
# Documents on stdout are: a full disk is an error there.


def make_safe() -> None:
    """Make the streams that this process was started with safe to write to."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            # The null device takes the first free descriptor, that of the closed stream. Else the
            # next file opened would take it, and receive what libraries write there.
            null = os.open(os.devnull, os.O_RDWR)
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, os.fdopen(null, mode, encoding="utf-8", closefd=False))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="replace")
    if sys.stderr is sys.__stderr__ and type(sys.stderr) is io.TextIOWrapper:
        stderr = sys.stderr
        sys.stderr = _Forgiving(stderr.buffer, stderr.encoding, stderr.errors, write_through=True)


def drop_stdout() -> None:
    """Discard the remaining output on stdout, also at the end of the process."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)


class _Forgiving(io.TextIOWrapper):
    """A stream that drops text that the system does not accept."""

    def write(self, text: str) -> int:
        with suppress(OSError):
            super().write(text)
            super().flush()
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            super().flush()


# What another installation may replace -----------------------------------------------------------


def too_old(distribution: str) -> str:
    """Return which packages are older than a distribution requires, and the remedy; else ""."""
    import importlib.metadata as installed

    words, needed = list[str](), list[str]()
    with suppress(installed.PackageNotFoundError):
        for line in installed.requires(distribution) or ():
            name, _, least = line.partition(">=")
            bound = re.match(r"[\d.]+", least)
            if bound is None or "extra ==" in line:
                continue
            version = installed.version(name)
            numbers = [
                [int(x) for x in re.findall(r"\d+", text)[:3]] for text in (version, bound[0])
            ]
            if numbers[0] < numbers[1]:
                words.append(f"{name} {version} is installed, and eqt needs {bound[0]} or newer")
                needed.append(f"'{name}>={bound[0]}'")
    return f"{'; '.join(words)}; install it with pip install {' '.join(needed)}" if words else ""
