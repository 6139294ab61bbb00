"""Runs a program with limits, in an empty folder; it ends with this process, however that ends.

A compiler reads text that somebody wrote, and what it makes is code: neither may take all memory,
fill the disk, or go on for ever.
"""

from __future__ import annotations

import errno
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from eqt_cli.core.errors import Remedy, TraceError

WINDOWS = os.name == "nt"
if not WINDOWS:
    import resource


@dataclass(frozen=True)
class Limits:
    """What a program and each that it starts may take.

    Attributes
    ----------
    seconds
        Time by the clock, s, of all together, and of the processor, s, of each.
    memory
        Address space, bytes. The largest traced law took gcc 0.4 GB, and clang of ziglang 1.1 GB.
    file
        Largest file that is written, bytes; also what is written to stdout, and to stderr.
    """

    seconds: float
    memory: int = 4 * 2**30
    file: int = 2**28


_GUARD = """
import ctypes, os, resource, signal, sys
def end(*_):
    os.killpg(0, signal.SIGKILL)
parent, seconds, memory, file = map(int, sys.argv[1:5])
signal.signal(signal.SIGTERM, end)
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGTERM, 0, 0, 0)  # when the parent ends
if os.getppid() != parent:
    end()
for kind, most in (("CPU", seconds), ("AS", memory), ("FSIZE", file), ("CORE", 0)):
    number = getattr(resource, "RLIMIT_" + kind)
    soft, hard = (least if least >= 0 else most for least in resource.getrlimit(number))
    try:
        resource.setrlimit(number, (min(soft, hard, most),) * 2)
    except (OSError, ValueError):
        pass  # macOS has no limit of the address space
try:
    child = os.posix_spawnp(sys.argv[5], sys.argv[5:], os.environ,
                            setsigdef=[signal.SIGPIPE, signal.SIGXFSZ, signal.SIGTERM])
except OSError as error:
    sys.exit("cannot be started: " + error.strerror)
code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
if code < 0:
    signal.signal(-code, signal.SIG_DFL) if -code not in (signal.SIGKILL, signal.SIGSTOP) else None
    os.kill(os.getpid(), -code)
sys.exit(code)
"""
"""The program between this process and the other one. It takes the limits, which the other one and
all that it starts inherit, and ends them all when this process has ended."""


def run(
    command: Sequence[str], given: bytes, limits: Limits, folder: Path | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Run a command without shell or terminal; whatever it has started ends with it.

    Parameters
    ----------
    given
        What it reads from stdin.
    folder
        Its current folder. Default: an empty one.

    Raises
    ------
    OSError
        If it cannot be started.
    subprocess.TimeoutExpired
        If it takes longer; with what it has written so far.
    """
    with (
        temporary_folder() as empty,
        tempfile.TemporaryFile() as stdin,
        tempfile.TemporaryFile() as out,
        tempfile.TemporaryFile() as err,
    ):
        stdin.write(given)
        stdin.seek(0)
        words = list(command)
        if not WINDOWS:
            numbers = os.getpid(), max(1, round(limits.seconds)), limits.memory, limits.file
            words = [sys.executable, "-I", "-S", "-c", _GUARD, *map(str, numbers), *command]
        process = subprocess.Popen(
            words, stdin=stdin, stdout=out, stderr=err, cwd=folder or empty, start_new_session=True
        )
        late = False
        try:
            process.wait(timeout=limits.seconds)
        except subprocess.TimeoutExpired:
            late = True
        finally:
            _end(process)
            process.wait()
        said = []
        for stream in (out, err):
            stream.seek(0)
            said.append(stream.read(limits.file))
    if late:
        raise subprocess.TimeoutExpired(command, limits.seconds, *said)
    return subprocess.CompletedProcess(command, process.returncode, *said)


def no_space(said: bytes, limits: Limits) -> int | None:
    """Return the error number of a full disk or of the user's limit of file size, if it is that."""
    own = -1 if WINDOWS else resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if 0 <= own < limits.file and re.search(rb"File size limit exceeded|File too large", said):
        return errno.EFBIG
    return errno.ENOSPC if b"No space left on device" in said else None


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process, and all others of its group."""
    with suppress(OSError):
        if WINDOWS:
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Make a folder of this user that is removed after the block.

    Raises
    ------
    TraceError
        If there is no place for it.
    """
    try:
        # A loaded library cannot be removed on Windows.
        folder = tempfile.TemporaryDirectory(prefix="eqt-", ignore_cleanup_errors=True)
    except OSError as error:
        raise TraceError(
            f"a law cannot be compiled: there is no folder for temporary files: {error.strerror}",
            Remedy("set the variable TMPDIR to a folder that you can write to"),
        ) from error
    with folder:
        yield Path(folder.name)
