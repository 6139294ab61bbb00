"""Makes stdout and stderr safe to write to: closed, full, or of an encoding with few characters.

What is said on stderr is never worth the work that it tells of: what cannot be written is left out.
Documents on stdout are: a full disk is an error there.
"""

import io
import os
import sys
from contextlib import suppress
from typing import Any, TextIO

_NAMES = ("stdin", "stdout", "stderr")
"""By file descriptor."""


def make_safe() -> None:
    """Do so for this process, whose streams are those that it was started with."""
    for descriptor, name in enumerate(_NAMES):
        if getattr(sys, name) is None:
            _open_null(descriptor, name)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="replace")
    if sys.stderr is sys.__stderr__ and sys.stderr is not None:
        sys.stderr = _forgiving(sys.stderr)


def drop_stdout() -> None:
    """What is left to write on stdout is left out, also at the end of the process."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)


def _open_null(descriptor: int, name: str) -> None:
    """Lead a stream that was closed to nowhere.

    Else the next file that is opened would take its place, and get what libraries write there.
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
    """A stream that loses what the system does not take."""

    def write(self, data: Any) -> int:
        with suppress(OSError):
            return super().write(data) or 0
        return len(data)


def _forgiving(stream: Any) -> TextIO:
    """The same stream, which loses what the system does not take; others stay as they are."""
    buffer = getattr(stream, "buffer", None)
    raw = getattr(buffer, "raw", buffer)  # there is no buffer with PYTHONUNBUFFERED
    if type(raw) is not io.FileIO:  # of tests, or a console of Windows
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
