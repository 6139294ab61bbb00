"""Locks a result folder for one writer; the lock ends with its process."""

import errno
import json
import os
import platform
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, EqtWarning, Remedy
from eqt_cli.core.files import FILE, check_kind, foreign, refusals
from eqt_cli.core.reporting import reporter
from eqt_cli.execution.provenance import now

LOCK = ".lock"

_BEGINNING = b'{"pid": '
"""First bytes of a lock file; a killed process may have written fewer."""

_MOST_READ = 4096
"""Largest number of bytes read from a lock file."""

_CAREFULLY = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC"))
"""Flags for opening a file without following links or waiting for pipes."""

if sys.platform == "win32":
    import ctypes
    import msvcrt
    from ctypes import wintypes

    _FAIL_AT_ONCE, _EXCLUSIVE = 1, 2

    class _Place(ctypes.Structure):
        """OVERLAPPED structure. The locked byte lies far behind the text, which stays readable."""

        _fields_ = (
            ("Internal", ctypes.c_void_p),
            ("InternalHigh", ctypes.c_void_p),
            ("Offset", wintypes.DWORD),
            ("OffsetHigh", wintypes.DWORD),
            ("hEvent", wintypes.HANDLE),
        )

    _kernel = ctypes.WinDLL("kernel32", use_last_error=True)

    def _flock(handle: int, *, shared: bool) -> None:
        """Lock an open file, or raise at once: `EACCES` if another process holds the lock."""
        file = wintypes.HANDLE(msvcrt.get_osfhandle(handle))
        flags = _FAIL_AT_ONCE | (0 if shared else _EXCLUSIVE)
        place = _Place(OffsetHigh=0x7FFF_FFFF)
        if not _kernel.LockFileEx(file, flags, 0, 1, 0, ctypes.byref(place)):
            raise ctypes.WinError(ctypes.get_last_error())

else:
    import fcntl

    def _flock(handle: int, *, shared: bool) -> None:
        """Lock an open file, or raise at once."""
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)


@contextmanager
def locked(
    folder: Path, *, shared: bool = False, name: str = LOCK, warns: bool = True
) -> Iterator[None]:
    """Lock the folder for this process until the block ends.

    The operating system holds the lock, so that a killed process leaves none behind. If the disk
    does not support locks, the folder is not locked.

    Parameters
    ----------
    shared
        Whether others may also take a shared lock, as the shards of a job array do.
    name
        Name of the locked file.
    warns
        Whether to remark that the disk does not support locks.

    Raises
    ------
    EqtError
        If another process holds the lock, the folder is not writable, or the file is not eqt's.
    """
    path = folder / name
    with refusals(folder, "used", OTHER_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        handle, is_locked = _opened(path, shared)
    try:
        if warns and not is_locked:
            reporter().remark(
                EqtWarning(
                    f"{folder}: its disk does not support file locks, so a second eqt could write "
                    "to it at the same time",
                    Remedy("run one at a time there"),
                    Remedy("choose another disk with {}", "out"),
                )
            )
        if not shared:
            with refusals(folder, "used", OTHER_FOLDER):
                _sign(handle)
        yield
    finally:
        with suppress(OSError):  # the next process reuses a file that remains
            if not shared and os.path.samestat(os.fstat(handle), path.lstat()):
                path.unlink()
        with suppress(OSError):
            os.close(handle)


def _sign(handle: int) -> None:
    """Write into the locked file which process holds it."""
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    own = {"pid": os.getpid(), "host": platform.node(), "since": now()}
    os.write(handle, json.dumps(own).encode())


def _opened(path: Path, shared: bool) -> tuple[int, bool]:
    """Open the file; return its handle, and whether it could be locked.

    This is repeated if the previous owner removed the file before it was locked.
    """
    while True:
        check_kind(path, FILE)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | _CAREFULLY, 0o666)
        try:
            is_locked = _lock(handle, path, shared)
            if os.path.samestat(os.fstat(handle), path.lstat()):
                _check_own(handle, path)
                return handle, is_locked
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _check_own(handle: int, path: Path) -> None:
    """Refuse a file that eqt did not write: one with several hard links or with other content."""
    status = os.fstat(handle)
    if status.st_nlink > 1:
        raise foreign(path, f"a file with {status.st_nlink} hard links", FILE)
    if not _BEGINNING.startswith(_text(handle)[: len(_BEGINNING)]):
        raise foreign(path, "a file with another content", "a lock")


def holder(folder: Path) -> dict[str, Any] | None:
    """Return the process, host and start time of the folder's writer; None if there is none."""
    for path in [folder / LOCK, *folder.glob(f"{LOCK}-*")]:
        try:
            handle = os.open(path, os.O_RDONLY | _CAREFULLY)
        except OSError:
            continue
        try:
            if stat.S_ISREG(os.fstat(handle).st_mode):
                _flock(handle, shared=True)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES):
                return _read(handle) or {}
        finally:
            os.close(handle)
    return None


def _lock(handle: int, path: Path, shared: bool) -> bool:
    """Lock a file; return whether the disk supports it; `EqtError` if another process holds it."""
    try:
        _flock(handle, shared=shared)
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EACCES):
            return False
        other = _read(handle)
        who = f" (process {other['pid']} on {other['host']})" if other else ""
        raise EqtError(
            f"{path.parent}: another eqt{who} is writing to it",
            Remedy("wait for its end"),
            OTHER_FOLDER,
        ) from error
    return True


def _read(handle: int) -> dict[str, Any] | None:
    """Return the content of a lock file; None if it names no process."""
    with suppress(OSError, ValueError):
        content = json.loads(_text(handle))
        return content if isinstance(content, dict) and {"pid", "host"} <= set(content) else None
    return None


def _text(handle: int) -> bytes:
    os.lseek(handle, 0, os.SEEK_SET)
    return os.read(handle, _MOST_READ)
