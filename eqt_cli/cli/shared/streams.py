"""Safe stdout and stderr: for closed or full streams, and encodings with few characters.

Text that stderr cannot take is dropped, since no message is worth the work that it reports on.
Documents on stdout are: a full disk is an error there.
"""

import io
import os
import sys
from contextlib import suppress
from typing import Any, TextIO

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
