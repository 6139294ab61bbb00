"""What a process owes the system: signals, the standard streams, the current folder."""

import io
import os
import signal
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager, nullcontext, suppress
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

# Turns requests to stop into exceptions: Ctrl-C, and the signals of clusters and terminals --------
#
# A signal is deferred while a library is loaded, a process is started, pydantic checks a value or
# HDF5 reads a file: the first two must not remain half done, and the others make an error of the
# value, or damage of the file, of any exception.


STOP_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Signals of Ctrl-C, of the end of a job's time, and of a closed terminal."""

AGAIN_AFTER = 0.05
"""Delay before a deferred signal is raised again, s."""

ONE_MOMENT = 0.5
"""Time in which two signals are one request, s: `timeout` signals a process and its group."""

PATIENCE = 5.0
"""Time for an orderly end, s; a later signal ends the process immediately."""


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
def as_exceptions(at_once: Callable[[], None]) -> Iterator[None]:
    """Raise `Interrupted` on the first signal; on a much later one, end the process immediately.

    Until then, the current work can end in order. A second request restores the system's default
    action for all signals. Then the next signal ends the process also where no Python code runs,
    as in a library that computes without end.

    A signal that the parent process ignores, as under `nohup`, stays ignored. An exception that is
    swallowed, as by finalisers and callbacks of libraries, is raised again.

    Parameters
    ----------
    at_once
        Called before a later signal ends the process.
    """
    handler = _Handler(at_once)
    earlier: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():  # only it may set handlers
        for number in STOP_SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:
                earlier[number] = signal.signal(number, handler.handle)
    try:
        with _not_printed_where_ignored():
            yield
    finally:
        handler.end()
        for number, before in earlier.items():
            # After an interruption, the rest of the work must not be interrupted again.
            signal.signal(number, before if handler.requested_at is None else signal.SIG_IGN)


class _Handler:
    """Handles signals, and raises a swallowed interruption again.

    Attributes
    ----------
    requested_at
        Time of the request to stop, s; None without one, or if its exception was swallowed.
    """

    def __init__(self, at_once: Callable[[], None]) -> None:
        self.requested_at: float | None = None
        self._at_once = at_once
        self._loss: weakref.finalize[Any, Interrupted] | None = None
        self._again: threading.Timer | None = None
        self._first_at: float | None = None
        self._sends_again = False

    def handle(self, number: int, frame: FrameType | None) -> None:
        again, self._sends_again, now = self._sends_again, False, time.monotonic()
        deferred = _must_not_interrupt(frame)
        self._first_at = self._first_at or now
        if deferred and (again or now <= self._first_at + PATIENCE):
            self._raise_again(number)
        elif self.requested_at is None and not deferred:
            self.requested_at = now
            raise self._interruption(number)
        elif now > (self.requested_at or self._first_at) + PATIENCE:
            self._at_once()
            _end_now(number)
        elif now > (self.requested_at or now) + ONE_MOMENT:
            for each in STOP_SIGNALS:
                if signal.getsignal(each) == self.handle:
                    signal.signal(each, signal.SIG_DFL)

    def _interruption(self, number: int) -> Interrupted:
        """Return the exception; if it is released before `end`, it was swallowed."""
        error = Interrupted(number)
        self._loss = weakref.finalize(error, self._lost, number)
        return error

    def _lost(self, number: int) -> None:
        self.requested_at = None
        self._raise_again(number)

    def _raise_again(self, number: int) -> None:
        """Send the signal again after a delay."""
        if self._again:
            self._again.cancel()
        self._again = threading.Timer(AGAIN_AFTER, self._send, [number])
        self._again.daemon = True
        self._again.start()

    def _send(self, number: int) -> None:
        self._sends_again = True
        _signal_main_thread(number)

    def end(self) -> None:
        """Raise nothing again from now on."""
        if self._loss:
            self._loss.detach()
        if self._again:
            self._again.cancel()


@contextmanager
def _not_printed_where_ignored() -> Iterator[None]:
    """Do not let Python print an ignored `Interrupted`, as in a finaliser: it is raised again."""
    earlier = sys.unraisablehook

    def hook(ignored: Any) -> None:
        if not isinstance(ignored.exc_value, Interrupted):
            earlier(ignored)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = earlier


def _end_now(number: int) -> None:
    """End this process and its child processes immediately."""
    library = sys.modules.get("multiprocessing")  # only loaded if processes were started
    for child in library.active_children() if library else ():
        child.kill()
    os._exit(128 + number)


def _signal_main_thread(number: int) -> None:
    """Send a signal to the main thread; another thread's signal would not end its waits."""
    main_thread = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main_thread is not None:
        signal.pthread_kill(main_thread, number)
    else:  # on Windows
        signal.raise_signal(number)


def _must_not_interrupt(frame: FrameType | None) -> bool:
    """Whether a module is imported, a process started, a value checked or a result read."""
    while frame is not None:
        file, function = frame.f_code.co_filename, frame.f_code.co_name
        module = str(frame.f_globals.get("__name__"))
        library = module.partition(".")[0]
        if file.startswith("<frozen importlib") or {library, module} & _SWALLOWING:
            return True
        if function == "start" and file.endswith(_PROCESSES):
            return True
        frame = frame.f_back
    return False


_PROCESSES = str(Path("multiprocessing", "process.py"))
_SWALLOWING = {"pydantic", "h5py", "eqt_cli.base.store_reader"}
"""Modules that take an exception for an error of the value or the file at hand."""


@contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Block Ctrl-C in the processes that the block starts, until `of_worker` ignores it.

    A starting Python would show a traceback on Ctrl-C; other signals end it without a message.
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
    """Ignore signals, which reach the whole process group, because the parent handles them.

    On Linux, this process is killed when its parent ends, however that ends.
    """
    for number in STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    if sys.platform == "linux":
        import ctypes

        parent = os.getppid()
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:  # the parent has ended meanwhile
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


_NAMES = ("stdin", "stdout", "stderr")
"""Names of the standard streams, by file descriptor."""


def make_safe() -> None:
    """Make the streams that this process was started with safe to write to."""
    for descriptor, name in enumerate(_NAMES):
        if getattr(sys, name) is None:
            _open_null(descriptor, name)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="replace")
    if sys.stderr is sys.__stderr__ and sys.stderr is not None:
        sys.stderr = _forgiving(sys.stderr)


def drop_stdout() -> None:
    """Discard the remaining output on stdout, also at the end of the process."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)


def _open_null(descriptor: int, name: str) -> None:
    """Open a closed stream on the null device.

    Else the next file opened would take its descriptor, and receive what libraries write there.
    """
    null = os.open(os.devnull, os.O_RDWR)
    if null != descriptor:
        try:
            os.fstat(descriptor)
        except OSError:
            os.dup2(null, descriptor)
            os.close(null)
            null = descriptor
    mode = "r" if name == "stdin" else "w"
    setattr(sys, name, os.fdopen(null, mode, encoding="utf-8", closefd=False))


class _Forgiving(io.FileIO):
    """A stream that drops data that the system does not accept."""

    def write(self, data: Any) -> int:
        with suppress(OSError):
            return super().write(data) or 0
        return len(data)


def _forgiving(stream: Any) -> TextIO:
    """Wrap a file stream so that it drops data not accepted; return others unchanged."""
    buffer = getattr(stream, "buffer", None)
    raw = getattr(buffer, "raw", buffer)  # no buffer with PYTHONUNBUFFERED
    if type(raw) is not io.FileIO:  # in tests, or a Windows console
        return stream
    with suppress(OSError):
        stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(_Forgiving(raw.fileno(), "w", closefd=False)),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=True,
        write_through=True,
    )
